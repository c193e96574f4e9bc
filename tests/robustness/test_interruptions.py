"""Kills, Ctrl-C, damaged checkpoints, a full disk, concurrent processes: nothing correct is lost."""

import functools
import os
import random
import shutil
import signal
import subprocess
import sys
import time
import uuid
from pathlib import Path

import pytest
from conftest import ROOT, TINY, damage, prepared, read_calls, spent_budget

from repro.cli.main import perform
from repro.evaluation.scoring import evaluate
from repro.learning.training import train
from repro.runs.provenance import Status

pytestmark = pytest.mark.slow

SMALL = (*TINY[:-3], "scale.max_epochs=3", *TINY[-2:], "exp=3", "model=fpn")
KEPT = ("metrics.csv", "per_image.csv", "predictions.npz", "model/model.safetensors")
KILLS = int(os.environ.get("REPRO_KILLS", "1"))  # of recording, and as many of training
ROUNDS = int(os.environ.get("REPRO_ROUNDS", "1"))
RUN = Path("runs/exp3/fpn/projection/seed0")


def start(outputs, *overrides, python=sys.executable):
    given = {override.partition("=")[0] for override in overrides}
    kept = (override for override in SMALL if override.partition("=")[0] not in given)
    command = [python, "run.py", *kept, f"outputs={outputs}", *overrides]
    output = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    # Ctrl-C must reach it also where these tests run in the background, whose children would ignore it
    accept = functools.partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    return subprocess.Popen(command, cwd=ROOT, start_new_session=True, preexec_fn=accept, **output)


def finish(process):
    text, _ = process.communicate(timeout=300)
    return process.returncode, text


def wait_for(pattern, outputs, process, seconds=120):
    deadline = time.monotonic() + seconds
    while not list(outputs.glob(pattern)) and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.005)


@pytest.fixture(scope="module")
def whole(tmp_path_factory, python):
    """Return the outputs of a study that was not interrupted."""
    outputs = tmp_path_factory.mktemp("whole") / "first"
    status, text = finish(start(outputs, python=python))
    assert status == 0, text
    return outputs


def check_same(outputs, whole):
    """Check that a run has the files of the study that was not interrupted."""
    for name in KEPT:
        assert (outputs / RUN / name).read_bytes() == (whole / RUN / name).read_bytes(), name


def start_code(python, code):
    """Start code that prints its process after its imports; return it and what tells when it has ended."""
    output = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen([python, "-c", code], cwd=ROOT, **output)
    return int(process.stdout.readline()), process


def seconds_of(python, code):
    """Measure how long code takes after its imports [s]."""
    _, process = start_code(python, code)
    began = time.monotonic()
    process.communicate(timeout=300)
    assert process.returncode == 0
    return time.monotonic() - began


def kill_at_random(python, code, rng, longest_s):
    """Start code and kill it at a random time after its imports, unless it has ended."""
    number, process = start_code(python, code)
    time.sleep(rng.uniform(0, longest_s))
    if process.poll() is None:
        os.kill(number, signal.SIGKILL)
    process.communicate()


def test_a_killed_recording_ends_with_the_same_bytes(tmp_path, python):
    code = (
        "import os; from pathlib import Path; from repro.worlds.spec import read_world, world_spec\n"
        "from repro.recordings import format; from repro.simulation.recorder import record_experiment\n"
        "print(os.getpid(), flush=True); format.SHARD_WORLDS = 2\n"
        "spec = world_spec(read_world(Path('conf/world/paper.yaml')), '4')\n"
        "record_experiment(Path({!r}), spec, {{'train': 40, 'val': 4, 'test': 4}}, workers=1)\n"
    )
    rng, seconds = random.Random(0), seconds_of(python, code.format(str(tmp_path / "whole")))
    for _ in range(KILLS):
        kill_at_random(python, code.format(str(tmp_path / "killed")), rng, seconds)
    subprocess.run([python, "-c", code.format(str(tmp_path / "killed"))], cwd=ROOT, check=True, timeout=120)
    whole, killed = (
        {path.name: path.read_bytes() for path in (tmp_path / name).iterdir() if path.name != ".lock"}
        for name in ("whole", "killed")
    )
    assert killed == whole


def test_a_killed_training_ends_with_the_same_bytes(recorded, tmp_path, python):
    code = (
        "import os; from pathlib import Path\n"
        "from repro.learning.training import train; from repro.runs.directories import Run\n"
        f"print(os.getpid(), flush=True); train(Run(Path({{!r}})), Path({str(recorded)!r}), accelerator='cpu')\n"
    )
    whole, killed = (prepared(tmp_path / name, max_epochs=6, patience=50) for name in ("whole", "killed"))
    rng, seconds = random.Random(0), seconds_of(python, code.format(str(whole.path)))
    number, begun = start_code(python, code.format(str(killed.path)))
    wait_for("history.csv", killed.path, begun)
    os.kill(number, signal.SIGKILL)
    begun.communicate()
    assert not killed.is_trained
    for _ in range(KILLS):
        kill_at_random(python, code.format(str(killed.path)), rng, seconds)
    assert train(killed, recorded, accelerator="cpu") is Status.trained
    weights = [(run.model / "model.safetensors").read_bytes() for run in (whole, killed)]
    assert weights[0] == weights[1]
    assert len(killed.provenance().steps) > 2
    assert not list(killed.path.rglob("*.tmp"))


def test_leftovers_of_a_killed_process_are_deleted(recorded, tmp_path):
    run = prepared(tmp_path / "run", max_epochs=1)
    for step in (train, evaluate):
        model, predictions = (run.path / f"{name}.{uuid.uuid4().hex}.tmp" for name in ("model", "predictions.npz"))
        model.mkdir()
        (model / "config.json").write_text("{")
        predictions.write_bytes(b"half")
        (run.path / "notes.tmp").write_text("not ours")
        step(run, recorded, accelerator="cpu")
        assert [path.name for path in run.path.rglob("*.tmp")] == ["notes.tmp"], step
    assert run.is_evaluated


def test_an_interrupted_command_resumes(whole, tmp_path, python):
    outputs = tmp_path / "first"
    process = start(outputs)
    wait_for(f"{RUN}/history.csv", outputs, process)
    os.killpg(process.pid, signal.SIGINT)
    status, text = finish(process)
    assert status == 130, text
    assert text.rstrip().endswith("\ninterrupted: the same command resumes"), text
    assert "Traceback" not in text
    status, text = finish(start(outputs, python=python))
    assert status == 0, text
    assert (outputs / RUN / "metrics.csv").read_text() == (whole / RUN / "metrics.csv").read_text()


def test_a_terminated_sweep_ends_its_workers(tmp_path):
    outputs = tmp_path / "first"
    process = start(outputs, "seed=0,1", "train.max_epochs=200", "train.patience=200", "hydra/launcher=cores", "-m")
    wait_for("runs/exp3/fpn/projection/seed*/history.csv", outputs, process)
    process.terminate()
    status, text = finish(process)
    assert status == 130, text
    assert "interrupted: the same command resumes" in text, text
    deadline = time.monotonic() + 20
    while (left := subprocess.run(["pgrep", "-s", str(process.pid)]).returncode == 0) and time.monotonic() < deadline:
        time.sleep(0.2)
    assert not left


@pytest.mark.parametrize("round_", range(ROUNDS))
@pytest.mark.parametrize("count", [2] if ROUNDS == 1 else [2, 4])
def test_concurrent_processes_do_the_work_once(whole, tmp_path, python, count, round_):
    outputs = tmp_path / "first"
    processes = [start(outputs, python=python) for _ in range(count)]
    texts = [finish(process) for process in processes]
    assert [status for status, _ in texts] == [0] * count, texts
    assert sum("epoch 3 of 3" in text for _, text in texts) == 1
    check_same(outputs, whole)


@pytest.fixture(scope="module")
def paused(recorded, tmp_path_factory):
    """Return a run directory paused after two of four epochs, and the weights it must end with."""
    reference = prepared(tmp_path_factory.mktemp("reference"), max_epochs=4)
    assert train(reference, recorded, accelerator="cpu") is Status.trained
    run = prepared(tmp_path_factory.mktemp("paused"), max_epochs=4)
    for _ in range(2):
        assert train(run, recorded, accelerator="cpu", budget=spent_budget()) is Status.paused
    return run.path, (reference.model / "model.safetensors").read_bytes()


@pytest.mark.parametrize(
    ("names", "how"),
    [
        *((("last",), how) for how in ("cut", "altered", "missing")),
        *((names, "altered") for names in (("best",), ("last", "best"))),
    ],
)
def test_damaged_checkpoints_are_skipped_and_the_weights_are_the_same(paused, recorded, tmp_path, names, how, caplog):
    path, weights = paused
    shutil.copytree(path, tmp_path / "run")
    run = prepared(tmp_path / "run", max_epochs=4)
    for name in names:
        damage(tmp_path / "run" / "checkpoints" / f"{name}.ckpt", how)
    assert train(run, recorded, accelerator="cpu") is Status.trained
    assert ("skipping the damaged checkpoint" in caplog.text) == (how != "missing")
    assert (run.model / "model.safetensors").read_bytes() == weights


@pytest.fixture
def small_disk(tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=3m", "none", str(disk)], capture_output=True)
    if mounted.returncode:
        pytest.skip("a small disk may not be mounted here")
    yield disk
    subprocess.run(["umount", "-l", str(disk)], check=True)


def test_a_read_only_or_full_disk_is_reported_with_a_fix(small_disk, whole, python):
    outputs = small_disk / "first"
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    status, text = finish(start(outputs, python=python))
    assert status == 1, text
    assert "Read-only file system" in text
    assert "choose a directory that can be written with outputs=" in text
    assert "Traceback" not in text
    subprocess.run(["mount", "-o", "remount,rw", str(small_disk)], check=True)
    status, text = finish(start(outputs, python=python))
    assert status == 1, text
    assert "No space left on device: free some space" in text
    assert "Traceback" not in text
    for shard in outputs.glob("recordings/exp3/*.npz"):
        assert shard.read_bytes() == (whole / "recordings/exp3" / shard.name).read_bytes()
    subprocess.run(["mount", "-o", "remount,size=600m", str(small_disk)], check=True)
    status, text = finish(start(outputs, python=python))
    assert status == 0, text
    check_same(outputs, whole)


def test_an_internal_error_shows_its_traceback(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("repro.simulation.recorder.record_experiment", lambda *_, **__: 1 / 0)
    (call,) = read_calls(*SMALL, "task=record", f"outputs={tmp_path / 'out'}")
    assert perform(call) == "ZeroDivisionError: division by zero"
    assert "Traceback" in capsys.readouterr().err
