// Visibility of pixels to a lidar, a port of repro.maps.visibility.

/**
 * Draw the newest step at which each pixel was passed by a beam.
 *
 * @param {object} scans see encodings.js
 * @param {{size_px: number, size_m: number}} grid
 * @param {number} rangeMax maximum range of the lidar [m]
 * @param {number} margin distance behind the end of a beam up to which a pixel counts as visible [m]
 * @param {number} first first step, from 0
 * @param {number} last the step after the last one
 * @returns {Uint16Array} the step, counted from 1 at `first`, 0 for never
 */
export function newestVisible(scans, grid, rangeMax, margin, first, last) {
  const { ranges, angles, poses } = scans, beams = angles.length, size = grid.size_px;
  const resolution = grid.size_m / size, spacing = (angles[beams - 1] - angles[0]) / (beams - 1);
  const image = new Uint16Array(size * size), start = angles[0] - spacing / 2;
  for (let step = first; step < last; step++) {
    const x = poses[3 * step] / resolution - 0.5, y = poses[3 * step + 1] / resolution - 0.5;
    const heading = poses[3 * step + 2];
    const reach = (beam) => Math.min(Math.min(ranges[step * beams + beam], rangeMax) + margin, rangeMax) / resolution;
    for (let beam = 0; beam < beams; ) {
      const radius = reach(beam);
      let end = beam + 1; // adjacent beams of equal reach, such as misses, form one sector
      while (end < beams && reach(end) === radius && (end + 1 - beam) * spacing < Math.PI / 2) end++;
      const from = heading + start + beam * spacing, to = heading + start + end * spacing;
      if (radius >= 0) drawSector(image, size, x, y, from, to, radius, step - first + 1);
      beam = end;
    }
  }
  return image;
}

/** Draw the part of a disc between two bearings [rad], less than half a turn apart, row by row. */
function drawSector(image, size, x, y, start, stop, radius, value) {
  const fromCos = Math.cos(start), fromSin = Math.sin(start), toCos = Math.cos(stop), toSin = Math.sin(stop);
  let lowest = radius * Math.min(0, fromSin, toSin), highest = radius * Math.max(0, fromSin, toSin);
  if (fromCos * toCos <= 0) { // the sector contains a y axis direction
    if (fromSin + toSin > 0) highest = radius; else [lowest, highest] = [-radius, highest];
  }
  const fromSlope = fromCos / (fromSin || 1), toSlope = toCos / (toSin || 1);
  const bottom = Math.max(0, Math.ceil(y + lowest)), top = Math.min(size - 1, Math.floor(y + highest));
  for (let row = bottom; row <= top; row++) {
    const up = row - y, half = Math.sqrt(Math.max(0, radius * radius - up * up));
    let left = x - half, right = x + half;
    // left of or on the ray at `start`
    if (fromSin > 0) right = Math.min(right, x + up * fromSlope);
    else if (fromSin < 0) left = Math.max(left, x + up * fromSlope);
    else if (fromCos * up < 0) continue;
    // right of the ray at `stop`
    if (toSin > 0) left = Math.max(left, Math.floor(x + up * toSlope) + 1);
    else if (toSin < 0) right = Math.min(right, Math.ceil(x + up * toSlope) - 1);
    else if (toCos * up >= 0) continue;
    const begin = Math.max(0, Math.ceil(left)), end = Math.min(size - 1, Math.floor(right));
    if (begin <= end) image.fill(value, (size - 1 - row) * size + begin, (size - 1 - row) * size + end + 1);
  }
}
