// Runs the page's modules on recordings that pytest wrote as JSON, and prints their results as JSON.
// node check_modules.mjs ASSETS FIXTURE
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [assets, fixture] = process.argv.slice(2);
const load = (name) => import(pathToFileURL(`${assets}/${name}`).href);
const [{ beginWorld, obstacleAt, takeScan }, { createEncoding }] = await Promise.all(["world.js", "encodings.js"].map(load));

const results = JSON.parse(readFileSync(fixture, "utf8")).map(({ world: description, steps, lidar, grid, encodings, ...recording }) => {
  const world = beginWorld(description, lidar), poses = [], ranges = [];
  for (world.step = 0; world.step < steps; world.step++) {
    takeScan(world);
    poses.push([world.robot.x, world.robot.y, world.robot.heading]);
    ranges.push([...world.ranges].map((range) => (Number.isFinite(range) ? range : null))); // JSON has no infinity
  }
  const scans = {
    ranges: Float32Array.from(recording.ranges.flat(), (range) => range ?? Infinity),
    angles: Float32Array.from(recording.angles), poses: Float32Array.from(recording.poses.flat()),
  };
  const images = encodings.map((encoding) => {
    const { draw, toInput } = createEncoding(encoding), drawn = draw(scans, grid);
    return { drawn: [...drawn], input: [...toInput(drawn)] };
  });
  const found = recording.places.map(([x, y]) => world.obstacles.indexOf(obstacleAt(world, x, y)));
  return { poses, ranges, images, found };
});
process.stdout.write(JSON.stringify(results));
