// What the controls and the pointer do.

import { at } from "./canvas.js";
import { changed, newWindow, settings, state, step } from "./state.js";
import { dragTo, obstacleAt, sampleWorld } from "./world.js";

/** Connect buttons and selects. */
export function connectControls() {
  const clicks = { play: togglePlay, step: stepOnce, "new-world": newWorld };
  for (const [id, action] of Object.entries(clicks)) at(id).addEventListener("click", () => action());
  at("experiment").addEventListener("change", () => newWorld());
  at("network").addEventListener("change", () => { state.isStale = true; });
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
}

/** Let the pointer drag obstacles in the world panel. */
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
