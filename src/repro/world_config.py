"""What decides the worlds of an experiment: the files of conf/world and the parts of them that are read most."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf


def plain(config: DictConfig) -> dict[str, Any]:
    """Return a part of the configuration as plain values, its interpolations resolved."""
    return OmegaConf.to_container(config, resolve=True)  # type: ignore[return-value]


def read_world(path: Path) -> dict[str, Any]:
    """Load a file of conf/world with those in its defaults, interpolations resolved as in the whole configuration."""
    return plain(OmegaConf.create({"world": _merged(path)}))["world"]


def _merged(path: Path) -> DictConfig:
    """Return a file merged with the files beside it that its defaults name, in their order, as Hydra merges them."""
    content = OmegaConf.load(path)
    assert isinstance(content, DictConfig), f"{path} is not a mapping"
    names = content.pop("defaults", ["_self_"])
    parts = [content if name == "_self_" else _merged(path.with_name(f"{name}.yaml")) for name in names]
    return OmegaConf.merge(*parts)  # type: ignore[return-value]


def world_spec(world: dict[str, Any], experiment: str) -> dict[str, Any]:
    """Return the part of `world` that decides the worlds of an experiment, as `worlds.sample_world` takes it."""
    return {
        "experiment": experiment,
        "world": world["world"],
        "robot": world["robot"],
        **world["experiments"][experiment],
    }


def lidar_of(spec: Mapping[str, Any]) -> dict[str, Any]:
    """Return the lidar of a world, or of what decides the worlds."""
    return spec["robot"]["sensors"][0]


def populations(experiment: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the populations of obstacles of an experiment or a world spec, which may name one or a list of them."""
    obstacles = experiment["obstacles"]
    return obstacles if isinstance(obstacles, list) else [obstacles]


def is_moving(experiment: Mapping[str, Any]) -> bool:
    """Return whether any obstacles of an experiment or a world spec move."""
    return any(population.get("behavior") for population in populations(experiment))
