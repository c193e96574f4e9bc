"""Measure the costs of each network: parameters, operations, training time, memory, and latency from scans to map.

    python reproduce/costs.py reproduce/results/laptop

writes costs.csv there, at the resolution of those results and at that of the paper scale, and costs.png where the
results have an analysis. The time of a training is that of its steps on one CPU thread, measured over a few. The
latency is that of one window, the encoding of its 100 scans and the prediction: the median of 20 calls after a warm-up.
With --compile, the latency of the compiled networks is measured where torch.compile works, which takes a minute each.
Values that cannot be measured stay empty.
"""

import argparse
import dataclasses
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import torch
import yaml
from torch import Tensor, nn
from torch.utils.flop_counter import FlopCounterMode

from repro.config import NETWORKS, Model, Training, paper_model
from repro.learning.cost import seconds_per_image
from repro.learning.training import TrainingModule
from repro.maps.datasets import Pairs
from repro.maps.encodings import Encoding, create_encoding
from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.networks.create import create_network
from repro.networks.onnx_files import INPUT, OUTPUT, OnnxNetwork
from repro.networks.predictor import Predictor
from repro.reporting.comparison_figures import efficiency
from repro.reporting.figures import STYLE
from repro.reporting.rows import read_rows
from repro.reporting.tables import Table, costs_to_markdown
from repro.scans import Scans
from repro.system.devices import clock, one_thread, resolve_precision

MODELS = Path(__file__).parents[1] / "conf" / "model"
STEPS, BEAMS, PAPER_PX = 100, 100, 256
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
LATENCIES = ("cpu_eager_ms", "cpu_compiled_ms", "cpu_onnx_ms", "cuda_eager_ms", "cuda_compiled_ms")


def random_scans(device: str) -> Scans:
    """Draw random scans of one window."""
    generator = torch.Generator().manual_seed(0)
    ranges = 30 * torch.rand(STEPS, BEAMS, generator=generator)
    angles = torch.linspace(-torch.pi / 4, torch.pi / 4, BEAMS)
    poses = torch.tensor([25.0, 25.0, 0.0]).repeat(STEPS, 1)
    poses[..., 2] = torch.linspace(0, 2 * torch.pi, STEPS)
    return Scans(ranges, angles, poses).tensors(device)


def latency_ms(predictor: Predictor, device: str, repeat: int = 20) -> float:
    """Measure the median time from one window of scans to its predicted map [ms]."""
    scans, times = random_scans(device), []
    for _ in range(repeat + 3):
        began = clock(device)
        predictor.predict(scans)
        times.append(clock(device) - began)
    return 1000 * float(np.median(times[3:]))


def compiled(model: nn.Module, image: Tensor) -> nn.Module | None:
    """Return the compiled network, or None if torch.compile fails."""
    torch.compiler.reset()  # otherwise earlier networks count toward its limit of recompilations
    try:
        network: nn.Module = torch.compile(model)  # type: ignore[assignment]
        network(image)
    except Exception as error:
        print(f"torch.compile failed ({type(error).__name__}), continuing without it", file=sys.stderr)
        return None
    return network


def in_onnx_runtime(network: nn.Module, image: Tensor) -> OnnxNetwork:
    """Return the network in ONNX Runtime on the CPU."""
    program = torch.onnx.export(
        network, (image,), dynamo=True, external_data=False, verbose=False, input_names=[INPUT], output_names=[OUTPUT]
    )
    assert program is not None, "with dynamo"
    return OnnxNetwork(program.model_proto.SerializeToString())


def training_minutes(model: Model, encoding: Encoding, runs: pd.DataFrame) -> float:
    """Measure a few training steps on one CPU thread and return the time of a training of all published steps [min]."""
    with one_thread():
        size_px, precision = int(runs["size_px"].iloc[0]), resolve_precision("auto", "cpu")
        seconds = seconds_per_image(model, size_px, 16, precision, 6, encoding.channels, encoding.frames)
    return seconds * runs["train_pairs"].max() * runs["epochs"].max() / 60


def peak_training_gb(model: Model, encoding: Encoding, size_px: int, batch_size: int) -> float | None:
    """Measure the peak GPU memory of a training step in bf16 [GB]; None without a GPU."""
    if not torch.cuda.is_available():
        return None
    torch.cuda.reset_peak_memory_stats()
    image = torch.zeros(batch_size, encoding.channels, size_px, size_px, dtype=torch.uint8, device="cuda")
    pairs, settings = Pairs(image, image[:, :1], encoding), Training(1e-4, 0.001, 5, batch_size, 1, 1e-6)
    network = create_network(model, encoding.channels, encoding.frames)
    module = TrainingModule(network, pairs, pairs, settings, seed=0).cuda()
    optimizer = module.configure_optimizers()
    for _ in range(2):
        with torch.autocast("cuda", torch.bfloat16):
            loss = module.training_step((image.float(), image[:, :1].float()), 0)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return torch.cuda.max_memory_allocated() / 1e9


def measure(name: str, label: str, size_px: int, runs: pd.DataFrame, options: argparse.Namespace) -> dict[str, object]:
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
        "training_gpu_gb": peak_training_gb(model, encoding, size_px, options.batch_size),
    }
    row |= dict.fromkeys(LATENCIES)
    for device in ("cpu", "cuda") if torch.cuda.is_available() else ("cpu",):
        predictor = Predictor(network.to(device), encoding, grid)
        row[f"{device}_eager_ms"] = latency_ms(predictor, device)
        fast = compiled(network, image.to(device)) if options.compile else None
        if fast is not None:
            row[f"{device}_compiled_ms"] = latency_ms(dataclasses.replace(predictor, network=fast), device)
    row["cpu_onnx_ms"] = latency_ms(Predictor(in_onnx_runtime(network.cpu(), image), encoding, grid), "cpu")
    return row


def model_named(name: str) -> Model:
    """Return a model of the paper, or the one in conf/model."""
    return paper_model(name) if name in NETWORKS else Model(**yaml.safe_load((MODELS / f"{name}.yaml").read_text()))


def note(runs: pd.DataFrame) -> str:
    """Describe the measurements and the machine."""
    gpu = f", GPU: {torch.cuda.get_device_name()}" if torch.cuda.is_available() else ""
    return (
        f"Costs of the networks. Training: {runs['epochs'].max():.0f} epochs of {runs['train_pairs'].max():.0f} pairs "
        f"at {runs['size_px'].iloc[0]:.0f} px on one thread, from a few steps ({resolve_precision('auto', 'cpu')}). "
        "Latency: one window, from its scans to the predicted map. "
        f"CPU: {torch.get_num_threads()} threads{gpu}, torch {torch.__version__}."
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, help="directory of published results, such as reproduce/results/laptop")
    parser.add_argument("--batch-size", type=int, default=16, help="batch size for the GPU memory of training")
    parser.add_argument("--compile", action="store_true", help="also measure compiled networks")
    options = parser.parse_args()
    runs = pd.read_csv(options.results / "runs.csv")
    sizes = sorted({int(runs["size_px"].iloc[0]), PAPER_PX})
    table = pd.DataFrame([measure(*cell, size, runs, options) for size in sizes for cell in CELLS])
    table.to_csv(options.results / "costs.csv", index=False, float_format="%.4g")
    (options.results / "costs.txt").write_text(note(runs) + "\n", encoding="utf-8")
    intervals = options.results / "analysis" / "intervals.csv"
    if intervals.is_file():
        with plt.rc_context(STYLE):
            efficiency(read_rows(intervals), table).savefig(options.results / "costs.png", bbox_inches="tight", dpi=130)
    print(costs_to_markdown(Table(table, note(runs))))


if __name__ == "__main__":
    main()
