// Outlines of obstacles, as IR-SIM draws them, and their placement in the world.
// An outline is a flat array x0, y0, x1, y1, ... [m], convex and closed by its first vertex.

const CIRCLE_VERTICES = 64; // IR-SIM's circles are polygons

/** Return the outline of an IR-SIM shape in its own frame [m]. */
export function outlineOf(shape) {
  if (shape.name === "rectangle") {
    const x = shape.length / 2, y = shape.width / 2;
    return Float64Array.of(-x, -y, x, -y, x, y, -x, y);
  }
  const outline = new Float64Array(2 * CIRCLE_VERTICES);
  for (let i = 0; i < CIRCLE_VERTICES; i++) {
    const angle = (-2 * Math.PI * i) / CIRCLE_VERTICES;
    outline[2 * i] = shape.radius * Math.cos(angle);
    outline[2 * i + 1] = shape.radius * Math.sin(angle);
  }
  return outline;
}

/** Return the radius of the circle around the origin that encloses an IR-SIM shape [m]. */
export function radiusOf(shape) {
  return shape.name === "circle" ? shape.radius : Math.hypot(shape.length, shape.width) / 2;
}

/** Transform an outline to the world frame at a pose {x, y, heading}. */
export function place(outline, pose) {
  const cos = Math.cos(pose.heading), sin = Math.sin(pose.heading);
  const placed = new Float64Array(outline.length);
  for (let i = 0; i < outline.length; i += 2) {
    placed[i] = outline[i] * cos - outline[i + 1] * sin + pose.x;
    placed[i + 1] = outline[i] * sin + outline[i + 1] * cos + pose.y;
  }
  return placed;
}

/** Return whether a point lies in a placed outline, by the crossings of a ray to the right. */
export function contains(placed, x, y) {
  let inside = false;
  for (let i = 0, j = placed.length - 2; i < placed.length; j = i, i += 2) {
    const crosses = placed[i + 1] > y !== placed[j + 1] > y;
    if (crosses && x < placed[i] + ((y - placed[i + 1]) * (placed[j] - placed[i])) / (placed[j + 1] - placed[i + 1])) {
      inside = !inside;
    }
  }
  return inside;
}

/** Return an angle in (-pi, pi]. */
export function wrap(angle) {
  let wrapped = angle;
  while (wrapped > Math.PI) wrapped -= 2 * Math.PI;
  while (wrapped < -Math.PI) wrapped += 2 * Math.PI;
  return wrapped;
}
