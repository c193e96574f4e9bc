"""Maps that are fitted to the other logs than the one that is tested: constants, the regression and probabilities."""

from dataclasses import dataclass

import numpy as np
from sklearn.pipeline import Pipeline

from repro.metrics.counts import LEVELS, PROBABILITY
from reproduce.real.evidence import CENTER, Evidence, fit, join, regression_map, score_map
from reproduce.real.measures import auroc, calibrated

DISTANCE_WEIGHTS = (0.0, 0.15, 0.3, 0.5, 1.0, 2.0)  # candidates
PASSED_WEIGHTS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5)
START = (0.15, 0.5)  # the weights before any choice
NETWORK, UNCALIBRATED = "network", "network, uncalibrated"
SCORE, REGRESSION = "counts and distances", "regression with continued walls"


@dataclass(frozen=True)
class Sample:
    """Pixels of some windows of a log, to which the maps of other logs are fitted.

    Args:
        evidence: evidence of the pixels and of those around them, (P, 9).
        network: levels of the network, the lowest of the nine, (P,).
        free: whether the held-out beams passed over the pixels, bool, (P,).
    """

    evidence: Evidence
    network: np.ndarray
    free: np.ndarray


@dataclass(frozen=True)
class Fitted:
    """What is fitted for a log: constants of the score, the regression, probabilities by map."""

    constants: tuple[float, float]
    model: Pipeline
    probability: dict[str, np.ndarray]


def fit_others(samples: dict[str, Sample], tested: str) -> Fitted:
    """Fit on all logs but the tested one: the weights with the best mean AUROC, the regression and probabilities."""
    others = [each for log, each in samples.items() if log != tested]
    distance_weight = max(DISTANCE_WEIGHTS, key=lambda weight: _mean_auroc(others, (weight, START[1]), is_seen=True))
    passed_weight = max(PASSED_WEIGHTS, key=lambda weight: _mean_auroc(others, (START[0], weight), is_seen=False))
    evidence, free = join([each.evidence for each in others]), np.concatenate([each.free for each in others])
    fitted = Fitted((distance_weight, passed_weight), fit(evidence, free), {})
    levels = {NETWORK: np.concatenate([each.network for each in others])}
    levels |= {name: each.min(1) for name, each in maps_of(evidence, fitted).items()}
    probability = {name: calibrated(counts_of(each, free)) for name, each in levels.items()}
    return Fitted(fitted.constants, fitted.model, probability | {UNCALIBRATED: PROBABILITY})


def maps_of(evidence: Evidence, fitted: Fitted) -> dict[str, np.ndarray]:
    """Return the levels of all maps without a network, in the shape of the evidence."""
    return {SCORE: score_map(evidence, *fitted.constants), REGRESSION: regression_map(evidence, fitted.model)}


def _mean_auroc(samples: list[Sample], constants: tuple[float, float], *, is_seen: bool) -> float:
    """Return the mean AUROC of a score over logs, on the pixels that were seen or on the others."""
    counts = [
        counts_of(score_map(each.evidence, *constants).min(1), each.free, each.evidence.seen[:, CENTER] == is_seen)
        for each in samples
    ]
    return float(np.nanmean(auroc(np.stack(counts))))


def counts_of(levels: np.ndarray, free: np.ndarray, pixels: np.ndarray | slice = slice(None)) -> np.ndarray:
    """Count some pixels by truth, hits first, and level, (2, 256)."""
    return np.stack([np.bincount(levels[pixels][free[pixels] == truth], minlength=LEVELS) for truth in (0, 1)])
