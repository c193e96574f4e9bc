// The panels of the page, drawn from its state.

import { drawChart } from "./chart.js";
import { at } from "./controls.js";
import { drawMap, errorPixels, inputPixels, mapPixels } from "./map_view.js";
import { settings, state } from "./state.js";
import { between } from "./world.js";
import { drawWorld } from "./world_view.js";

export const CHART_S = 30; // seconds in the chart

/** Draw the world at a fraction of the way from the last step to this one. */
export function showWorld(fraction) {
  const view = { colors: state.colors, selected: state.selected, steps: settings.steps, trail: state.window.poses };
  drawWorld(at("world"), state.world, between(state.world, fraction), view);
  at("clock").textContent = `${(state.world.step * state.world.stepTime).toFixed(1)} s`;
  state.isUndrawn = false;
}

/** Show the scores of the present map and the time it took. */
export function showScores() {
  const { iou, accuracy, ms } = state.shown;
  at("iou").textContent = iou.toFixed(2);
  at("accuracy").textContent = accuracy.toFixed(3);
  at("frame-time").textContent = `${ms.frame.toFixed(0)} ms`;
  at("timing").textContent = `encoding ${ms.encoding.toFixed(1)} ms, network ${ms.network.toFixed(0)} ms, one core`;
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
  const overlay = { outlines: at("outlines").checked ? outlines : [], robot, color: colors.truth };
  drawMap(at("input"), inputPixels(images, grid.size_px, frames), grid, { ...overlay, outlines: [] });
  drawMap(at("prediction"), mapPixels(free), grid, overlay);
  drawMap(at("errors"), errorPixels(classes, colors), grid, { ...overlay, outlines: [] });
  drawChart(at("chart"), state.scores, CHART_S, colors);
}
