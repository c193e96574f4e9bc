"""Learning curves: metrics by training pairs and resolution, extrapolated to paper scale for the paper's U-Net.

Every metric m for n training pairs and maps of p x p pixels follows

    1 - m(n, p) = c + a (n / 1000)^-alpha + b (p / 64)^-beta        with a, b, c >= 0,

a saturating power law (Hestness et al., "Deep Learning Scaling is Predictable, Empirically", 2017). Each curve (an
experiment with or without decay) has its own a, b and c; all curves share the exponents. With a single
resolution the law has no term in p and applies to that resolution only. Only the exponents need a search; for
given exponents, a, b and c solve a non-negative least-squares problem.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import minimize, nnls

from repro.config import PROJECTION, PROJECTION_NO_DECAY
from repro.metrics.bootstrap import bounds
from repro.runs.directories import Run
from repro.runs.outputs import Outputs
from repro.system.errors import InputError

FITTED_METRICS = ("accuracy", "specificity", "dice", "obstacle_iou")
CURVE = ["experiment", "encoding"]
POINT = ["pairs", "size_px"]
FEWEST = 4  # points of a curve
SHARED = {  # what runs with the same values of some columns must share
    "parameters": ("encoding",),
    "architecture": ("model",),
    "training": ("model", *CURVE, *POINT, "schedule"),
}
FITTED = "short"  # schedule of the fitted points: flip augmentation and EMA; "stated" is the schedule of the paper
DRAWS = 200
PAPER_PAIRS, PAPER_PX = 10_000, 256  # of scale paper, to which the curves are extrapolated
EXPONENTS = {"alpha": 0.5, "beta": 1.0}  # where their search begins
INTERVAL = (0.02, 3.0)  # of the search


def read_points(directories: list[Outputs], worlds: set[str]) -> pd.DataFrame:
    """Read all evaluated networks of some worlds, for any number of pairs and any resolution.

    Args:
        directories: outputs directories; their runs of other worlds are left out.
        worlds: fingerprints of the worlds.

    Returns:
        one row per run of each network, input and experiment with at least four numbers of pairs or resolutions: model,
        experiment, encoding, seed, scale, pairs, size_px, epochs, schedule, all metrics, training_seconds, recordings
        (their hash) and commit of the training.

    Raises:
        ValueError: the runs of an input have different parameters of it, those of a network different architectures, or
            those of a point different trainings or numbers of test pairs.
    """
    runs = [run for outputs in directories for run in outputs.runs() if run.is_evaluated]
    rows = pd.DataFrame([row for run in runs if (row := _row(run, worlds)) is not None])
    if rows.empty:
        return rows
    points = rows.groupby(["model", *CURVE]).filter(lambda curve: len(curve[POINT].drop_duplicates()) >= FEWEST)
    for fact, by in SHARED.items():
        for name, own in points.groupby(list(by)):
            if own[fact].nunique() > 1:
                rare = own.loc[own[fact] == own[fact].value_counts().index[-1], "run"]
                raise InputError(
                    f"the runs of {', '.join(by)} {', '.join(map(str, name))} differ in {fact} and cannot share a "
                    f"curve: move {rare.iloc[0]} elsewhere"
                )
    return points.drop(columns=[*SHARED, "run"])


def _row(run: Run, worlds: set[str]) -> dict[str, Any] | None:
    config, origin = run.config(), run.provenance()
    if config.encoding is None or config.train is None or config.data.worlds not in worlds:
        return None
    trained = origin.last("trained")
    assert trained, "an evaluated network is trained"
    return {
        "model": config.model.name,
        "experiment": config.experiment,
        "encoding": config.key.encoding,
        "seed": config.seed,
        "scale": config.data.scale,
        "pairs": config.data.pairs.train,
        "size_px": config.data.size_px,
        "schedule": FITTED if config.train.flip_augmentation and config.train.ema_decay else "stated",
        **{name: origin.fact(name) for name in ("epochs", "training_seconds", "recordings")},
        "commit": trained["commit"],
        "run": str(run),
        "parameters": str(config.encoding.parameters),
        "architecture": str(config.model),
        "training": f"{config.train}, {config.data.pairs.test} test pairs",
        **{str(name): value for name, value in run.read_metrics().items()},
    }


@dataclass(frozen=True)
class PowerLaw:
    """A fitted power law.

    Args:
        exponents: alpha and beta, or alpha alone for a single resolution.
        factors: c, a and, with beta, b of each curve, (curves, 3) or (curves, 2).
    """

    exponents: np.ndarray
    factors: np.ndarray

    def __call__(self, curve: np.ndarray, pairs: np.ndarray, size_px: np.ndarray) -> np.ndarray:
        """Return the metric of curves, given by index, for pairs and resolutions, all (K,)."""
        return 1 - (self.factors[curve] * _terms(self.exponents, pairs, size_px)).sum(1)

    def parameters(self) -> int:
        """Return the number of fitted parameters; factors at their bound, zero, are not counted."""
        return len(self.exponents) + int(np.count_nonzero(self.factors))


def fit_power_law(curve: np.ndarray, pairs: np.ndarray, size_px: np.ndarray, value: np.ndarray) -> PowerLaw:
    """Fit the law to points, all (K,); without its term in the resolution if they have a single one.

    Args:
        curve: index of each point's curve, from 0.
        pairs: number of training pairs.
        size_px: side of the map [px].
        value: the metric.

    Raises:
        ValueError: a curve has fewer than 3 points.
    """
    if np.bincount(curve).min() < 3:
        raise InputError(f"a curve needs at least 3 points, got {np.bincount(curve).min()}")

    def solve(exponents: np.ndarray) -> tuple[float, np.ndarray]:
        terms = _terms(exponents, pairs, size_px)
        solutions = [nnls(terms[curve == k], 1 - value[curve == k]) for k in range(curve.max() + 1)]
        return sum(rest**2 for _, rest in solutions), np.stack([factors for factors, _ in solutions])

    first = list(EXPONENTS.values())[: min(len(np.unique(size_px)), 2)]
    options: dict[str, Any] = {"bounds": [INTERVAL] * len(first), "options": {"xatol": 1e-3}}
    best = minimize(lambda exponents: solve(exponents)[0], first, method="Nelder-Mead", **options)
    return PowerLaw(best.x, solve(best.x)[1])


def extrapolate(points: pd.DataFrame) -> pd.DataFrame:
    """Extrapolate U-Net to paper scale, and to the held-out (largest) point of each curve from its other points.

    The exponent of the resolution needs three resolutions; with fewer, only the resolution with most points is fitted,
    and extrapolated to the pairs of paper scale.

    Args:
        points: see `read_points`; the fit uses the paper's input and the short schedule, averaged over seeds.

    Returns:
        experiment, encoding, metric, target (`paper scale` or `held-out point`), pairs, size_px, value with low and
        high (95 % for one training, by a parametric bootstrap with normal residuals), alpha, beta (NaN for a single
        resolution), and `measured` for a held-out point.
        Empty if no curve has four points.
    """
    is_papers = (points["model"] == "unet") & points["encoding"].isin([PROJECTION, PROJECTION_NO_DECAY])
    fitted = points[is_papers & (points["schedule"] == FITTED)]
    means = fitted.groupby([*CURVE, *POINT], as_index=False)[list(FITTED_METRICS)].mean()
    if means["size_px"].nunique() < 3:
        means = means[means["size_px"].isin(means["size_px"].mode()[:1])]
    means = means.groupby(CURVE).filter(lambda rows: len(rows) >= FEWEST)
    if means.empty:
        return pd.DataFrame()
    means = means.sort_values(["encoding", "experiment"], kind="stable")  # the order of the tables
    sizes = means["size_px"].unique()
    size_px = PAPER_PX if len(sizes) > 1 else int(sizes[0])
    largest = (means["pairs"] * means["size_px"] ** 2).groupby([means[key] for key in CURVE], sort=False).idxmax()
    held_out, others = means.loc[largest], means.drop(largest)
    aims = held_out.assign(pairs=PAPER_PAIRS, size_px=size_px)
    frames = []
    for metric in FITTED_METRICS:
        frames.append(_extrapolated(means, aims, metric).assign(target="paper scale"))
        predicted = _extrapolated(others, held_out, metric)
        frames.append(predicted.assign(target="held-out point", measured=held_out[metric].to_numpy()))
    return pd.concat(frames, ignore_index=True)


def _extrapolated(means: pd.DataFrame, aims: pd.DataFrame, metric: str) -> pd.DataFrame:
    """Fit the law to the points of one metric and extrapolate it to `aims`, with intervals."""
    names = list(dict.fromkeys(zip(means["experiment"], means["encoding"], strict=True)))

    def coordinates(rows: pd.DataFrame) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        curve = [names.index(name) for name in zip(rows["experiment"], rows["encoding"], strict=True)]
        return np.array(curve), rows["pairs"].to_numpy(float), rows["size_px"].to_numpy(float)

    at, value, aim = coordinates(means), means[metric].to_numpy(), coordinates(aims)
    law = fit_power_law(*at, value)
    residuals = value - law(*at)
    free = max(len(value) - law.parameters(), 1)
    std, rng = np.sqrt((residuals**2).sum() / free), np.random.default_rng(0)
    noise = rng.normal(0, std, (DRAWS, len(value)))
    drawn = np.stack([law(*aim), *(fit_power_law(*at, law(*at) + each)(*aim) for each in noise)])
    drawn[1:] += rng.normal(0, std, (DRAWS, len(aims)))  # a training deviates from the law as the fitted ones do
    low, high = bounds(drawn)
    table = aims[[*CURVE, *POINT]].reset_index(drop=True)
    exponents = dict.fromkeys(EXPONENTS, np.nan) | dict(zip(EXPONENTS, law.exponents, strict=False))
    return table.assign(metric=metric, value=drawn[0], low=low, high=high, **exponents)


def _terms(exponents: np.ndarray, pairs: np.ndarray, size_px: np.ndarray) -> np.ndarray:
    """Compute 1, (n / 1000)^-alpha and, if beta is given, (p / 64)^-beta, (K, 3) or (K, 2)."""
    bases = (pairs / 1000, size_px / 64)
    powers = [base**-exponent for base, exponent in zip(bases, exponents, strict=False)]
    return np.stack([np.ones_like(pairs, float), *powers], axis=1)
