// The world panel: obstacles, robot, field of view, beams and hits.

import { prepare, trace, useMeters } from "./canvas.js";

/**
 * Draw the world.
 *
 * @param {HTMLCanvasElement} canvas
 * @param {object} world see world.js
 * @param {{colors: object, steps: number, trail: Float32Array}} view the steps of a window, and the poses in it
 */
export function drawWorld(canvas, world, view) {
  const { context, width } = prepare(canvas), { colors } = view;
  const pixel = useMeters(context, width, world.sizeM);
  drawGrid(context, world, pixel, colors);
  drawView(context, world, pixel, colors);
  for (const obstacle of world.obstacles) drawObstacle(context, obstacle, world, pixel, view);
  drawHits(context, world, pixel, colors);
  drawRobot(context, world.robot, pixel, view);
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
function drawView(context, world, pixel, colors) {
  const { robot, ranges } = world;
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

/** Draw an obstacle, dashed if no beam hit it in the window. */
function drawObstacle(context, obstacle, world, pixel, { colors, steps }) {
  const isSeen = world.step - obstacle.lastHit < steps;
  trace(context, obstacle.placed);
  context.fillStyle = colors.obstacle;
  context.globalAlpha = isSeen ? 1 : 0.28;
  context.fill();
  context.globalAlpha = 1;
  context.setLineDash(isSeen ? [] : [5 * pixel, 4 * pixel]);
  context.lineWidth = pixel;
  context.strokeStyle = colors.edge;
  context.stroke();
  context.setLineDash([]);
}

function drawHits(context, { robot, ranges, angles }, pixel, colors) {
  context.fillStyle = colors.accent;
  context.beginPath();
  ranges.forEach((range, i) => {
    if (!Number.isFinite(range)) return;
    const bearing = robot.heading + angles[i];
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
