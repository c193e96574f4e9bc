// Encodings of a window of scans as the images of a network, ports of repro.maps.projection and repro.maps.series.
// Scans are {ranges, angles, poses}: Float32Arrays of T * N ranges [m], Infinity for a miss, N beam angles [rad], and
// T * 3 poses x, y [m], heading [rad]. Arithmetic is rounded to 32 bits as in PyTorch, so that pixels agree.

import { newestVisible } from "./visibility.js";

const f32 = Math.fround;

/**
 * Return how an encoding draws and feeds its images.
 *
 * @param {{name: string, parameters: object}} description as in predictor.json
 * @returns {{draw: function, toInput: function}} `draw(scans, grid)` returns gray images, Uint8Array, C * H * W;
 *   `toInput(images)` the Float32Array for the network
 */
export function createEncoding({ name, parameters }) {
  if (name === "projection") {
    return {
      draw: (scans, grid) => projection(scans, grid, parameters.decay, parameters.oldest_gray),
      toInput: (images) => Float32Array.from(images, (gray) => f32(gray / 255)),
    };
  }
  const { frames, range_max_m: rangeMax = null } = parameters;
  if ([`stack${frames}`, `series${frames}`].includes(name)) {
    return { draw: (scans, grid) => series(scans, grid, frames, rangeMax), toInput: inverted };
  }
  throw new Error(`encoding ${name} is unknown`);
}

const inverted = (images) => Float32Array.from(images, (gray) => 1 - f32(gray / 255));

/** Draw the cumulative projection: recent hits are dark, old hits light; without decay, all are black. */
function projection(scans, grid, decay, oldestGray) {
  const steps = scans.poses.length / 3, newest = newestHits(scans, grid, 0, steps);
  const shades = new Uint8Array(steps + 1);
  for (let step = 1; decay && step <= steps; step++) {
    shades[step] = Math.round((255 * oldestGray * (steps - step)) / Math.max(steps - 1, 1));
  }
  shades[0] = 255;
  return Uint8Array.from(newest, (step) => shades[step]);
}

/** Draw the hits of each part of the window, and, up to a range, the pixels observed to be free in each part. */
function series(scans, grid, frames, rangeMax) {
  const pixels = grid.size_px ** 2, kinds = rangeMax === null ? 1 : 2;
  const images = new Uint8Array(kinds * frames * pixels).fill(255);
  const blacken = (drawn, channel) => {
    for (let i = 0; i < pixels; i++) if (drawn[i]) images[channel * pixels + i] = 0;
  };
  equalParts(scans.poses.length / 3, frames).forEach(([first, last], part) => {
    blacken(newestHits(scans, grid, first, last), part);
    const margin = -grid.size_m / grid.size_px / 2;
    if (kinds === 2) blacken(newestVisible(scans, grid, rangeMax, margin, first, last), frames + part);
  });
  return images;
}

/** Divide steps into parts whose lengths differ by one at most, longer parts first: pairs of first and end. */
function equalParts(steps, frames) {
  const short = Math.floor(steps / frames), longer = steps % frames;
  const begin = (part) => part * short + Math.min(part, longer);
  return Array.from({ length: frames }, (_, part) => [begin(part), begin(part + 1)]);
}

/** Return the newest step at which each pixel was hit, counted from 1 at `first`, 0 without a hit. */
function newestHits({ ranges, angles, poses }, grid, first, last) {
  const size = grid.size_px, resolution = f32(grid.size_m / size), beams = angles.length;
  const newest = new Uint16Array(size * size);
  for (let step = first; step < last; step++) {
    for (let beam = 0; beam < beams; beam++) {
      const range = ranges[step * beams + beam];
      if (!Number.isFinite(range)) continue;
      const heading = f32(poses[3 * step + 2] + angles[beam]);
      const x = f32(poses[3 * step] + f32(range * f32(Math.cos(heading))));
      const y = f32(poses[3 * step + 1] + f32(range * f32(Math.sin(heading))));
      const column = Math.floor(f32(x / resolution)), row = size - 1 - Math.floor(f32(y / resolution));
      if (column >= 0 && column < size && row >= 0 && row < size) newest[row * size + column] = step - first + 1;
    }
  }
  return newest;
}
