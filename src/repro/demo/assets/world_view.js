// The world panel: obstacles, robot, field of view, beams and hits.

import { prepare, trace, useMeters } from "./canvas.js";

const ARROW_S = 4; // an arrow shows the way of so many seconds

/**
 * Draw the world.
 *
 * @param {HTMLCanvasElement} canvas
 * @param {object} world see world.js
 * @param {{robot: object, obstacles: object[], ranges: Float64Array}} moment see world.between
 * @param {{colors: object, selected: object, steps: number, trail: Float32Array}} view the selected obstacle, the
 *   steps of a window, and the poses in it
 */
export function drawWorld(canvas, world, moment, view) {
  const { context, width } = prepare(canvas), { colors } = view;
  const pixel = useMeters(context, width, world.sizeM);
  drawGrid(context, world, pixel, colors);
  drawView(context, world, moment, pixel, colors);
  for (const obstacle of moment.obstacles) drawObstacle(context, obstacle, world, pixel, view);
  drawHits(context, world, moment, pixel, colors);
  drawRobot(context, moment.robot, pixel, view);
}

function drawGrid(context, { sizeM }, pixel, colors) {
  context.lineWidth = pixel;
  context.strokeStyle = colors.line;
  context.beginPath();
  for (let at = 10; at < sizeM; at += 10) {
    context.moveTo(at, 0); context.lineTo(at, sizeM);
    context.moveTo(0, at); context.lineTo(sizeM, at);
  }
  context.stroke();
}

/** Draw what the beams see: the field of view up to the hits, and the beams. */
function drawView(context, world, { robot, ranges }, pixel, colors) {
  const ends = world.angles.map((angle, i) => robot.heading + angle);
  const reach = (i) => Math.min(ranges[i], world.rangeMax);
  context.fillStyle = context.strokeStyle = colors.accent;
  context.globalAlpha = 0.13;
  context.beginPath();
  context.moveTo(robot.x, robot.y);
  ends.forEach((bearing, i) => context.lineTo(robot.x + reach(i) * Math.cos(bearing), robot.y + reach(i) * Math.sin(bearing)));
  context.closePath();
  context.fill();
  context.globalAlpha = 0.3;
  context.lineWidth = 0.6 * pixel;
  context.beginPath();
  for (let i = 0; i < ends.length; i += 3) {
    context.moveTo(robot.x, robot.y);
    context.lineTo(robot.x + reach(i) * Math.cos(ends[i]), robot.y + reach(i) * Math.sin(ends[i]));
  }
  context.stroke();
  context.globalAlpha = 1;
}

/** Draw an obstacle, dashed if no beam hit it in the window, with an arrow of its velocity. */
function drawObstacle(context, obstacle, world, pixel, { colors, selected, steps }) {
  const isSelected = obstacle.source === selected, isSeen = world.step - obstacle.lastHit < steps;
  trace(context, obstacle.placed);
  context.fillStyle = colors.obstacle;
  context.globalAlpha = isSeen ? 1 : 0.28;
  context.fill();
  context.globalAlpha = 1;
  context.setLineDash(isSeen ? [] : [5 * pixel, 4 * pixel]);
  context.lineWidth = (isSelected ? 3 : 1) * pixel;
  context.strokeStyle = isSelected ? colors.ink : colors.edge;
  context.stroke();
  context.setLineDash([]);
  const length = obstacle.speed * ARROW_S;
  if (length > 0) drawArrow(context, obstacle, length, pixel, colors.ink);
}

function drawArrow(context, { x, y, course }, length, pixel, color) {
  const tip = [x + length * Math.cos(course), y + length * Math.sin(course)], head = Math.min(6 * pixel, length);
  context.strokeStyle = color;
  context.lineWidth = 1.3 * pixel;
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(...tip);
  for (const side of [-0.5, 0.5]) {
    context.moveTo(tip[0] - head * Math.cos(course + side), tip[1] - head * Math.sin(course + side));
    context.lineTo(...tip);
  }
  context.stroke();
}

function drawHits(context, world, { robot, ranges }, pixel, colors) {
  context.fillStyle = colors.accent;
  context.beginPath();
  ranges.forEach((range, i) => {
    if (!Number.isFinite(range)) return;
    const bearing = robot.heading + world.angles[i];
    const x = robot.x + range * Math.cos(bearing), y = robot.y + range * Math.sin(bearing);
    context.moveTo(x, y);
    context.arc(x, y, 1.8 * pixel, 0, 2 * Math.PI);
  });
  context.fill();
}

/** Draw the robot with its heading, and its way during the window. */
function drawRobot(context, { x, y, heading }, pixel, { colors, trail }) {
  context.strokeStyle = colors.accent;
  context.lineWidth = 1.5 * pixel;
  context.beginPath();
  for (let i = 0; i < trail.length; i += 3) context.lineTo(trail[i], trail[i + 1]);
  context.stroke();
  const size = Math.max(0.8, 7 * pixel);
  context.beginPath();
  context.arc(x, y, size, 0, 2 * Math.PI);
  context.fillStyle = colors.accent;
  context.fill();
  context.strokeStyle = colors.ground;
  context.lineWidth = 2 * pixel;
  context.stroke();
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(x + size * Math.cos(heading), y + size * Math.sin(heading));
  context.stroke();
}
