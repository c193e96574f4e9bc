"""task=publish: copy the results of an outputs directory into reproduce/results, and its tables into the docs."""

import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from omegaconf import OmegaConf

from repro.cli.composition import CONF
from repro.cli.jobs import RESULTS, Job
from repro.cli.tasks.docs import update_docs
from repro.config import Scale, plain
from repro.reporting.additions import add_to_published
from repro.reporting.paper import worlds_of
from repro.reporting.publish import publish
from repro.runs.directories import Outputs
from repro.runs.provenance import Status


def run(job: Job) -> None:
    """Publish the results and update the generated tables."""
    write = add_to_published if job.call.publish.add else publish
    target = write(job.outputs, RESULTS, job.call.scale.name, overrides=overrides_of(job), force=job.call.publish.force)
    print(f"published {target}")
    update_docs()


def overrides_of(job: Job) -> str:
    """Return the overrides that the runs of a job need, each after a space: of world, scale and training settings.

    Raises:
        ValueError: no file of conf/world has the worlds of all runs.
    """
    used = {run.config().data.worlds for run in job.outputs.runs() if run.status is Status.evaluated}
    names = [path.stem for path in sorted((CONF / "world").glob("*.yaml")) if used <= worlds_of(path)]
    if used and not names:
        raise ValueError(f"the runs in {job.outputs.path} have worlds of no file in conf/world: add one")
    scale = job.call.scale
    usual = plain(OmegaConf.load(CONF / "scale" / f"{scale.name}.yaml"))  # type: ignore[arg-type]
    world = [f" world={name}" for name in names[:1] if "paper" not in names]
    return "".join([*world, *changes("scale", asdict(scale), usual), *training_changes(job.outputs, scale)])


def training_changes(outputs: Outputs, scale: Scale) -> Iterator[str]:
    """Yield the overrides of the settings that the networks were trained with, if these are not the paper's."""
    conf = {"scale": asdict(scale), "train": OmegaConf.load(CONF / "train" / "paper.yaml")}
    usual = plain(OmegaConf.create(conf))["train"]
    trained = (run.config().train for run in outputs.runs() if run.status is Status.evaluated)
    training = next(filter(None, trained), None)  # a baseline has none; networks that differ are doubts of `publish`
    return changes("train", asdict(training), usual) if training else iter(())


def changes(path: str, values: dict[str, Any], usual: dict[str, Any]) -> Iterator[str]:
    """Yield the overrides of the values that differ from the usual ones, also in nested groups."""
    for key, value in values.items():
        if isinstance(value, dict):
            yield from changes(f"{path}.{key}", value, usual[key])
        elif value != usual[key]:
            yield f" {path}.{key}={json.dumps(value)}"
