import json
from functools import partial

import onnx
import pandas as pd
import pytest
import torch
import yaml
from conftest import ROOT, fake_run
from huggingface_hub import ModelCard

from repro.cli.tasks.export import suffix_of
from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.maps.statistics import TITLES
from repro.metrics.names import METRICS
from repro.networks.create import create_network
from repro.networks.model import paper_model
from repro.networks.predictor import Predictor, load_predictor
from repro.recordings.datasets import training_statistics
from repro.recordings.format import spec_fingerprint
from repro.reporting.export import CARD_METRICS, export_onnx, export_weights, make_card, with_front_matter
from repro.reporting.paper import WORLDS
from repro.runs.directories import Run
from repro.runs.keys import RunKey
from repro.world_config import read_world, world_spec

PUBLISHED = ROOT / "reproduce" / "results" / "workstation" / "exp4-unet"


@pytest.fixture
def run(tmp_path) -> Run:
    """Create an evaluated run with a network that is not trained."""
    run = fake_run(tmp_path / "laptop", "3", "unet", 0.4)
    values = {name: 0.1 * number for number, name in enumerate(CARD_METRICS, 1)}
    pd.DataFrame([values]).to_csv(run.metrics, index=False)
    Predictor(create_network(paper_model("unet")), Projection(), Grid(32, 50.0)).save(run.model)
    return run


def check_card(text: str) -> ModelCard:
    """Check the metadata with the parser of huggingface_hub, and against the rules of its hub for model-index."""
    card = ModelCard(text, ignore_metadata_errors=False)
    head = yaml.safe_load(text.split("---\n")[1])
    assert (head["license"], head["pipeline_tag"]) == ("mit", "image-segmentation")
    (model,) = head["model-index"]
    for result in model["results"]:
        assert result["task"]["type"] == "image-segmentation"
        assert set(result["dataset"]) >= {"name", "type"}
        assert all(set(metric) == {"type", "value"} for metric in result["metrics"])
    assert card.text.lstrip().startswith("# ")
    return card


@pytest.mark.slow
def test_an_onnx_export_predicts_as_the_run_does(run, tmp_path):
    target = tmp_path / "exports" / "exp3-unet"
    assert export_onnx(run, target) < 1e-4
    assert {path.name for path in target.iterdir()} == {"model.onnx", "README.md"}
    expected = load_predictor(run.model)
    images = torch.randint(0, 256, (3, 1, 32, 32), dtype=torch.uint8)
    for path in (target, target / "model.onnx"):
        found = load_predictor(path)
        assert (found.encoding, found.grid) == (expected.encoding, expected.grid)
        assert torch.allclose(found.predict_images(images), expected.predict_images(images), atol=1e-4)
    text = (target / "README.md").read_text()
    properties = {each.key: each.value for each in onnx.load(target / "model.onnx").metadata_props}
    assert properties["repro.model_card"] == text
    results = check_card(text).data.eval_results
    assert {each.metric_type: each.metric_value for each in results} == pytest.approx(
        {name: 0.1 * number for number, name in enumerate(CARD_METRICS, 1)}
    )


def test_weights_are_exported_with_a_card(run, tmp_path):
    export_weights(run, tmp_path / "weights")
    check_card((tmp_path / "weights" / "README.md").read_text())
    assert set(METRICS) < set(CARD_METRICS)


def test_weights_of_another_input_are_not_replaced(run, tmp_path):
    export_weights(run, tmp_path / "weights")
    export_weights(run, tmp_path / "weights")
    Predictor(create_network(paper_model("unet")), Projection(decay=False), Grid(32, 50.0)).save(run.model)
    with pytest.raises(ValueError, match=r"publish\.force=true replaces them anyway"):
        export_weights(run, tmp_path / "weights")
    export_weights(run, tmp_path / "weights", force=True)
    assert load_predictor(tmp_path / "weights").encoding == Projection(decay=False)


def test_weights_of_other_recordings_and_files_beside_are_not_replaced(run, tmp_path):
    """Such as of 16 pairs, in an outputs directory that has the name of a published one."""
    target = tmp_path / "published" / "exp3-unet"
    export_weights(run, target)
    steps = json.loads((run.path / "provenance.json").read_text())
    steps["steps"][0]["recordings"] = "those of 16 pairs"
    (run.path / "provenance.json").write_text(json.dumps(steps))
    before = (target / "model.safetensors").read_bytes()
    with pytest.raises(ValueError, match=r"recordings those of 16.*publish\.force=true replaces them anyway"):
        export_weights(run, target)
    (target / "notes.txt").write_text("mine")
    for export in (partial(export_weights, force=True), export_onnx):
        with pytest.raises(ValueError, match=r"has files such as .*move them"):
            export(run, target)
    assert (target / "notes.txt").read_text() == "mine"
    assert (target / "model.safetensors").read_bytes() == before


def test_a_run_is_loaded_by_its_directory(run):
    assert load_predictor(run.path).grid == load_predictor(run.model).grid == Grid(32, 50.0)


def test_text_that_breaks_the_metadata_is_quoted():
    title, dataset = "a: [b\n---\n# c", "{d: 'e"
    card = ModelCard(with_front_matter("# A\n", title, dataset, {"ssim": 0.5}, "repro"), ignore_metadata_errors=False)
    assert (card.data.model_name, card.data.eval_results[0].dataset_name) == (title, dataset)


def test_the_published_card_and_statistics_are_complete():
    card = check_card((PUBLISHED / "README.md").read_text())
    runs = pd.read_csv(PUBLISHED.parent / "runs.csv").astype({"experiment": str, "seed": str})
    row = runs.query("experiment == '4' and model == 'unet' and encoding == 'projection' and seed == '0.0'").iloc[0]
    measured = {each.metric_type: each.metric_value for each in card.data.eval_results}
    assert measured == pytest.approx({name: row[name] for name in CARD_METRICS}, abs=1e-4)
    statistics = load_predictor(PUBLISHED).statistics
    assert statistics.windows == 3000
    assert set(statistics.quantiles) == {*TITLES} - {"valid_share"}  # younger than these weights


def test_the_card_of_altered_worlds_does_not_claim_the_papers(tmp_path):
    for worlds, words in (("noise", "worlds of no file in conf/world"), (None, "without noise")):
        changes = {} if worlds is None else {"worlds": worlds}
        run = fake_run(tmp_path / str(worlds), "3", "unet", 0.4, **changes)
        pd.DataFrame([dict.fromkeys(CARD_METRICS, 0.4)]).to_csv(run.metrics, index=False)
        card = make_card(run, "model", "float32 weights")
        assert words in card
        assert ("conf/world/paper.yaml" in card) == (worlds is None)


def test_the_card_names_the_file_of_its_worlds(tmp_path):
    worlds = spec_fingerprint(world_spec(read_world(WORLDS.with_name("drive.yaml")), "mixed"))
    run = fake_run(tmp_path, "mixed", "unet", 0.4, worlds=worlds)
    pd.DataFrame([dict.fromkeys(CARD_METRICS, 0.4)]).to_csv(run.metrics, index=False)
    card = make_card(run, "model", "float32 weights")
    assert "experiment mixed of conf/world/drive.yaml" in card
    assert "simulated scans of conf/world/drive.yaml; float32 weights" in card


def test_exports_of_other_inputs_and_seeds_have_other_names():
    keys = [RunKey("4", "unet", encoding, seed) for encoding in ("projection", "series10") for seed in (0, 2)]
    assert [suffix_of(key) for key in keys] == ["", "-seed2", "-series10", "-series10-seed2"]


@pytest.mark.slow
def test_a_training_keeps_the_statistics_of_its_scans(recorded, evaluated, tmp_path):
    statistics = load_predictor(evaluated.model).statistics
    assert statistics == training_statistics(recorded, evaluated.config())
    assert statistics.windows == 24
    assert statistics.range_of("fov_deg") == pytest.approx((90, 90))
    export_weights(evaluated, tmp_path / "weights")
    assert load_predictor(tmp_path / "weights").statistics == statistics
