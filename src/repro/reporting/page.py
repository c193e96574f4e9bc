"""The page: one HTML file with tables, claims, figures, samples and provenance, that needs nothing but a browser."""

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined

from repro.baselines.names import rank
from repro.evaluation.samples import Sample
from repro.metrics.names import TABLE_METRICS
from repro.reporting.claims import Verdict
from repro.reporting.names import experiment_title, predictor_title
from repro.reporting.sections import sections
from repro.reporting.tables import HEADS, Table, row_title
from repro.runs.keys import CELL, RunKey
from repro.runs.provenance import Provenance

Frames = dict[str, pd.DataFrame]
LOOKS = {
    Verdict.reproduced: "reproduced",
    Verdict.in_direction: "direction",
    Verdict.not_reproduced: "not",
    Verdict.contradicts: "contradicts",
    Verdict.untested: "cannot",
}


@dataclass(frozen=True)
class Report:
    """All that the page shows of an outputs directory.

    Args:
        scale: its name.
        outputs: the name of the directory.
        command: what makes the page.
        caption: scale, resolution, pairs, epochs, seeds.
        tables: the main table and the ablation.
        frames: see `evaluation.analysis.gather`, and `audit`.
        claims: see `claims.judge`.
        figures: PNG files, by name.
        samples: of each experiment, see `evaluation.samples.load_samples`.
        origins: where each run came from, by its place.
    """

    scale: str
    outputs: str
    command: str
    caption: str
    tables: dict[str, Table]
    frames: Frames
    claims: pd.DataFrame
    figures: dict[str, Path]
    samples: dict[str, list[Sample]]
    origins: dict[str, Provenance]


def render(report: Report) -> str:
    """Writes the page as one string of HTML."""
    environment = Environment(loader=PackageLoader("repro.reporting"), autoescape=True, undefined=StrictUndefined)
    parts = sections(report.frames, report.figures, report.origins)
    places = [("summary", "In short"), ("tables", "Tables"), ("claims", "Claims")]
    places += [("samples", "Samples")] if report.samples else []
    intervals = report.frames["intervals"].set_index([*CELL, "metric"])
    counted = Counter(report.claims["verdict"])
    return environment.get_template("report.html").render(
        scale=report.scale,
        outputs=report.outputs,
        is_smoke=report.scale == "smoke",
        command=report.command,
        caption=report.caption,
        sections=places + [(part["id"], part["nav"]) for part in parts],
        verdicts=[{"name": str(v), "count": counted[v], "look": look} for v, look in LOOKS.items()],
        all_free=_all_free(report.frames["intervals"]),
        seeds=int(report.frames["intervals"]["seeds"].max()),
        heads=list(HEADS.values()),
        tables=[_table(table, intervals) for table in report.tables.values() if len(table.frame)],
        audit=report.frames["audit"].query("model == 'average'").to_dict("records"),
        claims=[_claim(row) for row in report.claims.to_dict("records")],
        browser=_browser(report.samples),
        parts=parts,
    )


def _table(table: Table, intervals: pd.DataFrame) -> dict[str, Any]:
    """One row a network: our number, its interval, the difference to the paper, and how strongly to colour it."""
    rows = []
    for _, row in table.frame.iterrows():
        cells = []
        for metric in TABLE_METRICS:
            cell = {"value": f"{row[metric]:.3f}", "interval": "", "delta": "", "tint": 0, "side": "above"}
            place = (*row[CELL], metric)
            if place in intervals.index:
                low, high = intervals.loc[place, ["low", "high"]]
                cell["interval"] = f"[{low:.3f}, {high:.3f}]"
            delta = row[f"delta_{metric}"]
            if pd.notna(delta):
                cell |= {"delta": f"{100 * delta:+z.1f}", "side": "above" if delta > 0 else "below"}
                cell["tint"] = round(min(abs(delta) / 0.1, 1) * 0.45, 3)
            cells.append(cell)
        title, is_average = row_title(row), row["model"] == "average"
        rows.append({"experiment": row["experiment"], "model": title, "strong": is_average, "cells": cells})
    return {"caption": table.caption, "rows": rows}


def _all_free(intervals: pd.DataFrame) -> str:
    """Says what calling everything free scores."""
    rows = intervals[intervals["model"] == "all_free"]
    if rows.empty:
        return ""
    low, high = (rows.groupby("metric")["value"].agg(each) for each in ("min", "max"))
    scored = [
        f"{name} {low[key]:.3f} to {high[key]:.3f}" for key, name in {"accuracy": "accuracy", "dice": "Dice"}.items()
    ]
    return f"Calling everything free scores {' and '.join(scored)}."


def _claim(row: Mapping[Any, Any]) -> dict[str, Any]:
    """One claim: its verdict, its words, and the facts behind it as pairs of name and text."""
    facts = [("Where", row["place"]), ("Tested as", row["means"])]
    if pd.notna(row.get("reason")):
        facts.append(("Not tested", row["reason"]))
    if pd.notna(row.get("value")):
        bound = f"{row['claimed']:.4g} needed, tolerance {row['tolerance']:.4g}"
        facts += [
            (
                "Ours",
                f"{row['value']:.4g} [{row['low']:.4g}, {row['high']:.4g}] where it is nearest to failing; {bound}",
            ),
            (
                "Holds",
                f"in {row['held']:.0f} of {row['combinations']:.0f} combinations; on our numbers alone: {row['ours']}",
            ),
            ("Tolerance", f"{row['tolerance_from']}; at half of it {row['at_half']}, at double {row['at_double']}"),
        ]
    elif pd.isna(row.get("reason")):
        facts.append(("Not tested", "a number that the test needs has not been measured here"))
    if row.get("paper") in ("holds", "fails"):
        facts.append(("The paper's tables", f"{row['paper']}, {row['paper_value']:.4g}"))
    return {"quote": row["quote"], "verdict": str(row["verdict"]), "look": LOOKS[row["verdict"]], "facts": facts}


def _browser(samples: dict[str, list[Sample]]) -> str:
    """Makes the samples' JSON; it stands in a script element, so nothing in it may close one."""
    experiments = []
    for experiment, found in samples.items():
        shown = [
            {
                "name": f"test recording {sample['index']}",
                "truth": sample["truth"],
                "inputs": sample["inputs"],
                "predictions": {
                    place: {"name": _run_name(place), "input": _input_of(place, sample["inputs"]), "image": image}
                    for place, image in sorted(sample["predictions"].items(), key=_rank)
                },
            }
            for sample in found
        ]
        experiments.append({"name": experiment_title(experiment, ": {}"), "samples": shown})
    return json.dumps({"experiments": experiments}).replace("</", "<\\/") if experiments else ""


def _rank(item: tuple[str, str]) -> tuple[int, str]:
    """Return the position of a run, given by its path, in the order of the tables."""
    return rank(RunKey.parse(item[0]).model), item[0]


def _run_name(path: str) -> str:
    key = RunKey.parse(path)
    return predictor_title(key.model, key.encoding) + (f", seed {key.seed}" if key.seed else "")


def _input_of(path: str, inputs: dict[str, str]) -> str:
    encoding = RunKey.parse(path).encoding
    return encoding if encoding in inputs else next(iter(inputs))
