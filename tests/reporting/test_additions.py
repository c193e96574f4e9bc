import json

import pandas as pd
import pytest
from conftest import fake_run, fake_study

from repro.config import Encoding
from repro.reporting.publish import publish
from repro.reporting.results import read_published, read_results
from repro.reporting.tables import make_tables
from repro.runs.keys import KEY, RunKey
from repro.runs.outputs import Outputs
from repro.runs.provenance import Status

SERIES = Encoding("series10", {"frames": 10, "range_max_m": 30.0})


@pytest.fixture
def published(tmp_path, monkeypatch):
    """Publish a study with an analysis; return reproduce/results."""
    monkeypatch.setattr("repro.runs.provenance._commit", lambda: "abc")
    first = tmp_path / "first" / "laptop"
    fake_study(first)
    write_intervals(first, [("3", "unet", "projection", 0.5), ("3", "all_free", "", 0.0)])
    publish(Outputs(first), tmp_path / "results")
    return tmp_path / "results"


@pytest.fixture
def later(tmp_path):
    """Return outputs with a run of another network and one of a published network with another seed."""
    path = tmp_path / "later" / "laptop"
    fake_run(path, "3", "convgru", 0.7, encoding=SERIES)
    fake_run(path, "3", "unet", 0.6, seed=1)
    write_intervals(
        path, [("3", "convgru", "series10", 0.7), ("3", "unet", "projection", 0.6), ("3", "all_free", "", 0)]
    )
    return Outputs(path)


def write_intervals(path, rows):
    (path / "analysis").mkdir(exist_ok=True)
    table = pd.DataFrame(rows, columns=["experiment", "model", "encoding", "value"]).assign(metric="obstacle_iou")
    table = table.assign(low=table["value"], high=table["value"])
    table.to_csv(path / "analysis" / "intervals.csv", index=False)


def test_new_runs_are_added_and_published_ones_stay(published, later):
    before = read_published(published / "laptop")
    target = publish(later, published)
    after = read_published(target)
    assert len(after) == len(before) + 2
    both = before.merge(after, how="left", on=[*before.columns], indicator=True)
    assert (both["_merge"] == "both").all()
    main = make_tables(after)["main"].frame
    assert main.loc[main["model"] == "convgru", "dice"].tolist() == [0.7]
    assert main.loc[(main["model"] == "unet") & (main["experiment"] == "3"), "seeds"].tolist() == [2]
    origins = json.loads((target / "provenance.json").read_text())
    assert len(origins) == len(after)
    assert "ConvGRU, series10" in (target / "README.md").read_text()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"learning_rate": 0.5}, "the paper's method was trained with different settings: .*0.001.* and .*0.5"),
        ({"scale": "workstation"}, "the published runs have laptop as scale, these runs workstation"),
        ({"size_px": 64}, "the published runs have 32 px, these runs 64"),
    ],
)
def test_runs_of_another_kind_are_not_added(changes, message, published, tmp_path):
    other = Outputs(tmp_path / "other" / "laptop")
    fake_run(other.path, "3", "unet", 0.6, seed=1, **changes)
    with pytest.raises(ValueError, match=message):
        publish(other, published)


def test_runs_on_other_recordings_are_not_added(published, tmp_path, monkeypatch):
    other = Outputs(tmp_path / "other" / "laptop")
    run = fake_run(other.path, "3", "unet", 0.6, seed=1)
    text = (run.path / "provenance.json").read_text()
    (run.path / "provenance.json").write_text(text.replace("hash of recordings", "another hash"))
    with pytest.raises(ValueError, match="seed1 has other recordings than the published runs of experiment 3"):
        publish(other, published)


def test_losses_of_new_runs_are_added_after_those_of_the_published_ones(published, later):
    for key in (RunKey("3", "convgru", "series10", 0), RunKey("3", "unet", "projection", 1)):
        run = later.run(key)
        pd.DataFrame({"epoch": [0], "val_loss": [0.1]}).to_csv(run.path / "history.csv", index=False)
    publish(later, published)
    third = Outputs(later.path.parents[1] / "third" / "laptop")
    run = fake_run(third.path, "3", "unet", 0.6, seed=2)
    pd.DataFrame({"epoch": [0], "val_loss": [0.2]}).to_csv(run.path / "history.csv", index=False)
    rows = pd.read_csv(publish(third, published) / "history.csv")
    assert set(zip(rows["model"], rows["seed"], rows["val_loss"], strict=True)) == {
        ("convgru", 0, 0.1),
        ("unet", 1, 0.1),
        ("unet", 2, 0.2),
    }


def test_only_new_combinations_are_added_to_the_analysis(published, later):
    """A published interval over other seeds is not replaced by that of one seed."""
    rows = pd.read_csv(publish(later, published) / "analysis" / "intervals.csv")
    assert rows["model"].tolist() == ["unet", "all_free", "convgru"]
    assert rows["value"].tolist() == [0.5, 0.0, 0.7]


def test_what_the_published_table_lacks_is_added_once(published, later):
    """A new average, new changes of the sensor and new rows of the audit, without a second copy of the earlier ones."""
    tables = {
        "intervals": (
            ["experiment", "model", "encoding", "metric", "value"],
            ("3", "average", "projection", "dice", 0.9),
        ),
        "generalization": (
            ["trained", "shift", "tested", "seed", "model", "encoding", "value"],
            ("3", "odometry error", "0.1", 0, "unet", "projection", 0.4),
        ),
        "audit": (["experiment", "model", "encoding", "source", "gain"], ("3", "unet", "projection", "ours", 0.1)),
        "differences": (
            ["experiment", "comparison", "one", "other", "model", "encoding", "metric", "value"],
            ("3", "networks", "convgru", "all_free", "", "series10", "ssim", 0.2),
        ),
    }
    old = {
        "generalization": ("3", "range noise [m]", "0.1", 0, "unet", "projection", 0.5),
        "audit": ("3", "unet", "projection", "paper", 0.2),
        "differences": ("3", "networks", "all_free", "last_seen", "", "", "ssim", 0.1),
    }
    for name, (columns, row) in tables.items():
        before = [old[name]] if name in old else []
        if before:
            pd.DataFrame(before, columns=columns).to_csv(published / "laptop" / "analysis" / f"{name}.csv", index=False)
        pd.DataFrame([*before, row], columns=columns).to_csv(later.analysis / f"{name}.csv", index=False)
    analysis = publish(later, published) / "analysis"
    assert "average" in set(pd.read_csv(analysis / "intervals.csv")["model"])
    assert pd.read_csv(analysis / "generalization.csv")["shift"].tolist() == ["range noise [m]", "odometry error"]
    assert pd.read_csv(analysis / "audit.csv")["source"].tolist() == ["paper", "ours"]
    assert pd.read_csv(analysis / "differences.csv")["value"].tolist() == [0.1, 0.2]


def test_the_robustness_of_a_published_network_is_added_without_runs(published, tmp_path):
    outputs = Outputs(tmp_path / "robustness" / "laptop")
    outputs.analysis.mkdir(parents=True)
    columns = ["metric", "value", "low", "high", "shift", "trained", "tested", "seed", "model", "encoding"]
    noise = ["obstacle_iou", 0.4, 0.3, 0.5, "range noise [m]", "3", "0.1", 0]
    old, new = [*noise, "unet", "projection"], [*noise, "convgru", "series10"]
    directory = published / "laptop" / "analysis"
    pd.DataFrame([old], columns=columns).to_csv(directory / "generalization.csv", index=False)
    (directory / "generalization.png").write_bytes(b"old")
    pd.DataFrame([old, new], columns=columns).to_csv(outputs.analysis / "generalization.csv", index=False)
    runs = read_published(published / "laptop").sort_values(KEY, ignore_index=True)
    directory = publish(outputs, published) / "analysis"
    pd.testing.assert_frame_equal(read_published(published / "laptop").sort_values(KEY, ignore_index=True), runs)
    assert pd.read_csv(directory / "generalization.csv")["model"].tolist() == ["unet", "convgru"]
    assert (directory / "generalization.png").read_bytes().startswith(b"\x89PNG")


def test_figures_of_the_analysis_are_drawn_with_the_new_runs(published, later):
    old = published / "laptop" / "analysis" / "baselines.png"
    old.write_bytes(b"old")
    analysis = publish(later, published) / "analysis"
    assert (analysis / "baselines.png").read_bytes().startswith(b"\x89PNG")
    assert {path.name for path in analysis.iterdir()} == {"intervals.csv", "baselines.png"}


def test_a_second_publication_changes_nothing_and_a_new_result_of_a_run_replaces_the_old_one(published, later):
    once = read_published(publish(later, published))
    twice = read_published(publish(later, published))
    pd.testing.assert_frame_equal(once, twice)
    run = later.run(RunKey("3", "unet", "projection", 1))
    pd.read_csv(run.metrics).assign(dice=0.65).to_csv(run.metrics, index=False)
    again = read_published(publish(later, published))
    assert len(again) == len(once)
    assert again.loc[again["seed"].eq(1) & (again["model"] == "unet"), "dice"].tolist() == [0.65]


def test_runs_of_uncommitted_code_are_not_added(published, tmp_path, monkeypatch):
    monkeypatch.setattr("repro.runs.provenance._commit", lambda: "abc+")
    outputs = Outputs(tmp_path / "other" / "laptop")
    fake_run(outputs.path, "3", "convgru", 0.7, encoding=SERIES)
    for key in [run for run in outputs.runs()]:
        key.begin_step("evaluated", Status.evaluated)
    before = read_results(outputs)
    assert len(before) == 1
    with pytest.raises(ValueError, match=r"uncommitted code; publish.force=true"):
        publish(outputs, published)
    target = publish(outputs, published, force=True)
    assert "abc+" in (target / "provenance.json").read_text()
