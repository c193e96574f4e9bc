"""The HTML report: one self-contained file with tables, claims, figures, samples and provenance."""

import base64
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined
from jinja2.utils import htmlsafe_json_dumps
from PIL import Image

from repro.baselines.names import rank
from repro.config import NO_DECAY
from repro.evaluation.samples import Sample
from repro.metrics.names import TABLE_METRICS
from repro.reporting.analysis_tables import tables_of_sections
from repro.reporting.claims import Verdict, on_paper
from repro.reporting.names import experiment_title, predictor_title
from repro.reporting.plots import DataFrames
from repro.reporting.render import interval, with_interval
from repro.reporting.results import read_frames, read_origins, read_published
from repro.reporting.tables import HEADS, Table, audits, caption, make_tables, row_title
from repro.runs.keys import CELL, RunKey
from repro.runs.provenance import Provenance

SAMPLES = re.compile(r'<script id="data" type="application/json">(.*?)</script>', re.DOTALL)
PX_PER_INCH = 110  # of the images on the page, so that their text has the size of its text
VERDICT_CLASSES = {
    Verdict.reproduced: "reproduced",
    Verdict.in_direction: "direction",
    Verdict.undecided: "undecided",
    Verdict.not_reproduced: "not",
    Verdict.fails_in_paper: "fails",
    Verdict.untested: "cannot",
}


@dataclass(frozen=True)
class Report:
    """The content of the HTML report of an outputs directory.

    Args:
        outputs: path of the outputs directory.
        results: tidy rows of its runs, see `results.read_results`.
        frames: the frames of `evaluation.analysis.gather`, `claims`, and `audit`.
        figures: PNG files by name.
        samples: see `samples_json`; empty without samples.
        origins: provenance of each run by its path.
    """

    outputs: Path
    results: pd.DataFrame
    frames: DataFrames
    figures: dict[str, Path]
    samples: str
    origins: dict[str, Provenance]


def render(report: Report) -> str:
    """Return the report as one string of HTML; worlds that are not the paper's have no claims."""
    claims, intervals = report.frames["claims"], report.frames["intervals"]
    scale = str(report.results["scale"].iloc[0])
    elsewhere = "" if report.outputs == Path("outputs", scale) else f" outputs={report.outputs}"
    has_claims = not claims.empty
    navigation = [("summary", "Summary"), ("tables", "Tables")]
    navigation += [("claims", "Claims of the paper")] if has_claims else []
    navigation += [("samples", "Test recordings")] if report.samples else []
    audit = report.frames["audit"].query("model == 'average'")
    of_cells = intervals.set_index([*CELL, "metric"])
    counted = Counter(claims["verdict"])
    environment = Environment(loader=PackageLoader("repro.reporting"), autoescape=True, undefined=StrictUndefined)
    return environment.get_template("report.html").render(
        title="Predicting dynamic map states from limited field-of-view sensor data"
        + (", reproduced" if has_claims else ""),
        scale=scale,
        outputs=report.outputs.name,
        has_claims=has_claims,
        command=f"python run.py task=analysis scale={scale}{elsewhere}",
        caption=caption(report.results),
        sections=navigation,
        verdicts=[{"name": str(v), "count": counted[v], "look": look} for v, look in VERDICT_CLASSES.items()],
        all_free=_all_free(intervals),
        seeds=int(intervals["seeds"].max()),
        heads=list(HEADS.values()),
        tables=[_table(table, of_cells) for table in make_tables(report.results).values() if len(table.frame)],
        audit=audit.assign(decay=~audit["encoding"].str.endswith(NO_DECAY)).to_dict("records"),
        claims=[_claim(row) for row in claims.to_dict("records")],
        browser=report.samples,
        figures=report.figures,
        embedded=_embedded,
        tables_of=tables_of_sections(report.frames, report.origins),
    )


def _embedded(path: Path) -> dict[str, Any]:
    """Return a PNG file for the page: its width on the page [px], and its data in base 64."""
    with Image.open(path) as image:
        inches = image.width / image.info["dpi"][0]
    return {"width": round(PX_PER_INCH * inches), "data": base64.b64encode(path.read_bytes()).decode()}


def _table(table: Table, intervals: pd.DataFrame) -> dict[str, Any]:
    """Return the rows of a table; each cell has our value, its interval, the paper's value and a tint.

    An interval of other seeds than those of the row is left out.
    """
    rows: list[dict[str, Any]] = []
    for _, row in table.frame.iterrows():
        cells = []
        for metric in TABLE_METRICS:
            cell = {"value": f"{row[metric]:.3f}", "interval": "", "paper": "", "tint": 0, "side": "above"}
            key = (*row[CELL], metric)
            if key in intervals.index and intervals.loc[key, "seeds"] == row["seeds"]:
                cell["interval"] = interval(*intervals.loc[key, ["low", "high"]])
            delta = row[f"delta_{metric}"]
            if pd.notna(delta):
                cell |= {"paper": f"{row[f'paper_{metric}']:.3f}", "side": "above" if delta > 0 else "below"}
                cell["tint"] = round(min(abs(delta) / 0.1, 1) * 0.45, 3)
            cells.append(cell)
        experiment, strong = row["experiment"], "strong" if row["model"] == "average" else ""
        look = "first" if rows and rows[-1]["experiment"] != experiment else strong
        rows.append({"experiment": experiment, "model": row_title(row), "look": look, "cells": cells})
    return {"caption": table.caption, "has_paper": table.has_paper, "rows": rows}


def _all_free(intervals: pd.DataFrame) -> str:
    """Return a sentence with the scores of the all-free baseline, empty if it is not evaluated."""
    rows = intervals[intervals["model"] == "all_free"]
    if rows.empty:
        return ""
    low, high = (rows.groupby("metric")["value"].agg(each) for each in ("min", "max"))
    scored = [
        f"{name} {low[key]:.3f} to {high[key]:.3f}" for key, name in {"accuracy": "accuracy", "dice": "Dice"}.items()
    ]
    return f"A prediction of free space everywhere has {' and '.join(scored)}."


def _claim(row: Mapping[Any, Any]) -> dict[str, Any]:
    """Return a claim: quote, verdict, CSS class of the verdict, and its details as pairs of name and text."""
    facts = [("Section", row["place"]), ("Test", row["means"])]
    if pd.notna(row["value"]):
        ours = with_interval(row["value"], row["low"], row["high"], ".4g")
        bound = f"required {row['claimed']:.4g}, tolerance {row['tolerance']:.4g}"
        held = f"in {row['held']:.0f} of {row['combinations']:.0f} combinations; on our numbers alone: {row['ours']}"
        at_others = f"half the tolerance: {row['at_half']}, double: {row['at_double']}"
        facts.append(("Ours", f"{ours} in the decisive combination; {bound}"))
        facts += [("Holds", held), ("Tolerance", f"{row['tolerance_from']}; {at_others}")]
    else:
        unmeasured = "a number that the test needs is not measured at this scale"
        facts.append(("Not tested", row["reason"] if pd.notna(row["reason"]) else unmeasured))
    if paper := on_paper(row, ".4g"):
        facts.append(("The paper's tables", paper))
    look = VERDICT_CLASSES[row["verdict"]]
    return {"quote": row["quote"], "verdict": str(row["verdict"]), "look": look, "facts": facts}


def samples_json(samples: dict[str, list[Sample]]) -> str:
    """Return samples as JSON for a script element, with `</` escaped so that it cannot close the element.

    Args:
        samples: see `evaluation.samples.load_samples`, by experiment.
    """
    experiments = [
        {
            "name": experiment_title(experiment, ": {}"),
            "samples": [
                {
                    "name": f"test recording {sample['index']}",
                    "truth": sample["truth"],
                    "inputs": sample["inputs"],
                    "predictions": _predictions(sample),
                }
                for sample in recordings
            ],
        }
        for experiment, recordings in samples.items()
    ]
    return htmlsafe_json_dumps({"experiments": experiments}) if experiments else ""


def _predictions(sample: Sample) -> dict[str, dict[str, str]]:
    """Return name, input and image of each prediction by the path of its run, in the order of the tables."""
    keys = {path: RunKey.parse(path) for path in sample["predictions"]}
    return {
        path: {
            "name": predictor_title(key.model, key.encoding),
            "input": key.encoding if key.encoding in sample["inputs"] else next(iter(sample["inputs"])),
            "image": sample["predictions"][path],
        }
        for path, key in sorted(keys.items(), key=lambda item: (rank(item[1].model), item[0]))
    }


def render_published(directory: Path) -> str:
    """Return the report of a published directory that has one; the samples stay those of the present report.

    Raises:
        ValueError: a table or the provenance cannot be read.
    """
    results = read_published(directory)
    samples = SAMPLES.search((directory / "report.html").read_text(encoding="utf-8"))
    report = Report(
        outputs=Path("outputs", directory.name),
        results=results,
        frames={**read_frames(directory), "audit": audits(results)},
        figures={path.stem: path for folder in (directory, directory / "analysis") for path in folder.glob("*.png")},
        samples=samples[1] if samples else "",
        origins=read_origins(directory),
    )
    return render(report)
