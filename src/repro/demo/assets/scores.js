// Scores of a predicted map, as in repro.metrics.scores.

export const FREE = 0, FOUND = 1, MISSED = 2, FALSE = 3; // pixels: free in both, obstacle in both, in truth, predicted

const EPS = 1e-5, THRESHOLD = 0.5; // a pixel at or above the threshold is predicted free

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
