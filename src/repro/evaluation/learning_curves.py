"""Learning curves: what more pairs and more pixels would give, from what fewer gave.

Of every metric m, for n training pairs and maps of p x p pixels,

    1 - m(n, p) = c + a (n / 1000)^-alpha + b (p / 64)^-beta        with a, b, c >= 0,

a saturating power law (Hestness et al., "Deep Learning Scaling is Predictable, Empirically", 2017) with a, b, c of each
experiment, with and without decay, and exponents that all share. With fewer than three resolutions there is no term of
p, and nothing is said of others. For given exponents the rest is a least-squares problem: only they are searched.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import minimize, nnls

from repro.config import PROJECTION
from repro.metrics.bootstrap import bounds
from repro.runs.directories import Outputs, Run

METRICS = ("accuracy", "specificity", "dice", "obstacle_iou")
CURVE = ["experiment", "encoding"]
FITTED = "short"  # the schedule of the fitted points: mirrored, averaged; "stated" keeps to what the paper states
DRAWS = 200
EXPONENTS = (0.02, 3.0)  # between which they are searched


def read_points(directories: list[Outputs]) -> pd.DataFrame:
    """Reads the evaluated U-Nets with the paper's input, whatever their pairs and pixels.

    Args:
        directories: outputs directories.

    Returns:
        a row a run: experiment, encoding, seed, scale, pairs, size_px, epochs, schedule, all metrics, training_seconds,
        recordings and commit, where it came from.
    """
    runs = [run for outputs in directories for run in outputs.runs() if run.is_evaluated]
    rows = [_row(run) for run in runs if run.config().model.name == "unet"]
    return pd.DataFrame([row for row in rows if row is not None])


def _row(run: Run) -> dict[str, Any] | None:
    config, origin = run.config(), run.provenance()
    if config.encoding is None or config.train is None or config.encoding.name != PROJECTION:
        return None
    trained = next(step for step in reversed(origin.steps) if step["step"] == "trained")
    return {
        "experiment": config.experiment,
        "encoding": config.key.encoding,
        "seed": config.seed,
        "scale": config.data.scale,
        "pairs": config.data.pairs.train,
        "size_px": config.data.size_px,
        "schedule": FITTED if config.train.flip_augmentation and config.train.ema_decay else "stated",
        **{name: origin.fact(name) for name in ("epochs", "training_seconds", "recordings")},
        "commit": trained["commit"],
        **{str(name): value for name, value in run.read_metrics().items()},
    }


@dataclass(frozen=True)
class Law:
    """A fitted law: exponents, and c, a and b of each curve, (curves, 3); b is zero where one resolution was fitted."""

    alpha: float
    beta: float
    factors: np.ndarray

    def __call__(self, curve: np.ndarray, pairs: np.ndarray, size_px: np.ndarray) -> np.ndarray:
        """Gives the metric of some curves (by number) for some pairs and pixels, all (K,)."""
        return 1 - (self.factors[curve] * _terms(self.alpha, self.beta, pairs, size_px)).sum(1)


def fit_law(curve: np.ndarray, pairs: np.ndarray, size_px: np.ndarray, value: np.ndarray) -> Law:
    """Fits the law to points, all (K,).

    Args:
        curve: the number of each point's curve, from 0.
        pairs: training pairs.
        size_px: pixels along a side.
        value: the metric.

    Raises:
        ValueError: a curve has fewer than 3 points.
    """
    if np.bincount(curve).min() < 3:
        raise ValueError(f"a curve needs at least 3 points, got {np.bincount(curve).min()}")

    def solve(exponents: np.ndarray) -> tuple[float, np.ndarray]:
        terms = _terms(exponents[0], exponents[1], pairs, size_px)
        if len(np.unique(size_px)) == 1:
            terms[:, 2] = 0
        found = [nnls(terms[curve == k], 1 - value[curve == k]) for k in range(curve.max() + 1)]
        return sum(rest**2 for _, rest in found), np.stack([factors for factors, _ in found])

    best = minimize(
        lambda x: solve(np.clip(x, *EXPONENTS))[0], (0.5, 1.0), method="Nelder-Mead", options={"xatol": 1e-3}
    )
    alpha, beta = np.clip(best.x, *EXPONENTS)
    return Law(alpha, beta, solve(np.array([alpha, beta]))[1])


def extrapolate(points: pd.DataFrame, pairs: int = 10_000, size_px: int = 256) -> pd.DataFrame:
    """Extrapolates the metrics at paper scale, and those of the largest point of each curve from the others.

    Args:
        points: see `read_points`; those of the short schedule are fitted, seeds averaged.
        pairs: training pairs to extrapolate.
        size_px: resolution to extrapolate. An exponent needs three resolutions; with fewer, the one with most points is
            taken by itself, and nothing is said of others.

    Returns:
        experiment, encoding, metric, target (`paper scale` or `held-out point`), pairs, size_px, value with low and
        high (95 %, residuals drawn as normal noise and refitted), alpha, beta, and `measured` for a held-out point.
    """
    keys = [*CURVE, "pairs", "size_px"]
    means = points[points["schedule"] == FITTED].groupby(keys, as_index=False)[list(METRICS)].mean()
    if means["size_px"].nunique() < 3:
        means = means[means["size_px"].isin(means["size_px"].mode()[:1])]
    means = means.groupby(CURVE).filter(lambda rows: len(rows) >= 4)
    if means.empty:
        return pd.DataFrame()
    means = means.sort_values(["encoding", "experiment"], kind="stable")  # as the tables
    sizes = means["size_px"].unique()
    size_px = size_px if len(sizes) > 1 else int(sizes[0])
    largest = (means["pairs"] * means["size_px"] ** 2).groupby([means[key] for key in CURVE], sort=False).idxmax()
    held, rest = means.loc[largest], means.drop(largest)
    aims = held.assign(pairs=pairs, size_px=size_px)
    frames = []
    for metric in METRICS:
        frames.append(_extrapolated(means, aims, metric).assign(target="paper scale"))
        left_out = _extrapolated(rest, held, metric).assign(target="held-out point", measured=held[metric].to_numpy())
        frames.append(left_out)
    return pd.concat(frames, ignore_index=True)


def _extrapolated(means: pd.DataFrame, aims: pd.DataFrame, metric: str, seed: int = 0) -> pd.DataFrame:
    names = list(dict.fromkeys(zip(means["experiment"], means["decay"], strict=True)))

    def places(rows: pd.DataFrame) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        curve = [names.index(name) for name in zip(rows["experiment"], rows["decay"], strict=True)]
        return np.array(curve), rows["pairs"].to_numpy(float), rows["size_px"].to_numpy(float)

    at, value, aim = places(means), means[metric].to_numpy(), places(aims)
    law = fit_law(*at, value)
    rest = value - law(*at)
    free = max(len(value) - np.count_nonzero(law.factors) - 2, 1)
    noise = np.random.default_rng(seed).normal(0, np.sqrt((rest**2).sum() / free), (DRAWS, len(value)))
    drawn = np.stack([law(*aim), *(fit_law(*at, law(*at) + each)(*aim) for each in noise)])
    low, high = bounds(drawn)
    found = aims[[*CURVE, "pairs", "size_px"]].reset_index(drop=True)
    return found.assign(metric=metric, value=drawn[0], low=low, high=high, alpha=law.alpha, beta=law.beta)


def _terms(alpha: float, beta: float, pairs: np.ndarray, size_px: np.ndarray) -> np.ndarray:
    """1, (n / 1000)^-alpha and (p / 64)^-beta, (K, 3)."""
    return np.stack([np.ones_like(pairs, float), (pairs / 1000) ** -alpha, (size_px / 64) ** -beta], axis=1)
