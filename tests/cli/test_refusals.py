"""Calls that are refused, by class: each with the key or argument in the message, quickly, and without writing."""

import copy
import functools
import itertools
import math
import operator
import os
import re
import shutil
import sys
from typing import Any

import hydra
import pytest
from conftest import TINY, cpu_seconds, fake_run, read_calls, refuse, run_py

from repro.cli import main
from repro.cli.call import read_call
from repro.cli.jobs import Job
from repro.cli.refusals import Refused
from repro.cli.tasks import evaluate, report, train
from repro.system.errors import InputError
from repro.system.project import conf_directory
from repro.worlds.spec import plain

LIDAR = "world.robot.sensors.0"
CALLS = {
    # unknown keys, and what the message suggests
    "train.lr=3": "train.lr: is not a known key; known are learning_rate",
    "model.parameters.centred=true": "is not a known key; +model.parameters.centred=... adds it",
    "scale.sizepx=64": "did you mean scale.size_px?",
    "sed=1": "did you mean seed?",
    "encoding.decay=true": "did you mean encoding.parameters.decay or decay?",
    "world.robot.sensors.lidar.range_max=3": "Index 'lidar' (str) is not an int",
    f"{LIDAR}.rang_max=3": "did you mean world.robot.sensors.0.range_max?",
    "hydra.foo=1": "Could not override 'hydra.foo'",
    # missing keys
    "~scale": "takes one name",
    "~seed": "seed: is missing",
    "~world.experiments.3.clear_radius_m": "world.experiments.3.clear_radius_m: is missing",
    # groups take one name
    "model=[unet,fpn]": "use -m model=a,b",
    "model=1": "takes one name",
    "model=unte": "model=unte: must be one of convgru, convlstm, fpn",
    # sweeps
    "exp=3,4": "exp=3,4: several values: -m runs a job for each",
    "task=predict scans=a,b": "[a,b] is a list",
    "--config-name other": "--config-name: not understood",
    "task=predict scans=${nokey}": "scans: Interpolation key 'nokey' not found",
    "task=predict scans=a\udcff.npz": r"scans=a\xff.npz: is no printable text in UTF-8: rename the file",
    "-m exp=glob(*)": "the sweep has no jobs",
    "-m seed=range(0,100000)": "the sweep has 100000 jobs: expected 1 to 2000",
    "-m exp=3 scale.size_px=64,128": "2 jobs write to ",
    "-m exp=3 train.dice_eps=1e-6,1e-5 seed=0,1": "seed0, such as train.dice_eps=1e-06 and train",
    "-m exp=3,3": "such as one and the same again: set outputs= for each",
    "-m task=predict scans=examples/rooms.npz prediction.fov_deg=60,80": "predictions/rooms, such as prediction",
    "-m task=world world.world.step_time=0.1,0.2": "worlds/exp1-seed0, such as world.world.step_time=0.1",
    "-m task=navigate world=navigation exp=mixed navigation.test_seeds=1,2": "navigation/keep, such as navigation",
    "-m task=all,report exp=3": "task=all,report: a sweep has one task",
    "-m task=report exp=3,4": "task=report: is done once for all runs",
    "-m exp=3 hydra/launcher=slurm": "srun is not found",
    "-m exp=3 hydra/launcher=fly": "hydra/launcher=fly: must be one of basic, cores",
    # what Hydra's grammar and options do not take
    "outputs=a#b": """quote the value for Hydra and for the shell: 'outputs="a#b"'""",
    "outputs=${foo}": "'foo' not found",
    "exp": "exp: an override is key=value",
    "=3": "=3: an override is key=value",
    "--exp=3": "overrides without dashes",
    "--config-dir=nowhere": "is not a directory",
    # types
    "outputs=2024_05_13": "outputs=20240513: must be a valid string; for a name, quote it",
    "seed=1e30": "must be a valid integer",
    "train.loss=bce": "must be 'map'",
    # tasks: what they need, and what has no effect; README.md stands for any file
    "task=fly": "task=fly: must be one of adapt, all, analysis",
    "task=predict": "scans: is needed with task=predict",
    "task=adapt": "adaptation.logs: is needed with task=adapt",
    "task=adapt adaptation.logs=[README.md,5]": "must be a file, or a list of files, [a.bag,b.bag]",
    "task=adapt adaptation.logs=README.md prediction.weights=fly": "prediction.weights: fly: no such weights, expected",
    "task=predict scans=README.md model=fpn": "model=fpn: has no effect with task=predict, prediction.weights chooses",
    "task=demo seed=1": "seed=1: has no effect with task=demo, demo.networks chooses the network",
    "task=world prediction.fov_deg=60": "prediction.fov_deg=60: is for task=adapt, navigate, predict only",
    "task=world publish.force=true": "publish.force=true: is for task=export, publish only",
    "task=navigate world=navigation navigation.inflations_m=[2.0]": "navigation.inflations_m",
    "task=navigate world=navigation navigation.experiments=[walls]": "walls is none of static, slow",
    # predictions
    "task=predict scans=README.md prediction.center=here": "prediction.center=here: must be robot, start, or [x,y]",
    "task=predict scans=README.md prediction.pose=[1,2]": "must be fixed, or [x,y,heading]",
    # encodings and networks
    "encoding.parameters.oldest_gray=1": "must be less than or equal to 0.996",
    "+encoding.parameters.dark=1": "takes decay, oldest_gray, got dark",
    "encoding=stack4 encoding.parameters.frames=1000000": "must be less than or equal to 100",
    "encoding=stack4 encoding.parameters.frames=8": "does not match its parameters",
    "encoding=stack4 decay=false": "has no decay",
    "encoding=series10 oldest_gray=0.3": "has no oldest gray",
    "encoding=series10 exp=3 world.motions.rotate.steps=9": "divides a window into 10 parts, those of exp 3 have 9",
    "model=convgru": "encoding=projection: model convgru takes a series of images: encoding=series10, counts10",
    "model=convlstm encoding=stack4 model.encoder_name=mit_b0": "model.encoder_name=mit_b0: architecture convlstm has",
    "model=convgru encoding=series10 model.parameters.hidden=9": "hidden must be a multiple of 16",
    "model=convgru encoding=series10 model.parameters.stride=4.0": "stride 2 or 4, got 48 and 4.0",
    "model=convgru encoding=series10 +model.parameters.centered=no": "must be true or false, got 'no'",
    "model=convlstm encoding=stack10 model.parameters.hidden=0": "hidden must be a multiple of 16, got 0",
    "model=convgru encoding=series10 +model.parameters.hiden=32": "unexpected keyword argument 'hiden'",
    "+model.parameters.hidden=32": "parameters are for the architectures convgru, convlstm",
    # worlds that cannot be simulated, or not in the memory of a machine
    f"{LIDAR}.number=50000": "more than 2000000 readings",
    "world.robot.vel_min=[1,1]": "the robot needs",
    "world.obstacles.static.count=[900,900]": "no room",
    "world.motions.rotate.name=circle": "world.motions.rotate: the name circle must be one of rotate, square",
    "+world.robot.state=[1,1,0]": "world.robot.state=[1, 1, 0]: is not a known key",
    f"+{LIDAR}.noise=true": "need one another",
    # more than this machine can do
    "scale.pairs.train=2000000 scale.size_px=4096": "GB of memory, this machine has",
    "runtime.accelerator=cpu runtime.precision=16-mixed": "float16 needs a GPU",
    "runtime.accelerator=gpu": "no CUDA GPU is visible",
}
PATHS = {  # files that cannot be read; {tmp} is a directory with a pipe
    "outputs=''": "outputs=: must have at least 1 character",
    "task=predict scans={tmp}/nowhere.npz": "No such file or directory",
    "task=predict scans=/dev/zero": "is neither a file nor a directory",
}
YAML = {  # contents of a file scale/broken.yaml
    "a:\tb\n\tc: 1\n": "found character",
    "batch_size: 8\nbatch_size: 9\n": "duplicate key batch_size",
    "\xff\xfe\x00": "a configuration file cannot be read: 'utf-8' codec",
    "": "Interpolation key 'scale.learning_rate' not found",
    "[1, 2]": "Index 'learning_rate' (str) is not an int",
    "a: &x [*x]": "aliases stand for",
    '!!python/object/apply:os.system ["touch pwned"]': "could not determine a constructor",
    "defaults: [first, _self_]\na: ${oc.env:HOME}": "is not a known key",
}
MOVING = "world.obstacles.moving.behavior"
SQUARE = "world.motions.square"
NUMBERS = {  # key: values that a number, a name or a rule on several values excludes
    "seed": (-1, 2**32),
    "scale.size_px": (0, 100),
    "scale.pairs.train": (3, 4_000_000),
    "scale.batch_size": (1, 20_000),
    "scale.name": ("a/b", "''"),
    "runtime.workers": (0, 1000),
    "runtime.precision": ("bf16", 32),
    "model.name": ("resnet", "all_free"),
    "encoding.name": ("foo",),
    "exp": (0, 5),
    "world.world.width": (100,),
    "world.robot.vel_max": ("[1,1]", 3),
    f"{LIDAR}.number": (1, 2.5),
    "world.obstacles.static.count": ("[7.5,9]", "[9,8]", 8, "[8]"),
    f"{MOVING}.name": ("fly",),
    f"{MOVING}.speed_m_s": ("[1,6]",),
    f"{SQUARE}.first_steps": (21,),
    "world.experiments.3.clear_radius_m": (0.4, 30),
}
ALLOWED = (
    "runtime.precision=bf16-true",
    "model.encoder_name=mit_b1",
    "world.world.width=100 & world.world.height=100",
    "runtime.max_minutes=0",
    "train.patience=0",
    "train.min_delta=0",
    "oldest_gray=0",
    f"{MOVING}.speed_m_s=[1,2]",
    f"{LIDAR}.angle_range=6.283185307179586 & {LIDAR}.number=360",
    "++world.experiments.office=${world.experiments.4} & exp=office",
)
HOSTILE = ("x", math.nan, -1e300, 1e300, {"a": 1}, None)  # for numbers; see MEANINGFUL
MEANINGFUL = {  # hostile values that have a meaning
    "runtime.max_minutes": (1e300, None),  # no limit
    "scale.ema_decay": (None,),  # no average
    "train.ema_decay": (None,),
}


@pytest.mark.parametrize(("call", "expected"), CALLS.items())
def test_a_call_is_refused_with_its_reason(call, expected, monkeypatch):
    monkeypatch.setattr("repro.system.memory.psutil.virtual_memory", lambda: Memory())
    monkeypatch.setattr(shutil, "which", lambda name: None)
    reasons = refuse(*call.split(" "))
    assert any(expected in reason for reason in reasons), reasons
    assert all("\n" not in reason for reason in reasons), reasons


class Memory:
    """The memory of a machine with 16 GB."""

    total = available = 16e9


@pytest.mark.parametrize(("call", "expected"), PATHS.items())
def test_a_path_that_cannot_be_used_is_refused(call, expected, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (reason, *_) = refuse(*call.replace("{tmp}", str(tmp_path)).split())
    assert expected in reason


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


with hydra.initialize_config_dir(str(conf_directory()), version_base="1.3"):
    USUAL = plain(hydra.compose("config"))


@pytest.mark.parametrize("key", [key for key in leaves(USUAL) if not re.match(r"world\.experiments\.\w+\..*\.", key)])
def test_a_number_takes_no_value_without_meaning(key):
    """Without the copies of motions and obstacles in the experiments."""
    *above, last = (int(word) if word.isdigit() and ".experiments" not in key else word for word in key.split("."))
    for value in HOSTILE:
        if value not in MEANINGFUL.get(key, ()):
            values = copy.deepcopy(USUAL)
            functools.reduce(operator.getitem, above, values)[last] = value
            with pytest.raises(Refused) as refused:
                read_call(values)
            name = re.sub(r"\.\d+$", "", key).split(".")[-1]
            assert any(name in str(reason) or key in str(reason) for reason in refused.value.args), value


@pytest.mark.parametrize("call", ["train.lr=3", "exp=9", "model=unte"])
def test_a_refusal_writes_nothing_and_takes_less_than_three_seconds_of_the_processor(call, tmp_path):
    before = cpu_seconds()
    done = run_py(f"outputs={tmp_path / 'out'}", call)
    assert done.returncode == 2
    assert done.stderr.startswith("error: this cannot be run\n")
    assert "Traceback" not in done.stderr
    assert cpu_seconds() - before < 3
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("override", [f"{key}={value}" for key, values in NUMBERS.items() for value in values])
def test_a_value_is_refused_naming_its_key(override):
    reasons = refuse("scale=paper", override)
    last, text = override.split("=")[0].split(".")[-1], " ".join(reasons)
    assert last in text or "world.experiments" in text, reasons
    assert all(len(reason) < 400 for reason in reasons)


@pytest.mark.parametrize("overrides", ALLOWED)
def test_unusual_values_are_allowed(overrides):
    assert read_calls("scale=paper", *overrides.split(" & "))


def test_all_reasons_of_all_jobs_are_listed_once():
    reasons = refuse("-m", "seed=-1,0", "runtime.workers=-5", "world.obstacles.static.disc_share=2")
    keys = [reason.split("=")[0] for reason in reasons]
    assert keys == [*(f"world.obstacles.{name}.disc_share" for name in ("static", "moving")), "seed", "runtime.workers"]


def test_every_job_of_a_sweep_is_composed():
    jobs = [(job.model.name, job.exp, job.seed) for job in read_calls("-m", "model=unet,fpn", "exp=3,4", "seed=0")]
    assert sorted(jobs) == sorted((model, exp, 0) for model, exp in itertools.product(("unet", "fpn"), "34"))


def test_a_sweep_of_other_data_than_that_of_its_outputs_is_refused_once(tmp_path, monkeypatch, capsys):
    fake_run(tmp_path, "3", "unet", 0.5)
    monkeypatch.setattr(main, "_prepare_process", lambda: None)
    monkeypatch.setattr(sys, "argv", ["run.py", "-m", "exp=3", "model=unet,fpn", *TINY, f"outputs={tmp_path}"])
    assert main.main() == 2
    assert capsys.readouterr().err.count("has other data than") == 1


def test_a_training_without_recordings_is_refused_before_its_run_begins(tmp_path):
    (call,) = read_calls("task=train", "exp=3", *TINY, f"outputs={tmp_path / 'out'}")
    with pytest.raises(InputError, match=r"no complete recordings in .*exp3"):
        train.run(Job(call))
    assert not list(tmp_path.iterdir())


def test_a_directory_with_the_log_of_a_refusal_alone_has_nothing_to_evaluate_or_report(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "repro.evaluation.scoring", None)  # takes seconds, and is not needed to tell
    (tmp_path / "runs/exp3/unet/projection/seed0").mkdir(parents=True)
    (call,) = read_calls("exp=3", *TINY, f"outputs={tmp_path}")
    with pytest.raises(InputError, match="seed0 is not fully trained"):
        evaluate.run(Job(call))
    with pytest.raises(InputError, match="holds no recordings and no runs"):
        report.run(Job(call))


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
        ("null: 2", "a configuration file cannot be read: it has a key that is no text"),
        ("world: {width: !!binary aGVsbG8=}", "world.world.width=b'hello': must be a valid number"),
        ("experiments: 5", "world.experiments=5: must be an object"),
    ],
)
def test_a_world_of_values_that_only_yaml_has_is_refused(tmp_path, content, expected):
    (tmp_path / "world").mkdir()
    (tmp_path / "world" / "odd.yaml").write_text(f"defaults: [office, _self_]\n{content}\n")
    reasons = refuse("--config-dir", str(tmp_path), "task=world", "world=odd", "exp=people")
    assert any(expected in reason for reason in reasons), reasons


def test_a_traceback_can_be_requested(tmp_path):
    done = run_py("train.lr=3", f"outputs={tmp_path / 'out'}", HYDRA_FULL_ERROR="1")
    assert done.returncode == 1
    assert "Traceback" in done.stderr
