import json
import shutil

import pandas as pd
import pytest
from conftest import ROOT, fake_run, fake_study

from repro.reporting import results
from repro.reporting.documents import with_results
from repro.reporting.publication import publish
from repro.reporting.results import keys_of, read_origins, read_published, read_results, read_rows
from repro.reporting.tables import make_tables
from repro.runs.config import EncodingChoice
from repro.runs.keys import RunKey
from repro.runs.outputs import Outputs

RESULTS = ROOT / "reproduce" / "results"
DIRECTORIES = sorted(path.parent for path in RESULTS.glob("*/runs.csv"))
SERIES = EncodingChoice("series10", {"frames": 10, "range_max_m": 30.0})


@pytest.fixture(autouse=True)
def committed(monkeypatch):
    monkeypatch.setattr("repro.runs.provenance._commit", lambda: "0123abc")


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Publish a small study with an ablation; return its outputs and reproduce/results, which tests may only read."""
    path = tmp_path_factory.mktemp("study")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("repro.runs.provenance._commit", lambda: "0123abc")
        fake_study(path / "laptop")
        fake_run(path / "laptop", "3", "unet", 0.4, decay=False)
        write_intervals(path / "laptop", [("3", "unet", "projection", 0.5), ("3", "all_free", "", 0.0)])
        publish(Outputs(path / "laptop"), path / "results")
    return Outputs(path / "laptop"), path / "results"


@pytest.fixture
def published(study, tmp_path):
    """Return a copy of reproduce/results, to be changed."""
    return shutil.copytree(study[1], tmp_path / "results")


@pytest.fixture
def later(study, tmp_path):
    """Return the published outputs with a run of another network, and one of a published network with another seed."""
    path = shutil.copytree(study[0].path, tmp_path / "later" / "laptop")
    fake_run(path, "3", "convgru", 0.7, encoding=SERIES)
    fake_run(path, "3", "unet", 0.6, seed=1)
    return Outputs(path)


def write_intervals(path, rows):
    (path / "analysis").mkdir(exist_ok=True)
    table = pd.DataFrame(rows, columns=["experiment", "model", "encoding", "value"]).assign(metric="obstacle_iou")
    table = table.assign(low=table["value"], high=table["value"])
    table.to_csv(path / "analysis" / "intervals.csv", index=False)


@pytest.mark.parametrize("directory", DIRECTORIES, ids=lambda path: path.name)
def test_every_published_run_has_its_provenance(directory):
    runs = read_published(directory)
    assert sorted(read_origins(directory)) == sorted(str(key.path) for key in keys_of(runs))
    origins = json.loads((directory / "provenance.json").read_text())
    for origin in origins.values():
        assert origin["status"] == "evaluated"
        assert any("recordings" in step for step in origin["steps"])
        assert origin["steps"][-1]["step"] == "evaluated"


def test_publishing_copies_runs_and_provenance(study):
    outputs, results = study
    target = results / "laptop"
    names = {"runs.csv", "provenance.json", "README.md", "analysis"}
    assert {path.name for path in target.iterdir()} == names
    assert len(pd.read_csv(target / "runs.csv")) == len(read_results(outputs)) == 6
    assert "runs/exp3/unet/projection-no-decay/seed0" in json.loads((target / "provenance.json").read_text())


def test_the_analysis_is_replaced_and_files_of_others_stay(published, later):
    target, analysis = published / "laptop", later.analysis
    for path in (target / "exp3-unet" / "model.onnx", target / "costs.csv", target / "drive.gif", target / "tables.md"):
        path.parent.mkdir(exist_ok=True)
        path.write_text("kept")
    for path in (target / "analysis" / "old.csv", target / "old.png"):
        path.write_text("stale")
    for name in ("claims.csv", "recency.png", "recency.pdf"):
        (analysis / name).write_text(name)
    write_intervals(later.path, [("3", "convgru", "series10", 0.7)])
    publish(later, published)
    assert sorted(path.name for path in target.glob("analysis/*")) == ["claims.csv", "intervals.csv", "recency.png"]
    assert pd.read_csv(target / "analysis" / "intervals.csv")["model"].tolist() == ["convgru"]
    kept = {str(path.relative_to(target)) for path in target.rglob("*.*") if path.read_bytes() == b"kept"}
    assert kept == {"exp3-unet/model.onnx", "costs.csv", "drive.gif", "tables.md"}
    assert not (target / "old.png").exists()
    assert {path.name for path in published.iterdir()} == {"laptop", ".lock"}


def test_new_runs_and_new_results_replace_the_published_ones(published, later):
    run = later.run(RunKey("3", "unet", "projection", 0))
    pd.read_csv(run.metrics).assign(dice=0.65).to_csv(run.metrics, index=False)
    target = publish(later, published)
    after = read_published(target)
    assert len(after) == 8
    main = make_tables(after)["main"].frame
    assert main.loc[main["model"] == "convgru", "dice"].tolist() == [0.7]
    assert main.loc[(main["model"] == "unet") & (main["experiment"] == "3"), "seeds"].tolist() == [2]
    assert sorted(after.loc[(after["model"] == "unet") & (after["encoding"] == "projection"), "dice"]) == [0.6, 0.65]
    assert len(json.loads((target / "provenance.json").read_text())) == 8
    before = listing(target)
    publish(later, published)
    assert listing(target) == before


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"learning_rate": 0.5}, "the paper's method was trained with different settings: .*0.001.* and .*0.5"),
        ({"commit": "abc+"}, r"uncommitted code; publish\.force=true"),
    ],
)
def test_doubtful_runs_need_force(changes, message, published, later):
    settings = {name: value for name, value in changes.items() if name != "commit"}
    path = fake_run(later.path, "4", "fpn", 0.6, **settings).path / "provenance.json"
    path.write_text(path.read_text().replace('"0123abc"', f'"{changes.get("commit", "0123abc")}"'))
    kept = listing(published / "laptop")
    with pytest.raises(ValueError, match=message):
        publish(later, published)
    assert listing(published / "laptop") == kept
    assert len(read_published(publish(later, published, force=True))) == 9


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, "6 published runs are not in the outputs, such as baselines/exp3/all_free"),
        ({"scale": "workstation"}, "the published runs have laptop as scale, these runs workstation"),
        ({"size_px": 64}, "the published runs have 32 px, these runs 64"),
    ],
)
def test_published_results_are_not_lost_without_force(changes, message, published, tmp_path):
    other, kept = Outputs(tmp_path / "other" / "laptop"), listing(published / "laptop")
    fake_run(other.path, "3", "unet", 0.6, seed=1, **changes)
    with pytest.raises(ValueError, match=message):
        publish(other, published)
    assert listing(published / "laptop") == kept
    assert len(read_published(publish(other, published, force=True))) == 1


def listing(directory):
    return {path.name: path.read_bytes() for path in directory.iterdir() if path.is_file()}


def test_readme_tables_are_those_of_the_report(study):
    outputs, results = study
    text = "before\n<!-- results: laptop main -->\nold\n<!-- end -->\nafter\n"
    made = with_results(text, results)
    page = make_tables(read_results(outputs))["main"].to_markdown()
    assert made == f"before\n<!-- results: laptop main -->\n{page}<!-- end -->\nafter\n"
    assert with_results(made, results) == made


def test_nothing_evaluated_cannot_be_published(tmp_path):
    (outputs := Outputs(tmp_path / "laptop")).analysis.mkdir(parents=True)
    with pytest.raises(ValueError, match="no network is evaluated"):
        publish(outputs, tmp_path / "results")
    fake_run(outputs.path, "3", "all_free", 0.4)
    with pytest.raises(ValueError, match="no network is evaluated"):
        publish(outputs, tmp_path / "results")


def test_a_marker_without_an_end_deletes_nothing(tmp_path):
    text = "<!-- results: laptop main -->\nrows\n<!-- results: laptop main -->\n<!-- end -->\n"
    with pytest.raises(ValueError, match="needs its own <!-- end -->"):
        with_results(text, tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [(",0.5,", ",abc,", "with .* from -1 to 1"), ("experiment,", "e,", "lacks the columns experiment")],
)
def test_published_runs_that_are_damaged_are_refused(old, new, message, published):
    path = published / "laptop" / "runs.csv"
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(ValueError, match=rf"laptop/runs\.csv cannot be read \(.*{message}.*\): restore"):
        with_results("<!-- results: laptop main -->\n<!-- end -->", published)


def test_rows_keep_the_names_of_experiments_and_baselines(tmp_path):
    path = tmp_path / "rows.csv"
    path.write_text("experiment,model,encoding,seed,value\n01,unet,projection,0,0.5\n3,all_free,,,inf\n")
    rows = read_rows(path)
    assert rows["experiment"].tolist() == ["01", "3"]
    assert rows["encoding"].tolist() == ["projection", ""]
    assert rows["seed"].tolist() == [0, pd.NA]


def test_published_rows_have_columns_that_are_younger(monkeypatch):
    monkeypatch.setattr(results, "TABLE_METRICS", (*results.TABLE_METRICS, "a_plugins"))
    assert read_published(ROOT / "reproduce" / "results" / "laptop")["a_plugins"].isna().all()
