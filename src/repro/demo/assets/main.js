// The page: starts the worker, steps the world in time, asks for maps and shows them.

import { at, themeColors } from "./canvas.js";
import { connectControls, newWorld, togglePlay } from "./controls.js";
import { connect } from "./inference.js";
import { compare, rasterize } from "./maps.js";
import { drawMaps, redraw, showScores, showWorld } from "./panels.js";
import { fail, say, settings, state, step } from "./state.js";

const MOST_STEPS_PER_FRAME = 8;
const STOPPED = "Something is in the robot's way: drag it aside.";

/** Load the networks in the worker and start; on failure, show why. */
export async function start(worker, modules) {
  try {
    state.ask = await connect(worker, modules);
    const weights = [...document.querySelectorAll(".weights")].map((element) => element.textContent);
    await state.ask("load", { wasm: at("wasm").textContent, weights, descriptions: settings.networks });
    for (const element of document.querySelectorAll("#wasm, .weights")) element.remove(); // the worker has them
  } catch (error) {
    return fail(error);
  }
  const address = new URLSearchParams(location.hash.slice(1));
  if (settings.spec.experiments[address.get("exp")]) at("experiment").value = address.get("exp");
  connectControls();
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { state.colors = themeColors(); redraw(); });
  window.addEventListener("resize", redraw);
  newWorld(Number(address.get("seed") ?? Math.floor(Math.random() * 2 ** 31)));
  if (address.has("paused") || matchMedia("(prefers-reduced-motion: reduce)").matches) togglePlay();
  for (const id of ["play", "step", "new-world"]) at(id).disabled = false;
  say("");
  requestAnimationFrame(frame);
}

/** Draw one frame of the screen, after the steps that are due. */
function frame(now) {
  const stepMs = state.world.stepTime * 1000, elapsed = Math.min(now - state.last, 250);
  state.last = now;
  state.behind += state.isPlaying ? elapsed : 0;
  for (let i = 0; state.behind >= stepMs && i < MOST_STEPS_PER_FRAME; i++, state.behind -= stepMs) step();
  if (state.behind >= stepMs) state.behind = 0;
  if (state.isPlaying || state.isUndrawn) showWorld();
  if (state.isStale && !state.isAsking && !state.hasFailed) predict();
  say(state.world.isStopped ? STOPPED : at("status").textContent === STOPPED ? "" : null);
  requestAnimationFrame(frame);
}

/** Ask for the map of the present moment, and show it with its errors. */
async function predict() {
  const { world } = state, network = Number(at("network").value), { grid } = settings.networks[network];
  const asked = { network, grid, robot: world.robot, outlines: world.obstacles.map(({ placed }) => placed) };
  state.isAsking = true;
  state.isStale = false;
  try {
    const answer = await state.ask("predict", { network, scans: state.window });
    if (world !== state.world) return;
    state.shown = { ...asked, ...answer, ...compare(answer.free, rasterize(asked.outlines, grid)) };
    showScores();
    drawMaps();
  } catch (error) {
    fail(error);
  } finally {
    state.isAsking = false;
  }
}
