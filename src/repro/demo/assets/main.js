// The page: the loop that steps the world, asks the worker for maps and draws them, and what the controls do.

import { themeColors } from "./canvas.js";
import { drawChart } from "./chart.js";
import { at, connectForm, connectKeys, connectPointer } from "./controls.js";
import { rasterize } from "./grid.js";
import { connect } from "./inference.js";
import { drawMap, errorPixels, inputPixels, mapPixels } from "./map_view.js";
import { compare } from "./scores.js";
import { append, copyOf, emptyWindow, replaceNewest } from "./window.js";
import * as worlds from "./world.js";
import { drawWorld } from "./world_view.js";

const CHART_S = 30, MOST_STEPS_PER_FRAME = 8;
const DECAY_NOTE = "Without decay, this network gets an input it was not trained with. The paper's ablation trains a second network without decay.";
const settings = JSON.parse(at("settings").textContent);
const state = {
  world: null, window: null, selected: null, isPlaying: true, ask: null, colors: themeColors(),
  isAsking: false, isStale: true, shown: null, scores: [], behind: 0, last: 0,
};

/** Load the networks in the worker and start; on failure, show why. */
export async function start(worker, modules) {
  try {
    state.ask = await connect(worker, modules);
    const weights = [...document.querySelectorAll(".weights")].map((element) => element.textContent);
    const { decays } = await state.ask("load", { wasm: at("wasm").textContent, weights, descriptions: settings.networks });
    settings.networks.forEach((network, i) => (network.decays = decays[i]));
    for (const element of document.querySelectorAll("#wasm, .weights")) element.remove(); // the worker has them
  } catch (error) {
    return fail(error);
  }
  const address = new URLSearchParams(location.hash.slice(1));
  if (settings.spec.experiments[address.get("exp")]) at("experiment").value = address.get("exp");
  connectForm(actions);
  connectKeys(at("world"), actions);
  connectPointer(at("world"), () => state.world, actions);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { state.colors = themeColors(); drawMaps(); });
  window.addEventListener("resize", drawMaps);
  actions.newWorld(Number(address.get("seed") ?? Math.floor(Math.random() * 2 ** 31)));
  actions.setNetwork();
  for (const id of ["play", "step", "new-world"]) at(id).disabled = false;
  at("status").textContent = "";
  requestAnimationFrame(frame);
}

function fail(error) {
  at("status").className = "error";
  at("status").textContent = `The network cannot run in this browser: ${error.message}.`;
}

/** Draw one frame of the screen, after the steps that are due. */
function frame(now) {
  const stepMs = state.world.stepTime * 1000, elapsed = Math.min(now - state.last, 250);
  state.last = now;
  state.behind += state.isPlaying ? elapsed * Number(at("rate").value) : 0;
  for (let i = 0; state.behind >= stepMs && i < MOST_STEPS_PER_FRAME; i++, state.behind -= stepMs) step();
  if (state.behind >= stepMs) state.behind = 0;
  const moment = worlds.between(state.world, state.isPlaying ? state.behind / stepMs : 1);
  const view = { colors: state.colors, selected: state.selected, steps: settings.steps, trail: state.window.poses };
  drawWorld(at("world"), state.world, moment, view);
  at("clock").textContent = `${(state.world.step * state.world.stepTime).toFixed(1)} s`;
  if (state.isStale && !state.isAsking) predict();
  requestAnimationFrame(frame);
}

function step() {
  worlds.stepWorld(state.world);
  append(state.window, state.world);
  state.isStale = true;
}

/** Take the scan again after the user changed something, and predict again. */
function changed() {
  worlds.takeScan(state.world);
  replaceNewest(state.window, state.world);
  state.isStale = true;
}

/** Ask for the map of the present moment, and show it with its errors. */
async function predict() {
  const { world } = state, network = Number(at("network").value), { grid } = settings.networks[network];
  const asked = { network, grid, robot: world.robot, outlines: world.obstacles.map(({ placed }) => placed), time: world.step * world.stepTime };
  state.isAsking = true;
  state.isStale = false;
  try {
    const answer = await state.ask("predict", { network, scans: copyOf(state.window), decay: at("decay").checked });
    if (world !== state.world) return;
    const scores = compare(answer.free, rasterize(asked.outlines, grid));
    state.shown = { ...asked, ...answer, ...scores };
    if (state.scores.at(-1)?.time === asked.time) state.scores.pop();
    state.scores = [...state.scores.filter(({ time }) => asked.time - time <= CHART_S), { time: asked.time, value: scores.iou }];
    showScores();
    drawMaps();
  } catch (error) {
    fail(error);
  } finally {
    state.isAsking = false;
  }
}

function showScores() {
  const { iou, accuracy, ms } = state.shown;
  at("iou").textContent = iou.toFixed(2);
  at("accuracy").textContent = accuracy.toFixed(3);
  at("frame-time").textContent = `${ms.frame.toFixed(0)} ms`;
  at("timing").textContent = `encoding ${ms.encoding.toFixed(1)} ms, network ${ms.network.toFixed(0)} ms, one core`;
}

function drawMaps() {
  if (!state.shown) return;
  const { images, free, classes, grid, robot, outlines, network } = state.shown, { colors } = state;
  const frames = settings.networks[network].encoding.parameters.frames ?? 1;
  const overlay = { outlines: at("outlines").checked ? outlines : [], robot, color: colors.truth };
  drawMap(at("input"), inputPixels(images, grid.size_px, frames), grid, { ...overlay, outlines: [] });
  drawMap(at("prediction"), mapPixels(free), grid, overlay);
  drawMap(at("errors"), errorPixels(classes, colors), grid, { ...overlay, outlines: [] });
  drawChart(at("chart"), state.scores, CHART_S, colors);
}

const actions = {
  togglePlay() {
    state.isPlaying = !state.isPlaying;
    at("play").textContent = state.isPlaying ? "Pause" : "Play";
  },

  step() {
    if (state.isPlaying) actions.togglePlay();
    step();
  },

  /** Sample a world and fill the window, so that the first map is that of a whole window. */
  newWorld(seed = Math.floor(Math.random() * 2 ** 31)) {
    state.world = worlds.sampleWorld(settings.spec, at("experiment").value, seed);
    at("motion").value = state.world.motion.name;
    at("direction").value = String(state.world.direction);
    state.window = emptyWindow(state.world, settings.steps);
    state.scores = [];
    state.behind = 0;
    for (let i = 0; i < settings.steps; i++) step();
    listObstacles(state.world.obstacles[0]);
  },

  add() {
    const added = worlds.addObstacle(state.world);
    at("status").textContent = added ? "" : "There is no room for another obstacle: remove or move one.";
    if (added) listObstacles(added);
    changed();
  },

  remove() {
    if (!state.selected) return;
    worlds.removeObstacle(state.world, state.selected);
    at("status").textContent = "";
    listObstacles(state.world.obstacles[0] ?? null);
    changed();
  },

  select(name) {
    state.selected = state.world.obstacles.find((obstacle) => obstacle.name === name) ?? null;
    at("obstacle").value = state.selected ? String(name) : "";
    at("speed").valueAsNumber = state.selected?.speed ?? 0;
    for (const id of ["obstacle", "speed", "remove", "same-speed"]) at(id).disabled = !state.selected;
    showSpeed();
  },

  selectNext(by) {
    const { obstacles } = state.world, count = obstacles.length;
    if (count) actions.select(obstacles[(obstacles.indexOf(state.selected) + by + count) % count].name);
  },

  setSpeed(speed) {
    for (const obstacle of at("same-speed").checked ? state.world.obstacles : [state.selected]) obstacle.speed = speed;
    showSpeed();
  },

  changeSpeed(by) {
    if (!state.selected) return;
    at("speed").valueAsNumber = state.selected.speed + by;
    actions.setSpeed(at("speed").valueAsNumber);
  },

  move(obstacle, x, y) {
    worlds.dragTo(state.world, obstacle, x, y);
    changed();
  },

  nudge([x, y]) {
    if (state.selected) actions.move(state.selected, state.selected.x + x, state.selected.y + y);
  },

  setMotion() {
    const name = at("motion").value, isByHand = name === worlds.BY_HAND;
    worlds.setMotion(state.world, isByHand ? worlds.BY_HAND : settings.spec.motions[name], Number(at("direction").value));
    at("direction").disabled = isByHand;
    changed();
  },

  /** Drive the robot; the first command takes it over from its motion. */
  drive(command) {
    const isMoving = command.some((part) => part !== 0);
    if (isMoving && state.world.motion !== worlds.BY_HAND) {
      at("motion").value = worlds.BY_HAND;
      actions.setMotion();
    }
    state.world.drive = command;
    if (isMoving && !state.isPlaying) actions.togglePlay();
  },

  setNetwork() {
    const network = settings.networks[Number(at("network").value)], { decays } = network;
    at("network-note").textContent = network.note;
    at("decay").disabled = !decays;
    at("input-note").textContent = decays && at("decay").checked ? "recent hits are dark" : inputNote(network);
    at("decay-note").textContent = decays ? DECAY_NOTE : `This network's input, ${network.encoding.name}, has no decay.`;
    state.isStale = true;
    drawMaps();
  },
};

function inputNote({ encoding: { name } }) {
  if (name.startsWith("series")) return "recent hits are dark, observed free is blue";
  return name.startsWith("stack") ? "recent hits are dark" : "all hits are black";
}

function listObstacles(selected) {
  const options = state.world.obstacles.map(({ name, shape }) => new Option(`${name}, ${shape.name === "circle" ? "disc" : "rectangle"}`, name));
  at("obstacle").replaceChildren(...options);
  actions.select(selected?.name);
}

function showSpeed() {
  at("speed-value").textContent = state.selected ? `${state.selected.speed.toFixed(1)} m/s` : "";
}
