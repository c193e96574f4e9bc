"""reproduce/paper_scale.sh with a stand-in for Python that notes what it is called with."""

import os
import subprocess
from pathlib import Path

import pytest
from conftest import ROOT

STAND_IN = """\
#!/bin/bash
echo "$@" >> calls.txt
mkdir -p outputs/paper/recordings
touch outputs/paper/recordings/train-0000.npz
for number in $(seq "$FOUND"); do
    for seed in 0 1; do
        mkdir -p "outputs/paper/runs/$number/seed$seed/model"
        touch "outputs/paper/runs/$number/seed$seed/metrics.csv" "outputs/paper/runs/$number/seed$seed/model/weights"
    done
done
if [[ $* == *"$STOPS"* ]]; then exit "$STATUS"; fi
"""


@pytest.fixture
def call(tmp_path):
    """Return a function that calls the script in a separate tree; it returns status, output and calls of run.py."""
    (tmp_path / "reproduce").mkdir()
    script = tmp_path / "reproduce" / "paper_scale.sh"
    script.write_text((ROOT / "reproduce" / "paper_scale.sh").read_text())
    python = tmp_path / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(STAND_IN)
    python.chmod(0o755)
    (tmp_path / ".venv" / "ready").touch()

    def run(found=24, stops="nothing", status=0, **settings):
        words = {"FOUND": str(found), "STOPS": stops, "STATUS": str(status), "KEEP": str(tmp_path / "kept"), **settings}
        done = subprocess.run(
            ["bash", script, "scale.pairs.train=8"], env=os.environ | words, capture_output=True, text=True, timeout=60
        )
        calls = tmp_path / "calls.txt"
        lines = calls.read_text().splitlines() if calls.is_file() else []
        calls.unlink(missing_ok=True)
        return done.returncode, done.stdout + done.stderr, lines

    return run


def test_it_records_trains_and_reports(call):
    status, said, calls = call(SEEDS="0 1")
    assert (status, "done: the study" in said) == (0, True)
    assert [line.split()[2] for line in calls[:1]] == ["task=record"]
    trainings = [line for line in calls if "model=unet,fpn,upernet,segformer" in line]
    assert [("decay=false" in line, "seed=1" in line) for line in trainings] == [
        (False, False), (True, False), (False, True), (True, True)
    ]  # fmt: skip
    assert "task=report" in calls[-1]
    assert all("scale=paper" in line and "runtime.max_minutes=" in line for line in calls)
    assert all("scale.pairs.train=8" in line for line in calls)


@pytest.mark.parametrize("settings", [{"stops": "task=record", "status": 130}, {"found": 23}])
def test_unfinished_work_is_left_to_another_call(call, settings):
    status, said, _ = call(**settings)
    assert (status, "call again: " in said) == (75, True)


def test_a_call_without_time_left_starts_nothing(call):
    status, _, calls = call(MINUTES="1")
    assert (status, calls) == (75, [])


def test_a_failure_ends_the_script_with_its_status(call):
    status, _, calls = call(stops="decay=false", status=1)
    assert status == 1
    assert "decay=false" in calls[-1]


def test_kept_files_are_restored(call, tmp_path):
    call()
    kept = {path.relative_to(tmp_path / "kept") for path in (tmp_path / "kept").rglob("*") if path.is_file()}
    assert kept == {Path(f"runs/{number}/seed{seed}/metrics.csv") for number in range(1, 25) for seed in (0, 1)}
    subprocess.run(["rm", "-r", tmp_path / "outputs"], check=True)
    (tmp_path / "kept" / "runs" / "exp2").mkdir()
    call(MINUTES="1")
    assert (tmp_path / "outputs" / "paper" / "runs" / "exp2").is_dir()
