// The world: sampled from an experiment as in repro.simulation.worlds, stepped, and changed by the user.

import { contains, outlineOf, place, radiusOf } from "./geometry.js";
import { advance, driftVelocity, robotCommands, setCourse, startPose } from "./motions.js";
import { beamAngles, scan } from "./raycasting.js";

const PLACEMENTS = 200; // attempts to place one obstacle
const TURN_STEPS = [50, 100]; // of an obstacle that stood still in its experiment

/** Return a generator of uniform random numbers in [0, 1), mulberry32. */
export function generator(seed) {
  let state = seed >>> 0;
  return () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let mixed = Math.imul(state ^ (state >>> 15), state | 1);
    mixed ^= mixed + Math.imul(mixed ^ (mixed >>> 7), mixed | 61);
    return ((mixed ^ (mixed >>> 14)) >>> 0) / 2 ** 32;
  };
}

/**
 * Sample the world of an experiment.
 *
 * @param {object} spec the content of conf/world/paper.yaml
 * @param {string} experiment a key of spec.experiments
 * @param {number} seed the same seed gives the same world
 */
export function sampleWorld(spec, experiment, seed) {
  const { motion, obstacles: population, clear_radius_m: clear } = spec.experiments[experiment];
  const lidar = spec.robot.sensors[0], random = generator(seed), direction = random() < 0.5 ? 1 : -1;
  const sizeM = spec.world.width, stepTime = spec.world.step_time, robot = startPose(motion, sizeM, direction);
  const world = {
    sizeM, stepTime, robotRadius: spec.robot.shape.radius, rangeMax: lidar.range_max, angles: beamAngles(lidar),
    clear, population, random, obstacles: [], step: 0, round: 0,
    commands: robotCommands(motion, direction, stepTime), robot,
  };
  const [least, most] = population.count;
  const count = least + Math.floor(random() * (most - least + 1));
  for (let i = 0; i < count; i++) addObstacle(world);
  takeScan(world);
  return world;
}

/** Add an obstacle of the population at a random free place, if there is room. */
function addObstacle(world) {
  const { random, sizeM } = world, shape = sampleShape(world), radius = radiusOf(shape);
  for (let attempt = 0; attempt < PLACEMENTS; attempt++) {
    const x = radius + random() * (sizeM - 2 * radius), y = radius + random() * (sizeM - 2 * radius);
    const apart = world.obstacles.every((other) => Math.hypot(x - other.x, y - other.y) >= radius + other.radius);
    const { zone } = rulesOf(world);
    if (!apart || Math.hypot(x - zone.x, y - zone.y) < zone.radius + radius) continue;
    const heading = (2 * random() - 1) * Math.PI, [slow, fast] = world.population.behavior?.speed_m_s ?? [0, 0];
    const obstacle = { radius, outline: outlineOf(shape), heading, lastHit: -Infinity };
    obstacle.speed = slow + random() * (fast - slow);
    setCourse(obstacle, 2 * Math.PI * random(), rulesOf(world), random);
    moveTo(obstacle, x, y);
    world.obstacles.push(obstacle);
    return;
  }
}

/** Move an obstacle to the free place nearest to a point, on the map and off the robot. */
export function dragTo(world, obstacle, x, y) {
  const within = (value) => Math.min(Math.max(value, 0), world.sizeM);
  const least = obstacle.radius + world.robotRadius, { robot } = world;
  let away = [within(x) - robot.x, within(y) - robot.y];
  const distance = Math.hypot(...away);
  if (distance < least) away = distance > 0 ? away.map((part) => (part * least) / distance) : [least, 0];
  moveTo(obstacle, robot.x + away[0], robot.y + away[1]);
}

/** Advance obstacles and robot by one step, and take a scan. */
export function stepWorld(world) {
  world.step++;
  const rules = rulesOf(world), stands = world.robot;
  for (const obstacle of world.obstacles) {
    if (obstacle.isHeld) continue; // by the pointer
    const [vx, vy] = driftVelocity(obstacle, rules, world.random, world.stepTime);
    const { x, y } = obstacle;
    moveTo(obstacle, x + vx * world.stepTime, y + vy * world.stepTime);
    if (isBlocked(world, stands, obstacle)) moveTo(obstacle, x, y);
  }
  const command = world.commands[world.round], next = advance(stands, command, world.stepTime);
  const stays = world.obstacles.some((obstacle) => isBlocked(world, next, obstacle));
  // the paper's motions keep to the clear zone; only an obstacle that the user put into it can stop them
  world.isStopped = stays && command[0] !== 0;
  world.robot = stays ? { ...stands, heading: next.heading } : next;
  if (!world.isStopped) world.round = (world.round + 1) % world.commands.length;
  takeScan(world);
}

/** Scan the world from the robot's pose and note which obstacles are hit. */
export function takeScan(world) {
  const { ranges, nearest } = scan(world.robot, world.angles, world.obstacles, world.rangeMax);
  world.ranges = ranges;
  for (const index of nearest) if (index >= 0) world.obstacles[index].lastHit = world.step;
}

/** Return the topmost obstacle at a point, or undefined. */
export function obstacleAt(world, x, y) {
  return world.obstacles.findLast((obstacle) => contains(obstacle.placed, x, y));
}

function moveTo(obstacle, x, y) {
  Object.assign(obstacle, { x, y });
  obstacle.placed = place(obstacle.outline, obstacle);
}

function sampleShape({ population, random }) {
  const uniform = ([low, high]) => low + random() * (high - low);
  const radius = uniform(population.radius_m), aspect = uniform(population.aspect);
  if (random() < population.disc_share) return { name: "circle", radius };
  const width = Math.sqrt((Math.PI * radius ** 2) / aspect);
  return { name: "rectangle", length: aspect * width, width };
}

/** Return what obstacles respect: the clear zone at the center, and the border. */
function rulesOf(world) {
  const zone = { x: world.sizeM / 2, y: world.sizeM / 2, radius: world.clear };
  return { zone, sizeM: world.sizeM, turnSteps: world.population.behavior?.turn_steps ?? TURN_STEPS };
}

function isBlocked(world, robot, obstacle) {
  return Math.hypot(robot.x - obstacle.x, robot.y - obstacle.y) < obstacle.radius + world.robotRadius;
}
