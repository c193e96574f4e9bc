// Motions of the robot and of the obstacles, as in repro.simulation.motions.

import { wrap } from "./geometry.js";

/** Return the commands of one round of a motion: linear and angular velocity of each step [m/s, rad/s]. */
export function robotCommands(motion, direction, stepTime) {
  if (motion.name === "rotate") {
    return Array(motion.steps).fill([0, (direction * 2 * Math.PI) / (motion.steps * stepTime)]);
  }
  const drive = Array(motion.drive_steps).fill([motion.side_m / (motion.drive_steps * stepTime), 0]);
  const turn = Array(motion.turn_steps).fill([0, (direction * Math.PI) / 2 / (motion.turn_steps * stepTime)]);
  const side = [...drive.slice(0, motion.first_steps), ...turn, ...drive.slice(motion.first_steps)];
  return [...side, ...side, ...side, ...side];
}

/** Return the start pose of a motion: the center for a rotation, the left side for a square. */
export function startPose(motion, sizeM, direction) {
  const center = sizeM / 2;
  if (motion.name === "rotate") return { x: center, y: center, heading: 0 };
  const half = motion.side_m / 2, ahead = (motion.side_m * motion.first_steps) / motion.drive_steps;
  return { x: center - half, y: center - direction * (half - ahead), heading: (-direction * Math.PI) / 2 };
}

/** Return the pose after one step of IR-SIM's differential kinematics. */
export function advance(pose, [speed, turn], stepTime) {
  return {
    x: pose.x + speed * Math.cos(pose.heading) * stepTime,
    y: pose.y + speed * Math.sin(pose.heading) * stepTime,
    heading: wrap(pose.heading + turn * stepTime),
  };
}

/**
 * Return the velocity of a drifting obstacle in its next step [m/s], and update its course.
 *
 * The obstacle drives straight, turns at random intervals, and turns away from the zone of the robot. A recording of
 * the study ends after 10 s; the demo goes on, so obstacles also turn back at the border of the map.
 *
 * @param {object} obstacle with x, y, radius [m], speed [m/s], course [rad], countdown [steps]
 * @param {{zone: {x: number, y: number, radius: number}, sizeM: number, turnSteps: number[]}} rules
 * @param {() => number} random uniform in [0, 1)
 * @param {number} stepTime [s]
 */
export function driftVelocity(obstacle, rules, random, stepTime) {
  if (obstacle.countdown === 0) setCourse(obstacle, random() * 2 * Math.PI, rules, random);
  obstacle.countdown -= 1;
  const { zone, sizeM } = rules;
  const toward = (x, y) => Math.cos(obstacle.course) * x + Math.sin(obstacle.course) * y > 0;
  const next = (axis) => obstacle[axis] + (axis === "x" ? Math.cos : Math.sin)(obstacle.course) * obstacle.speed * stepTime;
  const x = next("x"), y = next("y");
  const facing = (angle) => angle + (random() - 0.5) * Math.PI; // uniform over a half plane
  if (Math.hypot(x - zone.x, y - zone.y) < zone.radius + obstacle.radius && toward(zone.x - obstacle.x, zone.y - obstacle.y)) {
    obstacle.course = facing(Math.atan2(obstacle.y - zone.y, obstacle.x - zone.x));
  }
  for (const [isOut, angle] of [[x < 0, 0], [x > sizeM, Math.PI], [y < 0, Math.PI / 2], [y > sizeM, -Math.PI / 2]]) {
    if (isOut && toward(-Math.cos(angle), -Math.sin(angle))) obstacle.course = facing(angle);
  }
  return [obstacle.speed * Math.cos(obstacle.course), obstacle.speed * Math.sin(obstacle.course)];
}

/** Give an obstacle a course [rad] until its next random turn. */
export function setCourse(obstacle, course, { turnSteps: [least, most] }, random) {
  obstacle.course = course;
  obstacle.countdown = least + Math.floor(random() * (most - least + 1));
}
