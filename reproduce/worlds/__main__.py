"""Screen families of worlds: which obstacles bring a study closest to the paper's tables?

    python -m reproduce.worlds [FAMILY ...] [--train] [--publish]

measures coverage, visibility and the SSIM of a map without obstacles at 256 px. With --train, it trains U-Net in each
family at 64 px with 1,000 pairs; cells whose worlds are those of paper.yaml are trained once, and the same call
resumes. With --publish, it writes what is there to reproduce/results/worlds. A small study is worse than a large one in
the same worlds, so the misfit is that of the paper's protocol at 256 px plus the change from paper.yaml at 64 px.
"""

import argparse
import dataclasses
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from repro.evaluation.coverage import coverage_and_visibility
from repro.evaluation.image_metrics import ssim
from repro.maps.grid import Grid
from repro.metrics.headings import METRICS
from repro.recordings.reader import open_recordings
from repro.recordings.recorded import true_maps
from repro.reporting.results import read_results
from repro.runs.directories import Run
from repro.runs.outputs import Outputs
from repro.runs.provenance import Status, environment
from repro.simulation.recorder import record_experiment
from repro.system.files import write_json, write_text
from repro.worlds.spec import world_spec
from reproduce.worlds.families import FAMILIES, MOVING, STATIC, Family, world_of
from reproduce.worlds.misfit import CELL, RESULTS, misfits, ours, published

ROOT = Path(__file__).parents[2]
OUTPUTS, TARGET = ROOT / "outputs" / "worlds", RESULTS / "worlds"
PAIRS = 80  # of the statistics, per experiment
SETTINGS = ["scale=laptop", "scale.pairs={train: 1000, val: 64, test: 300}", "runtime.precision=bf16-mixed"]
SWEEPS = {MOVING: (["exp=3,4"], ["exp=3,4", "decay=false"]), STATIC: (["exp=1,2"],)}


def statistics(name: str) -> pd.DataFrame:
    """Record test pairs of a family; return coverage, visibility and the SSIM of an empty map, a row per experiment."""
    rows, grid = [], Grid(256, 50.0)
    for experiment in FAMILIES[name].experiments:
        directory = OUTPUTS / "statistics" / name / f"exp{experiment}"
        record_experiment(directory, world_spec(world_of(FAMILIES[name]), experiment), {"test": PAIRS}, workers=1)
        recordings = open_recordings(directory)
        maps = np.concatenate([true_maps(shard, grid)[::2] for shard in recordings.shards("test")])[:, None]
        empty = ssim(np.ones(maps.shape, np.float32), maps, batch=8).mean()
        found = coverage_and_visibility(recordings, "test", grid)
        rows.append({"family": name, "experiment": experiment, **found, "empty_ssim": empty})
    return pd.DataFrame(rows)


def train(name: str, arguments: list[str]) -> None:
    """Record and train what is missing of some cells of a family."""
    worlds = OUTPUTS / "conf" / "world"
    worlds.mkdir(parents=True, exist_ok=True)
    write_text(worlds / f"{name}-family.yaml", yaml.safe_dump(world_of(FAMILIES[name])))
    call = [sys.executable, "run.py", "-m", "--config-dir", str(worlds.parent), f"world={name}-family"]
    call += [*SETTINGS, f"outputs={OUTPUTS / name}", "runtime.workers=1", "hydra/launcher=basic"]
    subprocess.run([*call, *arguments], check=True, cwd=ROOT)


def evaluated(name: str) -> list[Run]:
    """Return the evaluated runs of a family."""
    return [run for run in Outputs(OUTPUTS / name).runs() if run.status is Status.evaluated]


def trained() -> pd.DataFrame:
    """Return the metrics of U-Net in every cell that is evaluated, by family, experiment and encoding."""
    rows = [read_results(Outputs(OUTPUTS / name)).assign(family=name) for name in FAMILIES if evaluated(name)]
    rows = [table[table["model"] == "unet"] for table in rows]  # without the baselines
    return pd.concat(rows)[["family", *CELL, *METRICS]] if rows else pd.DataFrame(columns=["family", *CELL, *METRICS])


def screened(cells: pd.DataFrame) -> pd.DataFrame:
    """Return the settings of every family and its misfits at 256 px, one row each; nan where a cell is not trained.

    Args:
        cells: see `trained`.
    """
    full, tables = (
        ours("paper", "unet"),
        {str(name): part.set_index(CELL)[[*METRICS]] for name, part in cells.groupby("family")},
    )
    plain, rows = tables.get("paper", full.iloc[:0]).reindex(full.index), []
    for name, family in FAMILIES.items():
        own = tables.get(name, full.iloc[:0]).reindex(full.index)
        own = own.combine_first(plain.loc[list(set(STATIC) - set(family.experiments))])
        rows.append({"family": name, **_settings(family), **misfits(full + own - plain)})
    return pd.DataFrame(rows)


def _settings(family: Family) -> dict[str, Any]:
    return {
        name: "-".join(map(str, value)) if isinstance(value, tuple) else value for name, value in vars(family).items()
    }


def main() -> None:
    """Measure, train and publish what is asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("families", nargs="*", default=[*FAMILIES], metavar="FAMILY", help=", ".join(FAMILIES))
    parser.add_argument("--train", action="store_true")
    parser.add_argument("--publish", action="store_true")
    options = parser.parse_args()
    origin, found = environment(), []
    for name in options.families:
        found.append(statistics(name))
        print(found[-1].to_string(index=False, float_format="{:.3f}".format), flush=True)
    for experiments, sweeps in (SWEEPS if options.train else {}).items():
        for name in options.families:
            for sweep in sweeps if set(experiments) <= set(FAMILIES[name].experiments) else ():
                train(name, sweep)
    tables = {"statistics": pd.concat(found), "cells": trained(), "published": published()}
    tables["families"] = screened(tables["cells"]).dropna(subset=["moving"]) if len(tables["cells"]) else pd.DataFrame()
    print(tables["families"].to_string(float_format="{:.3f}".format), tables["published"].to_string(), sep="\n")
    if options.publish:
        TARGET.mkdir(exist_ok=True)
        runs = [run for name in FAMILIES for run in evaluated(name)]
        origins = {str(run.path.relative_to(OUTPUTS)): dataclasses.asdict(run.provenance()) for run in runs}
        write_json(TARGET / "provenance.json", {"statistics": origin, "runs": origins})
        for name, table in tables.items():
            if not table.empty:
                write_text(TARGET / f"{name}.csv", table.to_csv(index=False, float_format="%.4g"))


if __name__ == "__main__":
    main()
