"""What maps hold of movers, by the scans since their last hit, with intervals from drawn recordings."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from repro.metrics.bootstrap import bounds, draw_weights
from reproduce.movers.scenes import BINS, Target, bin_of

CONSTANT, HITS, TRACKED = "constant", "hits", "tracked"  # maps without a network
DRAWN = 0.5  # probability of an obstacle from which a pixel is drawn as one
GROUPS = {**{name: (number,) for number, name in enumerate(BINS)}, "1-99": tuple(range(1, len(BINS)))}
SMALLEST = 0.5 / 255  # probability of a map of 8 bits


@dataclass(frozen=True)
class Held:
    """What a map holds of one mover.

    Args:
        recording: number of its recording.
        number: index in `BINS`.
        predicted: sum of the probabilities of an obstacle in its region [px].
        taken: pixels of its region that movers take.
        loss: negative log-likelihood of its region [nat].
        pixels: pixels of its region.
        peak: largest probability of an obstacle on the mover; NaN if it has left the map.
    """

    recording: int
    number: int
    predicted: float
    taken: int
    loss: float
    pixels: int
    peak: float


def losses(probability: np.ndarray, taken: np.ndarray) -> np.ndarray:
    """Return the negative log-likelihood of pixels [nat], of a probability that a map of 8 bits can have."""
    probability = probability.clip(SMALLEST, 1 - SMALLEST)
    return -np.log(np.where(taken, probability, 1 - probability))


def held(recording: int, target: Target, obstacle: np.ndarray) -> Held:
    """Measure a map, the probability of an obstacle, (H, W), at one mover."""
    region = target.region
    own, taken = obstacle[region], target.taken[region]
    sums = float(own.sum()), int(taken.sum()), float(losses(own, taken).sum()), int(region.sum())
    peak = float(obstacle[target.body].max()) if target.body.any() else np.nan
    return Held(recording, bin_of(target.mover.since), *sums, peak)


def rows(maps: Mapping[str, list[Held]], compared: tuple[str, ...]) -> Iterator[dict[str, Any]]:
    """Yield a row for each map and each of `GROUPS`.

    `held` is the sum of the probabilities over the area that movers take, `log_loss` the mean over the pixels of the
    regions [nat], `peak` the median over the movers of the largest probability on them, `drawn` the share of the movers
    with a pixel that is an obstacle. `less_<map>` is the log loss less that of another map.

    Args:
        maps: what is measured of the same movers, by the name of the map.
        compared: maps that the others are compared with.
    """
    recordings = 1 + max(each.recording for each in next(iter(maps.values())))
    weights = draw_weights(recordings)
    drawn = {name: _draw(own, recordings, weights) for name, own in maps.items()}
    for name, own in maps.items():
        for group, numbers in GROUPS.items():
            movers = [each for each in own if each.number in numbers]
            if not movers:
                continue
            row: dict[str, Any] = {"map": name, "since": group}
            row["movers"] = sum(np.isfinite(mover.peak) for mover in movers)
            row["recordings"] = len({each.recording for each in movers})
            for measure, values in drawn[name][group].items():
                row |= _interval(measure, values)
            for other in compared:
                if other != name:
                    less = drawn[name][group]["log_loss"] - drawn[other][group]["log_loss"]
                    row |= _interval(f"less_{other}", less)
            yield row


def _draw(movers: list[Held], recordings: int, weights: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
    """Compute each measure of each group in each draw of recordings, (draws + 1,)."""
    found = {}
    for group, numbers in GROUPS.items():
        own = [each for each in movers if each.number in numbers]
        recording = np.array([each.recording for each in own], dtype=int)
        values = np.array([(each.predicted, each.taken, each.loss, each.pixels) for each in own]).reshape(-1, 4)
        sums = np.zeros((recordings, 4))
        np.add.at(sums, recording, values)
        predicted, taken, loss, pixels = (weights @ sums).T
        peak = np.array([each.peak for each in own])
        here = np.isfinite(peak)
        peak, own_weights = peak[here], weights[:, recording[here]]
        with np.errstate(invalid="ignore", divide="ignore"):
            found[group] = {
                "held": predicted / taken,
                "log_loss": loss / pixels,
                "peak": _medians(peak, own_weights),
                "drawn": own_weights @ (peak >= DRAWN) / own_weights.sum(1),
            }
    return found


def _medians(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the lower median of values, (M,), which count as often as the weights of each draw say, (draws, M)."""
    order = np.argsort(values)
    summed = np.cumsum(weights[:, order], axis=1)
    if not len(values):
        return np.full(len(weights), np.nan)
    return np.where(summed[:, -1] > 0, values[order][(2 * summed >= summed[:, -1:]).argmax(1)], np.nan)


def _interval(name: str, values: np.ndarray) -> dict[str, float]:
    low, high = bounds(values)
    return {name: float(values[0]), f"{name}_low": float(low), f"{name}_high": float(high)}
