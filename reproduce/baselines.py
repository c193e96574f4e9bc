"""Evaluate classical baselines on the recordings of a published scale, and compare them with a published network there.

    python run.py -m task=record exp=1,2,3,4 scale=workstation
    python -m reproduce.baselines tracker,transitional,privileged exp=1,2,3,4 scale=workstation
    python run.py task=publish scale=workstation

`privileged` is the upper bound of upper_bound.py. The other arguments are those of run.py. Where
reproduce/results/<scale> has the weights of the paper's U-Net in an experiment, its paired differences to the baselines
are written to analysis/differences.csv. The other tables of the analysis have the intervals of the baselines.
"""

import itertools
import sys

import pandas as pd

from repro.baselines.registry import PREDICTORS
from repro.cli import compose, main
from repro.cli.jobs import RESULTS, Job
from repro.evaluation.frames import gather
from repro.evaluation.paired import paired_differences
from repro.evaluation.scoring import evaluate_baseline, read_predictions
from repro.networks.predictor import load_predictor
from repro.recordings.datasets import grid_of
from repro.recordings.reader import open_recordings
from repro.recordings.recorded import load_recorded
from repro.runs.config import PROJECTION
from repro.runs.devices import one_thread
from repro.system.files import write_text
from reproduce.upper_bound import privileged

NETWORK = "unet"
COLUMNS = ["experiment", "comparison", "one", "other", "model", "encoding"]


def differences(job: Job, names: list[str]) -> pd.DataFrame:
    """Return the metrics of the published U-Net less those of each baseline, a row per metric; no rows without it."""
    weights = RESULTS / job.call.scale.name / f"exp{job.call.exp}-{NETWORK}"
    if not weights.is_dir():
        return pd.DataFrame()
    test = load_recorded(open_recordings(job.recordings), "test", grid_of(job.config))
    with one_thread():
        network = load_predictor(weights).predict(test.scans)[:, None]
    tables = []
    for name in names:
        baseline = read_predictions(job.outputs.run(job.config.of_baseline(name).key))[:, None]
        table = pd.DataFrame(paired_differences(network, baseline, test.maps))
        table.insert(0, "other", name)
        tables.append(table)
    about = {"experiment": job.call.exp, "comparison": "networks", "one": NETWORK, "model": "", "encoding": PROJECTION}
    return pd.concat(tables).assign(**about)


def run(names: list[str], arguments: list[str]) -> None:
    """Evaluate the named baselines in every job of the call, and write the differences."""
    PREDICTORS["privileged"] = privileged
    parsed = main.read_arguments(["-m", *arguments])
    with compose.composed(parsed) as composed:
        jobs = [Job(call) for call in main.read_calls(parsed, composed)]
    for job, name in itertools.product(jobs, names):
        evaluate_baseline(job.outputs, job.config, name)
    outputs = jobs[0].outputs
    outputs.analysis.mkdir(exist_ok=True)
    frames = gather(outputs)
    if len(rows := pd.concat([differences(job, names) for job in jobs])):
        frames["differences"] = rows[[*COLUMNS, *rows.columns.drop(COLUMNS)]]
    for name, frame in frames.items():
        write_text(outputs.analysis / f"{name}.csv", frame.to_csv(index=False, float_format="%.6g"))


if __name__ == "__main__":
    run(sys.argv[1].split(","), sys.argv[2:])
