"""MCAP files, read by Foxglove's reader and by ours."""

from dataclasses import replace

import numpy as np
import pytest
from mcap_ros2.reader import read_ros2_messages

from repro.prediction.logs import ScanLog
from repro.prediction.mcap import write_mcap
from repro.prediction.readers import read_log
from repro.prediction.ros import occupancy
from repro.prediction.stream import StreamMap
from repro.prediction.times import WindowSettings

SCANS, BEAMS = 25, 31
STAMPS = 1e9 + 0.1 * np.arange(SCANS)
POSES = np.stack([0.1 * np.arange(SCANS), -0.05 * np.arange(SCANS), 0.2 * np.arange(SCANS)], axis=-1)
RANGES = np.random.default_rng(0).uniform(1, 40, (SCANS, BEAMS)).astype(np.float32)
RANGES[:, 3] = np.inf
LOG = ScanLog(STAMPS, RANGES, np.linspace(-1, 1, BEAMS), POSES)
MAPS = [
    StreamMap(np.random.default_rng(step).random((16, 16)), (step - 5.0, 3.0), 0.25, STAMPS[step]) for step in (9, 19)
]


def test_foxglove_reads_the_messages(tmp_path):
    write_mcap(tmp_path / "log.mcap", LOG, iter(MAPS), 30.0)
    messages: dict[str, list] = {}
    times = []
    for message in read_ros2_messages(tmp_path / "log.mcap"):
        messages.setdefault(message.channel.topic, []).append(message.ros_msg)
        times.append(message.log_time_ns)
    assert {topic: len(sent) for topic, sent in messages.items()} == {
        "/tf": SCANS,
        "/scan": SCANS,
        "/pose": SCANS,
        "/predicted_map": len(MAPS),
    }
    assert times == sorted(times)
    for step, (scan, pose, tf) in enumerate(zip(messages["/scan"], messages["/pose"], messages["/tf"], strict=True)):
        assert scan.header.stamp.sec + 1e-9 * scan.header.stamp.nanosec == pytest.approx(STAMPS[step], abs=1e-6)
        assert np.array_equal(np.array(scan.ranges, np.float32), RANGES[step])
        assert scan.range_max > RANGES[np.isfinite(RANGES)].max()
        assert (pose.pose.position.x, pose.pose.position.y) == pytest.approx(POSES[step, :2])
        (transform,) = tf.transforms
        assert (transform.header.frame_id, transform.child_frame_id) == (pose.header.frame_id, scan.header.frame_id)
    for grid, expected in zip(messages["/predicted_map"], MAPS, strict=True):
        assert list(grid.data) == occupancy(expected.free).tolist()
        assert (grid.info.origin.position.x, grid.info.origin.position.y) == expected.origin
        assert grid.header.frame_id == "map"


CROPPED = replace(LOG, ranges=np.ascontiguousarray(LOG.ranges[:, ::-1])).crop(1.0)


@pytest.mark.parametrize("log", [LOG, CROPPED])
def test_our_reader_reads_the_log_again(log, tmp_path):
    write_mcap(tmp_path / "log.mcap", log, iter(MAPS), 30.0)
    assert list(tmp_path.iterdir()) == [tmp_path / "log.mcap"]
    again = read_log(tmp_path / "log.mcap", WindowSettings())
    assert np.array_equal(again.ranges, log.ranges)
    assert again.poses == pytest.approx(POSES, abs=1e-6)
    assert again.angles == pytest.approx(log.angles, abs=1e-6)
    assert again.skipped == {}


@pytest.mark.parametrize("shift", [-2e9, 2e9])
def test_times_that_ros_does_not_have_are_an_error(shift, tmp_path):
    with pytest.raises(ValueError, match=r"an MCAP takes 0 to 2\*\*31"):
        write_mcap(tmp_path / "a.mcap", ScanLog(STAMPS + shift, RANGES, LOG.angles, POSES), [], 30.0)
    assert not list(tmp_path.iterdir())
