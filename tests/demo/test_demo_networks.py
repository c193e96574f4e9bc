import dataclasses
import json
import shutil

import numpy as np
import pytest
from conftest import ROOT

from repro.demo import demo_page, networks
from repro.demo.runtime import WebRuntime
from repro.maps.grid import Grid
from repro.networks.onnx_files import OnnxNetwork
from repro.networks.predictor import load_predictor

EXP4 = load_predictor("exp4")


def test_a_named_network_is_embedded_as_it_is_under_the_name_of_its_card():
    shown = networks.demo_network("exp4", EXP4)
    assert shown.title == "ConvGRU, experiment 4, obstacle IoU 0.66; sees hits and free pixels of 10 times"
    assert shown.onnx == EXP4.network.content
    html = demo_page.render([shown], WebRuntime("run </script>", b""))
    settings = json.loads(html.split('id="settings">')[1].split("</script>")[0])
    assert settings["networks"][0]["title"] == shown.title
    assert settings["runtime"] == "run </script>"
    assert len(settings["worlds"]) == 4
    assert "{{ " not in html


@pytest.mark.slow
def test_a_network_of_torch_without_a_card_is_exported_under_its_own_name(tmp_path):
    from repro.learning.networks.trained import load_trained

    source = ROOT / "reproduce" / "results" / "workstation-16000" / "exp4-convgru"
    shutil.copytree(source, tmp_path / "mine", ignore=shutil.ignore_patterns("*.md", "*.onnx"))
    predictor = load_trained(tmp_path / "mine")
    shown = networks.demo_network(str(tmp_path / "mine"), predictor)
    assert shown.title == f"{tmp_path / 'mine'}; sees hits and free pixels of 10 times"
    images = np.random.default_rng(0).random((1, 20, 128, 128), np.float32)
    assert OnnxNetwork(shown.onnx)(images) == pytest.approx(predictor.network(images), abs=1e-3)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"grid": Grid(128, 25.0)}, "exp4.* predicts maps of 25 m from 100 steps of 0.1 s, this page needs maps of 50"),
        ({"steps": 50}, "predicts maps of 50 m from 50 steps of 0.1 s, this page needs .* from 100 steps of 0.1 s"),
    ],
)
def test_a_network_of_other_maps_or_windows_is_refused(changes, problem):
    predictor = dataclasses.replace(EXP4, **changes)
    with pytest.raises(ValueError, match=problem.replace("exp4", "experiment 4")):
        demo_page.render([networks.demo_network("exp4", predictor)], WebRuntime("", b""))


@pytest.mark.parametrize(
    ("changes", "problem"),
    [({"has_fixed": True}, "trained with fixed obstacles"), ({"is_centered": True}, "in the middle of the map")],
)
def test_a_network_of_other_worlds_is_refused(changes, problem):
    with pytest.raises(ValueError, match=f"exp4 .*{problem}, which .*demo"):
        networks.demo_network("exp4", dataclasses.replace(EXP4, **changes))
