import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT, read_calls, refuse, run_py

from repro.cli.call import Call
from repro.cli.jobs import RESULTS, Job
from repro.runs.config import PairCounts
from repro.runs.model import NETWORKS, PAPER_ENCODER, paper_model
from repro.system.fields import OLDEST_GRAY

LIDAR = "world.robot.sensors.0"


def read_call(*overrides) -> Call:
    (call,) = read_calls(*overrides)
    return call


def test_defaults_are_the_papers():
    config = read_call("task=record", "scale=paper")
    assert config.scale.pairs == PairCounts(train=10000, val=128, test=500)
    assert (config.train.learning_rate, config.train.min_delta, config.train.patience) == (1e-4, 1e-3, 5)
    spec = config.specs["3"]
    assert (spec.lidar.number, spec.lidar.range_max) == (100, 30)
    assert spec.lidar.angle_range == pytest.approx(3.14159265 / 2)
    assert (spec.world.width, spec.world.height) == (50, 50)
    assert config.model.encoder_weights is None
    assert config.oldest_gray == OLDEST_GRAY


@pytest.mark.parametrize("experiment", ["1", "2", "3", "4"])
def test_every_experiment_has_the_papers_motion_obstacles_and_100_steps(experiment):
    spec = read_call(f"exp={experiment}").specs[experiment]
    assert spec.motion.name == ("rotate" if experiment in "13" else "square")
    assert bool(spec.behaviors) == (experiment in "34")
    assert spec.steps == 100


@pytest.mark.parametrize("model", NETWORKS)
def test_every_model_has_the_papers_encoder(model):
    assert read_call(f"model={model}").model == paper_model(model)
    assert PAPER_ENCODER == "mit_b0"


def test_a_job_has_the_directories_of_its_run():
    job = Job(read_call("exp=4", "model=fpn", "decay=false", "seed=2", "scale=laptop"))
    assert job.run.path == Path("outputs/laptop/runs/exp4/fpn/projection-no-decay/seed2")
    assert job.recordings == Path("outputs/laptop/recordings/exp4")
    assert job.published == ROOT / "reproduce" / "results" / "laptop"


def test_decay_belongs_to_the_encoding():
    assert read_call("decay=false", "oldest_gray=0.5").encoding.parameters == {"decay": False, "oldest_gray": 0.5}


def test_the_home_directory_is_expanded_in_every_path(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "x").touch()
    call = read_call("task=predict", "scans='~/x'", "outputs='~/y'", "prediction.weights='~/x'")
    assert (call.outputs, call.prediction.weights) == (f"{tmp_path}/y", f"{tmp_path}/x")
    demo = read_call("task=demo", "demo.networks=['~/x']").demo
    assert demo.networks == [f"{tmp_path}/x"]


def test_the_grid_has_the_size_of_the_world():
    config = read_call("world.world.width=100", "world.world.height=100")
    assert Job(config).config.data.size_m == 100


@pytest.mark.parametrize(("task", "refused"), [("all", True), ("train", True), ("record", False)])
def test_only_a_training_needs_as_many_pairs_as_its_batches(task, refused):
    call = ("scale=laptop", "scale.pairs.train=2", f"task={task}")
    if refused:
        assert refuse(*call) == ["train.batch_size=8: must be at most the 2 training pairs"]
    else:
        assert read_call(*call)


def test_weights_to_start_from_are_there_before_anything_is_recorded():
    for weights in ("", "no/such/weights/here"):
        [reason] = refuse(f"train.weights='{weights}'")
        assert reason.startswith(f"train.weights: {weights}: no such weights, expected one of buildings")
    read_call("train.weights=rooms", "model=convgru", "encoding=series10")
    [reason] = refuse("train.weights=conf")
    assert reason.startswith("train.weights: conf: expected a trained run or an exported network")


def test_runtime_settings_do_not_change_the_run():
    def run_config(*overrides):
        return Job(read_call("exp=3", *overrides)).config

    assert run_config() == run_config("runtime.workers=7", "runtime.max_minutes=3", "runtime.precision=bf16-mixed")
    assert run_config() != run_config("train.batch_size=4")
    assert run_config() != run_config("world.obstacles.moving.behavior.speed_m_s=[1,2]")


def test_validation_imports_no_heavy_library():
    heavy = ("torch", "irsim", "segmentation_models_pytorch")
    code = f"import sys, run; run.main(); print([name for name in {heavy} if name in sys.modules])"
    command = [sys.executable, "-c", code, "exp=9"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.slow
def test_a_world_is_written_and_replays_in_plain_irsim(tmp_path):
    outputs = tmp_path / "Ä"  # which the terminal cannot show
    done = run_py("task=world", "exp=3", "seed=17", f'outputs="{outputs}"', PYTHONIOENCODING="ascii")
    assert done.returncode == 0, done.stderr
    assert "\\xc4/worlds" in done.stdout
    code = (
        "import sys, irsim, repro.simulation.behaviors\n"
        "env = irsim.make(sys.argv[1], headless=True)\n"
        "for _ in range(100): env.step()\n"
        "print('hits', int(env.robot.lidar.valid.sum()), 'at', env.robot.state[:2, 0].round(3).tolist())\n"
    )
    path = outputs / "worlds" / "exp3-seed17-cw.yaml"
    done = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True, check=True)
    assert "at [25.0, 25.0]" in done.stdout


def test_published_results_are_those_of_the_name_of_the_outputs(monkeypatch):
    def job(outputs):
        return Job(read_call("scale=laptop", f"outputs={outputs}"))

    monkeypatch.chdir(ROOT / "src")
    assert job(".").published == job("outputs/src").published == RESULTS / "src"
    assert job("a/robot_logs").reference == job("b").reference == RESULTS / "laptop"  # no results of runs
    assert job("a/workstation").reference == RESULTS / "workstation"


def test_what_cannot_be_evaluated_leaves_no_run(tmp_path):
    """A run that is there fixes the settings of later calls."""
    job = Job(read_call("task=evaluate", "scale=first", f"outputs={tmp_path}"))
    with pytest.raises(ValueError, match=r"task=(train|record) first"):
        job.call.facts.run(job)
    assert not list(job.outputs.runs())
