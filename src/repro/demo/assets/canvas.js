// Elements of the page, and canvases that are sharp at any pixel density, in the colors of the page's theme.

export const at = (id) => document.getElementById(id);

/** Return the theme's colors as CSS strings, by their names in style.css. */
export function themeColors() {
  const style = getComputedStyle(document.documentElement);
  const names = ["ink", "soft", "line", "panel", "ground", "accent", "obstacle", "edge", "truth", "found", "missed", "false"];
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

/** Clear a canvas at its size on the screen; return its context in CSS pixels and that size. */
export function prepare(canvas) {
  const { width, height } = canvas.getBoundingClientRect(), density = window.devicePixelRatio || 1;
  const columns = Math.max(1, Math.round(width * density)), rows = Math.max(1, Math.round(height * density));
  if (canvas.width !== columns || canvas.height !== rows) [canvas.width, canvas.height] = [columns, rows];
  const context = canvas.getContext("2d");
  context.setTransform(columns / width, 0, 0, rows / height, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

/** Let a context draw in meters with y up, on a square map; return the length of a CSS pixel [m]. */
export function useMeters(context, width, sizeM) {
  const scale = width / sizeM;
  context.transform(scale, 0, 0, -scale, 0, width);
  return 1 / scale;
}

/** Trace a closed outline x0, y0, x1, y1, ... */
export function trace(context, outline) {
  context.beginPath();
  for (let i = 0; i < outline.length; i += 2) context.lineTo(outline[i], outline[i + 1]);
  context.closePath();
}

/** Convert a CSS color to [red, green, blue]. */
export function rgb(color) {
  const value = Number.parseInt(color.slice(1), 16);
  return [(value >> 16) & 255, (value >> 8) & 255, value & 255];
}
