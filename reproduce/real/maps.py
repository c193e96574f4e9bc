"""Maps without a network, fitted to logs of other places: counts, a regression, and gradient boosting."""

from dataclasses import dataclass

import numpy as np
from scipy.special import expit, logit
from sklearn.ensemble import HistGradientBoostingClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from repro.metrics.counts import LEVELS
from reproduce.real.evidence import COUNTS, Evidence
from reproduce.real.measures import auroc, calibrated, counts_of

COUNTED, REGRESSION, BOOSTING = "counts and distances", "regression with continued walls", "gradient boosting"
MIXED = "mean of the network and the boosting"
DISTANCE_WEIGHTS = (0.0, 0.15, 0.3, 0.5, 1.0, 2.0)  # candidates
PASSED_WEIGHTS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5)
START = (0.15, 0.5)  # the weights before any choice
UNSEEN_BAND, PASSED_BAND = LEVELS // 2, 3 * LEVELS // 4  # first levels of unseen and of passed pixels; last hits from 0
SQUARED = ("to_hit", "to_passed", "to_robot", "to_wall")  # of a regression
QUANTITIES = COUNTS[2:]
COMMON = {"l2_regularization": 5.0, "max_features": 1 / 3, "min_samples_leaf": 200, "random_state": 0}
CANDIDATES = (  # of the boosting, with a learning rate that takes most of a log's information in each
    {"max_iter": 120, "learning_rate": 0.12, "max_leaf_nodes": 24},
    {"max_iter": 300, "learning_rate": 0.05, "max_leaf_nodes": 24},
    {"max_iter": 300, "learning_rate": 0.05, "max_leaf_nodes": 64},
    {"max_iter": 300, "learning_rate": 0.1, "max_leaf_nodes": 8},
)


@dataclass(frozen=True)
class Sample:
    """Pixels of some windows of a log, P.

    Args:
        features: see `Evidence.features`, of which the first are `COUNTS`, (P, F).
        free: whether the held-out beams passed over the pixels, bool, (P,).
    """

    features: np.ndarray
    free: np.ndarray


def joined(samples: list[Sample]) -> Sample:
    """Return the pixels of several logs."""
    return Sample(np.concatenate([each.features for each in samples]), np.concatenate([each.free for each in samples]))


@dataclass(frozen=True)
class Fitted:
    """Constants of the counts with the probability of each of their levels, (256,), and the models."""

    constants: tuple[float, float]
    probability: np.ndarray
    regression: Pipeline
    boosting: HistGradientBoostingClassifier

    def predict(self, evidence: Evidence, pixels: np.ndarray) -> dict[str, np.ndarray]:
        """Return the probability of free at flat indices of pixels, (P,), of each map."""
        features = evidence.features(pixels)
        counts = features[:, : len(COUNTS)]
        return {
            COUNTED: self.probability[score(counts, *self.constants)],
            REGRESSION: self.regression.predict_proba(design(counts))[:, 1],
            BOOSTING: self.boosting.predict_proba(features)[:, 1],
        }


def fit(samples: list[Sample], settings: dict[str, float]) -> Fitted:
    """Fit all maps to samples of logs, each with equal weight: constants with the best mean AUROC, then the models."""
    distance = max(DISTANCE_WEIGHTS, key=lambda weight: _mean_auroc(samples, (weight, START[1]), is_seen=True))
    passed = max(PASSED_WEIGHTS, key=lambda weight: _mean_auroc(samples, (START[0], weight), is_seen=False))
    every = joined(samples)
    counts = every.features[:, : len(COUNTS)]
    probability = calibrated(counts_of(score(counts, distance, passed), every.free))
    regression = make_pipeline(StandardScaler(), LogisticRegression(solver="newton-cholesky"))
    return Fitted((distance, passed), probability, regression.fit(design(counts), every.free), boosted(every, settings))


def boosted(sample: Sample, settings: dict[str, float]) -> HistGradientBoostingClassifier:
    """Fit gradient boosting of decision trees (Friedman 2001; histograms as in LightGBM) to pixels."""
    return HistGradientBoostingClassifier(**COMMON, **settings).fit(sample.features, sample.free)


def mixed(network: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the probability with the mean log odds of two maps; those of a network end at half a level."""
    least = 0.5 / (LEVELS - 1)
    return expit(sum(logit(each.clip(least, 1 - least)) for each in (network, other)) / 2)


def tuned(samples: dict[str, list[Sample]]) -> dict[str, float]:
    """Return the settings of the boosting with the least log loss in a place when it is fitted to the others.

    Args:
        samples: those of development logs, by place.
    """

    def loss(settings: dict[str, float]) -> float:
        losses = []
        for place, tested in samples.items():
            others = [sample for name, each in samples.items() if name != place for sample in each]
            model, own = boosted(joined(others), settings), joined(tested)
            found = model.predict_proba(own.features)[np.arange(len(own.free)), own.free.astype(int)]
            losses.append(-np.log(found.clip(1e-3)).mean())
        return float(np.mean(losses))

    return min(CANDIDATES, key=loss)


def design(counts: np.ndarray) -> np.ndarray:
    """Return the features of a regression, (P, 10) to (P, F): a constant, slopes and squares for each kind of pixel."""
    of = dict(zip(COUNTS, counts.T, strict=True))
    columns = [of[name] for name in QUANTITIES] + [of[name] ** 2 for name in SQUARED]
    hit, seen = of["hit"] > 0, of["seen"] > 0
    kinds = np.stack([hit, seen & ~hit, ~seen])
    values = np.stack([np.ones(len(counts)), *columns])
    return (kinds[:, None] * values).reshape(-1, len(counts)).T


def score(counts: np.ndarray, distance_weight: float, passed_weight: float) -> np.ndarray:
    """Rank last hits below unseen and these below passed pixels, and the pixels of each kind by counts and distances.

    Last hits and passed pixels are ranked by the odds of a pass and the distance to the last hits, unseen pixels by
    the distances to the last hits and to the passed pixels.

    Args:
        counts: the quantities of `COUNTS`, (P, 10).
        distance_weight: of the distance of a seen pixel to the last hits.
        passed_weight: of the distance of an unseen pixel to the passed ones.

    Returns:
        levels from 0, the last hits, to 255, certainly free: unseen pixels from 128 and passed ones from 192 on.
    """
    of = dict(zip(COUNTS, counts.T, strict=True))
    seen = _scaled(of["odds"] + distance_weight * of["to_hit"], -3.1, 8.0)
    unseen = _scaled(of["to_hit"] - passed_weight * of["to_passed"], -5.0, 5.2)
    passed = PASSED_BAND + seen * (LEVELS - PASSED_BAND)
    levels = np.where(of["seen"] > 0, passed, UNSEEN_BAND + unseen * (PASSED_BAND - UNSEEN_BAND))
    return np.where(of["hit"] > 0, seen * UNSEEN_BAND, levels).astype(np.int64)


def _scaled(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Scale a score to 0 to 0.999."""
    return np.clip((values - low) / (high - low), 0, 0.999)


def _mean_auroc(samples: list[Sample], constants: tuple[float, float], *, is_seen: bool) -> float:
    """Return the mean AUROC of a score over logs, on the pixels that were seen or on the others."""
    found = []
    for sample in samples:
        chosen = (sample.features[:, COUNTS.index("seen")] > 0) == is_seen
        counts = sample.features[chosen][:, : len(COUNTS)]
        found.append(auroc(counts_of(score(counts, *constants), sample.free[chosen])))
    return float(np.nanmean(found))
