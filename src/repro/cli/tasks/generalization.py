"""task=generalization: test a network on other experiments, start headings, sensors, poses and speeds."""

from typing import Any

from repro.cli.jobs import Job
from repro.cli.tasks import Task


def run(job: Job) -> None:
    """Write the rows of a network to generalization.csv; those of other networks and experiments are kept.

    Raises:
        InputError: the network has been trained in no experiment with this seed.
    """
    import pandas as pd

    from repro.evaluation.generalization import across_experiments, across_start_headings, under_changes, updated
    from repro.recordings.reader import read_manifest
    from repro.reporting.names import predictor_title
    from repro.reporting.results import read_rows
    from repro.system.files import lock, write_text

    outputs, key = job.outputs, job.key
    experiment, title = key.experiment, predictor_title(key.model, key.encoding)
    predictors = _predictors(job, title)
    print(f"testing {title} of experiments {', '.join(predictors)} on one another's recordings", flush=True)
    rows = [across_experiments(predictors, {name: outputs.recordings(name) for name in predictors})]
    if experiment in predictors:
        print(f"testing {title} of experiment {experiment} on other headings, sensors, poses and speeds", flush=True)
        rows.append(across_start_headings(predictors[experiment], experiment, outputs.recordings(experiment)))
        spec, pairs = read_manifest(outputs.recordings(experiment)).world_spec, min(job.call.scale.pairs.test, 100)
        directory = outputs.path / "generalization" / f"exp{experiment}"
        workers = job.call.runtime.workers
        rows.append(under_changes(predictors[experiment], experiment, spec, directory, pairs, workers=workers))
    else:
        print(
            f"other headings, sensors, poses and speeds are left out: {title} is not trained in experiment {experiment}"
        )
    outputs.analysis.mkdir(parents=True, exist_ok=True)
    table = pd.concat(rows, ignore_index=True).assign(seed=job.call.seed, model=key.model, encoding=key.encoding)
    path = outputs.generalization
    with lock(outputs.analysis):
        if path.is_file():
            table = updated(read_rows(path), table)
        write_text(path, table.to_csv(index=False, float_format="%.6g"))
    print(f"{path}: task=analysis shows it")


def _predictors(job: Job, title: str) -> dict[str, Any]:
    """Load the networks of the call's model, encoding and seed, by the experiments in which they were trained."""
    from repro.networks.predictor import load_predictor
    from repro.recordings.format import spec_fingerprint
    from repro.runs.keys import RunKey
    from repro.system.errors import InputError
    from repro.world_config import world_spec

    key = job.key
    runs = {
        name: job.outputs.run(RunKey(name, key.model, key.encoding, job.call.seed))
        for name in sorted(job.outputs.recorded())
    }
    for name, run in runs.items():
        if run.is_trained and name in job.call.world["experiments"]:
            worlds = spec_fingerprint(world_spec(job.call.world, name))
            if run.config().data.worlds != worlds:
                raise InputError(f"{run} was trained in other worlds than those of this call: set world= or outputs=")
    predictors = {name: load_predictor(run.model) for name, run in runs.items() if run.is_trained}
    if not predictors:
        raise InputError(
            f"no {title} with seed {job.call.seed} has been trained in {job.outputs.path}: train some first"
        )
    return predictors


TASK = Task(run)
