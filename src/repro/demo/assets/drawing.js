// The panels of the page: the world, the input of the network, and the predicted map.

const ACCENT = "#0b6e99", OBSTACLE = "#9aa1a8", TRUTH = "#0b86bd";

/** Clear a canvas; return its context in meters with y up, on a square map, and the length of a CSS pixel [m]. */
function prepare(canvas, sizeM) {
  const { width } = canvas.getBoundingClientRect();
  canvas.width = canvas.height = Math.max(1, Math.round(width * (window.devicePixelRatio || 1)));
  const context = canvas.getContext("2d"), scale = canvas.width / sizeM;
  context.setTransform(scale, 0, 0, -scale, 0, canvas.width);
  return { context, pixel: sizeM / width };
}

/** Trace a closed outline x0, y0, x1, y1, ... */
function trace(context, outline) {
  context.beginPath();
  for (let i = 0; i < outline.length; i += 2) context.lineTo(outline[i], outline[i + 1]);
  context.closePath();
}

/** Draw the view of the robot up to the hits, the obstacles, pale if no beam hit them in the window, and the robot. */
export function drawWorld(canvas, { robot, ranges, angles, rangeMax, obstacles, step }, sizeM, poses) {
  const { context, pixel } = prepare(canvas, sizeM);
  const end = (range, i) => {
    const bearing = robot.heading + angles[i], reach = Math.min(range, rangeMax);
    return [robot.x + reach * Math.cos(bearing), robot.y + reach * Math.sin(bearing)];
  };
  trace(context, [robot.x, robot.y, ...Array.from(ranges).flatMap(end)]);
  context.fillStyle = context.strokeStyle = ACCENT;
  context.globalAlpha = 0.15;
  context.fill();
  for (const { placed, lastHit } of obstacles) {
    context.globalAlpha = step - lastHit < poses.length / 3 ? 1 : 0.28;
    trace(context, placed);
    context.fillStyle = OBSTACLE;
    context.fill();
  }
  context.globalAlpha = 1;
  context.lineWidth = 1.5 * pixel;
  context.beginPath();
  for (let i = 0; i < poses.length; i += 3) context.lineTo(poses[i], poses[i + 1]);
  context.stroke();
  context.fillStyle = ACCENT;
  ranges.forEach((range, i) => {
    const [x, y] = end(range, i);
    if (Number.isFinite(range)) context.fillRect(x - 1.5 * pixel, y - 1.5 * pixel, 3 * pixel, 3 * pixel);
  });
  drawRobot(context, robot, pixel, ACCENT);
}

/** Draw the newest hits of a window as one gray image, recent hits dark; a series has an image of each of its parts. */
export function drawInput(canvas, images, grid, frames, robot) {
  const pixels = grid.size_px ** 2;
  const gray = (i) => {
    for (let part = frames - 1; part >= 0; part--) if (images[part * pixels + i] === 0) return (204 * (frames - 1 - part)) / (frames - 1);
    return 255;
  };
  drawImage(canvas, frames === 1 ? (i) => images[i] : gray, grid, robot, []);
}

/** Draw a predicted map, black where an obstacle is certain, with the outlines of the true obstacles. */
export function drawMap(canvas, free, grid, robot, outlines) {
  drawImage(canvas, (i) => 255 * free[i], grid, robot, outlines);
}

function drawImage(canvas, gray, grid, robot, outlines) {
  const size = grid.size_px, image = new ImageData(size, size), buffer = new OffscreenCanvas(size, size);
  for (let i = 0; i < size * size; i++) {
    image.data.fill(gray(i), 4 * i, 4 * i + 3);
    image.data[4 * i + 3] = 255;
  }
  buffer.getContext("2d").putImageData(image, 0, 0);
  const { context, pixel } = prepare(canvas, grid.size_m);
  context.save();
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.imageSmoothingEnabled = false;
  context.drawImage(buffer, 0, 0, canvas.width, canvas.height);
  context.restore();
  context.strokeStyle = TRUTH;
  context.lineWidth = 1.2 * pixel;
  for (const outline of outlines) {
    trace(context, outline);
    context.stroke();
  }
  drawRobot(context, robot, pixel, TRUTH);
}

function drawRobot(context, { x, y, heading }, pixel, color) {
  const corners = [[0, 9], [2.5, 6], [-2.5, 6]].flatMap(([angle, length]) => [
    x + length * pixel * Math.cos(heading + angle), y + length * pixel * Math.sin(heading + angle),
  ]);
  trace(context, corners);
  context.fillStyle = color;
  context.fill();
}
