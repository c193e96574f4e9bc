// The controls: buttons, keys and pointer, each of which calls one action of the page.

import { obstacleAt } from "./world.js";

export const at = (id) => document.getElementById(id);

const DRIVES = { i: [1, 0], k: [-1, 0], j: [0, 1], l: [0, -1] }; // forward, backward, left, right
const ARROWS = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] }; // [m]

/** Connect buttons, selects and sliders with the actions of main.js. */
export function connectForm(actions) {
  const clicks = { play: actions.togglePlay, step: actions.step, "new-world": actions.newWorld, add: actions.add, remove: actions.remove };
  for (const [id, action] of Object.entries(clicks)) at(id).addEventListener("click", () => action());
  at("experiment").addEventListener("change", () => actions.newWorld());
  at("obstacle").addEventListener("change", (event) => actions.select(Number(event.target.value)));
  at("speed").addEventListener("input", (event) => actions.setSpeed(event.target.valueAsNumber));
  for (const id of ["motion", "direction"]) at(id).addEventListener("change", () => actions.setMotion());
  for (const id of ["network", "decay", "outlines"]) at(id).addEventListener("change", () => actions.setNetwork());
  at("controls").addEventListener("submit", (event) => event.preventDefault());
  for (const button of document.querySelectorAll("[data-drive]")) {
    const command = button.dataset.drive.split(",").map(Number);
    button.addEventListener("pointerdown", (event) => {
      button.setPointerCapture(event.pointerId);
      actions.drive(command);
    });
    for (const name of ["pointerup", "pointercancel", "blur"]) button.addEventListener(name, () => actions.drive([0, 0]));
    button.addEventListener("keydown", (event) => [" ", "Enter"].includes(event.key) && actions.drive(command));
    button.addEventListener("keyup", () => actions.drive([0, 0]));
  }
}

/** Connect the keys of the world panel. */
export function connectKeys(canvas, actions) {
  const keys = {
    " ": actions.togglePlay, s: actions.step, n: actions.newWorld, a: actions.add, Delete: actions.remove, Backspace: actions.remove,
    "]": () => actions.selectNext(1), "[": () => actions.selectNext(-1),
    "+": () => actions.changeSpeed(0.1), "=": () => actions.changeSpeed(0.1), "-": () => actions.changeSpeed(-0.1),
  };
  const pressed = new Set();
  const drive = () => {
    const commands = [...pressed].map((key) => DRIVES[key]);
    actions.drive([0, 1].map((axis) => Math.sign(commands.reduce((sum, command) => sum + command[axis], 0))));
  };
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (!(key in keys || key in ARROWS || key in DRIVES)) return;
    event.preventDefault();
    if (key in ARROWS) actions.nudge(ARROWS[key]);
    else if (key in DRIVES) { pressed.add(key); drive(); }
    else keys[key]();
  });
  canvas.addEventListener("keyup", (event) => pressed.delete(event.key.toLowerCase()) && drive());
  canvas.addEventListener("blur", () => { if (pressed.size) { pressed.clear(); drive(); } });
}

/** Let the pointer select and drag obstacles in the world panel. */
export function connectPointer(canvas, getWorld, actions) {
  let dragged = null, offset = [0, 0];
  const meters = (event) => {
    const box = canvas.getBoundingClientRect(), { sizeM } = getWorld();
    return [((event.clientX - box.left) / box.width) * sizeM, (1 - (event.clientY - box.top) / box.height) * sizeM];
  };
  canvas.addEventListener("pointerdown", (event) => {
    const [x, y] = meters(event), found = obstacleAt(getWorld(), x, y);
    if (!found) return;
    dragged = found;
    dragged.isHeld = true;
    offset = [found.x - x, found.y - y];
    canvas.setPointerCapture(event.pointerId);
    canvas.classList.add("dragging");
    actions.select(found.name);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!dragged) return;
    const [x, y] = meters(event);
    actions.move(dragged, x + offset[0], y + offset[1]);
  });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => {
    if (dragged) dragged.isHeld = false;
    dragged = null;
    canvas.classList.remove("dragging");
  });
}
