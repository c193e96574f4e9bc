// What the controls and the pointer do.

import { at } from "./canvas.js";
import { drawMaps } from "./panels.js";
import { changed, newWindow, say, settings, state, step } from "./state.js";
import { addObstacle, dragTo, obstacleAt, removeObstacle, sampleWorld } from "./world.js";

/** Connect buttons, selects and sliders. */
export function connectControls() {
  const clicks = { play: togglePlay, step: stepOnce, "new-world": newWorld, add, remove };
  for (const [id, action] of Object.entries(clicks)) at(id).addEventListener("click", () => action());
  at("experiment").addEventListener("change", () => newWorld());
  at("speed").addEventListener("input", (event) => setSpeed(event.target.valueAsNumber));
  for (const id of ["network", "outlines"]) at(id).addEventListener("change", choose);
  at("controls").addEventListener("submit", (event) => event.preventDefault());
  connectPointer(at("world"));
}

export function togglePlay() {
  state.isPlaying = !state.isPlaying;
  at("play").textContent = state.isPlaying ? "Pause" : "Play";
  state.isUndrawn = true;
}

function stepOnce() {
  if (state.isPlaying) togglePlay();
  step();
}

/** Sample a world and fill the window, so that the first map is that of a whole window. */
export function newWorld(seed = Math.floor(Math.random() * 2 ** 31)) {
  state.world = sampleWorld(settings.spec, at("experiment").value, seed);
  newWindow();
  state.behind = 0;
  for (let i = 0; i < settings.steps; i++) step();
  select(state.world.obstacles[0]);
}

function add() {
  const added = addObstacle(state.world);
  say(added ? "" : "There is no room for another obstacle: remove or move one.");
  if (added) select(added);
  changed();
}

function remove() {
  removeObstacle(state.world, state.selected);
  say("");
  select(state.world.obstacles[0]);
  changed();
}

function select(obstacle) {
  state.selected = obstacle;
  for (const id of ["speed", "remove"]) at(id).disabled = !obstacle;
  at("speed").valueAsNumber = obstacle?.speed ?? 0;
  if (obstacle) setSpeed(obstacle.speed);
}

function setSpeed(speed) {
  state.selected.speed = speed;
  state.isUndrawn = true;
  at("speed-value").textContent = `${speed.toFixed(1)} m/s`;
}

/** Predict with the selected network, and draw with the selected outlines. */
function choose() {
  state.isStale = true;
  drawMaps();
}

/** Let the pointer select and drag obstacles in the world panel. */
function connectPointer(canvas) {
  let dragged = null, offset = [0, 0];
  const meters = (event) => {
    const box = canvas.getBoundingClientRect(), { sizeM } = state.world;
    return [((event.clientX - box.left) / box.width) * sizeM, (1 - (event.clientY - box.top) / box.height) * sizeM];
  };
  canvas.addEventListener("pointerdown", (event) => {
    const [x, y] = meters(event), found = obstacleAt(state.world, x, y);
    if (!found) return;
    dragged = found;
    dragged.isHeld = true;
    offset = [found.x - x, found.y - y];
    canvas.setPointerCapture(event.pointerId);
    select(found);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!dragged) return;
    const [x, y] = meters(event);
    dragTo(state.world, dragged, x + offset[0], y + offset[1]);
    changed();
  });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => {
    if (dragged) dragged.isHeld = false;
    dragged = null;
  });
}
