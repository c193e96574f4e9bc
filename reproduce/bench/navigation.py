"""Benchmark episodes of task=navigate: many robots at the same time, and one after another."""

import time
from pathlib import Path

from table import head, row

from repro.maps.grid import Grid
from repro.navigation.courses import sample_course
from repro.navigation.episodes import Fleet
from repro.navigation.mappers import CLASSICAL
from repro.runs.devices import one_thread
from repro.worlds.spec import read_world, world_spec

ROOT = Path(__file__).parents[2]
COURSES, ALONE = 100, 5
SETTINGS = {"inflation_m": 1.6, "weight": 20.0, "threshold": None}
EPISODES, CORES = 500, 2  # of which a mapper shall take at most 15 minutes


def bench_navigation() -> None:
    """Print the CPU time of an episode at 64 px, driven together and alone, and that of a mapper."""
    spec = world_spec(read_world(ROOT / "conf" / "world" / "navigation.yaml"), "slow")
    courses = [sample_course(spec, seed)[0] for seed in range(COURSES)]
    mappers = {name: CLASSICAL[name] for name in ("scan", "keep", "truth", "true_velocities")}
    with one_thread():
        head("Navigation: CPU time of an episode at 64 px", "map", "together", "alone", "500 episodes on 2 cores")
        for name, mapper in mappers.items():
            batch = _seconds(spec, courses, mapper) / COURSES
            alone = sum(_seconds(spec, [course], mapper) for course in courses[:ALONE]) / ALONE
            whole = f"{batch * EPISODES / CORES / 60:.1f} min"
            row(name, f"{batch:.2f} s", f"{alone:.2f} s ({alone / batch:.1f} x)", whole)


def _seconds(spec, courses, mapper) -> float:
    start = time.process_time()
    Fleet(spec, courses, mapper, [SETTINGS] * len(courses), Grid(64, 50.0)).drive()
    return time.process_time() - start
