// Ray casting with the equations of repro.simulation.raycasting.

/** Return the beam angles of a lidar in the robot's frame [rad], evenly spaced over its field of view. */
export function beamAngles(lidar) {
  const spacing = lidar.angle_range / (lidar.number - 1);
  return Float64Array.from({ length: lidar.number }, (_, i) => -lidar.angle_range / 2 + i * spacing);
}

/**
 * Compute one scan: the nearest crossing of every beam with every outline.
 *
 * @param {{x: number, y: number, heading: number}} pose of the robot [m], [rad]
 * @param {Float64Array} angles beam angles in the robot's frame [rad]
 * @param {{x: number, y: number, radius: number, placed: Float64Array}[]} obstacles with outlines in the world frame
 * @param {number} rangeMax longest range [m]
 * @returns {{ranges: Float64Array, nearest: Int32Array}} ranges [m], Infinity for a miss; obstacle of each hit, or -1
 */
export function scan(pose, angles, obstacles, rangeMax) {
  const ranges = new Float64Array(angles.length).fill(Infinity);
  const nearest = new Int32Array(angles.length).fill(-1);
  for (let beam = 0; beam < angles.length; beam++) {
    const dx = Math.cos(pose.heading + angles[beam]), dy = Math.sin(pose.heading + angles[beam]);
    for (let index = 0; index < obstacles.length; index++) {
      const range = passes(pose, dx, dy, obstacles[index]) ? cross(pose, dx, dy, obstacles[index].placed) : Infinity;
      if (range <= rangeMax && range < ranges[beam]) {
        ranges[beam] = range;
        nearest[beam] = index;
      }
    }
  }
  return { ranges, nearest };
}

/** Return whether a beam passes through the circle around an obstacle, or starts in it. */
function passes(pose, dx, dy, obstacle) {
  const x = obstacle.x - pose.x, y = obstacle.y - pose.y;
  const square = x * x + y * y, along = x * dx + y * dy, radius = obstacle.radius ** 2;
  return square <= radius || (along > 0 && square - along * along <= radius * (1 + 1e-12));
}

/** Return the distance along a beam to an outline [m], Infinity without a crossing. */
function cross(pose, dx, dy, placed) {
  let nearest = Infinity;
  for (let i = 0; i < placed.length; i += 2) {
    const next = (i + 2) % placed.length;
    const edgeX = placed[next] - placed[i], edgeY = placed[next + 1] - placed[i + 1];
    const x = pose.x - placed[i], y = pose.y - placed[i + 1];
    const denominator = edgeY * dx - edgeX * dy;
    const u = (y * dx - x * dy) / denominator;
    const t = (edgeX * y - edgeY * x) / denominator;
    if (u >= 0 && u <= 1 && t > 1e-9 && t < nearest) nearest = t;
  }
  return nearest;
}
