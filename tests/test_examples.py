"""The examples in IR-SIM, run as a user runs them, without a display."""

import os
import runpy
import subprocess
import sys

import pytest
from conftest import ROOT
from PIL import Image

pytestmark = pytest.mark.slow
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
HEADLESS = {name: value for name, value in os.environ.items() if name not in DISPLAYS}


def test_a_robot_in_irsim_is_shown_with_its_predicted_map(tmp_path, python):
    path = tmp_path / "live.gif"
    options = ["--exp", "4", "--seed", "1", "--steps", "112", "--every", "10", "--save", path]
    command = [python, "examples/irsim_live.py", *options]
    done = subprocess.run(command, cwd=ROOT, env=HEADLESS, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    with Image.open(path) as image:
        frames = []
        for number in range(image.n_frames):
            image.seek(number)
            frames.append(image.convert("L").copy())
    width, height = frames[0].size
    assert len(frames) == 11
    right = (width * 6 // 10, height * 3 // 10, width * 9 // 10, height * 7 // 10)
    before, after = (frame.crop(right).getextrema() for frame in (frames[0], frames[-1]))
    assert before[0] > 60, "the robot on an empty map before the first window"
    assert after[0] < 40, "predicted obstacles"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "write a GIF with --save"),  # without a display
        (("--steps", "50"), "--steps: expected more than the 100 of a window, got 50"),
        (("--weights", "reproduce/results/rooms-16000/exppeople-convgru"), "map has 25 m, the world of the paper 50 m"),
        (("--weights", "nothing"), "--weights: nothing"),
    ],
)
def test_what_cannot_be_shown_is_refused(arguments, message, tmp_path, monkeypatch):
    saved = ("--save", str(tmp_path / "live.gif")) if arguments else ()
    monkeypatch.setattr(sys, "argv", ["irsim_live.py", *arguments, *saved])
    for name in DISPLAYS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(ROOT)
    with pytest.raises(SystemExit, match=message):
        runpy.run_path("examples/irsim_live.py", run_name="__main__")
