"""Descriptions of worlds that are refused, each with a message that names the value."""

import copy
from typing import Any

import pytest
from conftest import ROOT, world_errors

from repro.worlds.spec import read_world

OFFICE, ROOMS = (read_world(ROOT / "conf" / "world" / f"{name}.yaml") for name in ("office", "rooms"))
DRIVE = {"name": "waypoints", "points_m": [[2.0, 10.0], [18.0, 10.0]], "speed_m_s": 1.0, "turn_rad_s": 1.0, "steps": 50}
WALL = {"name": "linestring", "vertices": [[1, 1], [2, 2]]}


def office(changes: dict[str, Any], original: dict[str, Any] = OFFICE) -> dict[str, Any]:
    """Return a world with some values changed, by their path; its experiments hold copies, as when composed."""
    world = copy.deepcopy(original)
    for path, value in changes.items():
        *parents, last = (int(key) if key.isdigit() else key for key in path.split("."))
        node = world
        for key in parents:
            node = node[key]
        if value is None:
            del node[last]
        else:
            node[last] = value
    return world


MOTION, FIXED, PEOPLE = "experiments.people.motion", "experiments.people.fixed", "obstacles.people"
LIDAR = "robot.sensors.0"
MOVING = "experiments.people.obstacles.1"
SHORT = {"name": "linestring", "vertices": [[0, 0], [0.3, 0.2]]}
SHAPES = {f"{MOVING}.shapes": [SHORT]} | {f"{MOVING}.{key}": None for key in ("radius_m", "aspect", "disc_share")}
BRIEF = {f"{MOTION}.steps": 20}
FAST = {"name": "drift", "speed_m_s": [1.0, 2.0], "turn_steps": [5, 10]}
BOW = [[0, 0], [2, 2], [2, 0], [0, 2]]
REFUSED = {
    "negative radius": ({f"{FIXED}.13.shape.radius": -0.3}, "fixed.13.shape.radius=-0.3", "greater than or equal to"),
    "unknown shape": (
        {f"{FIXED}.0.shape": {"name": "compound"}},
        "fixed.0.shape",
        "must be one of circle, rectangle, polygon, linestring",
    ),
    "unknown key": ({f"{FIXED}.0.color": "red"}, "fixed.0.color=red", "not a known key"),
    "crossing polygon": ({f"{FIXED}.12.shape.vertices": BOW}, "fixed.12.shape.vertices", "Self-intersection[1 1]"),
    "polygon without area": (
        {f"{FIXED}.12.shape.vertices": [[0, 0], [1, 1], [2, 2]]},
        "fixed.12.shape.vertices",
        "does not cross or touch itself",
    ),
    "thin polygon": ({f"{FIXED}.12.shape.vertices": [[0, 0], [9, 0], [9, 1e-6]]}, "vertices", "use a linestring"),
    "corner twice": (
        {f"{FIXED}.12.shape.vertices": [[0, 0], [0, 0], [1, 0], [1, 1]]},
        "fixed.12.shape.vertices",
        "the same point twice in a row",
    ),
    "101 corners": ({f"{FIXED}.0.shape.vertices": [[k, k] for k in range(101)]}, "vertices", "at most 100 items"),
    "point twice": ({f"{FIXED}.0.shape.vertices": [[0, 0], [0, 0]]}, "vertices", "the same point twice in a row"),
    "off the map": ({f"{FIXED}.13.state": [40, 3, 0]}, "experiments.people", "fixed obstacle 14 is outside the map"),
    "too many": ({f"{MOVING}.count": [900, 900], f"{MOVING}.radius_m": [1, 1]}, "experiments.people", "no room for"),
    "no shapes": ({PEOPLE: {"count": [1, 2], "shapes": []}}, "obstacles.people.shapes=[]", "at least 1 item"),
    "two kinds": ({f"{PEOPLE}.shapes": [WALL]}, "obstacles.people.radius_m", "not a known key"),
    "no obstacles": ({"experiments.people.obstacles": [], FIXED: []}, "experiments.people", "has no obstacles"),
    "unknown motion": (
        {MOTION: {"name": "fly"}},
        "experiments.people.motion",
        "the name fly must be one of rotate, square",
    ),
    "no speed": ({f"{MOTION}.speed_m_s": 0}, "motion.speed_m_s=0", "greater than or equal to"),
    "too fast": ({f"{MOTION}.speed_m_s": 5}, "experiments.people", "the robot needs [5.0, 1.5] m/s"),
    "reversed range": ({f"{MOTION}.speed_m_s": [2, 1]}, "motion.speed_m_s=[2, 1]", "must be ordered, low to high"),
    "waypoint in an obstacle": (
        {MOTION: {**DRIVE, "points_m": [[2, 10], [8.5, 4.0]]}},
        "experiments.people",
        "touches a fixed obstacle near [",
    ),
    "waypoint off the map": (
        {MOTION: {**DRIVE, "points_m": [[2, 10], [25, 10]]}},
        "experiments.people",
        "waypoint 2, [25, 10], is outside the map of 20 x 20 m",
    ),
    "way through a wall": (
        {MOTION: {**DRIVE, "points_m": [[2, 10], [2, 14]]}},
        "experiments.people",
        "touches a fixed obstacle near [2.00, 11.50]",
    ),
    "turning on a wall": (
        {MOTION: {"name": "rotate", "steps": 60}, f"{FIXED}.13.state": [10.4, 10, 0]},
        "experiments.people",
        "the robot's path touches a fixed obstacle",
    ),
    "more than a turn": (
        {MOTION: {"name": "rotate", "steps": 60, "turned_rad": [0, 7]}},
        "motion.turned_rad.1=7",
        "less than or equal to 6.28",
    ),
    "turned drive": ({MOTION: {**DRIVE, "turned_rad": 1.0}}, "motion.turned_rad=1.0", "not a known key"),
    "endless": ({f"{MOTION}.steps": 10**6}, "experiments.people", "more than 2000000 readings"),
    "long": ({f"{MOTION}.steps": 40_000, f"{LIDAR}.number": 4}, "experiments.people", "longer than 30000"),
    "noise without std": ({f"{LIDAR}.std": None}, "robot.sensors.0", "need one another"),
    "std without noise": ({f"{LIDAR}.noise": False}, "robot.sensors.0", "need one another"),
    "beams too far apart": (
        {f"{LIDAR}.angle_range": 6.28, f"{LIDAR}.number": 2},
        "robot.sensors.0",
        "less than half a turn apart",
    ),
    "zone within the robot": (
        {"experiments.people.clear_radius_m": 0.2},
        "experiments.people",
        "less than the robot's radius of 0.3 m",
    ),
    "steps through walls": (
        {f"{MOVING}.radius_m": [0.15, 0.35], f"{MOVING}.behavior.speed_m_s": [0.3, 5.0], **BRIEF},
        "experiments.people",
        "move 0.5 m in a step and may pass through walls: expected less than 0.3 m, twice their smallest radius",
    ),
    "no free place": (
        {"robot.shape.radius": 4.3, "experiments.people.clear_radius_m": 5.0},
        "experiments.people",
        "no free place for a robot of radius 4.3 m",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_wrong_world_is_refused_with_key_and_reason(name):
    changes, key, reason = REFUSED[name]
    errors = [str(error) for error in world_errors(office(changes))]
    assert any(key in error and reason in error for error in errors), errors


ROOMS_REFUSED = {
    "another motion": (
        {"motions.goals": {"name": "rotate", "steps": 60}},
        "rooms need the motion random_goals, which avoids their walls, got rotate",
    ),
    "doors that are narrower than the robot": (
        {"rooms.floor.door_m": [0.6, 1.2]},
        "rooms.door_m begins at 0.6 m: expected more than the robot's 0.6 m",
    ),
    "corridors that are narrower than the robot": (
        {"rooms.floor.corridor_m": [0.5, 1.2]},
        "rooms.corridor_m begins at 0.5 m: expected more than the robot's 0.6 m",
    ),
    "more rooms than can be sampled": (
        {"world.width": 1000.0, "world.height": 1000.0},
        "a map of 1000 m has about 51200 rooms with sides of [2.5, 10.0] m, at most 1000 are allowed",
    ),
    "wide doors": ({"rooms.floor.door_m": [1.0, 3.5]}, "doors of 3.5 m are wider than the shortest side of 2.5 m"),
    "a share above one": ({"rooms.floor.corridor_share": 1.5}, "less than or equal to 1"),
    "sides out of order": ({"rooms.floor.side_m": [9.0, 3.0]}, "must be ordered, low to high"),
    "people that pass through walls": (
        {"obstacles.people.radius_m": [0.05, 0.1], "obstacles.people.behavior.speed_m_s": [0.3, 2.0]},
        "may pass through walls",
    ),
}


@pytest.mark.parametrize("name", ROOMS_REFUSED)
def test_rooms_that_cannot_be_are_refused(name):
    changes, reason = ROOMS_REFUSED[name]
    world = office(changes, ROOMS)
    for experiment in world["experiments"].values():  # they refer to the values when the file is composed
        experiment["motion"], experiment["rooms"] = world["motions"]["goals"], world["rooms"]["floor"]
        experiment["obstacles"] = list(world["obstacles"].values())
    errors = [str(error) for error in world_errors(world)]
    assert any(reason in error for error in errors), errors


ALLOWED = {
    "the office": {},
    "any field of view": {f"{LIDAR}.angle_range": 6.283185307179586, f"{LIDAR}.number": 361},
    "walls alone": {"experiments.people.obstacles": []},
    "waypoints": {MOTION: DRIVE},
    "a rotation": {MOTION: {"name": "rotate", "steps": 60}},
    "any start heading": {MOTION: {"name": "rotate", "steps": 60, "turned_rad": [-3.1416, 3.1416]}},
    "moving shapes": SHAPES,
    "fast among one another": {
        FIXED: None,
        "experiments.people.obstacles": [{**OFFICE["obstacles"]["people"], "radius_m": [0.05, 0.1], "behavior": FAST}],
    },
    "another step and window": {"world.step_time": 0.05, f"{MOTION}.steps": 333},
}


@pytest.mark.parametrize("name", ALLOWED)
def test_a_usual_world_is_accepted(name):
    assert [str(error) for error in world_errors(office(ALLOWED[name]))] == []
