"""Screen families of worlds: which obstacles bring a study closest to the paper's tables?

    python -m reproduce.worlds [FAMILY ...] [--train] [--scale SCALE] [--publish]

measures coverage, visibility and the SSIM of a map without obstacles at 256 px. With --train, it trains U-Net in each
family: at scale screen, 64 px and 1,000 pairs, or beside the published study at 128 or 256 px. The same call resumes.
A family is left as soon as its misfit cannot be half of the study's any more. With --publish, it writes what is there
to reproduce/results/worlds. A small study is worse than a large one in the same worlds, so the misfit is that of the
paper's protocol at 256 px plus the change from paper.yaml at the same scale.
"""

import argparse
import dataclasses
import json
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
from repro.reporting.results import read_results, read_rows
from repro.runs.directories import Run
from repro.runs.outputs import Outputs
from repro.runs.provenance import Status, environment
from repro.simulation.recorder import record_experiment
from repro.system.files import write_json, write_text
from repro.worlds.spec import world_spec
from reproduce.worlds.families import FAMILIES, MOVING, STATIC, Family, source, world_of
from reproduce.worlds.misfit import CELL, RESULTS, misfits, ours, papers, published

ROOT = Path(__file__).parents[2]
OUTPUTS, TARGET = ROOT / "outputs" / "worlds", RESULTS / "worlds"
PAIRS = 80  # of the statistics, per experiment
SCREEN = "screen"
SETTINGS = {
    SCREEN: ["scale=laptop", "scale.pairs={train: 1000, val: 64, test: 300}", "runtime.precision=bf16-mixed"],
    "workstation": ["scale=workstation"],  # these are published in the worlds of paper.yaml
    "workstation256": ["scale=workstation256"],
}
# experiment and decay, those first that have ruled out most families
CELLS = (("4", "true"), ("3", "false"), ("4", "false"), ("3", "true"), ("1", "true"), ("2", "true"))


def statistics(name: str) -> pd.DataFrame:
    """Record test pairs of a family; return coverage, visibility and the SSIM of an empty map, a row per experiment."""
    rows, grid = [], Grid(256, 50.0)
    for experiment in (number for number in STATIC + MOVING if source(name, number) == name):
        directory = OUTPUTS / "statistics" / name / f"exp{experiment}"
        record_experiment(directory, world_spec(world_of(FAMILIES[name]), experiment), {"test": PAIRS}, workers=1)
        recordings = open_recordings(directory)
        maps = np.concatenate([true_maps(shard, grid)[::2] for shard in recordings.shards("test")])[:, None]
        empty = ssim(np.ones(maps.shape, np.float32), maps, batch=8).mean()
        found = coverage_and_visibility(recordings, "test", grid)
        rows.append({"family": name, "experiment": experiment, **found, "empty_ssim": empty})
    return pd.DataFrame(rows)


def train(name: str, scale: str, experiment: str, decay: str) -> None:
    """Record and train what is missing of a cell of a family."""
    worlds = OUTPUTS / "conf" / "world"
    worlds.mkdir(parents=True, exist_ok=True)
    write_text(worlds / f"{name}-family.yaml", yaml.safe_dump(world_of(FAMILIES[name])))
    call = [sys.executable, "run.py", "--config-dir", str(worlds.parent.relative_to(ROOT)), f"world={name}-family"]
    call += [*SETTINGS[scale], f"outputs={(OUTPUTS / scale / name).relative_to(ROOT)}", "runtime.workers=1"]
    subprocess.run([*call, f"exp={experiment}", f"decay={decay}"], check=True, cwd=ROOT)


def train_missing(name: str, scale: str) -> None:
    """Train a family cell by cell until its misfit is known, or known to exceed half of the study's."""
    for experiment, decay in CELLS:
        if hopeless(screened(trained(scale))).get(name):
            return
        train(source(name, experiment), scale, experiment, decay)


def evaluated(name: str, scale: str) -> list[Run]:
    """Return the evaluated networks of a family."""
    runs = Outputs(OUTPUTS / scale / name).runs()
    return [run for run in runs if run.status is Status.evaluated and "runs" in run.path.parts]


def trained(scale: str) -> pd.DataFrame:
    """Return the metrics of U-Net in every cell that is evaluated, by family, experiment and encoding."""
    names = [name for name in FAMILIES if evaluated(name, scale)]
    rows = [read_results(Outputs(OUTPUTS / scale / name)).assign(family=name) for name in names]
    if scale != SCREEN and names:
        rows.append(ours(scale, "unet").reset_index().assign(family="paper", model="unet"))
    rows = [table[table["model"] == "unet"] for table in rows]  # without the baselines
    return pd.concat(rows)[["family", *CELL, *METRICS]] if rows else pd.DataFrame(columns=["family", *CELL, *METRICS])


def estimates(cells: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return for each family what U-Net would have by the paper's protocol at 256 px, by experiment and encoding.

    Args:
        cells: see `trained`.

    Returns:
        the published rows of paper.yaml plus the change from it in `cells`; nan where a cell is not trained.
    """
    full, found = ours("paper", "unet"), cells.set_index(["family", *CELL])[[*METRICS]]
    own = {
        name: found.reindex([(source(name, cell[0]), *cell) for cell in full.index]).set_axis(full.index)
        for name in FAMILIES
    }
    return {name: full + own[name] - own["paper"] for name in FAMILIES}


def beside_target(cells: pd.DataFrame) -> pd.DataFrame:
    """Return the paper's rows, family `target`, and those of `estimates` of the families with cells of their own."""
    own = {name: rows.dropna() for name, rows in estimates(cells).items() if name in set(cells["family"])}
    return pd.concat({"target": papers("unet"), **own}, names=["family"]).reset_index()


def screened(cells: pd.DataFrame) -> pd.DataFrame:
    """Return the settings of every family, the number of its known cells, and its misfits at 256 px, one row each."""
    rows = []
    for name, own in estimates(cells).items():
        count = int(own["ssim"].notna().sum())
        rows.append({"family": name, **_settings(FAMILIES[name]), "cells": count, **misfits(own)})
    return pd.DataFrame(rows)


def hopeless(families: pd.DataFrame) -> pd.Series:
    """Return for each family, see `screened`, whether the cells that are known rule out half of the study's misfit."""
    least = families.set_index("family")["least"]
    return (least > least["paper"] / 2) & (least.index != "paper")


def known(cells: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of `screened` of the families that have cells of their own or are hopeless without."""
    families = screened(cells)
    return families[families["family"].isin(cells["family"]) | hopeless(families).to_numpy()]


def _settings(family: Family) -> dict[str, Any]:
    return {
        name: "-".join(map(str, value)) if isinstance(value, tuple) else value for name, value in vars(family).items()
    }


def main() -> None:
    """Measure, train and publish what is asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("families", nargs="*", default=[*FAMILIES], metavar="FAMILY", help=", ".join(FAMILIES))
    parser.add_argument("--train", action="store_true")
    parser.add_argument("--scale", choices=[*SETTINGS], default=SCREEN)
    parser.add_argument("--publish", action="store_true")
    options = parser.parse_args()
    origins = {name: environment() for name in options.families}
    found = pd.concat([statistics(name) for name in options.families])
    print(found.to_string(index=False, float_format="{:.3f}".format), flush=True)
    for name in options.families if options.train else ():
        train_missing(name, options.scale)
    cells = {scale: rows for scale in SETTINGS if len(rows := trained(scale))}
    tables = {"statistics": found, "published": published()}
    for name, made in (("cells", pd.DataFrame), ("estimates", beside_target), ("families", known)):
        tables[name] = pd.concat([made(rows).assign(scale=scale) for scale, rows in cells.items()])
    print(tables["families"].to_string(float_format="{:.3f}".format), tables["published"].to_string(), sep="\n")
    if options.publish:
        publish(tables, origins)


def publish(tables: dict[str, pd.DataFrame], origins: dict[str, dict[str, Any]]) -> None:
    """Write tables and the origins of their statistics; the stored statistics of other families stay."""
    before = read_rows(TARGET / "statistics.csv")
    rows = pd.concat([before[~before["family"].isin(origins)], tables["statistics"]])
    rows = rows.sort_values("family", key=lambda names: names.map([*FAMILIES].index), kind="stable")
    origins = json.loads((TARGET / "provenance.json").read_text())["statistics"] | origins
    runs = [run for scale in SETTINGS for name in FAMILIES for run in evaluated(name, scale)]
    trainings = {str(run.path.relative_to(OUTPUTS)): dataclasses.asdict(run.provenance()) for run in runs}
    write_json(TARGET / "provenance.json", {"statistics": origins, "runs": trainings})
    for name, table in (tables | {"statistics": rows}).items():
        write_text(TARGET / f"{name}.csv", table.round(6).to_csv(index=False))


if __name__ == "__main__":
    main()
