import importlib.util

import pandas as pd
import pytest
import torch
from conftest import ROOT

from repro.metrics import scores


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("ssim_script", ROOT / "reproduce" / "ssim.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_without_an_effect_the_ssim_is_that_of_the_tables(script):
    free, truth = torch.rand(3, 1, 32, 32), torch.rand(3, 1, 32, 32).round()
    plain = scores.ssim(free, truth)
    assert torch.allclose(script.ssim(free, truth), plain)
    same = {"predictions scaled by": 1.0, "noise of": 0.0, "value_range of": 1.0, "Gaussian window of": 11}
    for name, level in same.items():
        assert torch.allclose(script.EFFECTS[name][0](free, truth, truth, level), plain, atol=1e-5), name


def test_the_fit_of_the_gap_finds_a_factor_and_a_constant(script):
    ours = pd.Series([0.9, 0.8, 0.6])
    for paper, fitted, value in ((0.8 * ours, "factor", 0.8), (ours - 0.1, "constant difference", 0.1)):
        fits = script.gap(pd.DataFrame({"ours": ours, "paper": paper})).set_index("fitted")
        assert fits.loc[fitted, "value"] == pytest.approx(value)
        assert fits.loc[fitted, "rms"] == pytest.approx(0, abs=1e-12)
        assert fits["rms"].max() > 0.01


def test_an_effect_changes_our_averages_by_its_ratio(script):
    both = pd.DataFrame({"ours": 0.8, "paper": 0.6}, index=pd.MultiIndex.from_tuples(script.CELLS, names=script.CELL))
    values = {("none", 0.0): 0.5, ("noise of", 0.01): 0.4, ("noise of", 0.02): 0.375}
    rows = pd.DataFrame(
        [(*kind, *cell, value) for cell in script.CELLS for kind, value in values.items()],
        columns=["effect", "level", *script.CELL, "ssim"],
    )
    effects, left = script.transferred(rows, both)
    assert effects.loc[effects["level"] == 0.01, "expected"].tolist() == pytest.approx([0.64] * 6)
    assert left["rms"].tolist() == pytest.approx([0.2, 0.04, 0.0])
