// A world of the study: robot and obstacles move as Python has computed, and the user may drag obstacles.
// An outline is a flat array x0, y0, x1, y1, ... [m], closed by its first vertex.

/**
 * Begin a world.
 *
 * @param {{poses: number[][], outlines: number[][], headings: number[], paths: number[][][]}} description the poses of
 *   the robot x, y [m], heading [rad] in one round, and of each obstacle outline, heading and the step and place x, y
 *   where it begins, changes and ends its straight parts, a single one if it stands
 * @param {{angle_range: number, number: number, range_max: number}} lidar as in conf/world
 */
export function beginWorld({ poses, outlines, headings, paths }, lidar) {
  const spacing = lidar.angle_range / (lidar.number - 1);
  const angles = Float64Array.from({ length: lidar.number }, (_, i) => -lidar.angle_range / 2 + i * spacing);
  const obstacles = outlines.map((outline, i) => ({
    outline, heading: headings[i], path: paths[i], moved: [0, 0], lastHit: -Infinity,
  }));
  const world = { poses, obstacles, angles, rangeMax: lidar.range_max, step: 0 };
  takeScan(world);
  return world;
}

/** Take the scan of the present step: `ranges` [m], Infinity for a miss, from the `robot`. */
export function takeScan(world) {
  const { poses, obstacles, angles, step } = world, [x, y, heading] = poses[step % poses.length];
  world.robot = { x, y, heading };
  for (const obstacle of obstacles) place(obstacle, step);
  world.ranges = Float64Array.from(angles, (angle) => {
    const dx = Math.cos(heading + angle), dy = Math.sin(heading + angle);
    let nearest = world.rangeMax, hit = null;
    for (const obstacle of obstacles) {
      const range = crossing(x, y, dx, dy, obstacle.placed);
      if (range <= nearest) [nearest, hit] = [range, obstacle];
    }
    if (hit) hit.lastHit = step;
    return hit ? nearest : Infinity;
  });
}

/** Place the outline of an obstacle in the world, where its path and the user have moved it. */
function place(obstacle, step) {
  const { outline, heading, path, moved } = obstacle, cos = Math.cos(heading), sin = Math.sin(heading);
  const next = path.find(([at]) => at > step) ?? path.at(-1), last = path.findLast(([at]) => at <= step);
  const share = (step - last[0]) / (next[0] - last[0] || 1);
  const [x, y] = [1, 2].map((i) => last[i] + share * (next[i] - last[i]) + moved[i - 1]);
  obstacle.placed = Float64Array.from(outline, (value, i) => (i % 2
    ? outline[i - 1] * sin + value * cos + y
    : value * cos - outline[i + 1] * sin + x));
}

/** Return the distance along a beam to an outline [m], Infinity without a crossing; as in repro.simulation.raycasting. */
function crossing(fromX, fromY, dx, dy, placed) {
  let nearest = Infinity;
  for (let i = 0; i < placed.length; i += 2) {
    const next = (i + 2) % placed.length;
    const edgeX = placed[next] - placed[i], edgeY = placed[next + 1] - placed[i + 1];
    const x = fromX - placed[i], y = fromY - placed[i + 1];
    const denominator = edgeY * dx - edgeX * dy;
    const u = (y * dx - x * dy) / denominator, t = (edgeX * y - edgeY * x) / denominator;
    if (u >= 0 && u <= 1 && t > 1e-9 && t < nearest) nearest = t;
  }
  return nearest;
}

/** Return the topmost obstacle at a point, or undefined; by the crossings of a ray to the right. */
export function obstacleAt(world, x, y) {
  return world.obstacles.findLast(({ placed }) => {
    let inside = false;
    for (let i = 0, j = placed.length - 2; i < placed.length; j = i, i += 2) {
      if (placed[i + 1] > y === placed[j + 1] > y) continue;
      const share = (y - placed[i + 1]) / (placed[j + 1] - placed[i + 1]);
      if (x < placed[i] + share * (placed[j] - placed[i])) inside = !inside;
    }
    return inside;
  });
}
