"""Memory of movers: what maps hold of obstacles that move, by the time since a beam last ended on them.

    python -m reproduce.movers --tune
    python -m reproduce.movers [--weights buildings rooms NAME=DIRECTORY ...] [--only "rooms crossing" corridor ...]
        [--recordings N] [--bags BAG ...] [--target DIRECTORY]

The first call tunes the maps without a network (a constant rate, hits kept for a time, tracked movers) on worlds of
their own and writes tuned.json. The second one measures them and networks, where the size of the map is that of the
world, and writes a table for each kind of worlds (rooms_crossing.csv and others, see `measures.rows`), a person in a
corridor (corridor.csv, corridor.png) and, with bags of a standing lidar, bags.csv. `--only` chooses among these. What
is published, in reproduce/results/movers, has the tuning where the target has none. A network takes about a CPU minute
for 200 recordings of all worlds, the maps without one three minutes.
"""

import argparse
import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from repro.cli.log_prediction import load
from repro.maps.grid import Grid
from repro.networks.predictor import Predictor
from repro.runs.devices import one_thread
from repro.runs.provenance import environment
from repro.scans import Scans
from repro.system.errors import InputError
from repro.system.files import write_json, write_text
from reproduce.calls import positive, reported
from reproduce.movers import bags, corridor
from reproduce.movers.measures import CONSTANT, HITS, TRACKED, Held, held, rows
from reproduce.movers.rates import groups, kinds
from reproduce.movers.scenes import PLACES, Place, bin_of, scenes
from reproduce.movers.tuning import Asked, Tuned, tune
from reproduce.real.maps import mixed

PUBLISHED = Path(__file__).parents[1] / "results" / "movers"
TARGET = PUBLISHED.parents[2] / "outputs" / "movers"
WEIGHTS = ("indoor", "buildings", "rooms", "exp3", "exp4")
FIRST_SEED, FIRST_TUNED = 4_000_000, 5_000_000  # of the worlds, above those of all splits
TUNED, SEARCHED = 200, 60  # worlds for the rates, of which the first ones choose the settings of the clouds
SIZE_PX = 128  # of the maps for tuning
CORRIDOR, BAGS, TUNED_FILE = "corridor", "bags", "tuned.json"
OF_CORRIDOR, OF_BAGS = "rooms people", "places people"  # whose clouds follow people in the corridor and in bags


def networks_of(names: list[str], place: Place) -> dict[str, Predictor]:
    """Load the networks that can be asked in a place: of maps as large as its worlds, of a robot in the middle or not.

    Raises:
        InputError: a network takes other windows than the worlds have.
    """
    spec = place.spec
    loaded = {name.split("=")[0]: load(name.split("=")[-1]) for name in names}
    fitting = {
        name: each
        for name, each in loaded.items()
        if each.grid.size_m == spec.world.width and not (each.is_centered and not place.centered) and not each.has_fixed
    }
    for name, each in fitting.items():
        if (each.steps, each.step_s) != (spec.steps, spec.world.step_time):
            raise InputError(f"{name}: expected windows of {spec.steps} steps, got {each.steps}")
    return fitting


def obstacle_map(predictor: Predictor, scans: Scans, range_max_m: float) -> np.ndarray:
    """Return the probability of an obstacle that a user gets for a window, (H, W)."""
    return 1 - np.asarray(predictor.with_range(range_max_m).predict(scans, allow_empty=True))[0]


def measured(place: Place, networks: dict[str, Predictor], tuned: Tuned, recordings: int) -> Iterator[dict[str, Any]]:
    """Yield the rows of a place, each with the size of its map in pixels; networks of one size share the movers.

    One map has the mean log odds of the first of them and of the tracked movers.
    """
    size_m = place.spec.world.width
    grids = {each.grid.size_px: each.grid for each in networks.values()}
    found: dict[int, dict[str, list[Held]]] = {size_px: {} for size_px in grids}
    for number, scene in enumerate(scenes(place, range(FIRST_SEED, FIRST_SEED + recordings), size_m)):
        for size_px, grid in grids.items():
            asked = Asked.of(scene, grid)
            kind, group = asked.kinds, asked.groups(tuned.follower)
            maps = {
                name: obstacle_map(each, scene.window.scans, scene.range_max_m)
                for name, each in networks.items()
                if each.grid.size_px == size_px
            }
            first = next(iter(maps))
            maps |= {HITS: tuned.hits.of(np.zeros_like(kind), kind), TRACKED: tuned.tracked.of(group, kind)}
            maps[f"{first}+{TRACKED}"] = mixed(maps[first], maps[TRACKED])
            for target in asked.targets:
                constant = np.full_like(maps[HITS], tuned.constant[bin_of(target.mover.since)])
                for name, obstacle in {**maps, CONSTANT: constant}.items():
                    found[size_px].setdefault(name, []).append(held(number, target, obstacle))
    for size_px, movers in found.items():
        yield from ({"world": place.name, "size_px": size_px, **row} for row in rows(movers, (CONSTANT, HITS, TRACKED)))


def in_corridor(networks: dict[str, Predictor], tuned: Tuned, stem: Path) -> Iterator[dict[str, Any]]:
    """Draw the figure of a person in a corridor, and yield the rows of its table."""
    grid = Grid(SIZE_PX, next(iter(networks.values())).grid.size_m)

    def tracked(scans: Scans) -> np.ndarray:
        group = groups(scans, grid, tuned.follower, corridor.STEP_S, corridor.RANGE_MAX_M)
        return tuned.tracked.of(group, kinds(scans, grid, corridor.RANGE_MAX_M))

    def of_network(predictor: Predictor) -> Callable[[Scans], np.ndarray]:
        return lambda scans: obstacle_map(predictor, scans, corridor.RANGE_MAX_M)

    maps = {name: of_network(network) for name, network in networks.items()} | {TRACKED: tracked}
    grids = {name: network.grid for name, network in networks.items()} | {TRACKED: grid}
    corridor.figure(maps, grids, stem)
    yield from corridor.rows(maps, grids)


def in_bags(networks: dict[str, Predictor], tuned: Tuned, paths: list[Path]) -> Iterator[dict[str, Any]]:
    """Yield the rows of all bags, each with the size of its map in pixels."""
    for size_px in sorted({network.grid.size_px for network in networks.values()}):
        own = {name: network for name, network in networks.items() if network.grid.size_px == size_px}
        windows = [window for path in paths for window in bags.shown(path, own, tuned.follower)]
        yield from ({"size_px": size_px, **row} for row in bags.rows(windows))


def main() -> None:
    """Tune, or measure and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parts = [*(place.name for place in PLACES), CORRIDOR, BAGS]
    parser.add_argument("--tune", action="store_true")
    parser.add_argument("--weights", nargs="+", default=list(WEIGHTS))
    parser.add_argument("--only", nargs="+", choices=parts, default=parts)
    parser.add_argument("--recordings", type=positive, default=200)
    parser.add_argument("--bags", nargs="+", type=Path, default=[])
    parser.add_argument("--target", type=Path, default=TARGET)
    options = parser.parse_args()
    if options.only == [BAGS] and not options.bags:
        parser.error("--only bags: expected --bags BAG ..., got none")
    origin = environment()  # before the results change the working tree
    options.target.mkdir(parents=True, exist_ok=True)
    with one_thread():
        for place in (place for place in PLACES if place.name in options.only):
            if options.tune:
                tune_place(place, options.target)
                _record(options.target, f"tuned {place.name}", {"worlds": TUNED, **origin})
            else:
                measure_place(place, options, origin)
        networks = {} if options.tune else networks_of(options.weights, PLACES[0])
        if networks and CORRIDOR in options.only:
            stem = options.target / CORRIDOR
            _write(stem, in_corridor(networks, tuned_of(OF_CORRIDOR, options.target), stem), {**origin})
        if networks and options.bags and BAGS in options.only:
            found = in_bags(networks, tuned_of(OF_BAGS, options.target), options.bags)
            _write(options.target / BAGS, found, {"bags": [path.name for path in options.bags], **origin})


def tune_place(place: Place, target: Path) -> None:
    """Tune the maps without a network for a place, and keep those of other places."""
    path = target / TUNED_FILE
    tuned = tune(place, range(FIRST_TUNED, FIRST_TUNED + TUNED), SEARCHED, Grid(SIZE_PX, place.spec.world.width))
    others = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    write_json(path, {**others, place.name: tuned.plain()})


def tuned_of(name: str, target: Path) -> Tuned:
    """Read what was tuned in a place.

    Raises:
        InputError: nothing was.
    """
    path = target / TUNED_FILE
    if not path.is_file():
        path = PUBLISHED / TUNED_FILE
    content = json.loads(path.read_text(encoding="utf-8"))
    if name not in content:
        raise InputError(f'{path} lacks {name}: call with --tune --only "{name}" first')
    return Tuned.parse(content[name])


def measure_place(place: Place, options: argparse.Namespace, origin: dict[str, Any]) -> None:
    """Write the table of a place, if any network has maps of its size."""
    if networks := networks_of(options.weights, place):
        found = measured(place, networks, tuned_of(place.name, options.target), options.recordings)
        about = {"weights": list(networks), "recordings": options.recordings, **origin}
        _write(options.target / place.name.replace(" ", "_"), found, about)


def _write(stem: Path, found: Iterable[dict[str, Any]], about: dict[str, Any]) -> None:
    """Write a table to <stem>.csv, and its origin."""
    table, path = pd.DataFrame(found), stem.with_suffix(".csv")
    write_text(path, table.to_csv(index=False, float_format="%.4g"))
    _record(stem.parent, path.name, about)
    print(f"{path}\n{table.to_string()}", flush=True)


def _record(target: Path, name: str, about: dict[str, Any]) -> None:
    path = target / "provenance.json"
    others = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    write_json(path, {**others, name: about})


if __name__ == "__main__":
    reported(main)
