"""Calls of run.py that are refused before anything is written, and the jobs of those that are not."""

import itertools
import subprocess
import sys

import pytest
from conftest import ROOT
from hydra._internal.utils import get_args_parser

from repro.cli import composition
from repro.cli.validation import RENAMED_KEYS, RENAMED_VALUES, renamed_errors

composition.register()
RENAMED = {
    "lightest=0.5": "oldest_gray",
    "scale.mirror=true": "scale.flip_augmentation",
    "train.mirror=true": "train.flip_augmentation",
    "scale.weight_average=0.9": "scale.ema_decay",
    "train.weight_average=0.9": "train.ema_decay",
    "task=evidence": "task=analysis",
    "task=transfer": "task=generalization",
    "task=readme": "task=docs",
    "encoding=seen_free": "encoding=observed_free",
}
COMMANDS = {  # arguments, and what the message must contain
    "lightest=0.5": ["oldest_gray"],
    "task=evidence": ["task=analysis"],
    "-m exp=3,4 encoding=projection,seen_free": ["encoding=observed_free"],
    "-m model=glob(*) seed=-1": ["seed=-1: must be greater than or equal to 0"],
    "-m exp=glob(*)": ["no jobs"],
    "~scale": ["scale"],
    "~train": ["train"],
    "+scale.size=32": ["scale.size", "is not a known key", "did you mean scale.size_px?"],
    "+sed=1": ["sed", "is not a known key", "did you mean seed?"],
    "--config-name=config": ["--config-name"],
}


def refuse(overrides: list[str]) -> list[str]:
    """Return the errors for which a call is refused."""
    with pytest.raises(composition.Refused) as refused:
        composition.compose_jobs(get_args_parser().parse_args(overrides))
    return [str(reason) for reason in refused.value.args]


@pytest.mark.parametrize("prefix", ["", "+", "++"])
@pytest.mark.parametrize(("override", "name"), RENAMED.items())
def test_a_former_name_is_refused_with_the_new_one(override, name, prefix):
    is_value = override.startswith(("task", "encoding"))  # of a key that exists, which takes no prefix
    (error,) = refuse([override if is_value else prefix + override])
    assert override.split("=")[0] in error
    assert f"is now called {name}" in error


def test_every_former_name_is_tested():
    values = {f"{key}={value}" for key, value in RENAMED_VALUES}
    assert {override for override in RENAMED if override in values or override.split("=")[0] in RENAMED_KEYS} == set(
        RENAMED
    )
    assert len(RENAMED) == len(RENAMED_KEYS) + len(RENAMED_VALUES)


def test_current_names_are_not_refused_as_former_ones():
    assert renamed_errors([("oldest_gray", "0.5"), ("task", "analysis"), ("encoding", "observed_free")]) == []


@pytest.mark.parametrize(("call", "expected"), COMMANDS.items())
def test_an_invalid_call_exits_with_status_2_and_writes_nothing(call, expected, tmp_path):
    command = [sys.executable, "run.py", *call.split(), f"outputs={tmp_path / 'out'}"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith("error: this cannot be run\n")
    assert all(part in done.stderr for part in expected), done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


def test_every_job_of_a_sweep_is_composed():
    arguments = get_args_parser().parse_args(["-m", "model=unet,fpn", "exp=3,4", "seed=0"])
    jobs = [(job.model.name, job.exp, job.seed) for job in composition.compose_jobs(arguments)]
    assert sorted(jobs) == sorted((model, exp, 0) for model, exp in itertools.product(("unet", "fpn"), "34"))


@pytest.mark.slow
def test_a_sweep_is_refused_if_one_of_its_jobs_is_invalid():
    errors = refuse(["-m", "model=glob(*)", "encoding=projection,stack4"])
    assert len(errors) == 2, errors
    for error, name in zip(sorted(errors), ("convgru", "convlstm"), strict=True):
        assert name in error
        assert "encoding=stack10" in error
