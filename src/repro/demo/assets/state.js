// What the page holds at a moment, and how it changes in time and by the user.

import { themeColors } from "./canvas.js";
import { at } from "./controls.js";
import { append, replaceNewest } from "./window.js";
import { stepWorld, takeScan } from "./world.js";

export const settings = JSON.parse(at("settings").textContent);
export const state = {
  world: null, window: null, selected: null, isPlaying: true, ask: null, colors: themeColors(),
  isAsking: false, isStale: true, isUndrawn: true, hasFailed: false, shown: null, scores: [], behind: 0, last: 0,
};

/** Advance world and window by one step. */
export function step() {
  stepWorld(state.world);
  append(state.window, state.world);
  state.isStale = state.isUndrawn = true;
}

/** Take the scan again after the user changed something, and predict again. */
export function changed() {
  takeScan(state.world);
  replaceNewest(state.window, state.world);
  state.isStale = state.isUndrawn = true;
}

/** Show a message, or none if it is empty; null keeps the present one. */
export function say(message) {
  if (message !== null && !state.hasFailed && at("status").textContent !== message) at("status").textContent = message;
}

/** Show why no network can run; the page makes no further predictions. */
export function fail(error) {
  state.hasFailed = true;
  at("status").className = "error";
  at("status").textContent = `The network cannot run in this browser: ${error.message}.`;
}
