"""Scans, poses and times that do not fit together are named, with the convention that makes the hits sharper."""

import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT

from repro.logs.consistency import inconsistencies, note_on_blur, note_on_rare
from repro.logs.formats import read_log
from repro.logs.options import WindowSettings
from repro.logs.scan_log import ScanLog
from repro.simulation.sampling import sample_world
from repro.simulation.simulator import simulate
from repro.worlds.spec import read_world, world_spec

WINDOWS = WindowSettings()
LOG = read_log(ROOT / "examples" / "rooms.npz", WINDOWS)


def messages(**changed) -> str:
    """Return the messages about the example with other arrays."""
    return "\n".join(inconsistencies(replace(LOG, **changed), WINDOWS))


def first(scans: int) -> ScanLog:
    return replace(LOG, stamps=LOG.stamps[:scans], ranges=LOG.ranges[:scans], poses=LOG.poses[:scans])


def test_right_poses_have_no_message():
    assert not inconsistencies(LOG, WINDOWS)
    still = {name: np.repeat(getattr(LOG, name)[:1], len(LOG), axis=0) for name in ("poses", "ranges")}
    assert not messages(**still), "it stands"


@pytest.mark.parametrize(("lag_s", "named"), [(0.3, "0.3 s earlier"), (-0.2, "0.2 s later"), (-0.1, "0.1 s later")])
def test_an_offset_of_the_clocks_is_named(lag_s, named):
    later = [np.interp(LOG.stamps + lag_s, LOG.stamps, column) for column in LOG.poses.T]
    message = messages(poses=np.stack(later, axis=-1))
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
        (LOG.poses[:, [1, 0, 2]], "with x and y exchanged"),
        (LOG.poses * (100, 100, 1), "positions in cm"),
        (LOG.poses * (1000, 1000, 1), "positions in mm"),
        (-LOG.angles, "beams in the reverse order"),
        (LOG.poses + np.array([0, 0, math.radians(20)]), "turned by -20 degrees more: add -0.3491 rad"),
    ],
)
def test_the_convention_that_sharpens_the_hits_is_named(changed, named):
    assert named in messages(**{"poses" if changed.ndim == 2 else "angles": changed})


@pytest.mark.parametrize("scans", [200, 300])
def test_a_mirrored_lidar_is_named_in_short_logs(scans):
    log = first(scans)
    assert not inconsistencies(log, WINDOWS)
    (message,) = inconsistencies(replace(log, ranges=log.ranges[:, ::-1]), WINDOWS)
    assert "beams in the reverse order" in message


@pytest.mark.parametrize(
    "poses", [LOG.poses[:, [2, 0, 1]], LOG.poses * (1, 1, 0), LOG.poses * (1, 1, -0.5), LOG.poses[:1].repeat(300, 0)]
)
def test_hits_that_are_rarely_near_others_are_noted(poses):
    assert note_on_blur(LOG, WINDOWS) is None
    note = note_on_blur(replace(LOG, poses=poses), WINDOWS)
    assert note is not None
    assert "most of what the lidar sees moves, or columns, units" in note


@pytest.mark.parametrize("exp", ["3", "4"])
def test_worlds_where_all_moves_have_no_message(exp):
    scans = simulate(sample_world(world_spec(read_world(ROOT / "conf" / "world" / "paper.yaml"), exp), 3)).scans
    ranges, poses = (np.concatenate([array, array[::-1]] * 2) for array in (scans.ranges, scans.poses))
    log = ScanLog(0.1 * np.arange(len(ranges)), ranges, scans.angles, poses)
    assert not inconsistencies(log, WINDOWS)


def test_one_window_is_too_little():
    log = first(130)
    assert not inconsistencies(replace(log, ranges=log.ranges[:, ::-1]), WINDOWS)


def test_readings_that_come_again_while_the_robot_moves_are_named():
    message = messages(ranges=LOG.ranges[np.arange(len(LOG)) // 5 * 5])
    assert "exactly the readings of the scan before" in message
    assert "exactly the readings" in messages(ranges=np.repeat(LOG.ranges[:1], len(LOG), axis=0))
    assert not messages(ranges=np.full_like(LOG.ranges, np.inf)), "an empty place"


def test_scans_that_are_rare_for_their_steps_are_named():
    note = note_on_rare(np.arange(float(len(LOG))), WINDOWS)
    assert note == "a scan every 1 s, the steps of a window take 0.1 s: are these times in seconds?"
    assert note_on_rare(LOG.stamps, WINDOWS) is None
