"""Schema of the configuration, its resolvers, and its parts as plain values. The values are in conf/."""

import enum
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from omegaconf import MISSING, DictConfig, OmegaConf


class Task(enum.Enum):
    """What a call does."""

    all = "all"
    record = "record"
    train = "train"
    evaluate = "evaluate"
    report = "report"
    plan = "plan"
    world = "world"
    publish = "publish"
    export = "export"
    readme = "readme"


@dataclass
class Model:
    name: str = MISSING
    encoder_name: str = MISSING
    encoder_weights: str | None = None


@dataclass
class Pairs:
    train: int = MISSING
    val: int = MISSING
    test: int = MISSING


@dataclass
class Scale:
    name: str = MISSING
    size_px: int = MISSING
    pairs: Pairs = field(default_factory=Pairs)
    learning_rate: float = MISSING
    batch_size: int = MISSING
    max_epochs: int = MISSING


@dataclass
class Train:
    learning_rate: float = MISSING
    min_delta: float = MISSING
    patience: int = MISSING
    batch_size: int = MISSING
    max_epochs: int = MISSING
    dice_eps: float = MISSING


@dataclass
class Runtime:
    """What may differ from one call to the next without making another run of it."""

    workers: int = 2
    accelerator: str = "auto"
    precision: str = "auto"
    compile: bool = False
    max_minutes: float | None = None


@dataclass
class Config:
    task: Task = Task.all
    exp: str = MISSING
    decay: bool = True
    lightest: float = MISSING
    seed: int = 0
    outputs: str = MISSING
    world: dict[str, Any] = field(default_factory=dict)
    model: Model = field(default_factory=Model)
    scale: Scale = field(default_factory=Scale)
    train: Train = field(default_factory=Train)
    runtime: Runtime = field(default_factory=Runtime)
    run: str = MISSING


def known_experiment(exp: str, experiments: Collection[str]) -> str:
    """Gives `exp` back, or ends with an error that lists the experiments there are."""
    if str(exp) not in experiments:
        raise SystemExit(f"unknown experiment exp={exp}; there are exp={', '.join(map(str, experiments))}")
    return str(exp)


def place(task: Task, exp: str, run: str) -> str:
    """Where a task's files lie below the outputs directory."""
    if task in (Task.all, Task.train, Task.evaluate):
        return run
    return f"recordings/exp{exp}" if task is Task.record else "hydra"


def plain(config: DictConfig) -> dict[str, Any]:
    """A part of the configuration as plain values, the only form in which the other modules take it."""
    return OmegaConf.to_container(config, resolve=True)  # type: ignore[return-value]


def read_world(path: Path) -> DictConfig:
    """A file of conf/world by itself, its references meaning what they mean in the whole configuration."""
    return OmegaConf.create({"world": OmegaConf.load(path)}).world


def world_spec(world: DictConfig, experiment: str) -> dict[str, Any]:
    """What decides the worlds of an experiment, as `worlds.sample_world` takes it."""
    values = plain(world)
    return {
        "experiment": experiment,
        "world": values["world"],
        "robot": values["robot"],
        **values["experiments"][experiment],
    }
