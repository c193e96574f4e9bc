import pytest
from conftest import prepared, run_config

from repro.runs.directories import Run
from repro.runs.outputs import Outputs, check_together
from repro.runs.provenance import Status


def test_all_run_directories_are_found_with_their_configuration(tmp_path):
    outputs = Outputs(tmp_path)
    configs = [run_config(experiment="office", **changes) for changes in ({}, {"seed": 1}, {"model": "all_free"})]
    for config in (*configs, *configs):
        outputs.run(config.key).prepare(config)
    assert [run.config() for run in outputs.runs()] == configs


def test_another_configuration_is_refused_naming_the_difference(tmp_path):
    run = prepared(tmp_path)
    with pytest.raises(ValueError, match=r"data\.size_px is 32, requested 64; train\.patience is 5, requested 3"):
        run.prepare(run_config(size_px=64, patience=3))
    assert run.config() == run_config()


def test_runs_of_one_experiment_are_of_the_same_worlds(tmp_path):
    others = {Run(tmp_path): run_config(worlds="others")}
    check_together(run_config(experiment="4"), others)
    with pytest.raises(ValueError, match=r"has other data .*worlds: the file of conf/world is another"):
        check_together(run_config(model="fpn"), others)


def test_another_directory_is_not_read_as_a_run(tmp_path):
    with pytest.raises(ValueError, match=r"not a run directory: it has no config\.yaml"):
        Run(tmp_path).config()


@pytest.mark.parametrize("content", ["", "experiment: '3'\n", "experiment: [", "- 1\n", "seed: many\n"])
def test_a_damaged_configuration_is_named_with_a_fix(tmp_path, content):
    run = prepared(tmp_path)
    (tmp_path / "config.yaml").write_text(content)
    for call in (run.config, lambda: run.prepare(run_config())):
        with pytest.raises(ValueError, match=r"config\.yaml cannot be read .*delete .* to start the run again"):
            call()


def test_a_missing_configuration_is_not_replaced_by_another(tmp_path):
    run = prepared(tmp_path)
    run.use_recordings("hash")
    (tmp_path / "config.yaml").unlink()
    with pytest.raises(ValueError, match=r"config\.yaml cannot be read"):
        run.prepare(run_config(seed=7))
    assert not (tmp_path / "config.yaml").exists()


def test_a_model_without_provenance_is_refused(tmp_path):
    run = prepared(tmp_path)
    run.model.mkdir()
    with pytest.raises(ValueError, match=r"provenance\.json cannot be read"):
        _ = run.status


def test_every_step_is_recorded_with_its_environment_and_never_overwritten(tmp_path, monkeypatch):
    def on(machine):
        monkeypatch.setattr("repro.runs.directories.environment", lambda: {"commit": machine, "hardware": machine})

    run = prepared(tmp_path)
    assert run.status is Status.prepared
    on("recorder")
    run.use_recordings("abc")
    run.use_recordings("abc")
    with pytest.raises(ValueError, match="started with other recordings"):
        run.use_recordings("def")
    assert run.status is Status.prepared
    on("gpu at A")
    run.begin_step("trained", Status.training, precision="bf16-mixed")
    run.end_step(Status.failed, "the loss is nan")
    assert run.provenance().error == "the loss is nan"
    run.begin_step("trained", Status.training, precision="bf16-mixed")
    run.end_step(Status.trained, epochs=3)
    on("cpu at B")
    run.begin_step("evaluated", Status.evaluated, test_pairs=8)
    found = run.provenance()
    assert found.status is Status.evaluated
    assert found.error is None
    assert [(step["step"], step["commit"]) for step in found.steps] == [
        ("recorded", "recorder"),
        ("trained", "gpu at A"),
        ("trained", "gpu at A"),
        ("evaluated", "cpu at B"),
    ]
    assert (found.fact("epochs"), found.fact("test_pairs"), found.fact("recordings")) == (3, 8, "abc")


def test_a_run_with_missing_metrics_is_not_evaluated(tmp_path):
    run = prepared(tmp_path)
    run.begin_step("evaluated", Status.evaluated)
    assert not run.is_evaluated
    assert run.is_trained
    step = run.provenance().steps[0]
    assert step["versions"]["ir-sim"] == "2.12.0"
    assert min(step["hardware"][name] for name in ("cpu_cores", "threads")) > 0
    assert step["written"].endswith("+00:00")
