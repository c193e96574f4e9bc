"""What the tests of ROS 1 and ROS 2 share: the log, programs beside the tests, and the maps of the batch."""

import os
import signal
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT

from repro.logs.messages import seconds
from repro.logs.options import WindowSettings
from repro.logs.scan_log import ScanLog
from repro.networks.predictor import load_predictor
from repro.prediction.stream import predict_map
from repro.prediction.windows import cut
from repro.ros.map_message import occupancy

EXAMPLE = ROOT / "examples" / "rooms.npz"
STEPS = 100


@contextmanager
def started(command: list[str], environment: dict[str, str], ready: str | Path, name: str = "") -> Iterator[Path]:
    """Run a program until the end of the block, from when it prints a text or creates a file; return its output."""
    end, log = time.monotonic() + 60, Path(environment["ROS_HOME"]) / f"{name or Path(command[0]).name}.log"
    with log.open("w") as output:
        process = subprocess.Popen(
            command, env=environment, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
        )
        try:
            is_file = isinstance(ready, Path)
            while not (ready.exists() if is_file else ready in log.read_text(errors="replace")):
                assert process.poll() is None, log.read_text(errors="replace")
                assert time.monotonic() < end, f"{command} is not ready: {log.read_text(errors='replace')}"
                time.sleep(0.1)
            yield log
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()


def wait_for(path: Path, output: Path) -> None:
    """Wait until a program, which prints an output, has made a file."""
    end = time.monotonic() + 120
    while not path.exists():
        assert time.monotonic() < end, f"{path} is missing: {output.read_text(errors='replace')}"
        time.sleep(0.1)


def batch_maps(log: ScanLog) -> dict[float, np.ndarray]:
    """Return the data of the OccupancyGrid of every window of a log by its time [s]."""
    predictor = load_predictor("rooms")
    windows = list(cut(log, WindowSettings((12.5, 12.5), STEPS), 0.1, 25.0))
    assert len(windows) == len(log) - STEPS + 1
    maps = (predict_map(predictor, window.scans, window.origin, window.stamp) for window in windows)
    return {each.stamp: occupancy(each.free, unknown=each.unknown) for each in maps}


def check_maps(received: Sequence[Any], maps: dict[float, np.ndarray], output: str) -> None:
    """Check that the OccupancyGrids of a node, which printed an output, are the maps of the batch."""
    assert "skipped" not in output, output
    assert [seconds(grid.header.stamp) for grid in received] == pytest.approx(list(maps), abs=1e-6), output
    for grid, data in zip(received, maps.values(), strict=True):
        assert np.array_equal(grid.data, data)
        assert grid.header.frame_id == "odom"
        assert (grid.info.width, grid.info.height) == (128, 128)
        assert grid.info.resolution == pytest.approx(25 / 128)
        assert (grid.info.origin.position.x, grid.info.origin.position.y) == (0, 0)
        assert grid.info.origin.orientation.w == 1
