import dataclasses
import os
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "2")

import pandas as pd
import pytest

import repro.config
from repro.config import NETWORKS, Encoding, Model, PairCounts, Training
from repro.metrics.names import METRICS
from repro.runs.directories import Data, Outputs, Run, RunConfig
from repro.runs.provenance import Status
from repro.simulation.recorder import record_experiment

ROOT = Path(__file__).parents[1]


def world_spec(experiment: str) -> dict[str, Any]:
    """What the configuration makes of an experiment, as plain values."""
    return repro.config.world_spec(repro.config.read_world(ROOT / "conf" / "world" / "paper.yaml"), experiment)


@pytest.fixture(params=["1", "2", "3", "4"])
def spec(request) -> dict[str, Any]:
    return world_spec(request.param)


@pytest.fixture(scope="session")
def recorded(tmp_path_factory) -> Path:
    """A small recorded experiment 3, to be read only."""
    directory = tmp_path_factory.mktemp("laptop") / "recordings" / "exp3"
    record_experiment(directory, world_spec("3"), {"train": 24, "val": 8, "test": 8}, workers=1)
    return directory


def run_config(**changes: Any) -> RunConfig:
    """The configuration of a small run; a baseline's name as `model` leaves out what only networks have."""
    decay, name = changes.pop("decay", True), changes.pop("model", "unet")
    data = Data(
        changes.pop("scale", "laptop"),
        changes.pop("size_px", 32),
        50.0,
        changes.pop("pairs", PairCounts(24, 8, 8)),
        "hash",
    )
    mine = {"learning_rate", "min_delta", "patience", "max_epochs", "flip_augmentation", "ema_decay"} & set(changes)
    settings = {key: changes.pop(key) for key in mine}
    train = Training(1e-3, 0.001, 5, 8, 3, 1e-6)
    is_network = name in NETWORKS
    config = RunConfig(
        "3",
        0,
        Model(name, "mit_b0") if is_network else Model(name),
        Encoding("projection", {"decay": decay, "oldest_gray": 0.8}),
        data,
        dataclasses.replace(train, **settings) if is_network else None,
    )
    return dataclasses.replace(config, **changes)


def prepared(path: Path, **changes: Any) -> Run:
    """A run directory with its config.yaml."""
    run = Run(path)
    run.prepare(run_config(**changes))
    return run


def fake_run(outputs, experiment, model, decay, seed, value, status=Status.evaluated, **changes) -> Run:
    """A run directory as evaluation leaves it, with every metric at one value."""
    run = Outputs(outputs).run(experiment, model, "decay" if decay else "no-decay", seed)
    run.prepare(run_config(experiment=experiment, model=model, decay=decay, seed=seed, **changes))
    pd.DataFrame([dict.fromkeys((*METRICS, "obstacle_iou"), value)]).to_csv(run.metrics, index=False)
    run.use_recordings("hash of recordings")
    if model in NETWORKS:
        facts = {"train_pairs": 24, "epochs": 3, "training_seconds": 1.0, "precision": "32-true"}
        run.begin_step("trained", Status.trained, **facts, weights_sha256=f"weights that score {value}")
    run.begin_step("evaluated", status, test_pairs=8)
    return run


def fake_study(outputs, seeds=(0,)) -> None:
    for seed in seeds:
        for rank, model in enumerate(NETWORKS):
            fake_run(outputs, "3", model, True, seed, 0.5 + 0.1 * rank + 0.01 * seed)
    fake_run(outputs, "3", "all_free", True, 0, 0.9)
