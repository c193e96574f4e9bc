"""The analysis of an outputs directory: baselines, intervals, recency, calibration, verdicts on claims, the page."""

import itertools
from pathlib import Path

import joblib
import pandas as pd

from repro.baselines.registry import PREDICTORS, applies
from repro.evaluation.frames import ANALYZED, gather
from repro.evaluation.scoring import evaluate_baseline
from repro.recordings.reader import open_recordings
from repro.reporting.analysis_figures import write_analysis_figures
from repro.reporting.answer import effects_line
from repro.reporting.claims import count_verdicts
from repro.reporting.page import images_of, render
from repro.reporting.papers_claims import verdicts
from repro.reporting.results import keys_of, read_results
from repro.reporting.tables import write_tables
from repro.runs.outputs import Outputs
from repro.system.errors import InputError
from repro.system.files import write_text


def evaluate_baselines(outputs: Outputs, parallel: joblib.Parallel) -> None:
    """Evaluate all baselines beside the networks, the slowest first; those that are done are checked.

    Args:
        parallel: processes that tune baselines.

    Raises:
        InputError: no network has been evaluated, or a run is damaged.
    """
    keys = [key for key in keys_of(read_results(outputs)) if not key.is_baseline]
    if not keys:
        raise InputError(f"no network has been evaluated in {outputs.path}: train some first")
    configs = {key.experiment: outputs.run(key).config() for key in keys}
    specs = {experiment: open_recordings(outputs.recordings(experiment)).spec for experiment in sorted(configs)}
    jobs = []
    for name, (experiment, spec) in itertools.product(reversed(PREDICTORS), specs.items()):
        if not applies(name, spec):
            continue
        config = configs[experiment]
        if outputs.run(config.of_baseline(name).key).is_evaluated:
            evaluate_baseline(outputs, config, name)
        else:
            jobs.append(joblib.delayed(evaluate_baseline)(outputs, config, name))
    parallel(jobs)


def analyze(outputs: Outputs, parallel: joblib.Parallel) -> None:
    """Analyze all runs, each experiment in one process, and write analysis/ and report.html.

    Raises:
        InputError: a run is damaged.
    """
    results = read_results(outputs)
    print(f"analyzing {len(results)} runs", flush=True)
    frames = gather(outputs, parallel)
    frames["claims"] = verdicts(frames, results)
    _write_frames(outputs.analysis, frames)
    if not frames["claims"].empty:  # empty without a run in the paper's worlds
        print(f"claims of the paper: {count_verdicts(frames['claims'])}")
    _write_page(outputs, frames, results)


def _write_frames(directory: Path, frames: dict[str, pd.DataFrame]) -> None:
    """Write the tables and figures of the analysis, and delete those of an earlier one that have no rows now."""
    directory.mkdir(parents=True, exist_ok=True)
    for name in set(ANALYZED) - set(frames):
        (directory / f"{name}.csv").unlink(missing_ok=True)
    for name, frame in frames.items():
        write_text(directory / f"{name}.csv", frame.to_csv(index=False, float_format="%.6g"))
    write_analysis_figures(directory, frames)


def _write_page(outputs: Outputs, frames: dict[str, pd.DataFrame], results: pd.DataFrame) -> None:
    write_tables(outputs.tables, results)
    page = render(outputs.path, results, frames, images_of(outputs.figures, outputs.analysis))
    write_text(outputs.path / "report.html", page)
    found = effects_line(results) or "no two runs show an effect of motion or of the decay"
    print(f"{found}; {outputs.path / 'report.html'} has all tables and figures", flush=True)
