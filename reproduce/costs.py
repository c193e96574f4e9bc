"""Measure the costs of each network: parameters, operations, training time, memory, and latency from scans to map.

    python reproduce/costs.py reproduce/results/laptop

writes costs.csv there, at the resolution of those results and at that of the paper scale. The latency is that of one
run, the projection of its 100 scans and the prediction: the median of 20 calls after a warm-up. Compilation is
measured if torch.compile works. Values that cannot be measured stay empty.
"""

import argparse
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from torch import Tensor, nn
from torch.utils.flop_counter import FlopCounterMode

from repro.config import NETWORKS, Training, paper_model
from repro.learning.training import TrainingModule
from repro.maps.datasets import Pairs
from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.networks.create import create_network
from repro.reporting.tables import Table, costs_to_markdown
from repro.scans import Scans
from repro.system.devices import clock

STEPS, BEAMS, PAPER_PX = 100, 100, 256
LATENCIES = ("cpu_eager_ms", "cpu_compiled_ms", "cpu_onnx_ms", "cuda_eager_ms", "cuda_compiled_ms")


def random_scans(device: str) -> Scans:
    """Draw random scans of one window."""
    generator = torch.Generator().manual_seed(0)
    ranges = 30 * torch.rand(STEPS, BEAMS, generator=generator)
    angles = torch.linspace(-torch.pi / 4, torch.pi / 4, BEAMS)
    poses = torch.tensor([25.0, 25.0, 0.0]).repeat(STEPS, 1)
    poses[..., 2] = torch.linspace(0, 2 * torch.pi, STEPS)
    return Scans(ranges, angles, poses).tensors(device)


def latency_ms(predict: Callable[[Tensor], object], grid: Grid, device: str, repeat: int = 20) -> float:
    """Measure the median time from one window of scans to its predicted map [ms]."""
    scans, encoding, times = random_scans(device), Projection(), []
    for _ in range(repeat + 3):
        began = clock(device)
        predict(encoding.to_input(encoding.encode(scans, grid)))
        times.append(clock(device) - began)
    return 1000 * float(np.median(times[3:]))


def compiled(model: nn.Module, image: Tensor) -> Callable[[Tensor], object] | None:
    """Return the compiled network, or None if torch.compile fails."""
    torch.compiler.reset()  # otherwise earlier networks count toward its limit of recompilations
    try:
        network = torch.compile(model)
        network(image)
    except Exception as error:
        print(f"torch.compile failed ({type(error).__name__}), continuing without it", file=sys.stderr)
        return None
    return network


def onnx(model: nn.Module, image: Tensor) -> Callable[[Tensor], object] | None:
    """Return the network in ONNX Runtime on the CPU, or None if that is not installed."""
    try:
        import onnxruntime
        import onnxscript  # noqa: F401
    except ImportError:
        return None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = torch.get_num_threads()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.onnx"
        torch.onnx.export(model, (image,), path, dynamo=True, external_data=False, verbose=False)
        session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    name = session.get_inputs()[0].name
    return lambda x: session.run(None, {name: x.numpy()})


def peak_training_gb(architecture: str, size_px: int, batch_size: int) -> float | None:
    """Measure the peak GPU memory of a training step in bf16 [GB]; None without a GPU."""
    if not torch.cuda.is_available():
        return None
    torch.cuda.reset_peak_memory_stats()
    image = torch.zeros(batch_size, 1, size_px, size_px, dtype=torch.uint8, device="cuda")
    pairs, settings = Pairs(image, image, Projection()), Training(1e-4, 0.001, 5, batch_size, 1, 1e-6)
    module = TrainingModule(create_network(paper_model(architecture)), pairs, pairs, settings, seed=0).cuda()
    optimizer = module.configure_optimizers()
    for _ in range(2):
        with torch.autocast("cuda", torch.bfloat16):
            loss = module.training_step((image.float(), image.float()), 0)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return torch.cuda.max_memory_allocated() / 1e9


def measure(architecture: str, size_px: int, batch_size: int) -> dict[str, object]:
    """Measure one row of the table."""
    grid, model = Grid(size_px, 50.0), create_network(paper_model(architecture)).eval()
    image = torch.rand(1, 1, size_px, size_px)
    counter = FlopCounterMode(display=False)
    with counter:
        model(image)
    row: dict[str, object] = {
        "model": architecture,
        "size_px": size_px,
        "parameters_m": sum(p.numel() for p in model.parameters()) / 1e6,
        "forward_gflop": counter.get_total_flops() / 1e9,
        "training_min": None,
        "training_gpu_gb": peak_training_gb(architecture, size_px, batch_size),
    }
    row |= dict.fromkeys(LATENCIES)
    with torch.inference_mode():
        for device in ("cpu", "cuda") if torch.cuda.is_available() else ("cpu",):
            row[f"{device}_eager_ms"] = latency_ms(model.to(device), grid, device)
            fast = compiled(model, image.to(device))
            if fast is not None:
                row[f"{device}_compiled_ms"] = latency_ms(fast, grid, device)
    session = onnx(model.cpu(), image)
    if session is not None:
        row["cpu_onnx_ms"] = latency_ms(session, grid, "cpu")
    return row


def note(runs: pd.DataFrame) -> str:
    """Describe the measurements and the machine."""
    gpu = f", GPU: {torch.cuda.get_device_name()}" if torch.cuda.is_available() else ""
    return (
        f"Costs of the networks. Training: minutes of a run at {runs['size_px'].iloc[0]:.0f} px, "
        f"{runs['train_pairs'].max():.0f} pairs, mean over all runs, possibly beside other work. "
        "Latency: one run, from its scans to the predicted map. "
        f"CPU: {torch.get_num_threads()} threads{gpu}, torch {torch.__version__}."
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, help="directory of published results, such as reproduce/results/laptop")
    parser.add_argument("--batch-size", type=int, default=16, help="batch size for the GPU memory of training")
    options = parser.parse_args()
    runs = pd.read_csv(options.results / "runs.csv")
    trained_px = int(runs["size_px"].iloc[0])
    sizes = sorted({trained_px, PAPER_PX})
    table = pd.DataFrame([measure(name, size, options.batch_size) for size in sizes for name in NETWORKS])
    minutes = table["model"].map(runs.groupby("model")["training_seconds"].mean() / 60)
    table["training_min"] = minutes.where(table["size_px"] == trained_px)
    table.to_csv(options.results / "costs.csv", index=False, float_format="%.3g")
    (options.results / "costs.txt").write_text(note(runs) + "\n", encoding="utf-8")
    print(costs_to_markdown(Table(table, note(runs))))


if __name__ == "__main__":
    main()
