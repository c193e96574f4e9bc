"""Descriptions of predictors that are damaged or edited, with a checksum that fits."""

import copy
import json
import re
import shutil

import pytest
from conftest import ROOT

from repro.networks.description import checked
from repro.networks.predictor import load_predictor
from repro.networks.torch_files import DESCRIPTION, _checksum

PUBLISHED = ROOT / "reproduce" / "results" / "drive-16000" / "expmixed-convgru"
LEVELS = "statistics.quantiles.hit_share"


def published() -> dict:
    """Return the description of a published network without its checksum."""
    content = json.loads((PUBLISHED / DESCRIPTION).read_text())
    del content["sha256"]
    return content


def changed(key: str, value: object) -> dict:
    """Return a description with another value."""
    content = copy.deepcopy(published())
    *path, last = key.split(".")
    part = content
    for name in path:
        part = part[name]
    part[last] = value
    return content


@pytest.mark.parametrize("path", sorted((ROOT / "reproduce" / "results").rglob(DESCRIPTION)), ids=lambda p: p.parts[-2])
def test_published_descriptions_are_accepted(path):
    content = json.loads(path.read_text())
    del content["sha256"]
    assert checked(content, "architecture")["grid"] == content["grid"]


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("window.steps", True, "window.steps=True: must be a valid integer"),
        ("window.step_s", -1, "window.step_s=-1: must be greater than or equal to 0.0001"),
        ("grid.size_px", 100, "grid.size_px=100: must be a multiple of 32"),
        ("grid.size_m", float("inf"), "grid.size_m=inf: must be a finite number"),
        ("grid", {"size_px": 128}, "grid.size_m: is missing"),
        (LEVELS, [0.1, 0.3, 0.2, 0.3, 0.4], f"{LEVELS}=[0.1, 0.3, 0.2, 0.3, 0.4]: must be ordered, low to high"),
        ("encoding.parameters", [], "encoding.parameters=[]: must be an object"),
        ("architecture", "vit", "architecture=vit: must be one of smp, convgru"),
        ("size_px", 128, "size_px=128: is not a known key"),
    ],
)
def test_a_wrong_value_is_refused_in_one_line_with_its_key(tmp_path, key, value, message):
    directory = tmp_path / "model"
    shutil.copytree(PUBLISHED, directory)
    content = changed(key, value)
    content |= {"sha256": _checksum(content, directory)}
    (directory / DESCRIPTION).write_text(json.dumps(content))
    with pytest.raises(ValueError, match=rf"model cannot be used \({re.escape(message)}") as refused:
        load_predictor(directory)
    assert "\n" not in str(refused.value)
    assert "pydantic" not in str(refused.value)


def test_missing_keys_and_many_errors_are_named():
    content = published()
    with pytest.raises(ValueError, match=r"^channels: is missing"):
        checked(content, "channels")
    del content["grid"]
    with pytest.raises(ValueError, match=r"^grid: is missing$"):
        checked(content, "architecture")
    wrong = {name: [float("nan")] * 5 for name in content["statistics"]["quantiles"]}
    with pytest.raises(ValueError, match=r"must be a finite number; and 37 more$"):
        checked(published() | {"statistics": {"windows": 1, "quantiles": wrong}}, "architecture")


def test_a_description_that_is_nested_too_deeply_is_refused(tmp_path):
    directory = tmp_path / "model"
    shutil.copytree(PUBLISHED, directory)
    (directory / DESCRIPTION).write_text('{"grid": ' + "[" * 100_000 + "]" * 100_000 + "}")
    with pytest.raises(ValueError, match=r"predictor.json cannot be read \(it is nested too deeply\)"):
        load_predictor(directory)
