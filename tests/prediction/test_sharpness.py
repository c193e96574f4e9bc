"""Wrong conventions of the poses of a log, which blur its hits, are named."""

import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT

from repro.prediction.logs import ScanLog
from repro.prediction.readers import read_log
from repro.prediction.sharpness import sharper_convention
from repro.prediction.times import WindowSettings

WINDOWS = WindowSettings()


@pytest.fixture(scope="module")
def log() -> ScanLog:
    return read_log(ROOT / "examples" / "rooms.npz", WINDOWS)


def test_right_poses_have_no_message(log):
    assert sharper_convention(log, WINDOWS) is None
    assert sharper_convention(replace(log, poses=np.zeros_like(log.poses)), WINDOWS) is None, "it stands"


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda log: replace(log, poses=log.poses + np.array([0, 0, math.pi])), "turned by 180 degrees"),
        (lambda log: replace(log, poses=log.poses - np.array([0, 0, math.pi / 2])), "turned by 90 degrees"),
        (lambda log: replace(log, poses=log.poses * (1, 1, -1)), "headings of the opposite sign"),
        (lambda log: replace(log, poses=log.poses * (1, 1, -1) + (0, 0, math.pi / 2)), "clockwise from the y axis"),
        (lambda log: replace(log, poses=log.poses * (1, 1, math.degrees(1))), "in degrees"),
        (lambda log: replace(log, angles=-log.angles), "beams in the reverse order:"),
        (lambda log: replace(log, poses=log.poses * (-1, 1, 1)), "with x of the opposite sign"),
        (lambda log: replace(log, poses=log.poses * (1, -1, 1)), "with y of the opposite sign"),
        (lambda log: replace(log, poses=log.poses[:, [1, 0, 2]]), "with x and y exchanged:"),
        (lambda log: replace(log, poses=log.poses * (100, 100, 1)), "positions in cm"),
        (lambda log: replace(log, poses=log.poses * (1 / 0.3048, 1 / 0.3048, 1)), "positions in feet"),
        (lambda log: replace(log, poses=log.poses * (1000, 1000, 1)), "positions in mm"),
    ],
)
def test_the_convention_that_sharpens_the_hits_is_named(log, change, named):
    message = sharper_convention(change(log), WINDOWS)
    assert message is not None
    assert named in message
