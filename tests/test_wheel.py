"""The wheel in a folder that is no checkout: networks by name, the prediction of a log, and a sweep."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from repro.demo.runtime import cached_archive

ROOT = Path(__file__).parents[1]
FOLDERS, FILES = ("conf", "src"), ("pyproject.toml", "README.md", "LICENSE")
SWEEP = "-m exp=4 decay=false model=unet scale=first scale.pairs.train=16 scale.pairs.val=2 scale.pairs.test=2"

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """Build the wheel from a copy of its sources and unpack it."""
    directory = tmp_path_factory.mktemp("wheel")
    for name in FOLDERS:
        shutil.copytree(ROOT / name, directory / "sources" / name)
    for name in FILES:
        shutil.copyfile(ROOT / name, directory / "sources" / name)
    build = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", directory]
    subprocess.run([*build, directory / "sources"], check=True)
    (wheel,) = directory.glob("*.whl")
    assert wheel.stat().st_size < 8e6
    with zipfile.ZipFile(wheel) as file:
        file.extractall(directory / "site")
    return directory / "site"


def call(python: Path | str, site: Path, folder: Path, code: str, *arguments: str) -> str:
    """Run Python in a folder with the unpacked wheel; return what it prints."""
    done = subprocess.run(
        [python, "-c", f"import sys, repro; assert {str(site)!r} in repro.__file__; {code}", *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


MAIN = "from repro.cli.main import main; sys.exit(main())"


def test_networks_are_loaded_by_name(python, site, tmp_path):
    names = ["indoor", "buildings", "rooms", "drive", "exp1", "exp2", "exp3", "exp4"]
    code = "[print(repro.load_predictor(name).grid.size_px) for name in sys.argv[1:]]"
    assert call(python, site, tmp_path, code, *names).split() == ["128"] * len(names)


def test_a_log_is_predicted(python, site, tmp_path):
    shutil.copyfile(ROOT / "examples" / "rooms.npz", tmp_path / "rooms.npz")
    call(python, site, tmp_path, MAIN, "task=predict", "scans=rooms.npz")
    assert list(tmp_path.glob("outputs/**/*.png"))


STUDY = (
    *("torch", "pandas", "scipy", "matplotlib", "PIL", "joblib", "shapely", "irsim", "onnx", "huggingface_hub"),
    "jinja2",
)
WITHOUT = f"sys.modules.update(dict.fromkeys({STUDY}))  # as if they were not installed"


def test_a_log_is_predicted_without_the_packages_of_the_study(site, tmp_path):
    shutil.copyfile(ROOT / "examples" / "rooms.npz", tmp_path / "rooms.npz")
    arguments = ("task=predict", "scans=rooms.npz", "prediction.stride_s=10")
    text = call(sys.executable, site, tmp_path, f"{WITHOUT}\n{MAIN}", *arguments)
    assert "pip install matplotlib for figures" in text
    assert {path.suffix for path in tmp_path.glob("outputs/*/predictions/rooms/*")} == {
        *(".npz", ".pgm", ".yaml", ".csv", ".json")
    }


def test_the_demo_is_written_without_the_packages_of_the_study(site, tmp_path):
    if not cached_archive().is_file():
        pytest.skip(f"{cached_archive()} is missing: python run.py task=demo downloads it")
    call(sys.executable, site, tmp_path, f"{WITHOUT}\n{MAIN}", "task=demo")
    (page,) = tmp_path.glob("outputs/*/demo.html")
    assert "ConvGRU, experiment 4" in page.read_text()


@pytest.mark.parametrize(
    ("arguments", "missing"), [("task=train exp=4", "shapely"), ("task=adapt adaptation.logs=[rooms.npz]", "torch")]
)
def test_a_task_of_the_study_names_what_installs_it(site, tmp_path, arguments, missing):
    shutil.copyfile(ROOT / "examples" / "rooms.npz", tmp_path / "rooms.npz")
    command = [sys.executable, "-c", f"import sys; {WITHOUT}\n{MAIN}", *arguments.split(), "scale=first"]
    done = subprocess.run(
        command, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(site)}, capture_output=True, text=True
    )
    assert done.returncode != 0
    assert f"this needs the study, of which {missing} is missing: make setup in a clone, or pip install" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_sweep_trains_and_tabulates(python, site, tmp_path):
    text = call(python, site, tmp_path, MAIN, *SWEEP.split(), "scale.max_epochs=1")
    assert "| 4 | U-Net |" in text
    assert (tmp_path / "outputs/first/runs/exp4/unet/projection-no-decay/seed0/metrics.csv").is_file()
