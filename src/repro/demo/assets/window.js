// The window: the newest T scans with their poses, from which one map is predicted.

/** Return an empty window: misses at the pose of the first scan, as before a recording. */
export function emptyWindow(world, steps) {
  const beams = world.angles.length, poses = new Float32Array(3 * steps);
  for (let step = 0; step < steps; step++) poses.set([world.robot.x, world.robot.y, world.robot.heading], 3 * step);
  return { ranges: new Float32Array(steps * beams).fill(Infinity), angles: Float32Array.from(world.angles), poses };
}

/** Drop the oldest scan and append the newest one of a world. */
export function append(window, world) {
  window.ranges.copyWithin(0, world.angles.length);
  window.poses.copyWithin(0, 3);
  replaceNewest(window, world);
}

/** Replace the newest scan, after the user changed a world that stands still. */
export function replaceNewest(window, world) {
  window.ranges.set(world.ranges, window.ranges.length - world.ranges.length);
  window.poses.set([world.robot.x, world.robot.y, world.robot.heading], window.poses.length - 3);
}

/** Return a copy that may be sent to a worker. */
export function copyOf(window) {
  return { ranges: window.ranges.slice(), angles: window.angles, poses: window.poses.slice() };
}
