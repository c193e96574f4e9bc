"""Truncated, empty, altered, missing or exchanged files: the messages, the repairs, and what must be preserved."""

import shutil
from pathlib import Path

import pytest
from conftest import TINY, damage, read_calls

from repro.baselines.titles import QUICK_BASELINES
from repro.cli.jobs import Job
from repro.cli.refusals import explain
from repro.runs.config import PROJECTION
from repro.runs.keys import RunKey
from repro.runs.outputs import Outputs

pytestmark = pytest.mark.slow

CELLS = (("3", "unet"), ("3", "fpn"), ("4", "fpn"))


def read_call(outputs, *overrides):
    (call,) = read_calls(*TINY, "runtime.precision=32-true", f"outputs={outputs}", *overrides)
    return call


def call(outputs, task, *overrides):
    """Run a task; return None, or the message that the command line would print."""
    try:
        job = Job(read_call(outputs, f"task={task}", *overrides))
        job.call.facts.run(job)
    except Exception as error:
        message = explain(error)
        if message is None:  # it would show a traceback
            raise
        return message
    return None


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    outputs = tmp_path_factory.mktemp("study") / "first"
    for experiment, model in CELLS:
        assert call(outputs, "all", f"exp={experiment}", f"model={model}") is None
    assert call(outputs, "report") is None
    return outputs


@pytest.fixture
def copy(study, tmp_path):
    shutil.copytree(study, tmp_path / "first")
    return tmp_path / "first"


def run_of(outputs: Path, experiment: str = "3", model: str = "fpn") -> Path:
    return Outputs(outputs).run(RunKey(experiment, model, PROJECTION, 0)).path


SMALL, TEXT = ("config.yaml", "provenance.json"), ("cut", "a list")


EVALUATED = [(name, how) for name in ("metrics.csv", "predictions.npz") for how in ("cut", "missing")]


@pytest.mark.parametrize(("name", "how"), [*zip(SMALL, TEXT, strict=True), *EVALUATED])
def test_a_damaged_run_is_named(copy, name, how):
    run = run_of(copy, model="unet")  # whose predictions the figures show
    damage(run / name, how)
    message = call(copy, "report")
    is_other = (name, how) in EVALUATED and how == "cut"
    assert f"{run / name} {'is not what was evaluated' if is_other else 'cannot be read ('}" in message
    assert ("task=evaluate" in message) == ((name, how) in EVALUATED)


@pytest.mark.parametrize(("name", "how"), [*zip(SMALL, TEXT, strict=True)])
def test_a_damaged_run_is_not_overwritten(copy, name, how):
    """It may hold hours of work: the file is named, with what to do."""
    weights = (run_of(copy) / "model" / "model.safetensors").read_bytes()
    damage(run_of(copy) / name, how)
    other = ["train.dice_eps=1e-5"] if name == "config.yaml" else []  # which there is nothing to compare with
    for task in ("all", "train", "evaluate"):
        message = call(copy, task, "exp=3", "model=fpn", *other)
        assert f"{name} cannot be read (" in message
        assert "restore it, or delete" in message
    assert (run_of(copy) / "model" / "model.safetensors").read_bytes() == weights


@pytest.mark.parametrize("task", ["all", "evaluate"])
def test_missing_metrics_are_measured_again(copy, task):
    path = run_of(copy) / "metrics.csv"
    before = path.read_text()
    path.unlink()
    assert call(copy, task, "exp=3", "model=fpn") is None
    assert path.read_text() == before


@pytest.mark.parametrize("how", ["altered", "missing"])
@pytest.mark.parametrize("name", ["model/model.safetensors", "predictions.npz"])
def test_a_run_of_which_a_file_is_damaged_or_missing_is_not_done(copy, name, how):
    damage(run_of(copy) / name, how)
    problem = "is missing" if how == "missing" else f"is not what was {'trained' if 'model' in name else 'evaluated'}"
    for task in ("all", "evaluate"):
        assert f"{run_of(copy) / name} {problem}: delete" in call(copy, task, "exp=3", "model=fpn")


def test_a_training_refuses_damaged_shards(copy):
    path = copy / "recordings" / "exp3" / "val-0000.npz"
    damage(path, "altered")
    message = call(copy, "train", "exp=3", "model=segformer")
    assert path.name in message
    assert "task=record" in message


@pytest.mark.parametrize("key", [RunKey("4", "fpn", PROJECTION, 1), RunKey("1", "fpn", PROJECTION, 0)], ids=str)
def test_a_copied_run_is_named(copy, key):
    target = Outputs(copy).run(key)
    shutil.copytree(run_of(copy), target.path)
    assert f"{target} holds the run of {run_of(copy)}" in call(copy, "report")


def test_a_wrong_size_is_refused_before_a_baseline_is_evaluated(tmp_path):
    """The baselines are not evaluated with the wrong size."""
    outputs = tmp_path / "first"
    assert call(outputs, "all", "exp=3", "model=fpn") is None
    message = call(outputs, "all", "exp=3", "model=fpn", "scale.size_px=64")
    assert "data.size_px is 32, requested 64" in message
    shutil.rmtree(run_of(outputs))
    for name in QUICK_BASELINES:
        shutil.rmtree(outputs / "baselines" / "exp3" / name)
    assert call(outputs, "all", "exp=3", "model=fpn", "scale.size_px=64") is None
