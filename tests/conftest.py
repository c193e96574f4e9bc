import dataclasses
import functools
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import pandas as pd
import pytest
from preloaded import preloaded_python

from repro.baselines.titles import BASELINES
from repro.cli import compose, main
from repro.cli.call import Call
from repro.cli.refusals import Refused
from repro.metrics.headings import METRICS
from repro.recordings.format import spec_fingerprint
from repro.runs import provenance
from repro.runs.config import RECURRENT, Data, EncodingChoice, PairCounts, RunConfig, Training
from repro.runs.directories import Run
from repro.runs.model import NETWORKS, PAPER_ENCODER, Model
from repro.runs.outputs import Outputs
from repro.runs.provenance import Status
from repro.simulation.checks import checked_world
from repro.simulation.recorder import record_experiment
from repro.system.fields import ConfigError, WrongValues
from repro.worlds import spec as world_config
from repro.worlds.spec import WorldSpec

ROOT = Path(__file__).parents[1]
TINY = (  # a call of seconds
    *("scale=first", "scale.pairs.train=16", "scale.pairs.val=4", "scale.pairs.test=4", "scale.max_epochs=1"),
    *("runtime.accelerator=cpu", "runtime.workers=1"),
)


def world_spec(name: str, /, **changes: Any) -> WorldSpec:
    """Return the world spec of an experiment of the paper; changes replace keys of its mappings, or other values."""
    world = world_config.read_world(ROOT / "conf" / "world" / "paper.yaml")
    raw = world_config.world_spec(world, name).raw
    for key, value in changes.items():
        raw[key] = {**raw[key], **value} if isinstance(value, dict) else value
    return WorldSpec.parse(raw)


def world_errors(values: dict[str, Any]) -> list[ConfigError]:
    """Return what is wrong with the section `world` of a configuration."""
    try:
        checked_world(values)
    except WrongValues as error:
        return list(error.args)
    return []


def read_calls(*arguments: str) -> list[Call]:
    """Return the checked jobs of a call of run.py."""
    parsed = main.read_arguments([*arguments])
    with compose.composed(parsed) as jobs:
        return main.read_calls(parsed, jobs)


def refuse(*arguments: str) -> list[str]:
    """Return the reasons for which a call of run.py is refused."""
    with pytest.raises(Refused) as refused:
        read_calls(*arguments)
    return [str(reason) for reason in refused.value.args]


@pytest.fixture(scope="session")
def python(tmp_path_factory) -> Iterator[Path]:
    """Return a Python that starts with the large libraries imported, for tests of something else than its start."""
    with preloaded_python(tmp_path_factory.mktemp("bin")) as path:
        yield path


def run_py(*arguments: str, python: Path | str = sys.executable, **environment: str) -> CompletedProcess[str]:
    """Run run.py in a new process."""
    command, env = [python, "run.py", *arguments], os.environ | environment
    return subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True, timeout=500)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run the files with slow tests first, so that the processes of pytest-xdist end at about the same time."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


read_commit = functools.cache(provenance._commit)


@pytest.fixture(autouse=True)
def commit_is_read_once(monkeypatch) -> None:
    """Run git once per process of the tests, not for every step of every run."""
    monkeypatch.setattr(provenance, "_commit", read_commit)


@pytest.fixture(params=["1", "2", "3", "4"])
def spec(request) -> WorldSpec:
    return world_spec(request.param)


@pytest.fixture(scope="session")
def recorded(tmp_path_factory) -> Path:
    """Record a small experiment 3, which tests may only read."""
    directory = tmp_path_factory.mktemp("laptop") / "recordings" / "exp3"
    record_experiment(directory, world_spec("3"), {"train": 24, "val": 8, "test": 8}, workers=1)
    return directory


@pytest.fixture(scope="session")
def evaluated(recorded) -> Run:
    """Train and evaluate a U-Net for an epoch beside the recordings; tests may read it, and copy it to change it."""
    from repro.evaluation.scoring import evaluate  # these import torch
    from repro.learning.training import train

    config = run_config(max_epochs=1)
    run = Outputs(recorded.parents[1]).run(config.key)
    run.prepare(config)
    train(run, recorded, accelerator="cpu")
    evaluate(run, recorded, accelerator="cpu")
    return run


def run_config(
    *, model: str = "unet", decay: bool = True, encoding: EncodingChoice | None = None, **changes: Any
) -> RunConfig:
    """Return the configuration of a small run, of a baseline if `model` names one.

    Args:
        model: name of a network or baseline.
        decay: whether the projection has the time decay.
        encoding: another encoding than the projection.
        changes: values of RunConfig, Model, Data or Training that differ from the usual ones.
    """

    def take(cls: type, **defaults: Any) -> Any:
        names = {field.name for field in dataclasses.fields(cls)} & set(changes)
        return cls(**{**defaults, **{name: changes.pop(name) for name in names}})

    data = take(
        Data,
        scale="laptop",
        size_px=32,
        size_m=50.0,
        pairs=PairCounts(24, 8, 8),
        worlds=spec_fingerprint(world_spec("3")),
    )
    train = take(Training, learning_rate=1e-3, min_delta=0.001, patience=5, batch_size=8, max_epochs=3, dice_eps=1e-6)
    encoding = encoding or EncodingChoice("projection", {"decay": decay, "oldest_gray": 0.8})
    network = take(Model, name=model, encoder_name=None if model in RECURRENT else PAPER_ENCODER)
    config = RunConfig("3", 0, network, encoding, data, train)
    config = dataclasses.replace(config, **changes)
    return config.of_baseline(model) if model in BASELINES else config


def prepared(path: Path, **changes: Any) -> Run:
    """Create a run directory with its config.yaml."""
    run = Run(path)
    run.prepare(run_config(**changes))
    return run


def damage(path: Path, how: str) -> None:
    """Delete, alter, cut or replace a file."""
    content = path.read_bytes()
    if how == "missing":
        path.unlink()
    elif how == "altered":
        at = len(content) // 2
        path.write_bytes(content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :])
    else:
        path.write_bytes(
            {"cut": content[: len(content) // 2], "empty": b"", "a list": b"- 1\n", "a word": b"word"}[how]
        )


def cpu_seconds() -> float:
    """Return the CPU time of the finished child processes, which does not depend on the load of the machine [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def spent_budget() -> Any:
    """Return a budget as a new process has it whose time limit has passed: it pauses after one epoch."""
    from repro.learning.callbacks import Budget

    return Budget(1, since=time.monotonic() - 3600)


def fake_run(
    outputs: Path,
    experiment: str,
    model: str,
    value: float,
    *,
    status: Status = Status.evaluated,
    typed: str = "",
    **changes: Any,
) -> Run:
    """Create a run directory as evaluation leaves it, with every metric at one value."""
    config = run_config(experiment=experiment, model=model, **changes)
    run = Outputs(outputs).run(config.key)
    run.prepare(config)
    pd.DataFrame([dict.fromkeys((*METRICS, "obstacle_iou"), value)]).to_csv(run.metrics, index=False)
    run.use_recordings("hash of recordings")
    if not config.key.is_baseline:
        facts = {"train_pairs": 24, "epochs": 3, "training_seconds": 1.0, "precision": "32-true"}
        facts |= {"command": f"python run.py {typed}", "weights_sha256": f"weights that score {value}"}
        run.begin_step("trained", Status.trained, **facts)
    run.begin_step("evaluated", status, test_pairs=8)
    return run


def fake_study(outputs: Path, seeds: tuple[int, ...] = (0,)) -> None:
    """Create evaluated runs of the paper's networks and of one baseline in experiment 3."""
    for seed in seeds:
        for number, model in enumerate(NETWORKS):
            fake_run(outputs, "3", model, 0.5 + 0.1 * number + 0.01 * seed, seed=seed)
    fake_run(outputs, "3", "all_free", 0.9)


CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.fixture(scope="module")
def browser():
    if not CHROMIUM:
        pytest.skip("no Chromium on this machine (Debian: apt install chromium)")
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="playwright drives the browser: pip install -e .[dev]"
    )
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()
