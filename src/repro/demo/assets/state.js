// What the page holds at a moment, and how it changes in time and by the user.

import { at, themeColors } from "./canvas.js";
import { stepWorld, takeScan } from "./world.js";

export const settings = JSON.parse(at("settings").textContent);
export const state = {
  world: null, window: null, isPlaying: true, ask: null, colors: themeColors(),
  isAsking: false, isStale: true, isUndrawn: true, hasFailed: false, shown: null, behind: 0, last: 0,
};

/** Begin a window, the newest scans with their poses from which one map is predicted: misses at the robot's pose. */
export function newWindow() {
  const { world: { angles, robot } } = state, { steps } = settings, poses = new Float32Array(3 * steps);
  for (let step = 0; step < steps; step++) poses.set([robot.x, robot.y, robot.heading], 3 * step);
  state.window = { ranges: new Float32Array(steps * angles.length).fill(Infinity), angles: Float32Array.from(angles), poses };
}

/** Advance world and window by one step. */
export function step() {
  stepWorld(state.world);
  state.window.ranges.copyWithin(0, state.world.angles.length);
  state.window.poses.copyWithin(0, 3);
  replaceNewest();
}

/** Take the scan again after the user changed something, and predict again. */
export function changed() {
  takeScan(state.world);
  replaceNewest();
}

function replaceNewest() {
  const { world: { ranges, robot }, window } = state;
  window.ranges.set(ranges, window.ranges.length - ranges.length);
  window.poses.set([robot.x, robot.y, robot.heading], window.poses.length - 3);
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
