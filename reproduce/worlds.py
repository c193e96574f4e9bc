"""Screen families of worlds: which obstacles bring a small study closest to the paper's tables?

    python -m reproduce.worlds [FAMILY ...]

records the worlds of each family, trains U-Net in them at 64 px, and writes reproduce/results/worlds. A family differs
from conf/world/paper.yaml in the number of obstacles at equal coverage, their shapes, the clear radius of experiments 1
and 3, or the motion of obstacles; cells whose worlds are those of paper.yaml are trained once. The same call resumes.

The misfit is the root mean square of the differences to the paper's U-Net, over the six cells and all metrics but SSIM,
each in units of the tolerance of the claims. A small study is worse than a large one in the same worlds, so the misfit
is also given with the change from paper.yaml at 64 px added to U-Net's stated protocol at 256 px.
"""

import argparse
import copy
import dataclasses
import math
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import shapely
import yaml
from irsim.lib.algorithm.generation import generate_polygon

from repro.evaluation.coverage import coverage_and_visibility
from repro.maps.grid import Grid
from repro.metrics.names import METRICS
from repro.recordings.reader import open_recordings
from repro.reporting.paper import WORLDS, read_paper
from repro.reporting.papers_claims import LEVEL
from repro.reporting.results import read_published, read_results
from repro.runs.config import PROJECTION, PROJECTION_NO_DECAY
from repro.runs.directories import Run
from repro.runs.keys import CELL
from repro.runs.outputs import Outputs
from repro.runs.provenance import Status
from repro.system.files import write_json, write_text
from repro.worlds.spec import read_world

ROOT = Path(__file__).parents[1]
OUTPUTS, RESULTS = ROOT / "outputs" / "worlds", ROOT / "reproduce" / "results"
SETTINGS = ["scale=laptop", "scale.pairs={train: 1000, val: 64, test: 300}", "runtime.precision=bf16-mixed"]
STATIC, MOVING = ("1", "2"), ("3", "4")
FITTED = [name for name in METRICS if name != "ssim"]
NUMBER = 10  # static obstacles in paper.yaml, on average; moving ones are 0.85 times as many
SHAPES = {"discs": 1.0, "rectangles": 0.0}  # share of discs
POLYGONS = 40  # different ones
SWEEPS = {MOVING: (["exp=3,4"], ["exp=3,4", "decay=false"]), STATIC: (["exp=1,2"],)}


@dataclass(frozen=True)
class Family:
    """How worlds differ from paper.yaml.

    Args:
        number: static obstacles on average; their area is that of 10 in paper.yaml.
        shape: mixed, discs, rectangles, or polygons as IR-SIM draws them at random.
        clear_m: clear radius of experiments 1 and 3 [m]; that of 2 and 4 is 8.5 m.
        speed_m_s: range of speeds of moving obstacles [m/s].
        turn_steps: range of steps between their turns.
        growth: factor of the radius of moving obstacles, for the coverage of paper.yaml at the last step.
    """

    number: int = NUMBER
    shape: str = "mixed"
    clear_m: float = 4.0
    speed_m_s: tuple[float, float] = (0.2, 0.7)
    turn_steps: tuple[int, int] = (50, 100)
    growth: float = 1.0

    @property
    def experiments(self) -> tuple[str, ...]:
        """The experiments whose worlds can differ from those of paper.yaml."""
        same = (self.number, self.shape, self.clear_m) == (NUMBER, "mixed", 4.0)
        return MOVING if same and self != Family() else STATIC + MOVING


FAMILIES = {
    "paper": Family(),
    "25": Family(25, clear_m=8.5, growth=1.015),
    "faster": Family(speed_m_s=(0.3, 1.0), growth=1.02),
    "polygons": Family(shape="polygons"),
    "turns": Family(turn_steps=(20, 60)),
    "25-faster": Family(25, clear_m=8.5, speed_m_s=(0.3, 1.0), growth=1.03),
    "discs": Family(shape="discs"),
    "rectangles": Family(shape="rectangles"),
    "20": Family(20, clear_m=8.5, growth=1.015),
    "15": Family(15, growth=1.015),
    "30": Family(30, clear_m=8.5, growth=1.02),
    "fast": Family(speed_m_s=(0.5, 1.5), growth=1.06),
}


def world_of(family: Family) -> dict[str, Any]:
    """Return the content of a file of conf/world for a family."""
    world = copy.deepcopy(read_world(WORLDS))
    shrink = math.sqrt(NUMBER / family.number)
    for experiment in STATIC + MOVING:
        own = world["experiments"][experiment]
        population, factor = own["obstacles"], shrink * (family.growth if experiment in MOVING else 1)
        population["count"] = [round(count * family.number / NUMBER) for count in population["count"]]
        population["radius_m"] = [factor * radius for radius in population["radius_m"]]
        population["disc_share"] = SHAPES.get(family.shape, population["disc_share"])
        if experiment in MOVING:
            population["behavior"] |= {"speed_m_s": [*family.speed_m_s], "turn_steps": [*family.turn_steps]}
        if family.shape == "polygons":
            own["obstacles"] = _as_polygons(population)
        if experiment in ("1", "3"):
            own["clear_radius_m"] = family.clear_m
    return world


def _as_polygons(population: dict[str, Any]) -> dict[str, Any]:
    """Return a population of polygons, with the areas that its discs would have.

    IR-SIM draws corners, irregularity and spikeyness from these ranges where a world file has `random_shape: true`.
    """
    rng, shapes, (low, high) = np.random.default_rng(0), [], population["radius_m"]
    for radius in np.linspace(low, high, POLYGONS):
        while True:
            corners, irregularity, spikeyness = int(rng.integers(4, 10)), *rng.uniform(0, 1, 2)
            vertices = np.array(generate_polygon(np.zeros(2), 1.0, irregularity, spikeyness, corners))
            outline = shapely.Polygon(vertices)
            if outline.is_valid and outline.area > 0.5:  # slivers would be many meters long
                break
        vertices *= radius * math.sqrt(math.pi / outline.area)
        shapes.append({"name": "polygon", "vertices": vertices.round(3).tolist()})
    moves = {"behavior": population["behavior"]} if "behavior" in population else {}
    return {"count": population["count"], "shapes": shapes, **moves}


def train(name: str, arguments: list[str]) -> None:
    """Record and train what is missing of some cells of a family."""
    worlds = OUTPUTS / "conf" / "world"
    worlds.mkdir(parents=True, exist_ok=True)
    write_text(worlds / f"{name}-family.yaml", yaml.safe_dump(world_of(FAMILIES[name])))
    call = [sys.executable, "run.py", "-m", "--config-dir", str(worlds.parent), f"world={name}-family"]
    call += [*SETTINGS, f"outputs={OUTPUTS / name}", "runtime.workers=1", "hydra/launcher=basic"]
    subprocess.run([*call, *arguments], check=True, cwd=ROOT)


def measured(name: str) -> pd.DataFrame:
    """Return coverage, visibility and all metrics of U-Net for each cell of a family."""
    outputs = Outputs(OUTPUTS / name)
    rows = read_results(outputs)
    for experiment in rows["experiment"].unique():
        recordings = open_recordings(outputs.recordings(experiment))
        found = coverage_and_visibility(recordings, "test", Grid(128, 50.0))
        rows.loc[rows["experiment"] == experiment, [*found]] = [*found.values()]
    return rows[[*CELL, "coverage", "visibility", *METRICS]].assign(family=name)


def misfit(rows: pd.DataFrame) -> float:
    """Return the root mean square of the differences to the paper's U-Net in units of the tolerances."""
    scale = pd.Series(LEVEL)[FITTED]
    return float(np.sqrt((((rows[FITTED] - _papers_unet().loc[rows.index, FITTED]) / scale) ** 2).to_numpy().mean()))


def _papers_unet() -> pd.DataFrame:
    return read_paper().query("model == 'unet'").set_index(["experiment", "encoding"])[[*METRICS]]


def protocol() -> pd.DataFrame:
    """Return U-Net's results of the paper's stated protocol at 256 px, published in `paper`."""
    rows = read_published(RESULTS / "paper")
    chosen = (rows["model"] == "unet") & rows["encoding"].isin([PROJECTION, PROJECTION_NO_DECAY])
    return rows[chosen].set_index(["experiment", "encoding"])[[*METRICS]].astype(float)


def summary(cells: pd.DataFrame) -> pd.DataFrame:
    """Return one row per family: its misfits in all, static and moving cells, and the paper's SSIM over its own.

    Args:
        cells: the rows of `measured`; what needs a cell that is missing is nan.
    """
    tables = {
        str(name): part.set_index(["experiment", "encoding"]) for name, part in cells.groupby("family", sort=False)
    }
    plain, full, rows = tables["paper"][[*METRICS]], protocol(), []
    for name, table in tables.items():
        same = plain if FAMILIES[name].experiments == MOVING else plain.iloc[:0]
        own = table[[*METRICS]].combine_first(same).reindex(full.index)
        row: dict[str, Any] = {"family": name, **vars(FAMILIES[name])}
        for suffix, values in (("", own), ("_at_256", full + own - plain)):
            parts = {"all": STATIC + MOVING, "static": STATIC, "moving": MOVING}
            row |= {f"misfit_{part}{suffix}": misfit(values.loc[list(of)]) for part, of in parts.items()}
            row[f"ssim_ratio{suffix}"] = (_papers_unet()["ssim"] / values["ssim"]).mean(skipna=False)
        rows.append(row)
    return pd.DataFrame(rows)


def main() -> None:
    """Train the families, print their table, and publish it if asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("families", nargs="*", default=[*FAMILIES], metavar="FAMILY", help=", ".join(FAMILIES))
    parser.add_argument("--publish", action="store_true", help="write reproduce/results/worlds, train nothing")
    options = parser.parse_args()
    for experiments, sweeps in ({} if options.publish else SWEEPS).items():
        for name in options.families:
            for sweep in sweeps if set(experiments) <= set(FAMILIES[name].experiments) else ():
                train(name, sweep)
    cells = pd.concat([measured(name) for name in FAMILIES if evaluated(name)])
    table = summary(cells)
    print(table.to_string(float_format="{:.3f}".format), flush=True)
    if options.publish:
        publish(cells, table)


def evaluated(name: str) -> list[Run]:
    """Return the evaluated runs of a family."""
    return [run for run in Outputs(OUTPUTS / name).runs() if run.status is Status.evaluated]


def publish(cells: pd.DataFrame, table: pd.DataFrame) -> None:
    """Write the cells and the summary, with the provenance of the runs."""
    target = RESULTS / "worlds"
    target.mkdir(exist_ok=True)
    write_text(target / "cells.csv", cells.to_csv(index=False, float_format="%.6g"))
    write_text(target / "families.csv", table.to_csv(index=False, float_format="%.4g"))
    runs = [run for name in FAMILIES for run in evaluated(name)]
    origins = {str(run.path.relative_to(OUTPUTS)): dataclasses.asdict(run.provenance()) for run in runs}
    write_json(target / "provenance.json", origins)


if __name__ == "__main__":
    main()
