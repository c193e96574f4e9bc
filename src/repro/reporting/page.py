"""The HTML report: one self-contained file with tables, claims and figures.

    python -m repro.reporting.page reproduce/results/workstation workstation.html

writes that of a published directory.
"""

import base64
import sys
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined
from PIL import Image

from repro.reporting.answer import answer, decay_table
from repro.reporting.claims import count_verdicts
from repro.reporting.documents import CLAIMS_NOTE, analyzed, claims
from repro.reporting.plots import DataFrames
from repro.reporting.render import Cells
from repro.reporting.results import read_frames, read_published
from repro.reporting.tables import caption, make_tables
from repro.system.errors import InputError
from repro.system.files import write_text

PX_PER_INCH = 110  # of the images on the page, so that their text has the size of its text


def render(outputs: Path, results: pd.DataFrame, frames: DataFrames, figures: dict[str, Path]) -> str:
    """Return the report of an outputs directory as one string of HTML; worlds that are not the paper's have no claims.

    Args:
        outputs: path of the outputs directory.
        results: tidy rows of its runs, see `results.read_results`.
        frames: the frames of `evaluation.frames.gather`, and `claims`.
        figures: PNG files by name.
    """
    environment = Environment(loader=PackageLoader("repro.reporting"), autoescape=True, undefined=StrictUndefined)
    return environment.get_template("report.html").render(
        scale=str(results["scale"].iloc[0]),
        outputs=outputs,
        caption=caption(results),
        answer=answer(results),
        all_free=_all_free(frames["intervals"]),
        verdicts=count_verdicts(frames["claims"]),
        claims_note=CLAIMS_NOTE,
        figures=figures,
        tables_of=tables_of_sections(results, frames),
        embedded=_embedded,
    )


def images_of(*directories: Path) -> dict[str, Path]:
    """Return the images in some directories by name."""
    return {path.stem: path for folder in directories for path in folder.glob("*.png")}


def tables_of_sections(results: pd.DataFrame, frames: DataFrames) -> dict[str, list[Cells]]:
    """Return the tables of each section of the page, by its id; some may have no rows."""
    return {
        "tables": [table.cells for table in make_tables(results).values() if len(table.frame)] + [decay_table(results)],
        "claims": [claims(frames)],
        "baselines": [analyzed("methods", frames)],
    }


def _embedded(path: Path) -> dict[str, Any]:
    """Return a PNG file for the page: its width on the page [px], and its data in base 64 as a URL."""
    with Image.open(path) as image:
        inches = image.width / image.info.get("dpi", (PX_PER_INCH, PX_PER_INCH))[0]
    data = base64.b64encode(path.read_bytes()).decode()
    return {"width": round(PX_PER_INCH * inches), "url": f"data:image/png;base64,{data}"}


def _all_free(intervals: pd.DataFrame) -> str:
    """Return a sentence with the scores of the all-free baseline, empty if it is not evaluated."""
    found = intervals[intervals["model"] == "all_free"].groupby("metric")["value"].agg(["min", "max"])
    if found.empty:
        return ""
    accuracy, dice = ("{:.3f} to {:.3f}".format(*found.loc[metric]) for metric in ("accuracy", "dice"))
    return f"A prediction of free space everywhere has accuracy {accuracy} and Dice {dice}."


def render_published(directory: Path) -> str:
    """Return the report of a published directory.

    Raises:
        InputError: it has no analysis, or a table cannot be read.
    """
    frames = read_frames(directory)
    if missing := sorted({"claims", "intervals"} - set(frames)):
        raise InputError(f"{directory} has no {' and no '.join(missing)}.csv in analysis/, which the page shows")
    figures = images_of(directory, directory / "analysis")
    return render(Path("outputs", directory.name), read_published(directory), frames, figures)


def main(arguments: list[str]) -> None:
    """Write the report of a published directory."""
    if len(arguments) != 2:
        sys.exit("expected a published directory and the file to write: reproduce/results/workstation workstation.html")
    try:
        write_text(Path(arguments[1]), render_published(Path(arguments[0])))
    except InputError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main(sys.argv[1:])
