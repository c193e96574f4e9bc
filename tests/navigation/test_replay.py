"""The replay of a course: which one is chosen, what is recorded of it, and the files."""

import numpy as np
import pandas as pd
from conftest import ROOT
from PIL import Image

from repro.maps.grid import Grid
from repro.navigation.arms import CLASSICAL
from repro.navigation.courses import TURN_STEPS, sample_course
from repro.navigation.episodes import EVERY, Fleet
from repro.reporting.animation import telling_course, watch, write_replay
from repro.world_config import read_world, world_spec

SPEC = world_spec(read_world(ROOT / "conf" / "world" / "navigation.yaml"), "fast")


def outcomes(**seeds: str) -> pd.DataFrame:
    rows = [
        {"experiment": name, "seed": seed, "outcome": {"g": "goal", "c": "collision", "t": "timeout"}[letter]}
        for name, letters in seeds.items()
        for seed, letter in enumerate(letters)
    ]
    return pd.DataFrame(rows)


def test_the_course_is_the_first_one_of_the_fastest_world_that_tells_the_two_apart():
    own, other = outcomes(slow="gggg", fast="cggg"), outcomes(slow="cggg", fast="ctcc")
    assert telling_course(own, other) == ("fast", 2)
    assert telling_course(own, outcomes(slow="gggc", fast="tggg")) == ("slow", 3)
    assert telling_course(own, own) is None


def test_a_drive_is_recorded_from_the_end_of_the_turn_and_drawn(tmp_path):
    course, _ = sample_course(SPEC, 1)
    settings = {"inflation_m": 1.6, "weight": 20.0, "threshold": None}
    fleet = Fleet(SPEC, [course], CLASSICAL["keep"], settings, Grid(64, 50.0))
    drive = watch(fleet, "keep")
    steps = len(drive.recording.scans.ranges)
    assert steps == round(fleet.episodes[0].time_s / 0.1)
    assert len(drive.maps) == -(-steps // EVERY)
    assert np.array_equal(drive.recording.states, course.states[:, TURN_STEPS + 1 : TURN_STEPS + 1 + steps])
    assert np.array_equal(drive.recording.scans.poses[-1], fleet.poses[0])
    path = tmp_path / "replay.gif"
    write_replay([drive, drive], course.goals, path, size_m=50.0, range_max_m=30.0)
    with Image.open(path) as image:
        assert image.n_frames > len(drive.maps) / 2
