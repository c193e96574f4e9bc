"""Wrong conventions of the poses of a log, which blur its hits, are named."""

import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT

from repro.logs.formats import read_log
from repro.logs.options import WindowSettings
from repro.logs.sharpness import sharper_convention

WINDOWS = WindowSettings()
LOG = read_log(ROOT / "examples" / "rooms.npz", WINDOWS)


def test_right_poses_have_no_message():
    assert sharper_convention(LOG, WINDOWS) is None
    assert sharper_convention(replace(LOG, poses=np.zeros_like(LOG.poses)), WINDOWS) is None, "it stands"


@pytest.mark.parametrize(("lag_s", "named"), [(0.3, "0.3 s earlier"), (-0.2, "0.2 s later"), (-0.1, "0.1 s later")])
def test_an_offset_of_the_clocks_is_named(lag_s, named):
    later = [np.interp(LOG.stamps + lag_s, LOG.stamps, column) for column in LOG.poses.T]
    message = sharper_convention(replace(LOG, poses=np.stack(later, axis=-1)), WINDOWS)
    assert message is not None
    assert f"with the poses of {named}: the clocks of scans and poses differ" in message


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        (LOG.poses + np.array([0, 0, math.pi]), "turned by 180 degrees"),
        (LOG.poses - np.array([0, 0, math.pi / 2]), "turned by 90 degrees"),
        (LOG.poses * (1, 1, -1), "headings of the opposite sign"),
        (LOG.poses * (1, 1, -1) + (0, 0, math.pi / 2), "clockwise from the y axis"),
        (LOG.poses * (1, 1, math.degrees(1)), "in degrees"),
        (LOG.poses * (-1, 1, 1), "with x of the opposite sign"),
        (LOG.poses * (1, -1, 1), "with y of the opposite sign"),
        (LOG.poses[:, [1, 0, 2]], "with x and y exchanged:"),
        (LOG.poses * (100, 100, 1), "positions in cm"),
        (LOG.poses * (1000, 1000, 1), "positions in mm"),
        (-LOG.angles, "beams in the reverse order:"),
    ],
)
def test_the_convention_that_sharpens_the_hits_is_named(changed, named):
    message = sharper_convention(replace(LOG, **{"poses" if changed.ndim == 2 else "angles": changed}), WINDOWS)
    assert message is not None
    assert named in message
