"""Benchmark an epoch of `learning.training` against the same epoch in plain PyTorch.

Every variant runs in a process of its own, since our training changes how its process frees memory.
"""

import multiprocessing
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from typing import Any

import lightning as L
import numpy as np
import torch
from table import head, row
from torch import nn
from torch.utils.data import DataLoader, TensorDataset

from repro.learning.kernels import accelerate
from repro.learning.losses import MapLoss
from repro.learning.networks.create import create_network
from repro.learning.training import TrainingModule, quiet
from repro.maps.encodings import Encoding, create_encoding
from repro.recordings.datasets import Pairs, packed
from repro.reporting.names import model_title
from repro.runs.config import Training
from repro.runs.devices import clock, resolve_device, resolve_precision
from repro.runs.model import NETWORKS, Model, paper_model
from repro.system.memory import keep_freed_memory

COLUMNS = ("model", "way", "images/s", "to plain")
SIZES = {  # pixels, batch, pairs of an epoch
    "cpu": [(64, 8, 96), (128, 8, 32), (256, 8, 16)],
    "cuda": [(256, 16, 2048)],
}
RECURRENT = "convgru"
WARM_UPS = 3  # epochs of a few steps, until a process keeps all the memory that a step needs
ROUNDS = 3  # the variants alternate, so that other load on the machine affects all of them
Epoch = Callable[[], float]  # returns its duration [s]
_epoch: Epoch  # of this process


def bench_training() -> None:
    """Compare our epoch with the plain one in every precision that this machine supports natively."""
    device = resolve_device()
    hardware = torch.cuda.get_device_name() if device == "cuda" else f"CPU, {torch.get_num_threads()} threads"
    for size_px, batch_size, pairs in SIZES[device]:
        head(f"Training at {size_px} px, batch {batch_size}, {hardware}", *COLUMNS)
        for cells in training_rows(device, size_px, batch_size, pairs):
            row(*cells)


def training_rows(device: str, size_px: int, batch_size: int, pairs: int) -> Iterator[tuple[str, ...]]:
    """Yield a row per network and variant: plain; ours in float32, in native bfloat16."""
    best = resolve_precision("auto", device)
    for name in (*NETWORKS, RECURRENT):
        arguments = (name, size_px, batch_size, pairs, device)
        ways: dict[str, tuple[Any, ...]] = {"plain, 32-true": (plain_epoch, *arguments)}
        for precision in sorted({"32-true", best}):
            ways[f"ours, {precision}"] = (our_epoch, *arguments, precision)
        with ExitStack() as processes:
            epochs = {way: _in_process(processes, *created) for way, created in ways.items()}
            for epoch in WARM_UPS * list(epochs.values()):
                epoch()
            rounds = [{way: epoch() for way, epoch in epochs.items()} for _ in range(ROUNDS)]
        times = {way: float(np.median([results[way] for results in rounds])) for way in ways}
        for way, seconds in times.items():
            ratio = times["plain, 32-true"] / seconds
            yield model_title(name), way, f"{pairs / seconds:.0f}", f"{ratio:.2f} x"


def _in_process(processes: ExitStack, create: Callable[..., Epoch], *arguments: Any) -> Epoch:
    """Create an epoch in a process of its own, which ends with the context."""
    context = multiprocessing.get_context("spawn")
    pool = processes.enter_context(ProcessPoolExecutor(1, context, _create_epoch, (create, arguments)))
    return lambda: pool.submit(_run_epoch).result()


def _create_epoch(create: Callable[..., Epoch], arguments: tuple[Any, ...]) -> None:
    global _epoch
    quiet()
    warnings.simplefilter("ignore")
    _epoch = create(*arguments)


def _run_epoch() -> float:
    return _epoch()


def encoding_of(name: str) -> Encoding:
    """Return the input of a network: the paper's image, a series for the recurrent network."""
    return create_encoding("series10", {"frames": 10}) if name == RECURRENT else create_encoding("projection", {})


def network_of(name: str) -> nn.Module:
    """Create a network without pretrained weights."""
    model, encoding = Model(name, None, None) if name == RECURRENT else paper_model(name), encoding_of(name)
    return create_network(model, encoding.channels, encoding.frames)


def plain_epoch(name: str, size_px: int, batch_size: int, pairs: int, device: str) -> Epoch:
    """Create an epoch in plain PyTorch: the same network, DataLoader, float32, eager."""
    model, loss = network_of(name).to(device), MapLoss()
    optimizer = torch.optim.Adam(model.parameters(), 1e-4)
    images = torch.rand(pairs, encoding_of(name).channels, size_px, size_px)
    maps = torch.rand(pairs, 1, size_px, size_px).round()
    loader = DataLoader(TensorDataset(images, maps), batch_size, shuffle=True, drop_last=True)

    def epoch() -> float:
        began = clock(device)
        for image, target in loader:
            optimizer.zero_grad()
            loss(model(image.to(device)), target.to(device)).backward()
            optimizer.step()
        return clock(device) - began

    return epoch


def our_epoch(name: str, size_px: int, batch_size: int, pairs: int, device: str, precision: Any) -> Epoch:
    """Create an epoch of the training loop of `learning.training`, without validation."""
    encoding = encoding_of(name)
    shape = (pairs, encoding.channels, size_px, size_px)
    images = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    maps = torch.from_numpy(images[:, :1] // 128).to(device)
    data = Pairs(packed(images, encoding).to(device), maps, encoding)
    network = network_of(name)
    accelerate(network, device)
    keep_freed_memory()
    module = TrainingModule(network, data, data, Training(1e-4, 0.001, 5, batch_size, 1, 1e-6), 0, MapLoss())

    def epoch() -> float:
        watch = EpochClock()
        trainer = L.Trainer(
            max_epochs=1, accelerator="gpu" if device == "cuda" else "cpu", devices=1, precision=precision,
            callbacks=[watch], logger=False, enable_checkpointing=False, limit_val_batches=0,
            enable_progress_bar=False, enable_model_summary=False,
        )  # fmt: skip
        trainer.fit(module)
        return watch.epoch_s

    return epoch


class EpochClock(L.Callback):
    """A clock of the epochs [s], without what Lightning does before and after."""

    epoch_s = 0.0

    def on_train_epoch_start(self, *_: Any) -> None:
        self.epoch_s -= time.perf_counter()

    def on_train_epoch_end(self, trainer: L.Trainer, module: TrainingModule) -> None:  # type: ignore[override]
        module.train_loss().item()  # waits for the GPU
        self.epoch_s += time.perf_counter()
