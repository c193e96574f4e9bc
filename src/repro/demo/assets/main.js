// The page: steps the world in time, asks the worker for maps and shows them, and follows the user.

import { drawInput, drawMap, drawWorld } from "./drawing.js";
import { beginWorld, obstacleAt, takeScan } from "./world.js";

const at = (id) => document.getElementById(id);
const settings = JSON.parse(at("settings").textContent), { steps, stepMs, sizeM } = settings;
const state = { world: null, window: null, begun: 0, isPlaying: true, isAsking: false, isStale: true, last: 0, dropped: 0 };
const worker = new Worker(URL.createObjectURL(new Blob([settings.worker], { type: "text/javascript" })));

/** Send values to the worker, and resolve to its answer; there is one question at a time. */
function ask(values) {
  return new Promise((resolve, reject) => {
    worker.onmessage = ({ data }) => (data.error ? reject(new Error(data.error)) : resolve(data));
    worker.onerror = (event) => reject(new Error(event.message || "its worker does not start"));
    worker.postMessage(values);
  });
}

/** Begin the next world of the chosen experiment, and fill the window, so that the first map is that of a whole one. */
function newWorld() {
  const worlds = settings.worlds[at("experiment").value];
  state.world = beginWorld(worlds[state.begun++ % worlds.length], settings.lidar);
  const { angles } = state.world;
  state.window = {
    ranges: new Float32Array(steps * angles.length), angles: Float32Array.from(angles), poses: new Float32Array(3 * steps),
  };
  for (let i = 0; i < steps; i++) step();
}

/** Advance world and window by one step. */
function step() {
  if (state.world.step === settings.longest) return newWorld();
  state.world.step++;
  state.window.ranges.copyWithin(0, state.world.angles.length);
  state.window.poses.copyWithin(0, 3);
  scan();
}

/** Take the newest scan of the window, anew after the user has moved an obstacle. */
function scan() {
  const { world, window: { ranges, poses } } = state;
  takeScan(world);
  ranges.set(world.ranges, ranges.length - world.ranges.length);
  poses.set([world.robot.x, world.robot.y, world.robot.heading], poses.length - 3);
  state.isStale = true;
}

/** Draw one frame of the screen, after the steps that are due. */
function frame(now) {
  if (state.isPlaying && now - state.last >= stepMs) {
    step();
    const lost = Math.max(0, now - stepMs - (state.last + stepMs)); // a slow machine shows the world more slowly
    state.last += stepMs + lost;
    state.dropped = 0.9 * state.dropped + 0.1 * lost;
  }
  drawWorld(at("world"), state.world, sizeM, state.window.poses);
  at("clock").textContent = `${((state.world.step * stepMs) / 1000).toFixed(1)} s`;
  if (state.isStale && !state.isAsking) predict().catch(fail);
  requestAnimationFrame(frame);
}

/** Ask for the map of the present moment, and show it. */
async function predict() {
  const { world, window: scans } = state, asked = performance.now(), number = Number(at("network").value), { grid, encoding } = settings.networks[number];
  const { robot } = world, outlines = world.obstacles.map(({ placed }) => placed);
  [state.isAsking, state.isStale] = [true, false];
  const { images, free } = await ask({ number, scans });
  state.isAsking = false;
  drawInput(at("input"), images, grid, encoding.parameters.frames ?? 1, robot);
  drawMap(at("prediction"), free, grid, robot, outlines);
  at("status").textContent = "";
  showLag(performance.now() - asked);
}

/** Show how old the map is when it appears, and how much more slowly than in reality the world moves. */
function showLag(ageMs) {
  const speed = stepMs / (stepMs + state.dropped);
  at("lag").textContent = `map ${(ageMs / 1000).toFixed(2)} s behind${speed < 0.9 ? `, world at ${speed.toFixed(1)} of its speed` : ""}`;
}

/** Show why no network can run; the page makes no further predictions. */
function fail(error) {
  at("status").textContent = `The network cannot run in this browser: ${error.message}.`;
}

/** Let the pointer drag obstacles in the world panel. */
function connectPointer(canvas) {
  let dragged = null, last = null;
  const meters = ({ clientX, clientY }) => {
    const { left, top, width, height } = canvas.getBoundingClientRect();
    return [((clientX - left) / width) * sizeM, (1 - (clientY - top) / height) * sizeM];
  };
  canvas.addEventListener("pointerdown", (event) => {
    last = meters(event);
    dragged = obstacleAt(state.world, ...last);
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!dragged) return;
    const [x, y] = meters(event);
    dragged.moved = [dragged.moved[0] + x - last[0], dragged.moved[1] + y - last[1]];
    last = [x, y];
    scan();
  });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => { dragged = null; });
}

function togglePlay() {
  state.isPlaying = !state.isPlaying;
  at("play").textContent = state.isPlaying ? "Pause" : "Play";
}

at("play").addEventListener("click", togglePlay);
at("new-world").addEventListener("click", newWorld);
at("experiment").addEventListener("change", newWorld);
at("network").addEventListener("change", () => { state.isStale = true; });
connectPointer(at("world"));
for (const title of Object.keys(settings.worlds)) at("experiment").add(new Option(title));
settings.networks.forEach(({ title }, number) => at("network").add(new Option(title, number)));
at("experiment").selectedIndex = at("experiment").length - 1;
newWorld();
ask(settings).then(() => requestAnimationFrame(frame), fail);
