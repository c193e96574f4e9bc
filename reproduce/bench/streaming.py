"""Benchmark the stream: one scan to one map, on one thread of the CPU, in ONNX Runtime, in torch and the plain way.

The times are CPU times, which on one thread are the latencies on an idle core, also where other processes run.
"""

import dataclasses
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from projection import plain_projection
from table import head, row

from repro.learning.networks.create import create_network
from repro.learning.networks.trained import TorchNetwork, export_onnx, load_trained
from repro.logs.formats import read_log
from repro.logs.options import WindowSettings
from repro.logs.scan_log import ScanLog
from repro.maps.encodings import create_encoding
from repro.maps.grid import Grid
from repro.networks.predictor import Predictor, load_predictor
from repro.prediction.stream import PredictionStream
from repro.prediction.windows import on_map
from repro.runs.devices import one_thread
from repro.runs.model import Model
from repro.scans import Scans

ROOT = Path(__file__).parents[2]
TARGET_MS = 20
STEPS, SCANS = 100, 130  # the first `STEPS` - 1 scans fill the window


def bench_streaming() -> None:
    """Print the median CPU time of an update, and of its encoding alone, at 128 and 256 px."""
    log = read_log(ROOT / "examples" / "rooms.npz", WindowSettings())
    unet = load_trained(ROOT / "reproduce/results/workstation/exp4-unet")
    series = create_encoding("series10", {"frames": 10})
    network = create_network(Model("convgru"), series.channels, series.frames).eval()  # not trained
    predictors = {"U-Net, projection": unet, "ConvGRU, series10": Predictor(TorchNetwork(network), series, unet.grid)}
    with one_thread():
        head(
            f"Stream: one scan to one map, 1 thread, target {TARGET_MS} ms at 128 px",
            *("network", "size", "plain", "torch", "ONNX Runtime", "to plain", "to torch", "encoding", "difference"),
        )
        for name, predictor in predictors.items():
            for size_px in (128, 256):
                _bench(name, dataclasses.replace(predictor, grid=Grid(size_px, unet.grid.size_m)), log)


def _bench(name: str, predictor: Predictor, log: ScanLog) -> None:
    origin = log.poses[STEPS - 1, :2] - predictor.grid.size_m / 2
    window = on_map(log.ranges[:STEPS], log.angles, log.poses[:STEPS], origin).batched()
    encoding_ms, _ = _timed(lambda: predictor.encoding.encode(window, predictor.grid))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.onnx"
        export_onnx(predictor, path)
        (torch_ms, maps), (onnx_ms, others) = (_update(ours, log) for ours in (predictor, load_predictor(path)))
    plain, to_plain = "-", "-"
    if predictor.encoding.name == "projection":
        plain_ms, _ = _timed(lambda: _plain_update(predictor, window))
        plain, to_plain = f"{plain_ms:.0f} ms", f"{plain_ms / onnx_ms:.1f} x"
    row(
        *(name, f"{predictor.grid.size_px} px", plain, f"{torch_ms:.0f} ms", f"{onnx_ms:.1f} ms", to_plain),
        *(f"{torch_ms / onnx_ms:.1f} x", f"{encoding_ms:.1f} ms", f"{np.abs(maps - others).max():.0e}"),
    )


def _plain_update(predictor: Predictor, window: Scans) -> np.ndarray:
    """Return the map of a window that is drawn anew point by point, by the network in torch."""
    image = plain_projection(window.ranges[0], window.angles, window.poses[0], predictor.grid.size_px)
    return predictor.predict_images([image[None, None].astype(np.uint8)])


def _timed(call: Callable[[], np.ndarray]) -> tuple[float, np.ndarray]:
    """Return the median CPU time of a call [ms], and its result."""
    times = []
    for _ in range(30):
        began = time.process_time()
        result = call()
        times.append(time.process_time() - began)
    return 1e3 * float(np.median(times)), result


def _update(predictor: Predictor, log: ScanLog) -> tuple[float, np.ndarray]:
    """Return the median time of an update with a full window [ms], and all maps."""
    stream, times, maps = PredictionStream(predictor, log.angles, steps=STEPS), [], []
    for scan in zip(log.ranges[:SCANS], log.poses[:SCANS], log.stamps[:SCANS], strict=True):
        began = time.process_time()
        predicted = stream.update(*scan)
        if predicted is not None:
            times.append(time.process_time() - began)
            maps.append(predicted.free)
    return 1e3 * float(np.median(times)), np.stack(maps)
