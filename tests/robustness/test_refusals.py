"""Calls that must be refused, by class: each with the key or argument in the message, quickly, and without writing."""

import re
import shutil
import subprocess
import sys
from typing import Any

import hydra
import pytest
from conftest import ROOT, cpu_seconds, refuse

from repro.cli import composition
from repro.world_config import plain

composition.register()

LIDAR = "world.robot.sensors.0"
KEYS = {  # unknown keys, and what the message suggests
    "train.lr=3": "known are learning_rate",
    "+train.lr=0.5": "known are learning_rate",
    "++train.lr=0.5": "known are learning_rate",
    "scale.sizepx=64": "did you mean scale.size_px?",
    "sed=1": "did you mean seed?",
    "outputsx=a": "did you mean outputs?",
    "mdoel=unet": "did you mean model?",
    "+foo=1": "known are task",
    "foo=1": "known are task",
    "+runtime.gpus=2": "known are workers",
    "runtime.gpus=2": "known are workers",
    "+encoding.foo=1": "known are name, parameters",
    "encoding.decay=true": "did you mean decay or encoding.parameters.decay?",
    "model.foo=1": "known are name",
    "size_px=64": "did you mean scale.size_px?",
    "world.robot.sensors.lidar.range_max=3": "an entry of a list is named by its number",
    f"{LIDAR}.rang_max=3": "did you mean world.robot.sensors.0.range_max?",
    "hydra.foo=1": "not a known key of Hydra",
    "~scale": "cannot be left out",
    "~seed": "cannot be left out",
    "~train.learning_rate": "does not support deletion",
    "~world.robot": "is missing",
}
GROUPS = {  # groups take one name
    "model=[unet,fpn]": "use -m model=a,b",
    "model=null": "takes one name",
    "world=null": "takes one name",
    "scale=null": "takes one name",
    "encoding=null": "takes one name",
    "train=null": "takes one name",
    "model={}": "takes one name",
    "model=1": "Hydra reads this as a number; for a name, quote it",
    "outputs=2024_05_13": "Hydra reads this as 20240513; for a name, quote it",
    "scans=1.10": "Hydra reads this as 1.1; for a name, quote it",
    "model=''": "must be one of convgru, convlstm, deeptracking",
    "model=unte": "did you mean unet?",
    "scale=lapto": "did you mean laptop?",
    "encoding=stack5": "must be one of ages",
    "encoding=series100 exp=3 world.motions.rotate.steps=50": "divides a window into 100 parts, those of exp 3 have 50",
    "train.loss=bce": "must be one of map, visible",
    "train=visible": "visible is for model=deeptracking with encoding=series10 or encoding=series100",
    "train=visible model=deeptracking encoding=stack10": "visible is for model=deeptracking",
    "train=foo": "must be one of paper",
    "world=foo": "must be one of",
    "hydra/launcher=foo": "must be one of basic",
    "+model=fpn": "write it without +",
    "model=unet,fpn": "for a sweep, add -m",
    "exp=3,4": "for a sweep, add -m",
    "exp=range(1,3)": "for a sweep, add -m",
    "-m exp=glob(*)": "the sweep has no jobs",
    "-m task=report exp=3,4": "done once for all runs",
}
ENCODINGS = {  # parameters of encodings, with their types and ranges
    "encoding.parameters.decay=foo": "must be a valid boolean",
    "encoding.parameters.decay=1": "must be a valid boolean",
    "encoding.parameters.oldest_gray=nan": "must be a finite number",
    "encoding.parameters.oldest_gray=true": "must be a valid number",
    "encoding.parameters.oldest_gray=1": "must be less than or equal to 0.996",
    "decay=foo": "not a valid bool",
    "encoding=exponential encoding.parameters.half_life=nan": "must be a finite number",
    "encoding=exponential encoding.parameters.half_life=inf": "must be a finite number",
    "encoding=exponential encoding.parameters.half_life=x": "must be a valid number",
    "encoding=exponential encoding.parameters.half_life=-1": "must be greater than 0",
    "encoding=exponential encoding.parameters.half_life=[1]": "must be a valid number",
    "encoding=observed_free encoding.parameters.range_max_m=nan": "must be a finite number",
    "encoding=observed_free encoding.parameters.range_max_m=0": "must be greater than 0",
    "encoding=stack4 encoding.parameters.frames=x": "must be a valid integer",
    "encoding=stack4 encoding.parameters.frames=2.5": "must be a valid integer",
    "encoding=stack4 encoding.parameters.frames=true": "must be a valid integer",
    "encoding=stack4 encoding.parameters.frames=0": "must be greater than or equal to 1",
    "encoding=stack4 encoding.parameters.frames=1000000": "must be less than or equal to 100",
    "encoding=stack4 encoding.parameters.frames=8": "does not match its parameters",
    "encoding=stack4 +encoding.parameters.oldest_gray=0.5": "takes frames, got oldest_gray",
    "encoding.parameters=null": "not Optional",
    "encoding.parameters=[1]": "Cannot merge",
    "encoding=stack4 decay=false": "has no decay",
    "encoding=series10 oldest_gray=0.3": "has no oldest gray",
}
WORLDS = {  # worlds that cannot be simulated, or not in the memory of a machine
    f"{LIDAR}.range_max=1e-300": "greater than or equal to 0.01",
    f"{LIDAR}.range_max=1e300": "less than or equal to 10000",
    f"{LIDAR}.angle_range=1e-300": "greater than or equal to 0.001",
    f"{LIDAR}.number=100000000": "less than or equal to 100000",
    f"{LIDAR}.number=50000": "more than 2000000 readings",
    "world.robot.shape.radius=0.001": "greater than or equal to 0.01",
    "world.robot.vel_min=[nan,nan]": "must be a finite number",
    "world.robot.vel_min=[-inf,-inf]": "must be a finite number",
    "world.robot.vel_min=[1,1]": "the robot needs",
    "world.robot.vel_max=[1e300,1e300]": "less than or equal to 1000000",
    "world.obstacles.static.aspect=[1e6,1e6]": "less than or equal to 100",
    "world.obstacles.static.aspect=[90,90]": "no room",
    "world.obstacles.static.radius_m=[0.001,0.001]": "greater than or equal to 0.01",
    "world.obstacles.static.count=[1000000,1000000]": "less than or equal to 1000",
    "world.obstacles.static.count=[900,900]": "no room",
    "world.motions.rotate.name=circle": "world.motions.rotate: the name circle must be one of rotate, square",
    "world.motions.rotate.steps=100.0": "must be a valid integer",
    "world.motions.rotate.steps=1000000000": "less than or equal to 1000000",
    "world.motions.rotate.steps=100000": "more than 2000000 readings",
    "world.motions.square.drive_steps=1000000000": "less than or equal to 100000",
    "world.motions.square.side_m=1e-300": "greater than or equal to 0.01",
    "world.world.step_time=1e-300": "greater than or equal to 0.0001",
    "world.world.width=1 world.world.height=1": "no room",
    "world.world.width=1e300 world.world.height=1e300": "less than or equal to 10000",
    "world.obstacles.moving.behavior.speed_m_s=[1e-300,1e-300]": "greater than or equal to",
    "world.experiments=null": "world.experiments: must be an object",
    "world.robot.sensors=null": "must be a valid array",
}
LIMITS = {  # more than this machine can do
    "scale.pairs.train=2000000 scale.size_px=4096": "GB of memory, this machine has",
    "scale.batch_size=100000 scale.pairs.train=200000": "GB of memory, this machine has",
    "train.batch_size=100000 scale.pairs.train=200000": "GB of memory, this machine has",
    "runtime.accelerator=cpu runtime.precision=16-mixed": "float16 needs a GPU",
    "scale.size_px=4096": "GB of memory, this machine has",
    "scale.max_epochs=1000000000": "less than or equal to 100000",
    "runtime.parts=1000000000": "less than or equal to 10000",
    "runtime.workers=100000": "less than or equal to",
    "seed=1e30": "could not be converted to Integer",
    "seed=4294967296": "less than 4294967296",
}
SYNTAX = {  # what Hydra's grammar cannot read
    "outputs=a#b": """quote the value for Hydra and for the shell: 'outputs="a#b"'""",
    "outputs=Ärger": """'outputs="Ärger"'""",
    "outputs=~/x": """'outputs="~/x"'""",
    "outputs=a'b": "cannot be read",
    "outputs=a=b": "cannot be read",
    "outputs=a(b": "cannot be read",
    "outputs=a;b": "cannot be read",
    "outputs={a}": "cannot be read",
    "outputs=a,b": "for a sweep, add -m",
    "outputs=[a]": "Cannot convert 'list' to string",
    "outputs=${foo}": "'foo' not found",
    "exp": "an override is key=value",
    "=3": "an override is key=value",
    "--exp=3": "overrides have no dashes",
    "--config-dir=nowhere": "is not a directory",
    "--config-name=config": "not supported",
}
PATHS = {  # directories that cannot exist; {tmp} is a directory with a file and a loop of links
    "outputs={tmp}/loop": "symbolic links",
    "outputs={tmp}/loop/a": "symbolic links",
    "outputs={tmp}/file": "is a file",
    "outputs={tmp}/file/a": "Not a directory",
    "outputs={tmp}/" + 300 * "a": "name too long",
    "outputs={tmp}/" + 300 * "aaaaaaaaaaaaaaaaaaaa/": "name too long",
    "outputs=/proc/a": "holds no files of users",
    "recordings=/proc/1": "holds no files of users",
    "recordings={tmp}/loop": "symbolic links",
    "recordings=/dev/null": "is a file",
    "outputs=''": "at least 1 character",
}
YAML = {  # contents of a file scale/broken.yaml
    "a:\tb\n\tc: 1\n": "found character",
    "batch_size: 8\nbatch_size: 9\n": "duplicate key batch_size",
    "a: [1\n": "while parsing",
    "\xff\xfe\x00": "scale/broken.yaml: is not UTF-8",
    "": "Missing mandatory value",
    "[1, 2]": "list is not a subclass of Scale",
    "a: &x [*x]": "recursion",
    '!!python/object/apply:os.system ["touch pwned"]': "could not determine a constructor",
    "a: 1": "Key 'a' not in 'Scale'",
    "a: ${oc.env:HOME}": "Key 'a' not in 'Scale'",
}
CALLS = KEYS | GROUPS | ENCODINGS | WORLDS | LIMITS | SYNTAX
HOSTILE = ("x", "nan", "-1e300", "1e300", "{a: 1}", "null")  # for numbers; see ALLOWED
ALLOWED = {  # hostile values that have a meaning
    "runtime.max_minutes": {"1e300", "null"},  # no limit
    "scale.ema_decay": {"null"},  # no average
    "train.ema_decay": {"null"},
}


@pytest.mark.parametrize(("call", "expected"), CALLS.items())
def test_a_call_is_refused_with_its_reason(call, expected, monkeypatch):
    monkeypatch.setattr("repro.system.memory.psutil.virtual_memory", lambda: Memory())
    reasons = refuse(*call.split(" ")) if not call.startswith("outputs=a'") else refuse(call)
    assert any(expected in reason for reason in reasons), reasons
    assert all("\n" not in reason for reason in reasons), reasons


class Memory:
    """The memory of a machine with 16 GB."""

    total = available = 16e9


@pytest.mark.parametrize(("call", "expected"), PATHS.items())
def test_a_directory_that_cannot_exist_is_refused(call, expected, tmp_path):
    (tmp_path / "file").write_text("a file")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    before = sorted(path.name for path in tmp_path.iterdir())
    (reason, *_) = refuse(call.replace("{tmp}", str(tmp_path)), "task=record")
    assert expected in reason
    assert sorted(path.name for path in tmp_path.iterdir()) == before


@pytest.mark.parametrize(("content", "expected"), YAML.items())
def test_a_configuration_file_that_cannot_be_read_is_refused(content, expected, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scale").mkdir()
    (tmp_path / "scale" / "broken.yaml").write_bytes(content.encode("latin-1"))
    (reason,) = refuse(f"--config-dir={tmp_path}", "scale=broken")
    assert expected in reason
    assert not (tmp_path / "pwned").exists()


def leaves(values: Any, prefix: str = "") -> dict[str, Any]:
    """Return the numbers of a configuration by key."""
    children = values.items() if isinstance(values, dict) else enumerate(values) if isinstance(values, list) else ()
    found: dict[str, Any] = {}
    for key, value in children:
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        found |= {f"{prefix}{key}": value} if is_number else leaves(value, f"{prefix}{key}.")
    return found


def numbers() -> list[str]:
    with hydra.initialize_config_dir(str(composition.CONF), version_base="1.3"):
        values = plain(hydra.compose("config"))
    for name in ("motions", "obstacles"):  # their copies in the experiments are the same values
        assert name in values["world"]
    return [key for key in leaves(values) if not (key.startswith("world.experiments.") and key.count(".") > 3)]


@pytest.mark.slow
@pytest.mark.parametrize("key", numbers())
def test_a_number_takes_no_value_without_meaning(key):
    for value in HOSTILE:
        if value not in ALLOWED.get(key, ()):
            reasons = refuse(f"{key}={value}")
            name = re.sub(r"\.\d+$", "", key).split(".")[-1]
            assert any(name in reason or key in reason for reason in reasons), (value, reasons)


@pytest.mark.parametrize("call", ["train.lr=3", "encoding.parameters.decay=foo", "exp=9", "model=unte", "outputs=a#b"])
def test_a_refusal_writes_nothing_and_takes_less_than_two_seconds_of_the_processor(call, tmp_path):
    command = [sys.executable, "run.py", f"outputs={tmp_path / 'out'}", call]
    before = cpu_seconds()
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert done.stderr.startswith("error: this cannot be run\n")
    assert "Traceback" not in done.stderr
    assert cpu_seconds() - before < 2
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "sweep",
    [("scans=a/run.npz,b/run.log",), ("scans=run.npz", "prediction.stride_s=1,2")],
)
def test_predictions_that_would_replace_one_another_are_refused(sweep):
    (reason,) = refuse("-m", "task=predict", *sweep)
    assert reason == "several predictions would write to predictions/run: make a call with outputs= for each"


@pytest.mark.parametrize("number", ["0", "-2", "1.5", "many", "null", "true"])
def test_a_wrong_number_of_parallel_trainings_is_refused(number):
    (reason,) = refuse("-m", "exp=3", "hydra/launcher=cores", f"hydra.launcher.n_jobs={number}")
    assert reason.startswith(f"hydra.launcher.n_jobs={number}: expected the number of trainings at the same time")


def test_slurm_is_refused_where_it_is_missing(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    (reason,) = refuse("-m", "exp=3", "hydra/launcher=slurm")
    assert "srun is not found" in reason
