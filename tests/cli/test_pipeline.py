import json
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from conftest import ROOT, TINY, run_py

from repro.baselines.titles import QUICK_BASELINES
from repro.metrics.headings import METRICS
from repro.runs.model import NETWORKS

pytestmark = pytest.mark.slow

COMMAND = ["-m", "model=unet,fpn,upernet,segformer", "exp=3,4", "decay=false"]


def tiny(outputs):
    return [*TINY, f"outputs={outputs}"]


@pytest.fixture(scope="module")
def call(python):
    """Return a function that calls run.py, and returns its status and output."""

    def run(*arguments):
        done = run_py(*arguments, python=python)
        return done.returncode, done.stdout + done.stderr

    return run


@pytest.fixture(scope="module")
def study(tmp_path_factory, call):
    """Run the sweep of the README at a tiny size."""
    outputs = tmp_path_factory.mktemp("study") / "first"
    status, text = call(*COMMAND, *tiny(outputs))
    assert status == 0, text[-4000:]
    return outputs, text


def test_the_sweep_ends_with_a_complete_table(study):
    outputs, text = study
    table = pd.read_csv(outputs / "tables" / "ablation.csv")
    assert table.groupby("experiment")["model"].apply(list).tolist() == [[*NETWORKS, "average", *QUICK_BASELINES]] * 2
    for metric in METRICS:
        assert table[metric].between(0, 1).all()
        assert ((table[metric] - table[f"paper_{metric}"]) - table[f"delta_{metric}"]).abs().max() < 2e-4
    assert "Prediction metrics without the gray-scale time decay" in text
    assert "Prediction metrics. " not in text
    assert "Scale first: 32 x 32 px, 16 training and 4 test pairs" in text
    origin = (outputs / "runs/exp3/fpn/projection-no-decay/seed0/provenance.json").read_text()
    assert '"command": "python run.py model=fpn exp=3 decay=False scale=first' in origin
    assert pd.read_csv(outputs / "tables" / "main.csv")["model"].tolist() == [*QUICK_BASELINES] * 2
    names = {path.name for path in (outputs / "runs/exp4/upernet/projection-no-decay/seed0").iterdir()}
    kept = {"config.yaml", "history.csv", "metrics.csv", "per_image.csv", "provenance.json", "predictions.npz"}
    assert names >= kept | {"model", ".hydra"}


def test_the_same_command_again_does_nothing_and_writes_the_table_without_a_failed_job(study, tmp_path, call):
    outputs, _ = study
    copy = tmp_path / "first"
    shutil.copytree(outputs, copy)
    shutil.rmtree(copy / "tables")
    config = copy / "runs/exp3/fpn/projection-no-decay/seed0/config.yaml"
    config.write_text(config.read_text().replace("batch_size: 16", "batch_size: 4"))
    shutil.rmtree(copy / "runs/exp3/fpn/projection-no-decay/seed0/model")
    (copy / "runs/exp3/fpn/projection-no-decay/seed0/provenance.json").unlink()
    files = [*copy.glob("recordings/*/*.npz"), *copy.glob("runs/**/history.csv")]
    before = {path: path.stat().st_mtime_ns for path in files}
    assert len(before) == 6 + 8
    status, text = call(*COMMAND, *tiny(copy))
    assert status != 0
    assert text.count("done already") == 7
    assert {path: path.stat().st_mtime_ns for path in files} == before
    (failed,) = text.split("failed:")[1].strip().splitlines()
    assert failed.startswith("model=fpn exp=3: ")
    assert "holds a run of another configuration (train.batch_size is 4, requested 16" in failed
    assert "Traceback" not in text
    table = pd.read_csv(copy / "tables" / "ablation.csv")
    assert len(table) == 4 + 4 + 1 - 1 + 2 * len(QUICK_BASELINES)
    assert "| 4 | U-Net |" in text


def test_trainings_one_after_the_other_with_a_time_limit_give_the_same_results(study, tmp_path, call):
    outputs, _ = study
    copy = tmp_path / "first"
    arguments = ["-m", "model=fpn", "exp=3,4", "decay=false", "hydra/launcher=basic", *tiny(copy)]
    arguments.append("runtime.max_minutes=0.001")  # for both trainings, an epoch in any case
    status, text = call(*arguments)
    assert status == 0, text[-4000:]
    assert "paused" in text
    assert "| 4 | FPN |" not in text
    status, text = call(*arguments)
    assert status == 0, text[-4000:]
    assert "| 4 | FPN |" in text
    for experiment in ("exp3", "exp4"):
        same = Path("runs") / experiment / "fpn/projection-no-decay/seed0/metrics.csv"
        assert (copy / same).read_text() == (outputs / same).read_text()
        facts = json.loads((outputs / same.with_name("provenance.json")).read_text())
        assert {step["hardware"]["threads"] for step in facts["steps"]} == {1}
        same = Path("recordings") / experiment / "manifest.json"
        assert (copy / same).read_text() == (outputs / same).read_text()


def test_an_experiment_of_ones_own_runs_through_all_tasks(tmp_path, call):
    office = "{motion: ${world.motions.square}, obstacles: ${world.obstacles.moving}, clear_radius_m: 9.0}"
    overrides = ["exp=office", f"++world.experiments.office={office}", "model=fpn", *tiny(tmp_path / "first")]
    status, text = call(*overrides)
    assert status == 0, text[-4000:]
    status, text = call(*overrides, "task=report")
    assert status == 0, text[-4000:]
    assert "| office | FPN |" in (tmp_path / "first/tables/main.md").read_text()
    assert (tmp_path / "first/figures/data_collection.png").is_file()


def test_a_reader_that_goes_away_stops_the_call_with_one_line(tmp_path):
    script = f"{sys.executable} run.py -m exp=3,4 {' '.join(tiny(tmp_path))} | head -1; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 1
    assert "stopped; the same command resumes" in done.stderr
    assert "Traceback" not in done.stderr
