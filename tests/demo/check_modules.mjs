// Runs the page's modules on recordings that pytest wrote as JSON, and prints their results as JSON.
// node check_modules.mjs ASSETS FIXTURE
import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [assets, fixture] = process.argv.slice(2);
const load = (name) => import(pathToFileURL(`${assets}/${name}`).href);
const [{ outlineOf, place }, { beamAngles, scan }, { robotCommands, advance, startPose }] = await Promise.all(
  ["geometry.js", "raycasting.js", "motions.js"].map(load));
const [{ createEncoding }, { compare, rasterize }] = await Promise.all(["encodings.js", "maps.js"].map(load));

const pose = ([x, y, heading]) => ({ x, y, heading });

/** Return the obstacles of a recording at a step, with the outlines that the page gives their shapes. */
function obstaclesAt(recording, step) {
  return recording.shapes.map((shape, i) => {
    const state = pose(recording.states[i][step]), outline = outlineOf(shape);
    return { ...state, radius: Math.hypot(outline[0], outline[1]), placed: place(outline, state) };
  });
}

function driven(recording) {
  const { motion, direction, sizeM, stepTime } = recording;
  let robot = startPose(motion, sizeM, direction);
  return robotCommands(motion, direction, stepTime).map((command) => {
    robot = advance(robot, command, stepTime);
    return [robot.x, robot.y, robot.heading];
  });
}

const finite = (range) => (Number.isFinite(range) ? range : null); // JSON has no infinity

const results = JSON.parse(readFileSync(fixture, "utf8")).map((recording) => {
  const { poses, lidar, grid } = recording, angles = beamAngles(lidar), last = poses.length - 1;
  const ranges = poses.map((each, step) => [...scan(pose(each), angles, obstaclesAt(recording, step), lidar.range_max).ranges].map(finite));
  const scans = {
    ranges: Float32Array.from(recording.ranges.flat(), (range) => range ?? Infinity),
    angles: Float32Array.from(recording.angles), poses: Float32Array.from(poses.flat()),
  };
  const images = recording.encodings.map((description) => {
    const encoding = createEncoding(description), drawn = encoding.draw(scans, grid);
    return { drawn: [...drawn], input: [...encoding.toInput(drawn)] };
  });
  const map = rasterize(obstaclesAt(recording, last).map(({ placed }) => placed), grid);
  const { iou, accuracy } = compare(Float32Array.from(recording.free), map);
  return { angles: [...angles], outlines: recording.shapes.map((shape) => [...outlineOf(shape)]), path: driven(recording), ranges, images, map: [...map], iou, accuracy };
});
process.stdout.write(JSON.stringify(results));
