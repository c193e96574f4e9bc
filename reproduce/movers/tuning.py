"""Tuning of the maps without a network on validation worlds, by the log loss where movers can be."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from repro.maps.grid import Grid
from reproduce.movers.cloud import CloudSettings
from reproduce.movers.measures import losses
from reproduce.movers.rates import Follower, Rates, Sample, TrackSettings, groups, kinds, parse, plain
from reproduce.movers.scenes import BINS, Place, Scene, Target, bin_of, scenes, targets

TRIED: dict[str, tuple[float, ...]] = {  # one after the other, as factors of the value
    "passed_share": (0.0, 6.0),
    "radius_m": (0.85, 1.3),
    "place_m": (0.7, 1.8),
    "turn_s": (0.5, 2.0),
    "least_width": (0.0,),
    "survival_s": (4.0,),
    "stop_share": (),
}
VALUES = {"stop_share": (0.3,)}


@dataclass(frozen=True)
class Asked:
    """A scene on a grid, with all that does not depend on what is tuned."""

    scene: Scene
    grid: Grid
    targets: list[Target]
    kinds: np.ndarray

    @classmethod
    def of(cls, scene: Scene, grid: Grid) -> "Asked":
        return cls(scene, grid, targets(scene, grid), kinds(scene.window.scans, grid, scene.range_max_m))

    def groups(self, follower: Follower) -> np.ndarray:
        """Return the group of each pixel, (H, W)."""
        return groups(self.scene.window.scans, self.grid, follower, self.scene.step_s, self.scene.range_max_m)

    def samples(self, follower: Follower) -> Iterator[tuple[int, Sample]]:
        """Yield index of the bin and pixels of each target."""
        group = self.groups(follower)
        for target in self.targets:
            pixels = target.region
            yield bin_of(target.mover.since), Sample(group[pixels], self.kinds[pixels], target.taken[pixels])


@dataclass(frozen=True)
class Tuned:
    """What validation worlds of a place say.

    Args:
        follower: what tracks movers.
        tracked: rates by where it expects them, and by kind.
        hits: rates of the kinds of pixels alone.
        constant: share of the pixels of a region that movers take, by bin, (B,).
    """

    follower: Follower
    tracked: Rates
    hits: Rates
    constant: np.ndarray

    def plain(self) -> dict[str, Any]:
        """Return all values for a JSON file."""
        rates = {"tracked": self.tracked.table, "hits": self.hits.table[:1], "constant": self.constant}
        return {"follower": plain(self.follower)} | {name: each.round(6).tolist() for name, each in rates.items()}

    @classmethod
    def parse(cls, values: dict[str, Any]) -> "Tuned":
        """Return what `plain` described."""
        tracked, hits, constant = (np.array(values[name]) for name in ("tracked", "hits", "constant"))
        return cls(parse(values["follower"]), Rates(tracked), Rates(hits), constant)


def tune(place: Place, seeds: range, searched: int, grid: Grid) -> Tuned:
    """Choose the settings of the clouds by the first worlds, and fit all rates to all of them."""
    asked = [Asked.of(scene, grid) for scene in scenes(place, seeds, grid.size_m)]
    follower = search(asked[:searched], place) if place.centered else TrackSettings.of_study(place.experiment)
    samples = [sample for scene in asked for sample in scene.samples(follower)]
    counts = np.zeros((2, len(BINS)))
    for number, sample in samples:
        counts[:, number] += sample.taken.sum(), sample.taken.size
    constant = (counts[0] + 0.5) / (counts[1] + 1)
    untracked = Rates.fit(sample.untracked for _, sample in samples)
    return Tuned(follower, Rates.fit(sample for _, sample in samples), untracked, constant)


def search(asked: list[Asked], place: Place) -> CloudSettings:
    """Return the settings with the least score, of which one value is changed after the other."""
    best = CloudSettings(speed_m_s=place.top_m_s)
    least = score(asked, best)
    for name, factors in TRIED.items():
        value = getattr(best, name)
        for other in (*(value * factor for factor in factors), *VALUES.get(name, ())):
            tried = replace(best, **{name: round(other, 4)})
            if (found := score(asked, tried)) < least:
                best, least = tried, found
        print(f"{place.name}: {name} {getattr(best, name):g}, {least:.4f}", flush=True)
    return best


def score(asked: list[Asked], settings: CloudSettings) -> float:
    """Return the log loss over that of a constant, averaged over the bins by their movers.

    Each half of the scenes has the rates of the other one.
    """
    halves = [[sample for scene in half for sample in scene.samples(settings)] for half in (asked[::2], asked[1::2])]
    found: list[list[tuple[np.ndarray, np.ndarray]]] = [[] for _ in BINS]
    for own, other in (halves, halves[::-1]):
        rates = Rates.fit(sample for _, sample in other)
        for number, sample in own:
            found[number].append((losses(rates.of(sample.group, sample.kind), sample.taken), sample.taken))
    ratios = np.zeros(len(BINS))
    for number, parts in enumerate(found):
        if parts:
            loss, taken = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
            ratios[number] = loss.mean() / losses(np.full(taken.shape, taken.mean()), taken).mean()
    return float(np.average(ratios, weights=[len(parts) for parts in found]))
