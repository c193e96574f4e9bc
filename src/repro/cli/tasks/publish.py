"""task=publish: copy the results of an outputs directory into reproduce/results, and its tables into the docs."""

import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from omegaconf import OmegaConf

from repro.cli.composition import CONF
from repro.cli.jobs import RESULTS, Job
from repro.cli.tasks.docs import update_docs
from repro.config import Scale, Training, plain
from repro.reporting.additions import add_to_published
from repro.reporting.paper import world_files
from repro.reporting.publish import Recipe, publish
from repro.runs.provenance import Status


def run(job: Job) -> None:
    """Publish the results and update the generated tables."""
    write = add_to_published if job.call.publish.add else publish
    recipe = Recipe(job.call.scale.name, overrides_of(job), usual_training(job.call.scale))
    target = write(job.outputs, RESULTS, recipe, force=job.call.publish.force)
    print(f"published {target}")
    update_docs()


def overrides_of(job: Job) -> str:
    """Return the overrides of world and scale that the runs of a job need, each after a space.

    Raises:
        ValueError: no file of conf/world has the worlds of all runs.
    """
    used = {run.config().data.worlds for run in job.outputs.runs() if run.status is Status.evaluated}
    names = world_files(used)
    if used and not names:
        raise ValueError(f"the runs in {job.outputs.path} have worlds of no file in conf/world: add one")
    scale = job.call.scale
    usual = plain(OmegaConf.load(CONF / "scale" / f"{scale.name}.yaml"))  # type: ignore[arg-type]
    world = [f" world={name}" for name in names[:1] if "paper" not in names]
    return "".join([*world, *changes("scale", asdict(scale), usual)])


def usual_training(scale: Scale) -> Training:
    """Return the training settings of a scale, those of conf/train/paper.yaml."""
    conf = {"scale": asdict(scale), "train": OmegaConf.load(CONF / "train" / "paper.yaml")}
    return Training(**plain(OmegaConf.create(conf))["train"])


def changes(path: str, values: dict[str, Any], usual: dict[str, Any]) -> Iterator[str]:
    """Yield the overrides of the values that differ from the usual ones, also in nested groups."""
    for key, value in values.items():
        if isinstance(value, dict):
            yield from changes(f"{path}.{key}", value, usual[key])
        elif value != usual[key]:
            yield f" {path}.{key}={json.dumps(value)}"
