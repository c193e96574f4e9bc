import itertools

import numpy as np
import pandas as pd
import pytest
from conftest import fake_run, world_spec

from repro.config import PROJECTION, PROJECTION_NO_DECAY, Encoding, PairCounts
from repro.evaluation import learning_curves
from repro.evaluation.learning_curves import FITTED_METRICS, extrapolate, fit_power_law, read_points
from repro.recordings.format import spec_fingerprint
from repro.runs.outputs import Outputs

WORLDS = {spec_fingerprint(world_spec("3"))}  # of fake runs
CURVES = {("3", PROJECTION): (0.95, 0.02, 0.01), ("3", PROJECTION_NO_DECAY): (0.93, 0.03, 0.02)}


@pytest.fixture(autouse=True)
def few_draws(monkeypatch):
    monkeypatch.setattr(learning_curves, "DRAWS", 2)


def made(sizes=(32, 64, 128), alpha=0.4, beta=0.8, noise=0.0) -> pd.DataFrame:
    """Points on a known law, every metric alike."""
    generator, rows = np.random.default_rng(0), []
    for ((experiment, encoding), (c, a, b)), pairs, px in itertools.product(
        CURVES.items(), (500, 1000, 2000, 4000, 8000), sizes
    ):
        value = c - a * (pairs / 1000) ** -alpha - b * (px / 64) ** -beta + noise * generator.normal()
        row = {"model": "unet", "experiment": experiment, "encoding": encoding, "schedule": "short"}
        rows.append(row | {"pairs": pairs, "size_px": px} | dict.fromkeys(FITTED_METRICS, value))
    return pd.DataFrame(rows)


def test_a_known_law_is_recovered():
    points = made()
    curve = (points["encoding"] == PROJECTION_NO_DECAY).to_numpy().astype(int)
    at = (curve, points["pairs"].to_numpy(float), points["size_px"].to_numpy(float))
    law = fit_power_law(*at, points["accuracy"].to_numpy())
    assert tuple(law.exponents) == pytest.approx((0.4, 0.8), abs=0.02)
    assert np.allclose(law.factors, [(1 - c, a, b) for c, a, b in CURVES.values()], atol=1e-3)
    assert np.allclose(law(*at), points["accuracy"], atol=1e-5)


@pytest.mark.slow
def test_paper_scale_and_held_out_points_are_within_their_intervals(monkeypatch):
    monkeypatch.setattr(learning_curves, "DRAWS", 20)
    table = extrapolate(made(noise=2e-4))
    rows = table[(table["metric"] == "accuracy") & (table["target"] == "paper scale")].set_index("encoding")
    for (_, encoding), (c, a, b) in CURVES.items():
        truth = c - a * 10**-0.4 - b * 4**-0.8
        low, high = rows.loc[encoding, ["low", "high"]]
        assert 1e-5 < high - low < 0.01
        assert low - (high - low) / 2 < truth < high + (high - low) / 2
    held = table[table["target"] == "held-out point"]
    assert set(zip(held["pairs"], held["size_px"], strict=True)) == {(8000, 128)}
    assert (held["measured"].between(held["low"] - 0.001, held["high"] + 0.001)).all()


@pytest.mark.parametrize("sizes", [(64,), (64, 128)])
def test_fewer_than_three_resolutions_are_not_extrapolated(sizes):
    table = extrapolate(made(sizes=sizes))
    assert set(table["size_px"]) == {64}
    assert table["beta"].isna().all()
    rows = table[table["target"] == "paper scale"].set_index(["encoding", "metric"])["value"]
    assert rows[PROJECTION, "accuracy"] == pytest.approx(0.95 - 0.01 - 0.02 * 10**-0.4, abs=1e-3)


def test_points_of_the_papers_schedule_are_not_fitted():
    points = made()
    anchor = points.iloc[[0]].assign(pairs=10_000, schedule="stated", **dict.fromkeys(FITTED_METRICS, 0.1))
    pd.testing.assert_frame_equal(extrapolate(pd.concat([points, anchor])), extrapolate(points))


def test_points_are_of_the_networks_and_inputs_with_four_numbers_of_pairs(tmp_path):
    short = {"flip_augmentation": True, "ema_decay": 0.99}
    for train in (24, 48, 96, 192):
        outputs, pairs = tmp_path / str(train), PairCounts(train, 8, 8)
        for decay in (True, False):
            fake_run(outputs, "3", "unet", 0.8, decay=decay, pairs=pairs, **short)
        fake_run(outputs, "4", "unet", 0.9, pairs=pairs)
        fake_run(outputs, "3", "all_free", 0.6, pairs=pairs)
    fake_run(tmp_path / "24", "3", "fpn", 0.7, pairs=PairCounts(24, 8, 8))
    fake_run(tmp_path / "24", "3", "unet", 0.8, seed=1, pairs=PairCounts(24, 8, 8), **short)
    fake_run(tmp_path / "24", "3", "unet", 0.8, seed=2, pairs=PairCounts(24, 8, 8), worlds="others", **short)
    points = read_points([Outputs(path) for path in sorted(tmp_path.iterdir())], WORLDS)
    assert set(points["model"]) == {"unet"}
    sizes = points.groupby(["experiment", "encoding"]).size().to_dict()
    assert sizes == {("3", PROJECTION): 5, ("3", PROJECTION_NO_DECAY): 4, ("4", PROJECTION): 4}
    schedules = points.groupby("experiment")["schedule"].unique().map(list).to_dict()
    assert schedules == {"3": ["short"], "4": ["stated"]}
    assert set(points["pairs"]) == {24, 48, 96, 192}
    assert points["commit"].notna().all()


@pytest.mark.parametrize(
    ("changes", "fact"),
    [
        ({"encoding": Encoding(PROJECTION, {"decay": True, "oldest_gray": 0.3})}, "parameters"),
        ({"encoder": "mit_b5"}, "architecture"),
    ],
)
def test_runs_of_another_kind_share_no_curve(changes, fact, tmp_path):
    for train in (24, 48, 96, 192):
        own = changes if train == 96 and "encoder" not in changes else {}
        run = fake_run(tmp_path / str(train), "3", "unet", 0.8, pairs=PairCounts(train, 8, 8), **own)
        if train == 96 and "encoder" in changes:
            config = run.path / "config.yaml"
            config.write_text(config.read_text().replace("mit_b0", changes["encoder"]))
    with pytest.raises(ValueError, match=f"differ in {fact} and cannot share a curve: move .*96"):
        read_points([Outputs(path) for path in sorted(tmp_path.iterdir())], WORLDS)


def test_no_curve_gives_no_points(tmp_path):
    fake_run(tmp_path, "3", "unet", 0.8)
    assert read_points([Outputs(tmp_path)], WORLDS).empty


def test_other_networks_are_not_fitted():
    points = made()
    other = points.assign(model="convgru", **dict.fromkeys(FITTED_METRICS, 0.1))
    pd.testing.assert_frame_equal(extrapolate(pd.concat([points, other])), extrapolate(points))


def test_too_few_points_are_not_fitted():
    assert extrapolate(made(sizes=(64,)).query("pairs <= 2000")).empty
    with pytest.raises(ValueError, match="at least 3 points, got 2"):
        fit_power_law(np.zeros(2, int), np.array([1.0, 2.0]), np.full(2, 64.0), np.array([0.9, 0.91]))
