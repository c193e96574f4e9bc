"""Calls that are refused, by class: each with the key or argument in the message, quickly, and without writing."""

import itertools
import os
import re
import shutil
import subprocess
import sys
from typing import Any

import hydra
import pytest
from conftest import ROOT, cpu_seconds, read_calls, refuse

from repro.cli.notes import warnings_of
from repro.system.places import conf_directory
from repro.world_config import plain

LIDAR = "world.robot.sensors.0"
KEYS = {  # unknown keys, and what the message suggests
    "train.lr=3": "Key 'lr' is not in struct; known are learning_rate",
    "+train.lr=0.5": "known are learning_rate",
    "scale.sizepx=64": "did you mean scale.size_px?",
    "sed=1": "did you mean seed?",
    "mdoel=unet": "did you mean model?",
    "foo=1": "known are",
    "runtime.gpus=2": "known are workers",
    "+encoding.foo=1": "known are name, parameters",
    "encoding.decay=true": "did you mean encoding.parameters.decay or decay?",
    "model.foo=1": "known are name",
    "size_px=64": "did you mean scale.size_px?",
    "world.robot.sensors.lidar.range_max=3": "an entry of a list is named by its number",
    f"{LIDAR}.rang_max=3": "did you mean world.robot.sensors.0.range_max?",
    "hydra.foo=1": "Could not override 'hydra.foo'",
    "~scale": "cannot be left out",
    "~seed": "cannot be left out",
    "~train.learning_rate": "train.learning_rate: is missing",
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
    "model=1": "takes one name",
    "outputs=2024_05_13": "outputs=20240513: must be a valid string; for a name, quote it",
    "scans=1.10": "scans=1.1: must be a valid string; for a name, quote it",
    "exp=true": "exp=True: must be a valid string",
    "model=''": "Available options in 'model': convgru convlstm",
    "model=unte": "did you mean unet?",
    "scale=lapto": "did you mean laptop?",
    "encoding=stack5": "did you mean stack4?",
    "encoding=series10 exp=3 world.motions.rotate.steps=9": "divides a window into 10 parts, those of exp 3 have 9",
    "train.loss=bce": "must be one of map",
    "train=foo": "Available options in 'train': paper",
    "world=foo": "Available options in 'world'",
    "hydra/launcher=foo": "Available options in 'hydra/launcher': basic",
    "+model=fpn": "Multiple values for model",
    "model=unet,fpn": "for a sweep, add -m",
    "exp=3,4": "for a sweep, add -m",
    "exp=range(1,3)": "for a sweep, add -m",
    "-m exp=glob(*)": "the sweep has no jobs",
    "-m task=report exp=3,4": "done once for all runs",
}
ENCODINGS = {  # parameters of encodings, with their types and ranges
    "encoding.parameters.decay=foo": "must be a valid boolean",
    "encoding.parameters.oldest_gray=nan": "must be a finite number",
    "encoding.parameters.oldest_gray=1": "must be less than or equal to 0.996",
    "decay=foo": "decay=foo: must be a valid boolean",
    "encoding=series10 encoding.parameters.range_max_m=nan": "must be a finite number",
    "encoding=stack4 encoding.parameters.frames=x": "must be a valid integer",
    "encoding=stack4 encoding.parameters.frames=1000000": "must be less than or equal to 100",
    "encoding=stack4 encoding.parameters.frames=8": "does not match its parameters",
    "encoding=stack4 +encoding.parameters.oldest_gray=0.5": "takes frames, got oldest_gray",
    "encoding.parameters=null": "encoding.parameters: must be an object",
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
    "seed=1e30": "must be a valid integer",
    "seed=true": "must be a valid integer",
    "seed=4294967296": "less than 4294967296",
}
SYNTAX = {  # what Hydra's grammar cannot read
    "outputs=a#b": """quote the value for Hydra and for the shell: 'outputs="a#b"'""",
    "outputs=Ärger": """'outputs="Ärger"'""",
    "outputs=~/x": """'outputs="~/x"'""",
    "outputs=a'b": "cannot be read",
    "outputs=a=b": "cannot be read",
    "outputs=a,b": "for a sweep, add -m",
    "outputs=[a]": "must be a valid string",
    "outputs=${foo}": "'foo' not found",
    "exp": "an override is key=value",
    "=3": "an override is key=value",
    "--exp=3": "overrides have no dashes",
    "--config-dir=nowhere": "is not a directory",
    "--config-name=config": "--config-name and --config-path are not supported",
    "--resolve": "--resolve is for --cfg only",
    "-m exp=1,2 --cfg job": "leave out -m",
    "exp=1 exp=2": "exp=1 and exp=2: exp is given twice",
    "-m seed=range(1000000)": "more than 1000 jobs",
    "-m seed=range(100) model=unet,fpn exp=1,2,3,4,1,2": "more than 1000 jobs",
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
    "task=predict scans={tmp}/loop": "symbolic links",
    "task=predict scans={tmp}/nowhere.npz": "No such file or directory",
    "task=predict scans=/dev/zero": "is neither a file nor a directory",
    "task=predict scans={tmp}/pipe": "is neither a file nor a directory",
    "recordings=/dev/null": "is a file",
    "task=demo demo.runtime={tmp}/pipe": "is neither a file nor a directory",
    "outputs=''": "at least 1 character",
}
YAML = {  # contents of a file scale/broken.yaml
    "a:\tb\n\tc: 1\n": "found character",
    "batch_size: 8\nbatch_size: 9\n": "duplicate key batch_size",
    "a: [1\n": "while parsing",
    "\xff\xfe\x00": "scale/broken.yaml: is not UTF-8",
    "": "Interpolation key 'scale.learning_rate' not found",
    "[1, 2]": "Index 'learning_rate' (str) is not an int",
    "a: &x [*x]": "recursion",
    '!!python/object/apply:os.system ["touch pwned"]': "could not determine a constructor",
    "a: 1": "Interpolation key 'scale.learning_rate' not found",
    "defaults: [first, _self_]\na: ${oc.env:HOME}": "is not a known key",
}
TASKS = {  # keys that a task needs, or does not use; README.md stands for any file
    "-m task=all,report exp=3": "task=all,report: a sweep has one task",
    "-m task=report seed=0,1": "task=report: is done once",
    "task=report seed=0,1": "seed=0,1: takes one value; for a sweep, add -m",
    "task=fly": "task=fly: must be one of adapt, all, analysis",
    "task=recrod": "did you mean record?",
    "task=predict": "scans: is needed with task=predict",
    "task=predict scans=README.md model=fpn": "model=fpn: has no effect with task=predict, prediction.weights chooses",
    "task=predict scans=README.md train.batch_size=2": "train.batch_size=2: has no effect with task=predict",
    "task=predict scans=README.md recordings=a": "recordings=a: has no effect with task=predict",
    "task=predict scans=README.md runtime.precision=32-true": "runtime.precision=32-true: has no effect",
    "task=demo seed=1": "seed=1: has no effect with task=demo, demo.networks chooses the network",
    "task=world prediction.fov_deg=60": "prediction.fov_deg=60: is for task=adapt and task=predict only",
    "task=world publish.force=true": "publish.force=true: is for task=export and task=publish only",
    "task=world format=onnx": "format=onnx: is for task=export only",
    "exp=3 demo.runtime=README.md": "demo.runtime=README.md: is for task=demo only",
    "task=report scans=README.md": "scans=README.md: is for task=predict only",
    "task=report floor_map=README.md": "floor_map=README.md: is for task=world only",
    "runtime.parts=2": "runtime.parts=2: is for task=record only",
    "task=predict scans=README.md prediction.center=here": "prediction.center=here: must be robot, start, or [x,y]",
    "task=predict scans=README.md prediction.center=[nan,1]": "must be robot, start, or [x,y]",
    "task=predict scans=README.md prediction.fov_deg=0": "must be greater than or equal to 10",
    "task=predict scans=README.md prediction.steps=0": "must be greater than or equal to 1",
    "task=predict scans=a,b.npz": "for a comma in it, quote it: 'scans=\"a,b.npz\"'",
    "runtime.accelerator=gpu": "no CUDA GPU is visible",
}
NETWORKS = {  # models and the encodings that they take
    "model=convlstm": "encoding=projection: model convlstm takes a series of images: encoding=series10 or",
    "model=convgru": "encoding=projection: model convgru takes a series of images",
    "model=convlstm encoding=stack4 model.encoder_name=mit_b0": "model.encoder_name=mit_b0: architecture convlstm has",
    "model=convgru encoding=series10 model.parameters.hidden=9": "model.parameters.hidden=9: must be a multiple of 16",
    "model=convgru encoding=series10 model.parameters.stride=3": "model.parameters.stride=3: must be 2 or 4",
    "model=convgru encoding=series10 +model.parameters.hiden=32": "hiden=32: is not a parameter of convgru",
    "+model.parameters.hidden=32": "parameters are for the architectures convgru, convlstm",
}
MOVING = "world.obstacles.moving.behavior"
SQUARE = "world.motions.square"
NUMBERS = {  # key: values that are not allowed
    "seed": (-1, 2**32),
    "oldest_gray": (-0.1, 1, 2, "nan"),
    "scale.size_px": (0, -32, 31, 50, 100, 8192),
    "scale.pairs.train": (0, -2, 3),
    "scale.pairs.val": (0, 1),
    "scale.pairs.test": (0, 7, 4_000_000),
    "scale.learning_rate": (0, -1, "nan", "inf"),
    "scale.batch_size": (0, 1, -8, 20_000),
    "scale.max_epochs": (0, -1),
    "scale.ema_decay": (0, 1, -1, "nan"),
    "train.learning_rate": (0, "nan"),
    "train.min_delta": (-1, "nan", "inf"),
    "train.patience": (-1,),
    "train.batch_size": (1, 10_001),
    "train.max_epochs": (0, -1),
    "train.dice_eps": (0, -1, "nan"),
    "runtime.workers": (0, -5, 1000),
    "runtime.part": (-1, 1),
    "runtime.parts": (0,),
    "runtime.max_minutes": (-1, "nan", "inf"),
    "runtime.accelerator": ("foo", "tpu", "cuda"),
    "runtime.precision": ("foo", "bf16", 32),
    "model.name": ("resnet", "all_free"),
    "model.encoder_weights": ("foo",),
    "encoding.name": ("foo",),
    "exp": (0, 5, "office"),
    "outputs": ("",),
    "recordings": ("",),
    "scale.name": ("a/b", "''"),
    "world.world.width": (0, -50, 100, "nan", "wide"),
    "world.world.height": (0, 49),
    "world.world.step_time": (0, -0.1, "inf"),
    "world.world.collision_mode": ("foo", "stop", "null"),
    "world.robot.shape.radius": (0, -1, 10, 1e-9),
    "world.robot.shape.name": ("rectangle",),
    "world.robot.kinematics.name": ("omni", "acker"),
    "world.robot.vel_max": ("[1,1]", "[0,0]", 3),
    "world.robot.vel_min": ("[-20,-1]",),
    "world.robot.sensors": ("[]",),
    f"{LIDAR}.type": ("fmcw_lidar2d",),
    f"{LIDAR}.range_min": (5, -1),
    f"{LIDAR}.range_max": (0, -5, "nan"),
    f"{LIDAR}.angle_range": (0, -1, 90, 7),
    f"{LIDAR}.number": (0, 1, -100, 2.5),
    "world.obstacles.static.count": ("[7.5,9]", "[9,8]", "[0,3]", "[80,80]", 8, "[8]"),
    "world.obstacles.static.radius_m": ("[0,1]", "[-1,2]", "[3,2]", "[20,20]"),
    "world.obstacles.static.aspect": ("[0,1]", "[2,1]"),
    "world.obstacles.static.disc_share": (2, -1, "nan"),
    f"{MOVING}.name": ("fly",),
    f"{MOVING}.speed_m_s": ("[0,1]", "[-1,1]", "[2,1]", "[1000,1000]", "[1,6]"),
    f"{MOVING}.turn_steps": ("[0,0]", "[-5,-1]", "[100,50]", "[1.5,3]"),
    f"{SQUARE}.side_m": (0, -10, 100, 12),
    f"{SQUARE}.drive_steps": (0, -1),
    f"{SQUARE}.turn_steps": (0, 2.5),
    f"{SQUARE}.first_steps": (-1, 21),
    f"{SQUARE}.name": ("fly",),
    "world.motions.rotate.steps": (0, 1),
    "world.experiments.3.clear_radius_m": (-1, "nan", 0.4, 30),
    "world.experiments.3.motion": ("null", "{}"),
}
UNKNOWN = (
    "+world.robot.state=[1,1,0]",
    f"+{LIDAR}.noise=true",
    f"+{LIDAR}.std=0.2",
    f"+{LIDAR}.offset=[1,0,0]",
    "+world.world.plot={}",
    "+world.obstacle=[]",
    "+world.obstacles.static.speed=1",
    "+world.experiments.3.seed=1",
    "+encoding.parameters.dark=1",
    "~world.world.width",
    "~world.robot.sensors",
    "~world.experiments.3.clear_radius_m",
    "++world.experiments.b!=${world.experiments.1}",
)
CASES = [f"{key}={value}" for key, values in NUMBERS.items() for value in values] + list(UNKNOWN)
QUICK = {f"{key}={values[0]}" for key, values in NUMBERS.items()} | set(UNKNOWN)  # a value of each key
ALLOWED = (
    "world.experiments.1.clear_radius_m=0",
    "runtime.precision=bf16-true",
    "model.encoder_name=mit_b1",
    "model.encoder_weights=imagenet",
    "world.world.width=100 & world.world.height=100",
    "runtime.max_minutes=0",
    "train.patience=0",
    "train.min_delta=0",
    "oldest_gray=0",
    f"{MOVING}.speed_m_s=[1,2]",
    "world.obstacles.static.disc_share=0",
    f"{LIDAR}.angle_range=6.283185307179586 & {LIDAR}.number=360",
    "++world.experiments.office=${world.experiments.4} & exp=office",
)
CALLS = KEYS | GROUPS | TASKS | NETWORKS | ENCODINGS | WORLDS | LIMITS | SYNTAX
HOSTILE = ("x", "nan", "-1e300", "1e300", "{a: 1}", "null")  # for numbers; see MEANINGFUL
MEANINGFUL = {  # hostile values that have a meaning
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
    os.mkfifo(tmp_path / "pipe")
    before = sorted(path.name for path in tmp_path.iterdir())
    arguments = call.replace("{tmp}", str(tmp_path)).split()
    (reason, *_) = refuse(*arguments, *([] if "task=" in call else ["task=record"]))
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
    with hydra.initialize_config_dir(str(conf_directory()), version_base="1.3"):
        values = plain(hydra.compose("config"))
    for name in ("motions", "obstacles"):  # their copies in the experiments are the same values
        assert name in values["world"]
    return [key for key in leaves(values) if not (key.startswith("world.experiments.") and key.count(".") > 3)]


@pytest.mark.slow
@pytest.mark.parametrize("key", numbers())
def test_a_number_takes_no_value_without_meaning(key):
    for value in HOSTILE:
        if value not in MEANINGFUL.get(key, ()):
            reasons = refuse(f"{key}={value}")
            name = re.sub(r"\.\d+$", "", key).split(".")[-1]
            assert any(name in reason or key in reason for reason in reasons), (value, reasons)


@pytest.mark.parametrize("call", ["train.lr=3", "encoding.parameters.decay=foo", "exp=9", "model=unte", "outputs=a#b"])
def test_a_refusal_writes_nothing_and_takes_less_than_three_seconds_of_the_processor(call, tmp_path):
    command = [sys.executable, "run.py", f"outputs={tmp_path / 'out'}", call]
    before = cpu_seconds()
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert done.stderr.startswith("error: this cannot be run\n")
    assert "Traceback" not in done.stderr
    assert cpu_seconds() - before < 3
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("sweep", ["scans={a}/run.npz,{b}/run.log", "scans={a}/run.npz prediction.stride_s=1,2"])
def test_predictions_that_would_replace_one_another_are_refused(sweep, tmp_path):
    for name in ("a/run.npz", "b/run.log"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text("a log")
    (reason,) = refuse("-m", "task=predict", *sweep.format(a=tmp_path / "a", b=tmp_path / "b").split())
    assert reason == "several predictions would write to predictions/run: make a call with outputs= for each"


@pytest.mark.parametrize("number", ["0", "-2", "1.5", "many", "null", "true"])
def test_a_wrong_number_of_parallel_trainings_is_refused(number):
    (reason,) = refuse("-m", "exp=3", "hydra/launcher=cores", f"hydra.launcher.n_jobs={number}")
    assert reason.startswith(f"hydra.launcher.n_jobs={number}: expected the number of trainings at the same time")


def test_slurm_is_refused_where_it_is_missing(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    (reason,) = refuse("-m", "exp=3", "hydra/launcher=slurm")
    assert "srun is not found" in reason


@pytest.mark.parametrize(
    "override", [pytest.param(case, marks=() if case in QUICK else pytest.mark.slow) for case in CASES]
)
def test_a_value_is_refused_naming_its_key(override):
    reasons = refuse("scale=paper", override)
    key = override.lstrip("+~").split("=")[0]
    last, text = key.split(".")[-1], " ".join(reasons)
    assert last in text or "world.experiments" in text, reasons
    assert all(len(reason) < 400 for reason in reasons)


@pytest.mark.parametrize("overrides", ALLOWED)
def test_unusual_values_are_allowed(overrides):
    assert read_calls("scale=paper", *overrides.split(" & "))


def test_all_reasons_are_listed_once():
    reasons = refuse("seed=-1", "scale.learning_rate=0", "runtime.workers=-5", "world.obstacles.static.disc_share=2")
    keys = [reason.split("=")[0] for reason in reasons]
    assert keys[2:] == ["seed", "scale.learning_rate", "runtime.workers"]
    assert keys[:2] == [f"world.obstacles.{name}.disc_share" for name in ("static", "moving")]  # it has two values


def test_the_reasons_of_all_jobs_are_listed():
    reasons = ["seed=-1: must be greater than or equal to 0", "exp=9: must be one of 1, 2, 3, 4"]
    assert refuse("-m", "exp=3,9", "seed=-1,0") == reasons


def test_every_job_of_a_sweep_is_composed():
    jobs = [(job.model.name, job.exp, job.seed) for job in read_calls("-m", "model=unet,fpn", "exp=3,4", "seed=0")]
    assert sorted(jobs) == sorted((model, exp, 0) for model, exp in itertools.product(("unet", "fpn"), "34"))


@pytest.mark.parametrize(
    "content", ["callbacks: {x: {_target_: numpy.savetxt, X: [1], fname: F}}", "job: {env_set: {A: b}}"]
)
def test_a_file_of_conf_cannot_configure_hydra(tmp_path, content):
    """Hydra calls what its configuration names, and a world may come from somebody else."""
    (tmp_path / "world").mkdir()
    written = content.replace("F}", f"{tmp_path / 'written'}}}")
    (tmp_path / "world" / "planted.yaml").write_text(
        f"# @package _global_\ndefaults: [office@world]\nhydra: {{{written}}}\n"
    )
    (reason,) = refuse("--config-dir", str(tmp_path), "task=world", "world=planted", "exp=people")
    assert f"world=planted: a file sets hydra.{content.split(':')[0]}" in reason
    assert not (tmp_path / "written").exists()


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("null: 2", "a configuration file has a key that is no text"),
        ("world: !!set {a, b}", "a configuration file has a key that is no text"),
        ("world: {width: !!binary aGVsbG8=}", "world.world.width=b'hello': must be a valid number"),
        ("experiments: 5", "world.experiments=5: must be an object"),
    ],
)
def test_a_world_of_values_that_only_yaml_has_is_refused(tmp_path, content, expected):
    (tmp_path / "world").mkdir()
    (tmp_path / "world" / "odd.yaml").write_text(f"defaults: [office, _self_]\n{content}\n")
    reasons = refuse("--config-dir", str(tmp_path), "task=world", "world=odd", "exp=people")
    assert any(expected in reason for reason in reasons), reasons


@pytest.mark.parametrize("arguments", [["--cfg", "job", "bogus=1"], ["--info", "searchpath", "exp=3,4"]])
def test_information_about_a_call_that_cannot_be_composed_is_refused(arguments):
    done = subprocess.run([sys.executable, "run.py", *arguments], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: this cannot be run")


def test_a_number_of_threads_that_is_none_is_refused(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "abc")
    assert refuse("exp=1") == ["OMP_NUM_THREADS=abc: expected a number of threads, such as 1"]


def test_a_deleted_working_directory_is_named(tmp_path):
    script = f"mkdir {tmp_path}/gone && cd {tmp_path}/gone && rmdir {tmp_path}/gone && {sys.executable} {ROOT}/run.py"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert done.stderr == "error: the working directory has been deleted: change to another one\n"


def test_a_traceback_can_be_requested(tmp_path):
    command = [sys.executable, "run.py", "train.lr=3", f"outputs={tmp_path / 'out'}"]
    environment = {**os.environ, "HYDRA_FULL_ERROR": "1"}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, env=environment)
    assert done.returncode == 1
    assert "Traceback" in done.stderr


@pytest.mark.parametrize(
    ("override", "warning"),
    [
        ("runtime.precision=bf16-true", "few digits"),
        ("model.encoder_name=mit_b1", "not the paper's"),
        ("world.experiments.3.clear_radius_m=0", "no clear zone"),
        (
            "++world.motions.rotate={name: waypoints,points_m: [[25, 25],[26,25]],speed_m_s: 1,turn_rad_s: 1}",
            "path",
        ),
    ],
)
def test_surprising_values_are_allowed_with_a_warning(override, warning):
    ((surprising,), (usual,)) = (read_calls("exp=3", *overrides) for overrides in ([override], []))
    assert [text for text in warnings_of(surprising) if warning in text]
    assert list(warnings_of(usual)) == []
