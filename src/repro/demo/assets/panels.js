// The panels of the page: the world, and the images of the network input, the prediction and the errors.

import { at, prepare, rgb, trace, useMeters } from "./canvas.js";
import { FALSE, FOUND, FREE, MISSED } from "./maps.js";
import { settings, state } from "./state.js";
import { drawWorld } from "./world_view.js";

const OBSERVED = [11, 110, 153]; // tint of pixels observed to be free in a series of images

/** Draw the world. */
export function showWorld() {
  const view = { colors: state.colors, steps: settings.steps, trail: state.window.poses };
  drawWorld(at("world"), state.world, view);
  at("clock").textContent = `${(state.world.step * state.world.stepTime).toFixed(1)} s`;
  state.isUndrawn = false;
}

/** Show the scores of the present map and the time it took. */
export function showScores() {
  const { iou, accuracy, ms } = state.shown;
  at("iou").textContent = iou.toFixed(2);
  at("accuracy").textContent = accuracy.toFixed(3);
  at("frame-time").textContent = `${ms.toFixed(0)} ms`;
}

/** Draw all panels again, as after a change of their size or colors. */
export function redraw() {
  state.isUndrawn = true;
  drawMaps();
}

/** Draw the input, the prediction and the errors of the present map. */
export function drawMaps() {
  if (!state.shown) return;
  const { images, free, classes, grid, robot, outlines, network } = state.shown, { colors } = state;
  const frames = settings.networks[network].encoding.parameters.frames ?? 1;
  const overlay = { outlines, robot, color: colors.truth };
  drawMap(at("input"), inputPixels(images, grid.size_px, frames), grid, { ...overlay, outlines: [] });
  drawMap(at("prediction"), mapPixels(free), grid, overlay);
  drawMap(at("errors"), errorPixels(classes, colors), grid, { ...overlay, outlines: [] });
}

/**
 * Return the pixels of the network input: the gray image itself, or a series of images drawn as one, in which recent
 * hits are dark and recently observed free pixels are tinted.
 *
 * @param {Uint8Array} images C * H * W
 * @param {number} size H = W
 * @param {number} frames parts of the window in a series, 1 without
 */
function inputPixels(images, size, frames) {
  if (frames === 1) return (i) => [images[i], images[i], images[i]];
  const pixels = size * size, isWithFree = images.length > frames * pixels;
  const newest = (i, first) => {
    for (let part = frames - 1; part >= 0; part--) if (images[(first + part) * pixels + i] === 0) return part;
    return -1;
  };
  return (i) => {
    const hit = newest(i, 0), passed = isWithFree ? newest(i, frames) : -1;
    if (hit >= passed && hit >= 0) return Array(3).fill((204 * (frames - 1 - hit)) / Math.max(frames - 1, 1));
    if (passed < 0) return [255, 255, 255];
    const share = 0.08 + (0.3 * (passed + 1)) / frames;
    return OBSERVED.map((part) => 255 + (part - 255) * share);
  };
}

/** Return the pixels of a predicted map: white is certainly free, black certainly an obstacle. */
function mapPixels(free) {
  return (i) => Array(3).fill(255 * free[i]);
}

/** Return the pixels of the errors. */
function errorPixels(classes, colors) {
  const palette = { [FREE]: rgb(colors.ground), [FOUND]: rgb(colors.found), [MISSED]: rgb(colors.missed), [FALSE]: rgb(colors.false) };
  return (i) => palette[classes[i]];
}

/**
 * Draw an image of a map.
 *
 * @param {HTMLCanvasElement} canvas
 * @param {(i: number) => number[]} pixels red, green and blue of each pixel, row-major
 * @param {{size_px: number, size_m: number}} grid
 * @param {{outlines: Float64Array[], robot: object, color: string}} overlay
 */
function drawMap(canvas, pixels, grid, overlay) {
  const { context, width } = prepare(canvas), size = grid.size_px;
  const image = new ImageData(size, size);
  for (let i = 0; i < size * size; i++) {
    const [red, green, blue] = pixels(i);
    image.data[4 * i] = red; image.data[4 * i + 1] = green; image.data[4 * i + 2] = blue; image.data[4 * i + 3] = 255;
  }
  context.imageSmoothingEnabled = false;
  context.drawImage(asCanvas(canvas, image), 0, 0, width, width);
  const pixel = useMeters(context, width, grid.size_m);
  context.strokeStyle = overlay.color;
  context.lineWidth = 1.2 * pixel;
  for (const outline of overlay.outlines) {
    trace(context, outline);
    context.stroke();
  }
  drawRobot(context, overlay.robot, pixel, overlay.color);
}

const buffers = new WeakMap(); // one off-screen canvas per panel

function asCanvas(canvas, image) {
  if (!buffers.has(canvas)) buffers.set(canvas, document.createElement("canvas"));
  const buffer = buffers.get(canvas);
  [buffer.width, buffer.height] = [image.width, image.height];
  buffer.getContext("2d").putImageData(image, 0, 0);
  return buffer;
}

function drawRobot(context, { x, y, heading }, pixel, color) {
  const tip = 6 * pixel;
  context.beginPath();
  for (const [angle, length] of [[0, 1.5], [2.5, 1], [-2.5, 1]]) {
    context.lineTo(x + length * tip * Math.cos(heading + angle), y + length * tip * Math.sin(heading + angle));
  }
  context.closePath();
  context.fillStyle = color;
  context.fill();
}
