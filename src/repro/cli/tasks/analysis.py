"""task=analysis: intervals, recency, calibration, baselines, the verdicts on the paper's claims, and the page."""

import itertools

import pandas as pd

from repro.baselines.names import BASELINES
from repro.cli.jobs import ROOT, Job
from repro.cli.tasks.curves import curves_directory
from repro.evaluation.analysis import gather
from repro.evaluation.evaluate import evaluate_baseline
from repro.evaluation.samples import load_samples
from repro.reporting.analysis_figures import write_analysis_figures
from repro.reporting.claims import judge, read_claims
from repro.reporting.numbers import analysis_rows
from repro.reporting.page import Report, render
from repro.reporting.results import audits, caption, read_results
from repro.reporting.rows import read_rows
from repro.reporting.tables import write_tables
from repro.reporting.uptodate import inputs_hash, is_up_to_date, mark_up_to_date
from repro.runs.directories import Outputs
from repro.system.files import write_text

CLAIMS = ROOT / "reproduce" / "claims.yaml"


def run(job: Job) -> None:
    """Evaluate the baselines, analyze all runs, write analysis/ and report.html.

    Raises:
        ValueError: no network has been evaluated, or a run cannot be trusted.
    """
    outputs = job.outputs
    results = read_results(outputs)
    if results.empty or not (results["encoding"] != "").any():
        raise ValueError(f"no network has been evaluated in {outputs.path}: train some first")
    configs = {run.config().experiment: run.config() for run in outputs.runs() if run.config().train}
    for experiment, name in itertools.product(sorted(configs), BASELINES):
        evaluate_baseline(outputs, configs[experiment], name)
    other = [*curves_directory(outputs).glob("*.csv"), outputs.analysis / "generalization.csv", CLAIMS]
    inputs = inputs_hash(outputs, [*other, *outputs.figures.glob("*.png")])
    if is_up_to_date(outputs.analysis, inputs) and (outputs.path / "report.html").is_file():
        print(f"Page is up to date: {outputs.path / 'report.html'}")
        return
    results = read_results(outputs)
    print(f"analyzing {len(results)} runs", flush=True)
    frames = gather(outputs) | _written_by_other_tasks(outputs)
    frames["audit"] = audits(results)
    frames["claims"] = judge(read_claims(CLAIMS), analysis_rows(frames))
    outputs.analysis.mkdir(parents=True, exist_ok=True)
    for name, frame in frames.items():
        write_text(outputs.analysis / f"{name}.csv", frame.to_csv(index=False, float_format="%.6g"))
    write_analysis_figures(outputs.analysis, frames)
    if job.scale.name != "smoke":
        verdicts = frames["claims"]["verdict"].value_counts()
        print("claims of the paper: " + ", ".join(f"{count} {verdict}" for verdict, count in verdicts.items()))
    _write_page(job, frames, caption(results))
    mark_up_to_date(outputs.analysis, inputs)


def _written_by_other_tasks(outputs: Outputs) -> dict[str, pd.DataFrame]:
    """Load the rows that task=generalization and task=curves wrote, where they did."""
    frames = {path.stem: read_rows(path) for path in curves_directory(outputs).glob("*.csv")}
    path = outputs.analysis / "generalization.csv"
    if path.is_file():
        frames["generalization"] = pd.read_csv(path, dtype={"trained": str, "tested": str})
    return frames


def _write_page(job: Job, frames: dict[str, pd.DataFrame], caption_text: str) -> None:
    outputs = job.outputs
    runs = [run for run in outputs.runs() if run.is_evaluated]
    shown: dict[str, list] = {}
    for run in runs:
        key = run.config().key
        if key.seed in (None, 0) and key.model != "all_free":
            shown.setdefault(key.experiment, []).append(run)
    for found in shown.values():
        found.sort(key=lambda run: run.config().key.is_baseline)  # the grid is that of a network
    report = Report(
        scale=job.scale.name,
        outputs=outputs.path.name,
        command=f"python run.py task=analysis scale={job.scale.name}",
        caption=caption_text,
        tables=write_tables(outputs),
        frames=frames,
        claims=frames["claims"],
        figures={path.stem: path for folder in (outputs.figures, outputs.analysis) for path in folder.glob("*.png")},
        samples={experiment: load_samples(outputs, experiment, mine) for experiment, mine in shown.items()},
        origins={str(run.path.relative_to(outputs.path)): run.provenance() for run in runs},
    )
    write_text(outputs.path / "report.html", render(report))
    print(f"Page: {outputs.path / 'report.html'}", flush=True)
