// The chart of the obstacle IoU over the last seconds.

import { prepare } from "./canvas.js";

const PAD = { left: 30, right: 8, top: 8, bottom: 20 };

/**
 * Draw a line chart of values in [0, 1].
 *
 * @param {HTMLCanvasElement} canvas
 * @param {{time: number, value: number}[]} points in seconds, oldest first
 * @param {number} span seconds shown
 * @param {object} colors see canvas.themeColors
 */
export function drawChart(canvas, points, span, colors) {
  const { context, width, height } = prepare(canvas), now = points.at(-1)?.time ?? 0;
  const x = (time) => width - PAD.right - ((now - time) / span) * (width - PAD.left - PAD.right);
  const y = (value) => PAD.top + (1 - value) * (height - PAD.top - PAD.bottom);
  context.font = "11px system-ui, sans-serif";
  context.lineWidth = 1;
  context.textBaseline = "middle";
  context.textAlign = "right";
  for (const value of [0, 0.5, 1]) {
    context.strokeStyle = colors.line;
    context.beginPath();
    context.moveTo(PAD.left, y(value)); context.lineTo(width - PAD.right, y(value));
    context.stroke();
    context.fillStyle = colors.soft;
    context.fillText(String(value), PAD.left - 6, y(value));
  }
  context.textAlign = "left";
  context.fillText(`${span} s ago`, PAD.left, height - 8);
  context.fillText("Obstacle IoU", PAD.left + 2, PAD.top + 8);
  context.textAlign = "right";
  context.fillText("now", width - PAD.right, height - 8);
  context.strokeStyle = colors.accent;
  context.lineWidth = 2;
  context.lineJoin = "round";
  context.beginPath();
  for (const { time, value } of points) if (now - time <= span) context.lineTo(x(time), y(value));
  context.stroke();
  if (!points.length) return;
  context.fillStyle = colors.accent;
  context.beginPath();
  context.arc(x(now), y(points.at(-1).value), 3.5, 0, 2 * Math.PI);
  context.fill();
}
