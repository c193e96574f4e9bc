"""task=generalization: test U-Net on other experiments than its own, and on changed sensors, poses and speeds."""

import pandas as pd

from repro.cli.jobs import Job
from repro.config import PROJECTION
from repro.evaluation.generalization import across_experiments, under_changes
from repro.networks.predictor import load_predictor
from repro.recordings.reader import read_manifest
from repro.runs.keys import RunKey
from repro.system.files import write_text


def run(job: Job) -> None:
    """Write generalization.csv.

    Raises:
        ValueError: no U-Net with this seed has been trained.
    """
    outputs, experiment = job.outputs, job.key.experiment
    runs = {name: outputs.run(RunKey(name, "unet", PROJECTION, job.seed)) for name in sorted(outputs.recorded())}
    predictors = {name: load_predictor(run.model) for name, run in runs.items() if run.is_trained}
    if not predictors:
        raise ValueError(f"no U-Net with seed {job.seed} has been trained in {outputs.path}: train some first")
    print(f"testing U-Net of experiments {', '.join(predictors)} on one another's recordings", flush=True)
    rows = [across_experiments(predictors, {name: outputs.recordings(name) for name in predictors})]
    if experiment in predictors:
        print(f"testing U-Net of experiment {experiment} on changed sensors, poses and speeds", flush=True)
        spec, pairs = read_manifest(outputs.recordings(experiment)).spec, min(job.scale.pairs.test, 100)
        directory = outputs.path / "generalization" / f"exp{experiment}"
        rows.append(under_changes(predictors[experiment], experiment, spec, directory, pairs))
    outputs.analysis.mkdir(parents=True, exist_ok=True)
    table = pd.concat(rows, ignore_index=True).assign(seed=job.seed)
    write_text(outputs.analysis / "generalization.csv", table.to_csv(index=False, float_format="%.6g"))
    print(f"{outputs.analysis / 'generalization.csv'}: task=analysis shows it")
