import json
import re

import pandas as pd
import pytest
import segmentation_models_pytorch as smp
import torch
from conftest import ROOT, fake_run, fake_study, prepared

from repro.config import PROJECTION, PROJECTION_NO_DECAY, Encoding
from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.metrics.names import METRICS
from repro.networks.create import create_network
from repro.networks.model import paper_model
from repro.networks.predictor import Predictor
from repro.reporting.documents import with_results
from repro.reporting.export import export_weights
from repro.reporting.publish import publish
from repro.reporting.results import keys_of, read_origins, read_published, read_results, read_rows
from repro.reporting.tables import make_tables
from repro.runs.keys import KEY
from repro.runs.outputs import Outputs
from repro.runs.provenance import Status

RESULTS = ROOT / "reproduce" / "results"
DIRECTORIES = sorted(path.parent for path in RESULTS.glob("*/runs.csv"))


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
    publish(Outputs(path / "laptop"), path / "results")
    return Outputs(path / "laptop"), path / "results"


DOCUMENTS = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))


def of_paper(runs):
    """Return the runs with the paper's input and its ablation."""
    return runs[runs["encoding"].isin([PROJECTION, PROJECTION_NO_DECAY])]


@pytest.mark.parametrize("directory", DIRECTORIES, ids=lambda path: path.name)
def test_every_published_run_has_its_provenance(directory):
    runs = read_published(directory)
    assert len(read_origins(directory, keys_of(runs))) == len(runs)
    origins = json.loads((directory / "provenance.json").read_text())
    for origin in origins.values():
        assert origin["status"] == "evaluated"
        assert any("recordings" in step for step in origin["steps"])
        assert origin["steps"][-1]["step"] == "evaluated"


def test_publishing_copies_runs_and_provenance(study):
    outputs, results = study
    target = results / "laptop"
    assert {path.name for path in target.iterdir()} == {"runs.csv", "provenance.json", "README.md"}
    page = (target / "README.md").read_text()
    assert "python run.py -m model=segformer exp=3 seed=0 scale=laptop" in page
    assert len(pd.read_csv(target / "runs.csv")) == len(read_results(outputs)) == 6
    assert "runs/exp3/unet/projection-no-decay/seed0" in json.loads((target / "provenance.json").read_text())


def test_the_losses_of_every_epoch_are_published(tmp_path):
    fake_study(tmp_path / "laptop")
    run = fake_run(tmp_path / "laptop", "3", "unet", 0.4, decay=False)
    losses = pd.DataFrame({"epoch": [0, 1], "train_loss": [0.3, 0.2], "val_loss": [0.4, 0.1], "seconds": [9.5, 8.5]})
    losses.to_csv(run.path / "history.csv", index=False)
    target = publish(Outputs(tmp_path / "laptop"), tmp_path / "results")
    rows = read_rows(target / "history.csv")
    assert rows.columns.tolist() == [*KEY, *losses.columns]
    assert set(map(tuple, rows[KEY].to_numpy())) == {("3", "unet", PROJECTION_NO_DECAY, 0)}
    pd.testing.assert_frame_equal(rows[losses.columns], losses)


def test_analysis_and_page_are_published_with_the_tables_and_stale_files_are_removed(tmp_path):
    fake_study(tmp_path / "laptop")
    outputs, results = Outputs(tmp_path / "laptop"), tmp_path / "results"
    outputs.analysis.mkdir()
    for name in ("claims.csv", "ages.png", "ages.pdf", "old.csv"):
        (outputs.analysis / name).write_text(name)
    (outputs.path / "report.html").write_text("page")
    publish(outputs, results)
    (outputs.analysis / "old.csv").unlink()
    target = publish(outputs, results)
    assert sorted(path.name for path in target.glob("analysis/*")) == ["ages.png", "claims.csv"]
    assert (target / "report.html").read_text() == "page"


def listing(directory):
    return {path.name: path.read_bytes() for path in directory.iterdir() if path.is_file()}


def test_runs_of_another_size_replace_all_published_runs_or_nothing(tmp_path):
    results = tmp_path / "results"
    fake_study(tmp_path / "first" / "laptop")
    fake_run(tmp_path / "first" / "laptop", "3", "unet", 0.4, decay=False)
    (target := publish(Outputs(tmp_path / "first" / "laptop"), results) / "exp3-unet").mkdir()
    (target / "kept").write_text("weights")
    before = listing(results / "laptop")
    fake_run(tmp_path / "other" / "laptop", "3", "unet", 0.7, size_px=16)
    other = Outputs(tmp_path / "other" / "laptop")
    with pytest.raises(ValueError, match=r"the published runs have 32 px, these runs 16; publish\.force=true"):
        publish(other, results)
    assert listing(results / "laptop") == before
    publish(other, results, force=True)
    assert len(read_published(results / "laptop")) == 1
    assert (target / "kept").read_text() == "weights"
    assert {path.name for path in results.iterdir()} == {"laptop", ".lock"}


def test_weights_are_not_replaced_by_those_of_a_lower_resolution(tmp_path):
    run = fake_run(tmp_path / "laptop", "3", "unet", 0.4)
    pd.DataFrame([dict.fromkeys((*METRICS, "obstacle_iou"), 0.4)]).to_csv(run.metrics, index=False)
    network = create_network(paper_model("unet"))
    Predictor(network, Projection(), Grid(32, 50.0)).save(run.model)
    Predictor(network, Projection(), Grid(64, 50.0)).save(tmp_path / "weights")
    with pytest.raises(ValueError, match=r"has weights for 64 px .* has 32 px, .*: publish\.force=true"):
        export_weights(run, tmp_path / "weights")
    export_weights(run, tmp_path / "weights", force=True)
    assert (tmp_path / "weights" / "README.md").is_file()


def test_each_command_has_the_overrides_and_seeds_of_its_trainings(tmp_path):
    outputs = tmp_path / "tiny-variant"
    fake_run(outputs, "3", "unet", 0.5, typed="exp=3 scale=laptop outputs=/elsewhere runtime.accelerator=cpu")
    typed = "model=convgru encoding=series10 'world.range_m=[1, 2]' hydra.launcher.n_jobs=1"
    own = {"encoding": Encoding("series10", {"frames": 10, "range_max_m": 15.0})}
    for experiment, seed in (("1", 0), ("2", 0), ("2", 1)):
        fake_run(outputs, experiment, "convgru", 0.7, seed=seed, typed=f"{typed} exp={experiment} seed={seed}", **own)
    fake_run(outputs, "3", "convgru", 0.7, **own, batch_size=2, typed=f"{typed} train.batch_size=2")
    page = (publish(Outputs(outputs), tmp_path / "results") / "README.md").read_text()
    place = "runtime.precision=32-true outputs=outputs/tiny-variant`"
    assert f"`python run.py -m model=unet exp=3 seed=0 scale=laptop {place}" in page
    shared = "scale=laptop encoding=series10 'world.range_m=[1, 2]'"
    assert f"model=convgru exp=1 seed=0 {shared} {place}" in page
    assert f"model=convgru exp=2 seed=0,1 {shared} {place}" in page
    assert f"model=convgru exp=3 seed=0 {shared} train.batch_size=2 {place}" in page


def test_readme_tables_are_those_of_the_report(study):
    outputs, results = study
    text = "before\n<!-- results: laptop main -->\nold\n<!-- end -->\nafter\n"
    made = with_results(text, results)
    page = make_tables(read_results(outputs))["main"].to_markdown()
    assert made == f"before\n<!-- results: laptop main -->\n{page}<!-- end -->\nafter\n"
    assert with_results(made, results) == made


def test_readme_can_show_the_rows_of_one_model(study):
    made = with_results("<!-- results: laptop unet -->\n<!-- end -->\n", study[1]).splitlines()
    assert made[1].startswith("**Scale laptop: 32 x 32 px")
    assert [line.split("(")[0] for line in made[5:-1]] == ["| 3 | U-Net | 0.500 ", "| 3, no decay | U-Net | 0.400 "]
    assert made[-1] == "<!-- end -->"


@pytest.mark.slow
def test_exported_weights_predict_as_the_run_does(evaluated, tmp_path):
    target = tmp_path / "weights"
    with pytest.raises(ValueError, match="not evaluated"):
        export_weights(prepared(tmp_path / "run"), target)
    export_weights(evaluated, target)
    image = torch.rand(2, 1, 32, 32)
    full, half = (smp.from_pretrained(path).float().eval() for path in (evaluated.model, target))
    with torch.inference_mode():
        assert (torch.sigmoid(full(image)) - torch.sigmoid(half(image))).abs().max() < 0.01
    size = (target / "model.safetensors").stat().st_size
    assert size < 0.55 * (evaluated.model / "model.safetensors").stat().st_size
    card = (target / "README.md").read_text()
    assert "24 simulated pairs" in card
    assert "obstacle_iou" in card

    example = card.split("```python")[1].split("```")[0]
    where = f"reproduce/results/{tmp_path.name}/weights"
    assert where in example
    names = {"ranges": 30 * torch.rand(2, 9, 7), "angles": torch.rand(7), "poses": torch.full((2, 9, 3), 25.0)}
    exec(example.replace(where, str(target)), names)
    assert names["free"].shape == (2, 32, 32)
    assert names["free"].min() >= 0
    assert names["free"].max() <= 1


def test_nothing_evaluated_cannot_be_published(tmp_path):
    (outputs := Outputs(tmp_path / "laptop")).analysis.mkdir(parents=True)
    with pytest.raises(ValueError, match="no network is evaluated"):
        publish(outputs, tmp_path / "results")
    fake_run(outputs.path, "3", "all_free", 0.4)
    with pytest.raises(ValueError, match="no network is evaluated"):
        publish(outputs, tmp_path / "results")


def test_a_marker_of_an_unknown_table_names_the_known_ones(study):
    message = r"laptop unett: expected methods, .*, costs, main, ablation, or a network"
    with pytest.raises(ValueError, match=message):
        with_results("<!-- results: laptop unett -->\n<!-- end -->\n", study[1])


@pytest.mark.parametrize(
    "text",
    [
        "<!-- results: laptop main -->\nrows\n",
        "<!-- results: laptop main -->\nrows\n<!-- results: laptop main -->\n<!-- end -->\n",
    ],
)
def test_a_marker_without_an_end_deletes_nothing(text, tmp_path):
    with pytest.raises(ValueError, match="needs its own <!-- end -->"):
        with_results(text, tmp_path)


def test_the_published_readme_lists_hardware_and_versions_of_all_steps_that_have_them(tmp_path, monkeypatch):
    fake_run(tmp_path / "laptop", "3", "unet", 0.4)
    run = fake_run(tmp_path / "laptop", "4", "unet", 0.4, status=Status.trained)
    versions = run.provenance().steps[-1]["versions"]
    where = {"commit": "B", "hardware": {"gpu": "none at all"}, "versions": versions | {"torch": "99.9"}}
    monkeypatch.setattr("repro.runs.directories.environment", lambda: where)
    run.begin_step("evaluated", Status.evaluated, test_pairs=8)
    content = json.loads((run.path / "provenance.json").read_text())
    trained = next(step for step in content["steps"] if step["step"] == "trained")
    for name in ("commit", "hardware", "versions"):  # as in the oldest runs
        del trained[name]
    (run.path / "provenance.json").write_text(json.dumps(content))
    page = (publish(Outputs(tmp_path / "laptop"), tmp_path / "results") / "README.md").read_text()
    on = {verb: next(line for line in page.splitlines() if f"- {verb} on" in line) for verb in ("trained", "evaluated")}
    assert "none at all" in on["evaluated"]
    assert "none at all" not in on["trained"]
    assert f"- versions: torch {versions['torch']} and 99.9, " in page


def test_an_experiment_of_ones_own_is_exported_and_published(tmp_path):
    """A fifth experiment has no title in the paper."""
    run = fake_run(tmp_path / "laptop", "office", "unet", 0.4)
    network = create_network(paper_model("unet"))
    Predictor(network, Projection(), Grid(32, 50.0)).save(run.model)
    metrics = pd.DataFrame([dict.fromkeys((*METRICS, "obstacle_iou"), 0.4)])
    metrics.to_csv(run.metrics, index=False)
    export_weights(run, tmp_path / "weights")
    assert "experiment office" in (tmp_path / "weights" / "README.md").read_text()
    target = publish(Outputs(tmp_path / "laptop"), tmp_path / "results")
    assert read_published(target)["experiment"].tolist() == ["office"]


def test_the_documents_state_how_long_a_study_takes():
    """On two cores, the trainings of every whole published study take as long as the table of scales says."""
    text = "\n".join(path.read_text() for path in DOCUMENTS)
    whole = 0
    for directory in DIRECTORIES:
        runs = of_paper(read_published(directory)).dropna(subset=["training_seconds"])
        for _, rows in runs.groupby("seed"):
            if len(rows) == 24:
                row = next(line for line in text.splitlines() if line.startswith(f"| `{directory.name}` |"))
                low, high = map(int, re.search(r"(\d+) to (\d+) minutes", row).groups())
                assert low <= rows["training_seconds"].sum() / 60 / 2 <= high
                whole += 1
    assert whole
