"""The analysis of an outputs directory: baselines, intervals, recency, calibration, verdicts on claims, the page."""

import itertools
import sys
from contextlib import suppress
from pathlib import Path

import pandas as pd

from repro.baselines.registry import PREDICTORS, applies
from repro.evaluation.analysis import ANALYZED, gather
from repro.evaluation.evaluate import evaluate_baseline
from repro.recordings.reader import read_manifest
from repro.reporting.analysis_figures import write_analysis_figures
from repro.reporting.claims import count_verdicts
from repro.reporting.page import Report, render
from repro.reporting.papers_claims import verdicts
from repro.reporting.results import keys_of, read_results
from repro.reporting.tables import audits, write_tables
from repro.runs.outputs import Outputs
from repro.system.errors import InputError
from repro.system.files import write_text


def analyze(outputs: Outputs) -> None:
    """Evaluate the baselines, analyze all runs, write analysis/ and report.html.

    Raises:
        ValueError: no network has been evaluated, or some runs are damaged; everything else is written.
    """
    damaged: list[str] = []
    errors: list[str] = []
    results = read_results(outputs, damaged)
    if results.empty or not (results["encoding"] != "").any():
        reason = f" ({damaged[0]})" if damaged else ""
        raise InputError(f"no network has been evaluated in {outputs.path}{reason}: train some first")
    networks = [outputs.run(key).config() for key in keys_of(results) if not key.is_baseline]
    configs = {config.experiment: config for config in networks}
    for experiment, name in itertools.product(sorted(configs), PREDICTORS):
        if not _applies(name, outputs, experiment):
            continue
        try:
            evaluate_baseline(outputs, configs[experiment], name)
        except InputError as error:
            errors.append(str(error))
    results = read_results(outputs, errors)
    print(f"analyzing {len(results)} runs", flush=True)
    frames = gather(outputs, errors)
    frames["audit"] = audits(results)
    frames["claims"] = verdicts(frames, results)
    _write_frames(outputs.analysis, frames)
    if not frames["claims"].empty:  # empty without a run in the paper's worlds
        print(f"claims of the paper: {count_verdicts(frames['claims'])}")
    _write_page(outputs, frames, results)
    left_out = dict.fromkeys(errors)
    for message in left_out:
        print(f"error: left out of the analysis: {message}", file=sys.stderr)
    if left_out:
        raise InputError(f"{len(left_out)} runs are left out of the analysis, see above")


def _write_frames(directory: Path, frames: dict[str, pd.DataFrame]) -> None:
    """Write the tables and figures of the analysis, and delete those of an earlier one that have no rows now."""
    directory.mkdir(parents=True, exist_ok=True)
    for name in set(ANALYZED) - set(frames):
        (directory / f"{name}.csv").unlink(missing_ok=True)
    for name, frame in frames.items():
        write_text(directory / f"{name}.csv", frame.to_csv(index=False, float_format="%.6g"))
    write_analysis_figures(directory, frames)


def _applies(name: str, outputs: Outputs, experiment: str) -> bool:
    """Return whether a baseline applies to the worlds of an experiment; true without readable recordings."""
    with suppress(InputError):
        return applies(name, read_manifest(outputs.recordings(experiment)).world_spec)
    return True


def _write_page(outputs: Outputs, frames: dict[str, pd.DataFrame], results: pd.DataFrame) -> None:
    write_tables(outputs.tables, results)
    report = Report(
        outputs=outputs.path,
        results=results,
        frames=frames,
        figures={path.stem: path for folder in (outputs.figures, outputs.analysis) for path in folder.glob("*.png")},
        origins={str(key.path): outputs.run(key).provenance() for key in keys_of(results)},
    )
    write_text(outputs.path / "report.html", render(report))
    print(f"Page: {outputs.path / 'report.html'}", flush=True)
