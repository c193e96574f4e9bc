"""Calls of run.py that are refused before anything is written, and the jobs of those that are not."""

import itertools
import subprocess
import sys

import pytest
from conftest import ROOT, refuse
from hydra._internal.utils import get_args_parser

from repro.cli import composition

composition.register()
CALLS = {  # arguments, and what the message must contain
    "-m exp=3,4 encoding=projection,seen_free": ["encoding=seen_free", "observed_free"],
    "-m model=glob(*) seed=-1": ["seed=-1: must be greater than or equal to 0"],
    "-m exp=glob(*)": ["no jobs"],
    "~scale": ["scale"],
    "~train": ["train"],
    "+scale.size=32": ["scale.size", "is not a known key", "did you mean scale.size_px?"],
    "+sed=1": ["sed", "is not a known key", "did you mean seed?"],
    "--config-name=config": ["--config-name"],
    "-m task=all,report exp=3": ["task=all,report: a sweep has one task"],
    "world.robot.sensors.0.noise=true": ["noise: is not set in the files of conf/: add it with +world.robot"],
    "model=resnet": ["resnet", "fpn", "segformer", "unet", "upernet"],
    "scale=huge": ["huge", "laptop", "paper", "smoke"],
    "task=fly": ["fly", "record", "train", "evaluate", "report", "all"],
    "world=moon": ["moon", "paper"],
    "decay=maybe": ["maybe", "bool"],
    "train.patience=often": ["often", "train.patience"],
    "-m exp=3,9 seed=-1,0": ["exp=9: must be one of 1, 2, 3, 4", "seed=-1: must be"],
    "-m task=report seed=0,1": ["task=report: is done once"],
    "task=report seed=0,1": ["seed=0,1: takes one value; for a sweep, add -m"],
    "task=predict": ["scans: is needed with task=predict"],
    "task=predict scans=a model=fpn exp=3 train.batch_size=2": [
        "model=fpn: has no effect with task=predict, prediction.weights chooses the network",
        "exp=3: has no effect with task=predict, prediction.weights chooses the network",
        "train.batch_size=2: has no effect with task=predict, prediction.weights chooses the network",
    ],
    "runtime.parts=2": ["runtime.parts=2: is for task=record only"],
    "encoding.parameters.decay=false": ["encoding.parameters.decay=False: set decay instead"],
    "task=demo seed=1": ["seed=1: has no effect with task=demo, demo.networks chooses the network"],
    "task=world exp=1 prediction.fov_deg=60 publish.force=true format=onnx": [
        "prediction.fov_deg=60: is for task=predict only",
        "publish.force=true: is for task=publish and task=export only",
        "format=onnx: is for task=export only",
    ],
    "exp=3 demo.runtime=a": ["demo.runtime=a: is for task=demo only"],
    "task=report scans=a": ["scans=a: is for task=predict only"],
    "task=floor": ["floor_map: is needed with task=floor"],
    "task=report floor_map=a": ["floor_map=a: is for task=floor only"],
    "task=predict scans=a prediction.center=here": ["prediction.center=here: must be robot, start, or [x,y]"],
    "task=predict scans=a prediction.center=[nan,1]": ["must be robot, start, or [x,y]"],
    "task=predict scans=a prediction.fov_deg=0": ["prediction.fov_deg=0.0: must be greater than or equal to 10"],
    "task=predict scans=a prediction.steps=0": ["prediction.steps=0: must be greater than or equal to 1"],
    "runtime.accelerator=gpu": ["no CUDA GPU is visible"],
    "model=convlstm": ["encoding=projection", "a series of images: encoding=series10 or encoding=stack10"],
    "model=convgru": ["encoding=projection", "a series of images: encoding=series10 or encoding=stack10"],
    "model=convlstm encoding=stack4 model.encoder_name=mit_b0": ["model.encoder_name=mit_b0", "of its own"],
    "model=convgru encoding=series10 model.parameters.hidden=9 model.parameters.stride=3": [
        "model.parameters.hidden=9: must be a multiple of 16",
        "model.parameters.stride=3: must be 2 or 4",
    ],
    "model=convgru encoding=series10 +model.parameters.hiden=32": ["hiden=32: is not a parameter of convgru"],
    "+model.parameters.hidden=32": ["parameters are for the architectures convgru, convlstm, deeptracking"],
}


@pytest.mark.parametrize(("call", "expected"), CALLS.items())
def test_an_invalid_call_is_refused_with_its_reason(call, expected):
    reasons = "\n".join(refuse(*call.split()))
    assert all(part in reasons for part in expected), reasons


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
    ("content", "reason"),
    [
        ("null: 2", "a configuration file has a key that is no text"),
        ("world: !!set {a, b}", "a configuration file has a key that is no text"),
        ("world: {width: !!binary aGVsbG8=}", "world.world.width=b'hello': must be a valid number"),
        ("experiments: 5", "world.experiments=5: must be an object"),
    ],
)
def test_a_world_of_values_that_only_yaml_has_is_refused(tmp_path, content, reason):
    (tmp_path / "world").mkdir()
    (tmp_path / "world" / "odd.yaml").write_text(f"defaults: [office, _self_]\n{content}\n")
    assert reason in refuse("--config-dir", str(tmp_path), "task=world", "world=odd", "exp=people")


def test_every_job_of_a_sweep_is_composed():
    arguments = get_args_parser().parse_args(["-m", "model=unet,fpn", "exp=3,4", "seed=0"])
    jobs = [(job.model.name, job.exp, job.seed) for job in composition.compose_jobs(arguments)]
    assert sorted(jobs) == sorted((model, exp, 0) for model, exp in itertools.product(("unet", "fpn"), "34"))


@pytest.mark.slow
def test_a_sweep_is_refused_if_one_of_its_jobs_is_invalid():
    errors = refuse("-m", "model=glob(*)", "encoding=projection,stack4")
    assert len(errors) == 4, errors
    for error, name in zip(sorted(errors), ("convgru", "convlstm", "deeptracking", "light_convgru"), strict=True):
        assert name in error
        assert "encoding=stack10" in error


@pytest.mark.parametrize("option", [["--cfg", "job"], ["--info", "searchpath"]])
@pytest.mark.parametrize(("override", "reason"), [("bogus=1", "is not a known key"), ("exp=3,4", "sweep, add -m")])
def test_information_about_a_call_that_cannot_be_composed_is_refused(option, override, reason):
    command = [sys.executable, "run.py", *option, override]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: this cannot be run")
    assert reason in done.stderr


def test_the_configuration_of_a_sweep_is_not_printed():
    command = [sys.executable, "run.py", "-m", "exp=1,2", "--cfg", "job"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "error: --cfg prints the configuration of one job: leave out -m\n"
