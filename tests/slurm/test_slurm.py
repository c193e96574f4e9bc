"""A sweep as jobs of a Slurm array, on a Slurm of one node: make test-slurm."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest
from conftest import ROOT

from repro.runs.model import NETWORKS
from repro.runs.outputs import Outputs

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif("REPRO_SLURM" not in os.environ, reason="make test-slurm starts a Slurm for it"),
]
SIZE = ["scale=first", "scale.pairs.train=200", "scale.pairs.val=16", "scale.pairs.test=16", "scale.max_epochs=6"]
SMALL = [*SIZE, "hydra/launcher=slurm", "hydra.launcher.cpus_per_task=1"]


@pytest.fixture(scope="module")
def slurm(tmp_path_factory):
    """Start Slurm and return its environment."""
    if shutil.which("slurmctld") is None or os.getuid() != 0:
        pytest.fail("a Slurm of one node needs root and Debian's packages slurm-wlm and munge")
    directory = tmp_path_factory.mktemp("slurm")
    script = str(Path(__file__).parent / "one_node.sh")
    subprocess.run([script, "start", str(directory)], check=True)
    yield os.environ | {"SLURM_CONF": str(directory / "slurm.conf"), "OMP_NUM_THREADS": "1"}
    subprocess.run([script, "stop", str(directory)], check=True)


@pytest.fixture(scope="module")
def outputs(slurm, tmp_path_factory):
    """Two experiments recorded by an array of two jobs."""
    found = Outputs(tmp_path_factory.mktemp("outputs") / "first")
    overrides = ["-m", "task=record", "exp=3,4", *SMALL, f"outputs={found.path}"]
    done = subprocess.run([sys.executable, "run.py", *overrides], cwd=ROOT, env=slurm, timeout=600)
    assert done.returncode == 0
    assert sorted(found.recorded()) == ["3", "4"]
    return found


def test_an_array_of_trainings_survives_the_loss_of_a_job(slurm, outputs):
    overrides = ["-m", "model=unet,fpn,upernet,segformer", "exp=3,4", *SMALL, f"outputs={outputs.path}"]
    with subprocess.Popen([sys.executable, "run.py", *overrides], cwd=ROOT, env=slurm, stdout=subprocess.PIPE) as sweep:
        run, job = _first_in_training(outputs, slurm)
        _control(slurm, "requeue", job)
        _control(slurm, "update", f"JobId={job}", "StartTime=now")  # else Slurm lets it wait for two minutes
        printed = sweep.communicate(timeout=900)[0].decode()
    assert sweep.returncode == 0, printed
    table = pd.read_csv(outputs.tables / "main.csv")
    networks = table[table["model"].isin(NETWORKS)]
    assert len(networks) == 8
    assert networks["accuracy"].notna().all()
    assert sum(step["step"] == "trained" for step in run.provenance().steps) == 2, "it was to be cut off in training"
    elsewhere = outputs.path.parent / "alone"
    config = run.config()
    task = ["task=train", f"model={config.model.name}", f"exp={config.experiment}", *SIZE]
    directories = [f"outputs={elsewhere}", f"recordings={outputs.path / 'recordings'}"]
    subprocess.run([sys.executable, "run.py", *task, *directories], cwd=ROOT, env=slurm, check=True, timeout=300)
    same = Outputs(elsewhere).run(config.key).provenance()
    assert same.fact("weights_sha256") == run.provenance().fact("weights_sha256")


def _first_in_training(outputs, slurm):
    """Wait for a run with a finished epoch; return it with the Slurm job that trains it."""
    for _ in range(600):
        for run in outputs.runs():
            if (run.path / "history.csv").is_file() and not run.is_trained:
                return run, _job_of(run, outputs, slurm)
        time.sleep(0.2)
    raise AssertionError("no training has begun")


def _job_of(run, outputs, slurm) -> str:
    for log in outputs.path.glob("slurm/*/*.out"):
        if f"{run.path}\n" in log.read_text() or f"{run.path} " in log.read_text():
            return log.parent.name
    raise AssertionError(f"no job says that it trains {run}")


def _control(slurm, *overrides: str) -> None:
    subprocess.run(["scontrol", *overrides], env=slurm, check=True)
