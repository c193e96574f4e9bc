// True maps, and scores of predicted ones, as in repro.maps.ground_truth and repro.metrics.scores; row 0 is the top.

export const FREE = 0, FOUND = 1, MISSED = 2, FALSE = 3; // pixels: free in both, obstacle in both, in truth, predicted

const EPS = 1e-5, THRESHOLD = 0.5; // a pixel at or above the threshold is predicted free

/**
 * Draw the true map: a pixel is an obstacle if its center lies in one.
 *
 * @param {Float64Array[]} outlines convex outlines in the world frame [m]
 * @param {{size_px: number, size_m: number}} grid
 * @returns {Uint8Array} 1 is free, 0 is an obstacle, row-major, H * W
 */
export function rasterize(outlines, grid) {
  const size = grid.size_px, resolution = grid.size_m / size;
  const map = new Uint8Array(size * size).fill(1);
  const firstColumn = (x) => Math.min(Math.max(Math.ceil(x / resolution - 0.5), 0), size);
  for (const outline of outlines) {
    for (let row = 0; row < size; row++) {
      const y = (size - 0.5 - row) * resolution;
      let left = Infinity, right = -Infinity;
      for (let i = 0, j = outline.length - 2; i < outline.length; j = i, i += 2) {
        const x0 = outline[j], y0 = outline[j + 1], x1 = outline[i], y1 = outline[i + 1];
        if (y0 <= y === y1 <= y) continue;
        const crossing = x0 + ((y - y0) * (x1 - x0)) / (y1 - y0);
        left = Math.min(left, crossing);
        right = Math.max(right, crossing);
      }
      if (left <= right) map.fill(0, row * size + firstColumn(left), row * size + Math.max(firstColumn(left), firstColumn(right)));
    }
  }
  return map;
}

/**
 * Compare a predicted map with the true one.
 *
 * @param {Float32Array} probability of free
 * @param {Uint8Array} truth 1 is free
 * @returns {{classes: Uint8Array, iou: number, accuracy: number}} the class of each pixel, obstacle IoU and accuracy
 */
export function compare(probability, truth) {
  const counts = [0, 0, 0, 0], classes = new Uint8Array(truth.length);
  for (let i = 0; i < truth.length; i++) {
    const free = probability[i] >= THRESHOLD;
    classes[i] = truth[i] ? (free ? FREE : FALSE) : free ? MISSED : FOUND;
    counts[classes[i]]++;
  }
  const [free, found, missed, invented] = counts;
  return {
    classes,
    iou: (found + EPS) / (found + missed + invented + EPS),
    accuracy: (free + found + EPS) / (truth.length + EPS),
  };
}
