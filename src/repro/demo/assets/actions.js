// What the controls do.

import { at } from "./controls.js";
import { drawMaps } from "./panels.js";
import { changed, emptyWindow, say, settings, state, step } from "./state.js";
import * as worlds from "./world.js";

const DECAY_NOTE = "Without decay, this network gets an input it was not trained with. The paper's ablation trains a second network without decay.";

export const actions = {
  togglePlay() {
    state.isPlaying = !state.isPlaying;
    at("play").textContent = state.isPlaying ? "Pause" : "Play";
    state.isUndrawn = true;
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
    emptyWindow();
    state.behind = 0;
    for (let i = 0; i < settings.steps; i++) step();
    listObstacles(state.world.obstacles[0]);
  },

  add() {
    const added = worlds.addObstacle(state.world);
    say(added ? "" : "There is no room for another obstacle: remove or move one.");
    if (added) listObstacles(added);
    changed();
  },

  remove() {
    if (!state.selected) return;
    worlds.removeObstacle(state.world, state.selected);
    say("");
    listObstacles(state.world.obstacles[0] ?? null);
    changed();
  },

  select(name) {
    state.selected = state.world.obstacles.find((obstacle) => obstacle.name === name) ?? null;
    state.isUndrawn = true;
    at("obstacle").value = state.selected ? String(name) : "";
    at("speed").valueAsNumber = state.selected?.speed ?? 0;
    for (const id of ["obstacle", "speed", "remove"]) at(id).disabled = !state.selected;
    showSpeed();
  },

  selectNext(by) {
    const { obstacles } = state.world, count = obstacles.length;
    if (count) actions.select(obstacles[(obstacles.indexOf(state.selected) + by + count) % count].name);
  },

  setSpeed(speed) {
    state.selected.speed = speed;
    state.isUndrawn = true;
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
  if (name.startsWith("series")) return "hits dark, free blue";
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
