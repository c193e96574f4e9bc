"""Misses that are none are noted by logs, streams and nodes, and misses of a lidar that reaches less far are not."""

import logging

import numpy as np
import pytest
from conftest import ROOT
from log_files import npz, read
from test_live_mapper import ANGLES, Robot, predictor_of
from test_live_mapper import scan as message

from repro.logs.options import WindowSettings
from repro.maps.projection import Projection
from repro.prediction.stream import PredictionStream

EXAMPLE = np.load(ROOT / "examples" / "rooms.npz")
RANGES, POSES, STAMPS = EXAMPLE["ranges"].astype(np.float32), EXAMPLE["poses"], EXAMPLE["stamps"]
SCANS = len(RANGES)


def lost(share: float) -> np.ndarray:
    return np.where(np.random.default_rng(0).random(RANGES.shape) < share, np.float32(np.inf), RANGES)


def changed(first: int, last: int, value: float) -> np.ndarray:
    ranges = RANGES.copy()
    ranges[:, first:last] = value
    return ranges


def stopped() -> np.ndarray:
    ranges = RANGES.copy()
    ranges[100:130] = 31.0
    return ranges


def scattered() -> np.ndarray:
    noise = np.random.default_rng(0).normal(0, 0.02, RANGES.shape)
    return np.where(RANGES < 8, RANGES, 8 + noise).astype(np.float32)


FAULTS = {  # ranges, maximum range, and what is seen
    "masked": (changed(30, 51, 31.0), 30.0, "21 of 91 beams miss in all "),
    "stopped": (stopped(), 30.0, " scans have misses only: "),
    "lost": (lost(0.4), 30.0, " of the readings miss between two equal hits: "),
    "sparse": (lost(0.9), 30.0, " of the readings are misses: "),
    "scattered": (scattered(), 8.0, "hits at the maximum range, 8 m: misses vary around it: set range_max_m=7.76"),
    "beyond": (RANGES, 6.0, " of the readings are beyond the maximum range, 6 m, such as "),
}
SOUND = {
    "example": (RANGES, 30.0),
    "short": (np.where(RANGES < 6, RANGES, np.float32(np.inf)), 6.0),
    "invalid": (changed(30, 51, np.nan), 30.0),
}


def of_log(ranges, range_max_m, path, caplog) -> list[str]:
    file = npz(path / "log.npz", ranges=ranges, angles=ANGLES, poses=POSES, stamps=STAMPS, range_max_m=range_max_m)
    return list(read(file).notes)


def of_stream(ranges, range_max_m, path, caplog) -> list[str]:
    stream = PredictionStream(predictor_of(Projection()), ANGLES, steps=SCANS + 1, step_s=0.1, range_max_m=range_max_m)
    for values, pose, stamp in zip(ranges, POSES, STAMPS, strict=True):
        if not np.isnan(values).all():
            stream.update(values, pose, stamp)
    return caplog.messages


def of_node(ranges, range_max_m, path, caplog) -> list[str]:
    robot = Robot(is_mounted=False, steps=SCANS + 1)
    robot.drive(SCANS, {step: message(step, ranges=ranges[step], range_max=range_max_m) for step in range(SCANS)})
    return robot.warnings


@pytest.mark.parametrize("way", [of_log, of_stream, of_node])
@pytest.mark.parametrize("fault", FAULTS)
def test_misses_that_are_none_are_noted(fault, way, tmp_path, caplog):
    ranges, range_max_m, seen = FAULTS[fault]
    with caplog.at_level(logging.WARNING):
        notes = way(ranges, range_max_m, tmp_path, caplog)
    assert any(seen in note for note in notes), notes
    assert len(notes) == len(set(notes)) <= 3, "once of each kind"


@pytest.mark.parametrize("way", [of_log, of_stream, of_node])
@pytest.mark.parametrize("kind", SOUND)
def test_real_misses_are_not(kind, way, tmp_path, caplog):
    with caplog.at_level(logging.WARNING):
        assert way(*SOUND[kind], tmp_path, caplog) == []


def test_a_beam_that_always_misses_is_real_for_a_lidar_that_does_not_turn(tmp_path):
    path = npz(tmp_path / "log.npz", ranges=changed(30, 51, 31.0), angles=ANGLES, stamps=STAMPS, poses=None)
    assert read(path, pose=(0.0, 0.0, 0.0)).notes == ()


def test_misses_may_be_taken_as_invalid(tmp_path):
    ranges, _, _ = FAULTS["sparse"]
    path = npz(tmp_path / "log.npz", ranges=ranges, angles=ANGLES, poses=POSES, stamps=STAMPS)
    free, invalid = (read(path, WindowSettings(steps=10, misses=misses)) for misses in ("free", "invalid"))
    assert np.array_equal(np.isinf(free.ranges), np.isnan(invalid.ranges))
    assert np.isinf(free.ranges).any()
    assert not invalid.notes
    with pytest.raises(ValueError, match="misses=lost: must be 'free' or 'invalid'"):
        WindowSettings(misses="lost")
