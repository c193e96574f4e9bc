"""Values that must be refused, with their messages, and unusual values that are allowed."""

import os
import subprocess
import sys

import pytest
from conftest import ROOT
from hydra import compose, initialize_config_dir
from hydra.errors import HydraException
from omegaconf.errors import OmegaConfBaseException

from repro.cli import composition
from repro.cli.config import to_typed
from repro.cli.validation import all_errors, warnings_of
from repro.world_config import plain

composition.register()

MOVING = "world.obstacles.moving.behavior"
LIDAR = "world.robot.sensors.0"
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


@pytest.fixture(scope="module", autouse=True)
def hydra_is_ready():
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        yield


def errors_of(overrides: str) -> list[str]:
    """Return the errors of overrides, separated by ` & `, at paper scale."""
    try:
        config = compose("config", overrides=["scale=paper", *overrides.split(" & ")])
        return [str(error) for error in all_errors(plain(config))]
    except (HydraException, OmegaConfBaseException) as error:  # refused by Hydra itself
        return [f"{error} {error.__cause__}"]


@pytest.mark.parametrize(
    "override", [pytest.param(case, marks=() if case in QUICK else pytest.mark.slow) for case in CASES]
)
def test_invalid_values_are_refused_naming_their_key(override):
    errors = errors_of(override)
    assert errors, f"{override} was accepted"
    key = override.lstrip("+~").split("=")[0]
    last, text = key.split(".")[-1], " ".join(errors)
    assert last in text or "world.experiments" in text, errors
    assert all(len(error) < 400 for error in errors)


@pytest.mark.parametrize("overrides", ALLOWED)
def test_unusual_values_are_allowed(overrides):
    assert errors_of(overrides) == []


def test_all_errors_are_listed_once():
    errors = errors_of("seed=-1 & scale.learning_rate=0 & runtime.workers=-5 & world.obstacles.static.disc_share=2")
    assert len(errors) == len(set(errors)) == 5  # conf/world has two values of disc_share
    keys = [error.split("=")[0] for error in errors]
    assert keys[:3] == ["seed", "scale.learning_rate", "runtime.workers"]


def test_a_traceback_can_be_requested(tmp_path):
    command = [sys.executable, "run.py", "train.lr=3", f"outputs={tmp_path / 'out'}"]
    environment = {**os.environ, "HYDRA_FULL_ERROR": "1"}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, env=environment)
    assert done.returncode == 1
    assert "Traceback" in done.stderr


def test_outputs_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "out").write_text("a file")
    assert errors_of(f"outputs={tmp_path / 'out'}") == [f"outputs={tmp_path / 'out'}: is a file, a directory is needed"]


@pytest.mark.parametrize(
    ("override", "warning"),
    [
        ("runtime.precision=16-true", "few digits"),
        ("model.encoder_name=mit_b1", "not the paper's"),
        ("world.experiments.3.clear_radius_m=0", "no clear zone"),
        ("world.motions.rotate.name=waypoints", "path upside down"),
    ],
)
def test_surprising_values_are_allowed_with_a_warning(override, warning):
    surprising, usual = (
        to_typed(plain(compose("config", overrides=overrides))) for overrides in (["exp=3", override], ["exp=3"])
    )
    assert [text for text in warnings_of(surprising) if warning in text]
    assert warnings_of(usual) == []
