from conftest import read_calls

from repro.cli.jobs import Job, resolve
from repro.cli.notes import print_cost
from repro.learning import cost
from repro.runs.provenance import Status


def jobs_of(outputs, seeds, *overrides) -> list[Job]:
    """Return trainings at paper scale."""
    overrides = ["task=train", "scale=paper", f"outputs={outputs}", *overrides]
    return [resolve(call) for seed in seeds for call in read_calls(*overrides, f"seed={seed}")]


def test_without_gpu_the_cost_of_paper_scale_and_an_alternative_are_printed(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cost, "training_seconds", lambda *_: 3600.0)
    monkeypatch.setattr(cost, "trainings_at_once", lambda *_: 2)
    print_cost(jobs_of(tmp_path, range(8)))
    warning = capsys.readouterr().err
    assert "no CUDA GPU" in warning
    assert "these 8 trainings take about 4 h" in warning
    assert "scale=laptop" in warning


def test_every_network_and_input_is_measured_once(tmp_path, monkeypatch, capsys):
    durations = {"projection": 3600.0, "series10": 7200.0}
    measured = []
    monkeypatch.setattr(
        cost, "training_seconds", lambda config, *_: measured.append(config) or durations[config.encoding.name]
    )
    monkeypatch.setattr(cost, "trainings_at_once", lambda *_: 1)
    series = jobs_of(tmp_path, range(2), "model=convgru", "encoding=series10", "train=small_batches")
    print_cost(jobs_of(tmp_path, range(2)) + jobs_of(tmp_path, [0], "exp=3") + series)
    assert [config.train.batch_size for config in measured] == [16, 2]
    assert "these 5 trainings take about 7 h" in capsys.readouterr().err


def test_the_cost_of_finished_trainings_is_not_printed(tmp_path, capsys):
    (job,) = jobs_of(tmp_path, [0])
    job.run.prepare(job.config)
    job.run.begin_step("trained", Status.trained)
    print_cost([job])
    assert capsys.readouterr().err == ""
