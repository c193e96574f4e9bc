"""Copy the results of an outputs directory into reproduce/results, and its tables into the docs."""

from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from repro.cli.documents import update_docs
from repro.cli.jobs import RESULTS, Job
from repro.config import NO_DECAY, Encoding, Scale, Training
from repro.fields import OLDEST_GRAY
from repro.networks.model import Model
from repro.reporting.paper import world_files
from repro.reporting.publish import publish
from repro.reporting.published_readme import Recipe, overrides
from repro.reporting.rows import changed
from repro.runs.config import flatten, settings_of
from repro.runs.provenance import Status
from repro.system.errors import InputError
from repro.system.places import conf_directory
from repro.world_config import plain


def publish_results(job: Job) -> None:
    """Publish the results and update the generated tables."""
    usual = partial(usual_settings, job.call.scale, job.call.world)
    recipe = Recipe(job.call.scale.name, overrides_of(job), usual)
    target = publish(job.outputs, RESULTS, recipe, force=job.call.publish.force)
    print(f"published {target}")
    update_docs()


def overrides_of(job: Job) -> str:
    """Return the overrides of world and scale that the runs of a job need, each after a space.

    Raises:
        ValueError: no file of conf/world has the worlds of all runs, conf/ has no file of a network or an encoding, or
            the call has another number of pairs or pixels.
    """
    scale = job.call.scale
    configs = [run.config() for run in job.outputs.runs() if run.status is Status.evaluated]
    for key in (config.key for config in configs if config.encoding):
        check_files(key.model, key.encoding.removesuffix(NO_DECAY))
    data = [config.data for config in configs]
    names = world_files({each.worlds for each in data})
    if data and not names:
        raise InputError(f"the runs in {job.outputs.path} have worlds of no file in conf/world: add one")
    for each in data:
        of_run = flatten({"size_px": each.size_px, "pairs": asdict(each.pairs)}, "scale.")
        of_call = flatten({"size_px": scale.size_px, "pairs": asdict(scale.pairs)}, "scale.")
        if missing := list(overrides(changed(of_run, of_call))):
            raise InputError(f"the runs in {job.outputs.path} have other data than this call: add{''.join(missing)}")
    usual = plain(OmegaConf.load(conf_directory() / "scale" / f"{scale.name}.yaml"))  # type: ignore[arg-type]
    world = [f" world={name}" for name in names[:1] if "paper" not in names]
    return "".join([*world, *changes("scale", asdict(scale), usual)])


def usual_settings(scale: Scale, world: dict[str, Any], model: str, encoding: str) -> dict[str, Any] | None:
    """Return the settings of a network and an encoding at a scale without overrides, see `reporting.rows`.

    None without a file in conf/ of one of them: a published network whose code has been deleted since.
    """
    files = _files(model, encoding)
    if not all(path.is_file() for path in files.values()):
        return None
    parts = {group: OmegaConf.load(path) for group, path in files.items()}
    shared = {"scale": asdict(scale), "world": world, "decay": True, "oldest_gray": OLDEST_GRAY}
    values = plain(OmegaConf.create({**shared, **parts}))
    return settings_of(Model(**values["model"]), Encoding(**values["encoding"]), Training(**values["train"]))


def check_files(model: str, encoding: str) -> None:
    """Check that conf/ has the files of a network and an encoding, which the published command names.

    Raises:
        ValueError: one is missing.
    """
    for group, path in _files(model, encoding).items():
        if not path.is_file():
            raise InputError(f"the published command needs a file of {group} {path.stem}: add {path}")


def _files(model: str, encoding: str) -> dict[str, Path]:
    names = {"model": model, "encoding": encoding, "train": "paper"}
    return {group: conf_directory() / group / f"{name}.yaml" for group, name in names.items()}


def changes(path: str, values: dict[str, Any], usual: dict[str, Any]) -> Iterator[str]:
    """Yield the overrides of the values that differ from the usual ones, also in nested groups."""
    return overrides(changed(flatten(values, f"{path}."), flatten(usual, f"{path}.")))
