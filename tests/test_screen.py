"""reproduce/worlds and reproduce/ssim.py: families of worlds, misfits, and SSIM in 16 bits."""

import numpy as np
import pandas as pd
import pytest
import torch
from reproduce.ssim import ssim_gpu
from reproduce.worlds.__main__ import hopeless, screened
from reproduce.worlds.families import FAMILIES, MOVING, STATIC, source, world_of
from reproduce.worlds.misfit import misfits, ours, papers

from repro.evaluation.image_metrics import ssim
from repro.recordings.format import spec_fingerprint
from repro.reporting.paper import are_papers
from repro.reporting.papers_claims import LEVEL
from repro.worlds.spec import world_spec


@pytest.mark.parametrize("name", FAMILIES)
def test_a_family_has_other_worlds_than_the_papers_in_its_experiments_only(name):
    world = world_of(FAMILIES[name])
    for experiment in STATIC + MOVING:
        is_papers = are_papers(spec_fingerprint(world_spec(world, experiment)))
        assert is_papers == (source(name, experiment) == "paper")


def test_the_misfit_is_in_tolerances_and_leaves_ssim_out():
    paper, tolerance = papers("unet"), pd.Series(LEVEL)
    assert misfits(paper)["all"] == 0
    assert misfits(paper + 2 * tolerance)["all"] == pytest.approx(2)
    other = misfits(paper.assign(ssim=2 * paper["ssim"]))
    assert (other["all"], other["ssim_square"]) == (0, pytest.approx(0.5))
    missing = pd.Series(misfits((paper + tolerance).drop(index=[("1", "projection")])))
    assert missing[["static", "ssim_rotation"]].isna().all()
    assert missing["least"] == pytest.approx((5 / 6) ** 0.5)


def test_a_small_study_changes_the_large_one_by_its_difference_to_the_papers_worlds():
    full = ours("paper", "unet")
    plain = (full - 0.1).reset_index().assign(family="paper")
    moving = plain[plain["experiment"].isin(MOVING)].assign(family="faster")
    moving["specificity"] -= 0.06
    found = screened(pd.concat([plain, moving])).set_index("family")
    assert found.loc["paper", "all"] == pytest.approx(misfits(full)["all"])
    assert found.loc["faster", "static"] == pytest.approx(misfits(full)["static"])
    assert found.loc["faster", "moving"] < found.loc["paper", "moving"]
    assert np.isnan(found.loc["25", "all"])
    assert list(hopeless(found.reset_index())[["paper", "25", "clear"]]) == [False, False, True]


def test_ssim_by_the_rules_of_a_gpu_is_piqas_in_32_bits():
    rng = np.random.default_rng(0)
    free, maps = rng.random((2, 1, 32, 32), np.float32), (rng.random((2, 1, 32, 32)) < 0.9).astype(np.float32)
    exact, pair = ssim(free, maps), (torch.from_numpy(free), torch.from_numpy(maps))
    np.testing.assert_allclose(ssim_gpu(*pair, torch.float32), exact, atol=1e-5)
    assert np.abs(ssim_gpu(pair[0].bfloat16(), pair[1], torch.bfloat16).numpy() - exact).max() > 1e-4
