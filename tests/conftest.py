import os
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "2")

import pytest

import repro.config
from repro.simulation.store import record_experiment

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


def run_config(**changes: Any) -> dict[str, Any]:
    """The config.yaml of a small run."""
    config = {
        "experiment": "3",
        "decay": True,
        "seed": 0,
        "model": {"name": "unet", "encoder_name": "mit_b0", "encoder_weights": None},
        "data": {"size_px": 32, "lightest": 0.8, "pairs": {"train": 24}, "worlds": "hash"},
        "train": {
            "learning_rate": 1e-3,
            "min_delta": 0.001,
            "patience": 5,
            "batch_size": 8,
            "max_epochs": 3,
            "dice_eps": 1e-6,
        },
    }
    for key, value in changes.items():
        section = next((s for s in ("model", "data", "train") if key in config[s]), None)
        (config[section] if section else config)[key] = value
    return config
