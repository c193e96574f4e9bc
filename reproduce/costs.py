"""Measure the costs of each network: parameters, operations, training time, and latency from scans to map.

    python reproduce/costs.py reproduce/results/laptop

writes costs.csv there, at the resolution of those results and at that of the paper scale. The time of a training is
that of its steps on one CPU thread, measured over a few. The latency is that of one window, the encoding of its 100
scans and the prediction: the median of 20 calls after a warm-up. Values that cannot be measured stay empty.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
import torch
import yaml
from torch.utils.flop_counter import FlopCounterMode

from repro.learning.kernels import accelerate, create_optimizer
from repro.learning.losses import MapLoss
from repro.learning.networks.create import create_network
from repro.learning.networks.trained import TorchNetwork, export_onnx
from repro.maps.encodings import Encoding, create_encoding
from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.networks.predictor import Predictor, load_predictor
from repro.reporting import documents
from repro.runs.devices import clock, one_thread, resolve_precision
from repro.runs.model import NETWORKS, Model, paper_model
from repro.scans import Scans

MODELS = Path(__file__).parents[1] / "conf" / "model"
STEPS, BEAMS, PAPER_PX = 100, 100, 256
BATCH = 16  # pairs of a measured training step
ENCODINGS = {
    "projection": Projection(),
    "stack10": create_encoding("stack10", {"frames": 10}),
    "series10": create_encoding("series10", {"frames": 10, "range_max_m": 30.0}),
}
CELLS = [  # networks and their inputs
    *((name, "projection") for name in NETWORKS),
    ("unet", "stack10"),
    *((name, "series10") for name in NETWORKS),
    *(("convlstm", "stack10"), ("convgru", "series10")),
]
LATENCIES = ("cpu_eager_ms", "cpu_onnx_ms", "cuda_eager_ms")


def random_scans() -> Scans:
    """Draw random scans of one window."""
    ranges = 30 * np.random.default_rng(0).random((STEPS, BEAMS))
    angles = np.linspace(-np.pi / 4, np.pi / 4, BEAMS)
    poses = np.column_stack([np.full((STEPS, 2), 25.0), np.linspace(0, 2 * np.pi, STEPS)])
    return Scans(ranges, angles, poses)


def latency_ms(predictor: Predictor, device: str, repeat: int = 20) -> float:
    """Measure the median time from one window of scans to its predicted map [ms]."""
    scans, times = random_scans(), []
    for _ in range(repeat + 3):
        began = clock(device)
        predictor.predict(scans)
        times.append(clock(device) - began)
    return 1000 * float(np.median(times[3:]))


def training_minutes(model: Model, encoding: Encoding, runs: pd.DataFrame, steps: int = 6) -> float:
    """Measure some training steps on one CPU thread and return the time of a training of all published steps [min]."""
    size_px, is_mixed = int(runs["size_px"].iloc[0]), resolve_precision("auto", "cpu") == "bf16-mixed"
    network = create_network(model, encoding.channels, encoding.frames)
    accelerate(network, "cpu")
    optimizer, loss = create_optimizer(network, learning_rate=1e-3), MapLoss()
    image = torch.rand(BATCH, encoding.channels, size_px, size_px).to(memory_format=torch.channels_last)
    with one_thread():
        for step in range(steps + 1):
            if step == 1:  # the first step is a warm-up
                began = time.process_time()  # other processes share the CPU
            with torch.autocast("cpu", torch.bfloat16, enabled=is_mixed):
                value = loss(network(image), image[:, :1])
            optimizer.zero_grad()
            value.backward()
            optimizer.step()
    seconds = (time.process_time() - began) / steps / BATCH
    return seconds * runs["train_pairs"].max() * runs["epochs"].max() / 60


def measure(name: str, label: str, size_px: int, runs: pd.DataFrame) -> dict[str, object]:
    """Measure one row of the table."""
    grid, model, encoding = Grid(size_px, 50.0), model_named(name), ENCODINGS[label]
    network = create_network(model, encoding.channels, encoding.frames).eval()
    image = torch.rand(1, encoding.channels, size_px, size_px)
    counter = FlopCounterMode(display=False)
    with counter:
        network(image)
    is_published = size_px == int(runs["size_px"].iloc[0])
    row: dict[str, object] = {
        "model": name,
        "encoding": label,
        "size_px": size_px,
        "parameters_m": sum(p.numel() for p in network.parameters()) / 1e6,
        "forward_gflop": counter.get_total_flops() / 1e9,
        "training_min": training_minutes(model, encoding, runs) if is_published else None,
    }
    row |= dict.fromkeys(LATENCIES)
    for device in ("cpu", "cuda") if torch.cuda.is_available() else ("cpu",):
        row[f"{device}_eager_ms"] = latency_ms(Predictor(TorchNetwork(network, device), encoding, grid), device)
    with tempfile.TemporaryDirectory() as folder:
        export_onnx(Predictor(TorchNetwork(network), encoding, grid), path := Path(folder) / "model.onnx")
        row["cpu_onnx_ms"] = latency_ms(load_predictor(path), "cpu")
    return row


def model_named(name: str) -> Model:
    """Return a model of the paper, or the one in conf/model."""
    return paper_model(name) if name in NETWORKS else Model(**yaml.safe_load((MODELS / f"{name}.yaml").read_text()))


def note(runs: pd.DataFrame) -> str:
    """Describe the measurements and the machine."""
    gpu = f", GPU: {torch.cuda.get_device_name()}" if torch.cuda.is_available() else ""
    return (
        f"Costs of the networks. Training: {runs['epochs'].max():.0f} epochs of {runs['train_pairs'].max():.0f} pairs "
        f"at {runs['size_px'].iloc[0]:.0f} px on one thread, from a few steps of {BATCH} pairs "
        f"({resolve_precision('auto', 'cpu')}). Latency: one window, from its scans to the predicted map. "
        f"CPU: {torch.get_num_threads()} threads{gpu}, torch {torch.__version__}."
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, help="directory of published results, such as reproduce/results/laptop")
    options = parser.parse_args()
    runs = pd.read_csv(options.results / "runs.csv")
    sizes = sorted({int(runs["size_px"].iloc[0]), PAPER_PX})
    table = pd.DataFrame([measure(*cell, size, runs) for size in sizes for cell in CELLS])
    table.to_csv(options.results / "costs.csv", index=False, float_format="%.4g")
    (options.results / "costs.txt").write_text(note(runs) + "\n", encoding="utf-8")
    print(documents.costs(table, note(runs)).to_markdown())


if __name__ == "__main__":
    main()
