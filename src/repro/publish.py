"""What the reproduction claims: results copied from an outputs directory into reproduce/results, and into README.

A published directory holds main.csv and ablation.csv, runs.csv (every run with its seed, metrics and times),
provenance.json (where every run came from), commands.md and the figures. The README's tables are generated
from it and from nothing else.
"""

import json
import re
import shutil
from pathlib import Path

import pandas as pd

from repro.report import to_markdown, write_tables
from repro.results import TRAINED, read_results
from repro.runs import read_provenance, run_directory

MARKS = re.compile(r"(<!-- results: (\w+) (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def publish(outputs: Path, results: Path) -> Path:
    """Copies what an outputs directory has measured to results/<scale>.

    Args:
        outputs: the outputs directory of one scale, named after it.
        results: reproduce/results.

    Returns:
        the published directory.

    Raises:
        ValueError: no network has been evaluated there.
    """
    runs = read_results(outputs)
    if runs.empty or not runs["model"].isin(TRAINED).any():
        raise ValueError(f"nothing to publish in {outputs}: no network has been evaluated there")
    target = results / outputs.name
    target.mkdir(parents=True, exist_ok=True)
    for name, page in write_tables(outputs).items():
        if (outputs / "tables" / f"{name}.csv").is_file():
            shutil.copyfile(outputs / "tables" / f"{name}.csv", target / f"{name}.csv")
            note = re.search(r"\*\*(.*?)\*\*", page)
            assert note
            (target / f"{name}.txt").write_text(note[1] + "\n")
    runs.to_csv(target / "runs.csv", index=False, float_format="%.6g")
    origins = {
        str(run.relative_to(outputs)): read_provenance(run)
        for run in (run_directory(outputs, r.experiment, r.model, r.decay, r.seed) for r in runs.itertuples())
    }
    (target / "provenance.json").write_text(json.dumps(origins, indent=1) + "\n")
    for figure in sorted((outputs / "figures").glob("*.png")):
        shutil.copyfile(figure, target / figure.name)
    return target


def readme_with_results(text: str, results: Path) -> str:
    """The README with the tables between its marks made anew from the published results.

    A mark is `<!-- results: laptop main -->`, closed by `<!-- end -->`.
    """

    def table(match: re.Match[str]) -> str:
        directory, name = results / match[2], match[3]
        rows = pd.read_csv(directory / f"{name}.csv", dtype={"experiment": str})
        return match[1] + to_markdown(rows, (directory / f"{name}.txt").read_text().strip()) + match[4]

    return MARKS.sub(table, text)
