import math

import numpy as np
import pytest

from repro.worlds.obstacle_motions import Drift
from repro.worlds.robot_motions import Square, drive_of, integrated


@pytest.mark.parametrize("direction", [1, -1])
def test_rotation_is_one_full_turn_without_driving(direction):
    commands = drive_of({"name": "rotate", "steps": 100, "direction": direction}).commands(0.1)
    assert commands.shape == (100, 2)
    assert not commands[:, 0].any()
    assert commands[:, 1].sum() * 0.1 == pytest.approx(direction * 2 * math.pi)


def square(*, first_steps: int, direction: int = 1) -> np.ndarray:
    behavior = {"name": "square", "side_m": 10, "drive_steps": 20, "turn_steps": 5, "first_steps": first_steps}
    return drive_of({**behavior, "direction": direction}).commands(0.1)


@pytest.mark.parametrize("direction", [1, -1])
def test_square_ends_where_it_began(direction):
    commands = square(first_steps=7, direction=direction)
    assert commands.shape == (100, 2)
    heading, position, corners = 0.0, np.zeros(2), []
    for speed, turn in commands:
        position = position + speed * 0.1 * np.array([math.cos(heading), math.sin(heading)])
        heading += turn * 0.1
        corners.append(position)
    assert np.allclose(position, 0, atol=1e-9)
    assert heading == pytest.approx(direction * 2 * math.pi)
    spread = np.ptp(corners, axis=0)
    assert np.allclose(spread, 10)


@pytest.mark.parametrize("first_steps", [0, 10, 20])
def test_a_square_turns_after_its_first_steps(first_steps):
    turning = square(first_steps=first_steps)[:, 0] == 0
    assert np.flatnonzero(turning)[:6].tolist() == [*range(first_steps, first_steps + 5), first_steps + 25]
    with pytest.raises(ValueError, match=r"between 0 and drive_steps=20"):
        Square(name="square", side_m=10.0, drive_steps=20, turn_steps=5, first_steps=21)


def test_unknown_robot_behavior_lists_the_known_ones():
    with pytest.raises(ValueError, match=r"rotate.*square.*got 'dash'"):
        drive_of({"name": "dash"}).commands(0.1)


def track(obstacle: Drift, start: tuple[float, float], steps: int) -> np.ndarray:
    points = [start]
    for _ in range(steps):
        vx, vy = obstacle.velocity(*points[-1], 0.1)
        points.append((points[-1][0] + 0.1 * vx, points[-1][1] + 0.1 * vy))
    return np.array(points)


def drift(seed: int = 0, **changes) -> Drift:
    options = {"speed_m_s": 2.0, "turn_steps": (20, 40), "center_m": (25.0, 25.0), "keep_out_m": 6.0}
    return Drift(seed=seed, **{**options, **changes})


@pytest.mark.parametrize("seed", range(5))
def test_drift_has_constant_speed_and_straight_stretches_of_the_given_length(seed):
    steps = np.diff(track(drift(seed, keep_out_m=0.0), (5.0, 5.0), 400), axis=0)
    assert np.allclose(np.linalg.norm(steps, axis=1), 0.2)
    turns = np.flatnonzero(np.abs(np.diff(steps, axis=0)).max(axis=1) > 1e-9) + 1
    stretches = np.diff([0, *turns])
    assert stretches.min() >= 20
    assert stretches.max() <= 40


@pytest.mark.parametrize("seed", range(20))
def test_drift_never_enters_the_zone(seed):
    points = track(drift(seed, speed_m_s=8.0), (25.0, 33.0), 600)
    assert np.linalg.norm(points - 25, axis=1).min() >= 6.0 - 1e-9


@pytest.mark.parametrize("steps", [7, 100, 200])
def test_a_drive_turns_and_drives_within_its_rates_and_arrives(steps):
    points = [[1.0, 1.0], [4.0, 1.0], [4.0, 3.0], [1.0, 1.0]]
    behavior = {"name": "waypoints", "points_m": points, "speed_m_s": 0.7, "turn_rad_s": 1.1, "steps": steps}
    commands = drive_of({**behavior, "direction": 1}).commands(0.1)
    assert commands.shape == (steps, 2)
    assert np.abs(commands).max(axis=0) == pytest.approx([0.7, 1.1 if steps > 40 else 0.0], abs=0.03)
    assert (np.abs(commands) <= [0.7, 1.1]).all()
    assert not (commands != 0).all(axis=1).any()  # it turns in place
    path = integrated(commands, [1.0, 1.0, 0.0], 0.1)[:, :2]
    reached = [np.linalg.norm(path - point, axis=1).min() < 1e-9 for point in points]
    assert reached == ([True] + [False] * 2 + [True] if steps == 7 else [True] * 4)
    assert steps < 200 or not commands[-1].any()  # it stands still at the end


def test_a_drive_backwards_passes_the_same_places():
    points = [[1.0, 1.0], [4.0, 1.5], [2.0, 3.0], [9.0, 9.0]]
    drive = {"name": "waypoints", "points_m": points, "speed_m_s": 1.3, "turn_rad_s": 0.9, "steps": 90}
    ahead, behind = (drive_of({**drive, "direction": direction}) for direction in (1, -1))
    there, back = (integrated(motion.commands(0.1), motion.start(10.0, 0.1), 0.1) for motion in (ahead, behind))
    assert np.allclose(back[::-1, :2], there[:, :2], atol=1e-9)
    assert np.allclose(np.cos(back[::-1, 2] - there[:, 2]), -1)
    assert (behind.commands(0.1)[:, 0] >= 0).all()  # it drives ahead
