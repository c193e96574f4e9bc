import dataclasses

import numpy as np
import pytest
from conftest import ROOT, world_spec

from repro.learning.networks.trained import load_trained
from repro.networks.predictor import load_predictor
from repro.networks.weights import locate
from repro.scans import Scans
from repro.simulation.sampling import sample_world
from repro.simulation.simulator import simulate

SIDES_M = {
    "indoor": 25.0,
    "buildings": 25.0,
    "rooms": 25.0,
    "drive": 50.0,
    "exp1": 50.0,
    "exp2": 50.0,
    "exp3": 50.0,
    "exp4": 50.0,
}


@pytest.mark.parametrize("name", SIDES_M)
def test_the_weights_of_the_package_have_names(name):
    predictor = load_predictor(name)
    assert (predictor.grid.size_px, predictor.grid.size_m) == (128, SIDES_M[name])
    assert predictor.statistics


@pytest.mark.parametrize("name", SIDES_M)
def test_the_named_networks_are_their_weights_of_torch_in_onnx(name):
    predictor = load_predictor(name)
    if predictor.grid.size_m == 50:
        window = simulate(sample_world(world_spec("4"), 17)).scans
    else:
        log = np.load(ROOT / "examples" / "rooms.npz")
        window = Scans(log["ranges"][:100], log["angles"], log["poses"][:100])
    expected = load_trained(name)
    assert dataclasses.replace(predictor, network=expected.network) == expected
    free, free_of_torch = (loaded.predict(window)[0] for loaded in (predictor, expected))
    np.testing.assert_allclose(free, free_of_torch, rtol=0, atol=1e-5)
    assert np.array_equal(free < 0.5, free_of_torch < 0.5)


def test_a_path_may_be_relative_and_what_is_missing_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own").mkdir()
    assert locate("own").resolve() == tmp_path / "own"
    for missing in ("room", "owner/name", "", "/nowhere/at/all", "x" * 300):
        with pytest.raises(
            ValueError, match=f"^{missing}: no such weights, expected one of buildings, .*, rooms, or a"
        ):
            locate(missing)


def test_weights_of_torch_name_what_reads_them():
    with pytest.raises(ValueError, match=r"exp4-unet has no model.onnx: weights of torch need the study, make setup"):
        load_predictor("reproduce/results/workstation/exp4-unet")
