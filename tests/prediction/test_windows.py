from dataclasses import replace

import numpy as np
import pytest

from repro.logs.options import WindowSettings
from repro.logs.scan_log import ScanLog
from repro.maps.statistics import Statistics
from repro.prediction.windows import Window, cut, spaced_by_distance

WINDOWS = WindowSettings(steps=10)
PLACE = (0.5, 50.0)  # stride [s] and side of the map [m]
NO_PATH = {"path_m": (0.0,) * 5}


def log_of(stamps: np.ndarray) -> ScanLog:
    """Return a log whose ranges and x are the time since its first scan."""
    since = stamps - stamps[0]
    poses = np.stack([since, 100 + 0 * since, 2 * since], axis=-1)
    return ScanLog(stamps, np.repeat(since[:, None], 3, axis=1).astype(np.float32), np.array([-0.1, 0, 0.1]), poses)


def test_windows_end_at_every_stride():
    windows = list(cut(log_of(1000 + np.arange(0, 3.01, 0.1)), WINDOWS, *PLACE))
    assert [window.number for window in windows] == [1, 2, 3, 4, 5]
    assert [window.stamp - 1000 for window in windows] == pytest.approx([0.9, 1.4, 1.9, 2.4, 2.9])
    assert windows[1].scans.ranges[:, 0] == pytest.approx(np.arange(0.5, 1.41, 0.1))
    assert windows[1].following.ranges[0, 0] == pytest.approx(1.5)


@pytest.mark.parametrize("rate", [7, 10, 23, 40])
def test_a_step_takes_the_scan_nearest_in_time(rate):
    stamps = np.arange(0, 4, 1 / rate)
    for window in cut(log_of(stamps), WINDOWS, *PLACE):
        times = window.stamp - 0.1 * np.arange(9, -1, -1)
        nearest = np.abs(window.scans.ranges[:, 0] - times)
        assert (nearest[1:] <= 0.5 / rate + 1e-5).all()
        assert nearest[0] <= max(0.5 / rate, 0.05) + 1e-5, "the first scan of a log may be half a step late"


@pytest.mark.parametrize("rate", [1.5, 4, 6, 7, 10, 23])
@pytest.mark.parametrize("start", [0.0, 1.7e9])
def test_a_window_ends_at_the_time_of_its_last_scan(rate, start):
    """So that the map is where the robot was at that time, also if the lidar is slower than the steps."""
    stamps = start + np.arange(0, 6, 1 / rate)
    windows = list(cut(log_of(stamps), WINDOWS, *PLACE))
    assert all(isinstance(window, Window) for window in windows)
    ends = [window.stamp for window in windows]
    assert set(ends) <= set(stamps)
    assert sorted(set(ends)) == ends
    assert np.diff(ends).max() <= max(0.5, 1 / rate) + 1 / rate
    for window in windows:
        assert (np.abs(window.scans.poses[:, 2]) <= np.pi).all()
        assert window.scans.ranges[-1, 0] == pytest.approx(window.stamp - stamps[0], abs=1e-5)
        assert window.origin[0] + 25 == pytest.approx(window.stamp - stamps[0], abs=1e-5)


@pytest.mark.parametrize(
    ("center", "origins"), [("robot", [0.9, 1.4]), ("start", [0.0, 0.0]), ([10, 100], [10.0, 10.0])]
)
def test_the_map_is_centered_as_asked(center, origins):
    windows = list(cut(log_of(np.arange(0, 1.5, 0.1)), replace(WINDOWS, center=center), *PLACE))
    for window, x in zip(windows, origins, strict=True):
        assert window.origin == pytest.approx((x - 25, 75))
        assert window.scans.poses[:, :2] + window.origin == pytest.approx(
            np.stack([window.scans.ranges[:, 0], np.full(10, 100)], axis=-1), abs=1e-5
        )


def test_a_gap_divides_a_log():
    stamps = np.concatenate([np.arange(0, 2, 0.1), np.arange(3, 3.5, 0.1), np.arange(5000.05, 5001.6, 0.1)])
    found = list(cut(log_of(stamps), WINDOWS, *PLACE))
    windows = [part for part in found if isinstance(part, Window)]
    assert [window.number for window in windows] == [1, 2, 3, 4, 5]
    assert [window.stamp for window in windows] == pytest.approx([0.9, 1.4, 1.9, 5000.95, 5001.45])
    assert windows[2].following is None, "the scan after the gap is not the next one"
    assert windows[3].following.ranges[0, 0] == pytest.approx(5001.05)
    assert windows[3].scans.ranges[:, 0] == pytest.approx(np.arange(5000.05, 5001, 0.1))
    assert [part for part in found if isinstance(part, str)] == [
        "no scans for 1.1 s before 3.00 s",
        "0.4 s of scans from 3.00 s, a window takes 0.9 s",
        "no scans for 4996.7 s before 5000.05 s",
    ]


def test_a_clock_that_is_set_back_divides_a_log():
    found = list(cut(log_of(np.concatenate([np.arange(0, 1.05, 0.1), np.arange(-20, -18.95, 0.1)])), WINDOWS, *PLACE))
    assert [part for part in found if isinstance(part, str)] == ["the time goes back by 21.0 s to -20.00 s"]


def test_a_short_log_is_refused():
    with pytest.raises(ValueError, match=r"the log has 0.5 s of scans, a window of 10 steps takes 0.9 s"):
        list(cut(log_of(np.arange(0, 0.55, 0.1)), WINDOWS, *PLACE))
    with pytest.raises(ValueError, match=r"the log has 0.5 s of scans without a gap, a window of 10 steps"):
        list(cut(log_of(np.concatenate([np.arange(0, 0.55, 0.1), np.arange(3, 3.45, 0.1)])), WINDOWS, *PLACE))


def test_times_of_scans_that_are_too_rare_are_lost():
    stamps = 3.4 * np.arange(50)
    log = ScanLog(stamps, np.full((50, 2), 5.0, np.float32), np.array([-0.1, 0.1]), np.zeros((50, 3)))
    with pytest.raises(ValueError, match=r"steps of 0.1 s need one every 1 s: use prediction.spacing=distance"):
        list(cut(log, WindowSettings(steps=20), 1.0, 50.0))
    assert all(isinstance(window, Window) for window in cut(log, WindowSettings(steps=20, step_s=3.4), 1.0, 50.0))


def test_a_window_of_a_cropped_log_has_the_other_beams_of_its_last_scan():
    log = log_of(np.arange(0, 1.5, 0.1))
    wide = replace(log, ranges=np.repeat(log.ranges, 2, axis=1)[:, :5], angles=np.linspace(-1, 1, 5))
    for window, cropped in zip(cut(wide, WINDOWS, *PLACE), cut(wide.crop(1.2), WINDOWS, *PLACE), strict=True):
        assert window.held_out is None
        assert cropped.scans.ranges.shape == (10, 3)
        held_out = cropped.held_out.ranges[0]
        assert np.isnan(held_out[1:4]).all()
        assert held_out[[0, 4]] == pytest.approx(window.scans.ranges[-1, [0, 4]])
        assert cropped.held_out.poses == pytest.approx(window.scans.poses[-1:])


def test_windows_spaced_by_distance_are_as_long_as_those_of_the_training():
    log, usual = log_of(0.5 * np.arange(61)), Statistics(1, {"path_m": (1.0, 2.0, 10.0, 20.0, 30.0)})  # 0.5 m a scan
    found = spaced_by_distance(log, WINDOWS, usual)
    assert (found.spacing, found.step_s) == ("distance", pytest.approx(2.0))  # 10 steps of two scans are 10 m
    short = replace(usual, quantiles={"path_m": (0.0, 0.0, 0.1, 1.0, 1.0)})
    assert spaced_by_distance(log, WINDOWS, short).step_s == pytest.approx(1.0), "ten different scans"
    for standing, statistics in ((replace(log, poses=0 * log.poses), usual), (log, replace(short, quantiles=NO_PATH))):
        with pytest.raises(ValueError, match="its scans cannot be spaced by distance"):
            spaced_by_distance(standing, WINDOWS, statistics)


def test_refusals_of_windows_spaced_by_distance_count_scans():
    log, spaced = log_of(np.arange(50.0)), replace(WINDOWS, spacing="distance")
    with pytest.raises(ValueError, match=r"the log has 50 scans, a window of 10 steps takes 90, a path as long"):
        log.check_times(replace(spaced, step_s=10.0))
    with pytest.raises(ValueError, match=r"1000 steps are too many for windows of 10 scans"):
        log.check_times(replace(spaced, steps=1000, step_s=0.01))
