"""Bags of a standing lidar among people: what maps say near the last hits of what moves, by the time since then.

The view of 90 degrees swings, and the beams that it does not have at the end of a window tell what is true. Hits on
what moves, which are nearer than the beam usually measures, are compared with passed pixels.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.distance import cdist

from repro.logs.scan_log import ScanLog
from repro.metrics.bootstrap import bounds, draw_weights
from repro.metrics.calibration import log_loss
from repro.metrics.counts import LEVELS
from repro.networks.predictor import Predictor
from repro.scans import Scans
from reproduce.movers.measures import CONSTANT, GROUPS, HITS, TRACKED
from reproduce.movers.rates import Follower, Rates, Sample, groups, kinds
from reproduce.movers.scenes import BINS, SLACK_M, bin_of
from reproduce.real.logs import NEARER_M, log_of, standing
from reproduce.real.measures import auroc

RADIUS_M, TOP_M_S = 0.3, 1.8  # of people, as in `places`


@dataclass(frozen=True)
class Shown:
    """The pixels that held-out beams show near the last hits of what moves, at the end of one window, P.

    Args:
        bag: name of the bag.
        block: number of the part of it whose windows are drawn together.
        number: index in `BINS` of the scans since a hit from which something can have come here.
        sample: the pixels; taken are those where a held-out beam hits something that moves, the others are passed.
        obstacle: probability of an obstacle by each network.
    """

    bag: str
    block: int
    number: np.ndarray
    sample: Sample
    obstacle: dict[str, np.ndarray]


def shown(path: Path, networks: Mapping[str, Predictor], follower: Follower) -> Iterator[Shown]:
    """Yield what held-out beams show in each window of a bag; all networks have one grid."""
    first = next(iter(networks.values()))
    grid, usual_m = first.grid, usual_ranges(log_of(path, first)[0])
    for case in standing(path, first):
        assert case.moving is not None, "the lidar of a bag stands"
        taken, scans = case.moving & case.clear.hits, case.window.scans
        pixels = np.flatnonzero(taken | case.clear.passed)
        row, column = np.divmod(pixels, grid.size_px)
        centers = grid.resolution_m * (np.stack([column, grid.size_px - 1 - row], -1) + 0.5)
        since = since_hits(scans, moving_hits(scans, usual_m), centers, first.step_s)
        pixels, since = pixels[since >= 0], since[since >= 0]
        group = groups(scans, grid, follower, first.step_s, case.range_max_m).ravel()[pixels]
        kind = kinds(scans, grid, case.range_max_m).ravel()[pixels]
        obstacle = {name: 1 - np.asarray(case.map_of(network)).ravel()[pixels] for name, network in networks.items()}
        number = np.array([bin_of(scans_since) for scans_since in since], dtype=int)
        yield Shown(path.stem, case.block, number, Sample(group, kind, taken.ravel()[pixels]), obstacle)


def usual_ranges(log: ScanLog) -> tuple[np.ndarray, np.ndarray]:
    """Return the angle of each beam of a standing lidar [rad] and its median range [m], both (N,)."""
    return log.angles, np.median(np.nan_to_num(log.ranges, nan=np.inf, posinf=np.inf), axis=0)


def moving_hits(scans: Scans, usual_m: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return the beams of a window, (T, N), that end nearer than the beam of the lidar usually does, bool."""
    angles, median_m = usual_m
    beam = np.rint((scans.poses[:, 2:] + scans.angles - angles[0]) / (angles[1] - angles[0])).astype(int)
    return scans.ranges < median_m[beam.clip(0, len(angles) - 1)] - NEARER_M


def since_hits(scans: Scans, moving: np.ndarray, centers: np.ndarray, step_s: float) -> np.ndarray:
    """Return the scans since the newest hit from which something that moves can have come to each place, -1 for none.

    Args:
        scans: one window, (T, N).
        moving: hits on what moves, bool, (T, N).
        centers: the places, x, y [m], (P, 2).
        step_s: time of a step [s].
    """
    since = len(moving) - 1 - np.nonzero(moving)[0]  # (Q,)
    reaches = cdist(centers, scans.points()[0][moving]) <= RADIUS_M + SLACK_M + TOP_M_S * step_s * since
    newest = np.where(reaches, since, len(moving)).min(1, initial=len(moving))
    return np.where(newest < len(moving), newest, -1)


def rows(windows: list[Shown]) -> Iterator[dict[str, Any]]:
    """Yield a row for each map and bin; rates and constants are those of the other bags."""
    blocks = {block: number for number, block in enumerate(sorted({(shown.bag, shown.block) for shown in windows}))}
    counts: dict[str, np.ndarray] = {}
    for bag in sorted({shown.bag for shown in windows}):
        others = [shown for shown in windows if shown.bag != bag]
        tracked = Rates.fit(shown.sample for shown in others)
        hits = Rates.fit(shown.sample.untracked for shown in others)
        number = np.concatenate([shown.number for shown in others])
        taken = np.concatenate([shown.sample.taken for shown in others])
        constant = (np.bincount(number, taken, len(BINS)) + 0.5) / (np.bincount(number, minlength=len(BINS)) + 1)
        for shown in (shown for shown in windows if shown.bag == bag):
            sample = shown.sample
            maps = shown.obstacle | {
                HITS: hits.of(sample.untracked.group, sample.kind),
                TRACKED: tracked.of(sample.group, sample.kind),
                CONSTANT: constant[shown.number],
            }
            for name, obstacle in maps.items():
                own = counts.setdefault(name, np.zeros((len(blocks), len(BINS), 2, LEVELS), dtype=np.int64))
                free = np.rint((1 - obstacle) * (LEVELS - 1)).astype(int)
                block = own[blocks[shown.bag, shown.block]]
                np.add.at(block, (shown.number, 1 - sample.taken.astype(int), free), 1)
    yield from _measured(counts)


def _measured(counts: dict[str, np.ndarray]) -> Iterator[dict[str, Any]]:
    weights = draw_weights(len(next(iter(counts.values()))))
    drawn = {
        name: {
            group: np.einsum("db,btl->dtl", weights, own[:, list(numbers)].sum(1)) for group, numbers in GROUPS.items()
        }
        for name, own in counts.items()
    }
    for name, in_groups in drawn.items():
        for group, own in in_groups.items():
            hits, passed = own[0].sum(-1)
            row: dict[str, Any] = {"map": name, "since": group, "hits": int(hits), "passed": int(passed)}
            values = {"log_loss": log_loss(own), "auroc": auroc(own)}
            other = drawn[TRACKED][group]
            values |= {f"log_loss_less_{TRACKED}": values["log_loss"] - log_loss(other)}
            values |= {f"auroc_less_{TRACKED}": values["auroc"] - auroc(other)}
            for measure, each in values.items():
                low, high = bounds(each)
                row |= {measure: each[0], f"{measure}_low": low, f"{measure}_high": high}
            yield row
