from functools import partial

import numpy as np
import onnx
import pandas as pd
import pytest
import segmentation_models_pytorch as smp
import torch
import yaml
from conftest import ROOT, fake_run, prepared
from huggingface_hub import ModelCard

from repro.learning.networks.create import create_network
from repro.learning.networks.trained import TorchNetwork, load_trained, save_trained
from repro.maps.grid import Grid
from repro.maps.projection import Projection
from repro.maps.statistics import TITLES
from repro.networks.predictor import Predictor, load_predictor
from repro.recordings.format import spec_fingerprint
from repro.reporting.network_export import CARD_METRICS, export_run, export_weights, hub_metadata, make_card
from repro.reporting.paper import WORLDS
from repro.runs.directories import Run
from repro.runs.model import paper_model
from repro.worlds.spec import read_world, world_spec

PUBLISHED = ROOT / "reproduce" / "results" / "workstation" / "exp4-unet"


@pytest.fixture
def run(tmp_path) -> Run:
    """Create an evaluated run with a network that is not trained."""
    run = fake_run(tmp_path / "laptop", "3", "unet", 0.4)
    values = {name: 0.1 * number for number, name in enumerate(CARD_METRICS, 1)}
    pd.DataFrame([values]).to_csv(run.metrics, index=False)
    network = TorchNetwork(create_network(paper_model("unet")))
    save_trained(Predictor(network, Projection(), Grid(32, 50.0)), run.model)
    return run


def check_card(text: str) -> ModelCard:
    """Check the metadata with the parser of huggingface_hub, and against the rules of its hub for model-index."""
    card = ModelCard(text, ignore_metadata_errors=False)
    (model,) = yaml.safe_load(text.split("---\n")[1])["model-index"]
    for result in model["results"]:
        assert set(result["dataset"]) >= {"name", "type"}
        assert all(set(metric) == {"type", "value"} for metric in result["metrics"])
    assert card.text.lstrip().startswith("# ")
    return card


@pytest.mark.slow
def test_an_onnx_export_predicts_as_the_run_does(run, tmp_path):
    target = tmp_path / "exports" / "exp3-unet"
    assert export_run(run, target) < 1e-4
    assert {path.name for path in target.iterdir()} == {"model.onnx", "README.md"}
    expected = load_trained(run.model)
    images = np.random.default_rng(0).integers(0, 256, (3, 1, 32, 32), np.uint8)
    for path in (target, target / "model.onnx"):
        found = load_predictor(path)
        assert (found.encoding, found.grid) == (expected.encoding, expected.grid)
        assert np.allclose(found.predict_images([images]), expected.predict_images([images]), atol=1e-4)
    text = (target / "README.md").read_text()
    properties = {entry.key: entry.value for entry in onnx.load(target / "model.onnx").metadata_props}
    assert properties["repro.model_card"] == text
    results = check_card(text).data.eval_results
    assert {result.metric_type: result.metric_value for result in results} == pytest.approx(
        {name: 0.1 * number for number, name in enumerate(CARD_METRICS, 1)}
    )


def test_existing_weights_and_files_beside_are_not_replaced(run, tmp_path):
    target = tmp_path / "published" / "exp3-unet"
    export_weights(run, target)
    check_card((target / "README.md").read_text())
    before = (target / "model.safetensors").read_bytes()
    with pytest.raises(ValueError, match=r"has weights already: publish\.force=true replaces them"):
        export_weights(run, target)
    export_weights(run, target, force=True)
    (target / "notes.txt").write_text("mine")
    for export in (partial(export_weights, force=True), export_run):
        with pytest.raises(ValueError, match=r"has files such as .*move them"):
            export(run, target)
    assert (target / "notes.txt").read_text() == "mine"
    assert (target / "model.safetensors").read_bytes() == before


def test_text_that_breaks_the_metadata_is_quoted():
    title, dataset = "a: [b\n---\n# c", "{d: 'e"
    head = hub_metadata(title, dataset, {"ssim": 0.5}, "repro")
    card = ModelCard(f"---\n{head}\n---\n\n# A\n", ignore_metadata_errors=False)
    assert (card.data.model_name, card.data.eval_results[0].dataset_name) == (title, dataset)


def test_the_published_card_and_statistics_are_complete():
    card = check_card((PUBLISHED / "README.md").read_text())
    runs = pd.read_csv(PUBLISHED.parent / "runs.csv").astype({"experiment": str, "seed": str})
    row = runs.query("experiment == '4' and model == 'unet' and encoding == 'projection' and seed == '0.0'").iloc[0]
    measured = {result.metric_type: result.metric_value for result in card.data.eval_results}
    assert measured == pytest.approx({name: row[name] for name in CARD_METRICS}, abs=1e-4)
    statistics = load_trained(PUBLISHED).statistics
    assert statistics.windows == 3000
    assert set(statistics.quantiles) == {*TITLES} - {"valid_share"}  # younger than these weights


@pytest.mark.parametrize(
    ("file", "experiment", "words"),
    [
        ("paper", "3", "Dynamic, rotation), | conf/world/paper.yaml, without noise"),
        ("drive", "mixed", "experiment mixed of conf/world/drive.yaml), | scans of conf/world/drive.yaml; float32"),
        (None, "3", "experiment 3 of worlds of no file in conf/world), | scans of worlds of no file"),
    ],
)
def test_the_card_names_the_file_of_its_worlds(file, experiment, words, tmp_path):
    worlds = "noise"
    if file:
        worlds = spec_fingerprint(world_spec(read_world(WORLDS.with_name(f"{file}.yaml")), experiment))
    run = fake_run(tmp_path, experiment, "unet", 0.4, worlds=worlds)
    card = make_card(run, "model", "float32 weights")
    assert all(word in card for word in words.split(" | "))
    assert ("conf/world/paper.yaml" in card) == (file == "paper")


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
    names = {"ranges": np.full((2, 9, 7), 5.0), "angles": np.linspace(-1, 1, 7), "poses": np.full((2, 9, 3), 25.0)}
    exec(example.replace(where, str(target)), names)
    assert names["free"].shape == (2, 32, 32)
    assert names["free"].min() >= 0
    assert names["free"].max() <= 1
