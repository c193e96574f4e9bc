"""The clock of scans by its definition, and the windows of a stream against those of a log."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from repro.logs.log_scan import LogScan
from repro.logs.options import WindowSettings
from repro.logs.scan_log import collect
from repro.logs.times import Clock, ends_of, parts_of
from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.networks.predictor import Predictor
from repro.prediction.stream import PredictionStream
from repro.prediction.windows import Window, cut

WINDOWS = WindowSettings(steps=10)
ANGLES = np.linspace(-0.5, 0.5, 5)


def stream_windows(stamps: list[float]) -> dict[float, list[int]]:
    """Return the scans of the windows that a stream predicts, by their end."""
    predictor = Predictor(lambda images: images, Projection(), Grid(32, 50.0))
    stream, found = PredictionStream(predictor, ANGLES, steps=WINDOWS.steps), {}
    with pytest.MonkeyPatch.context() as patch:
        still = SimpleNamespace(any=lambda: False)

        def found_map(_, window, __, stamp, *others) -> SimpleNamespace:
            return SimpleNamespace(ranges=window.ranges, moving=still, stamp=stamp, outside_training=())

        patch.setattr("repro.prediction.stream.predict_map", found_map)
        for number, stamp in enumerate(stamps):
            window = stream.update(np.full(5, 1.0 + number), (0.01 * number, 0, 0), stamp)
            if window is not None:
                found[stamp] = (window.ranges[:, 0] - 1).astype(int).tolist()
    return found


@st.composite
def logs(draw) -> list[float]:
    """Return the times of a log at some rate, with gaps, jitter, wrong single times, and a clock that is set back."""
    count, rate = draw(st.integers(12, 60)), draw(st.sampled_from([4, 10, 20, 33]))
    jitter = draw(st.sampled_from([0.0, 0.3, 0.9]))
    random = np.random.default_rng(draw(st.integers(0, 999)))
    stamps = draw(st.sampled_from([0.0, 1.7e9])) + np.cumsum(1 + jitter * random.uniform(-1, 1, count)) / rate
    for place in draw(st.lists(st.integers(1, count - 1), max_size=2)):
        stamps[place:] += draw(st.sampled_from([0.15, 0.6, 1.01, 3.0, 30.0, -0.5, -2.0, -500.0]))
    for place in draw(st.lists(st.integers(0, count - 1), max_size=3)):
        stamps[place] += draw(st.sampled_from([-3.0, -1.0, -0.12, 0.04, 1.0, 2.0, 3.0, 1e4, -1e4]))
    return stamps.tolist()


@settings(max_examples=100, deadline=None)
@given(logs())
def test_the_windows_of_a_stream_are_those_of_the_log(stamps):
    """Bit by bit, since both stack the same scans: also at window starts and where single times are wrong."""
    scans = [
        LogScan(stamp, np.full(5, 1.0 + n), -0.5, 0.25, 0.0, 99.0, (0.01 * n, 0, 0)) for n, stamp in enumerate(stamps)
    ]
    expected = stream_windows(stamps)
    try:
        log = collect(scans, "log", WINDOWS)  # type: ignore[arg-type]
        windows = [window for window in cut(log, WINDOWS, 1e-9, 50.0) if isinstance(window, Window)]
    except ValueError as error:  # too few scans, or too short for a window
        if "prediction.spacing=distance" not in str(error):
            assert not expected.keys() & set(kept(stamps))  # but those of wrong times, as the scans after them tell
        return
    found = {window.stamp: (window.scans.ranges[:, 0] - 1).astype(int).tolist() for window in windows}
    assert found.items() <= expected.items()
    for end in expected.keys() - found.keys():  # the first windows of a log are full ones, if it goes on
        is_wrong = end not in log.stamps  # as the log knows by the scan after it
        assert is_wrong or end - stamps[expected[end][0]] < WINDOWS.duration_s


def kept(stamps: list[float]) -> list[float]:
    clock, found = Clock(WINDOWS), list[float]()
    for stamp in stamps:
        if clock.why_left_out(stamp) is None:
            found[len(found) - clock.replaces :] = [stamp]
    return found


@pytest.mark.parametrize("shift", [3.0, -500.0])
def test_a_gap_and_a_clock_that_is_set_begin_a_new_part_with_its_first_scan(shift):
    stamps = [0.1 * number + shift * (number >= 5) for number in range(10)]
    assert kept(stamps) == stamps
    assert parts_of(np.array(stamps), WINDOWS) == [(0, 5), (5, 10)]


@pytest.mark.parametrize("wrong_by", [0.72, 3.0, 1e4, -0.72, -3.0, -1e4])
@pytest.mark.parametrize("places", [[15], range(2, 30, 2)])
def test_a_wrong_time_costs_one_scan(places, wrong_by):
    right = 1000 + 0.1 * np.arange(30)
    wrong = right.copy()
    wrong[places] += wrong_by
    assert kept(wrong.tolist()) == pytest.approx(np.delete(right, places))


@pytest.mark.parametrize("wrong_by", [-1000.0, 999.0])
@pytest.mark.parametrize("place", range(20, 40))
def test_a_wrong_time_of_a_fast_lidar_divides_no_window(place, wrong_by):
    stamps = 1000 + np.arange(200) / 50
    stamps[place] += wrong_by
    found = np.array(kept(stamps.tolist()))
    assert parts_of(found, WINDOWS) == [(0, len(found))]


def test_scans_at_half_a_step_are_kept_at_the_times_of_today():
    """Float64 resolves 2e-7 s there, so that the time between two scans is below 0.05 s half of the time."""
    stamps = (1.7e9 + 0.05 * np.arange(50)).tolist()
    assert kept(stamps) == stamps


def test_a_stride_far_below_the_time_between_scans_ends_a_window_with_each():
    stamps = 0.1 * np.arange(30)
    assert ends_of(stamps, WINDOWS, 1e-12).tolist() == list(range(9, 30))
