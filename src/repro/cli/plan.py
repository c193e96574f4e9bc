"""What is left of the study at a scale, and how long it takes on this machine."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

from repro.baselines.registry import PREDICTORS, applies
from repro.cli.jobs import Job
from repro.cli.notes import recording_seconds
from repro.cli.settings import Runtime
from repro.learning.cost import training_seconds, trainings_at_once, usual_epochs
from repro.networks.model import NETWORKS, paper_model
from repro.parallel import count_cores
from repro.recordings.format import recordings_in
from repro.reporting.names import duration
from repro.runs.config import RunConfig
from repro.runs.keys import RunKey
from repro.world_config import world_spec

EVALUATION_SECONDS = {64: 2.0, 128: 8.0, 256: 30.0}  # per run and 500 test pairs, by resolution [px]
ANALYSIS_SECONDS = 3.0  # per evaluated run
BASELINE_SECONDS = 0.036  # per baseline and validation or test pair at 64 px; grows with size^3, as dilations do


def print_plan(job: Job) -> None:
    """Print what is left, measuring the networks that are still to be trained."""
    print(f"Left to do in {job.outputs.path}:", flush=True)
    experiments, wanted = job.call.world["experiments"], job.pairs
    missing = {name: sum(wanted.values()) - recordings_in(job.outputs.recordings(name), wanted) for name in experiments}
    seconds = sum(recording_seconds(world_spec(job.call.world, name), count) for name, count in missing.items())
    seconds /= min(job.call.runtime.workers, count_cores())
    study = job.study
    runs = study.runs()
    untrained = [key.model for key, run in runs.items() if not study.is_trained(run)]
    trainings = {name: untrained.count(name) for name in NETWORKS}
    evaluations = sum(not (study.is_trained(run) and run.is_evaluated) for run in runs.values())
    recordings, runtime = sum(missing.values()), job.call.runtime
    for line in plan_study(job.config, runtime, recordings, seconds, trainings, evaluations, _baselines_left(job)):
        print(line, flush=True)


def _baselines_left(job: Job) -> int:
    """Return the number of baselines that task=analysis would evaluate."""
    specs = {name: world_spec(job.call.world, name) for name in job.call.world["experiments"]}
    keys = [
        RunKey(experiment, name) for experiment, spec in specs.items() for name in PREDICTORS if applies(name, spec)
    ]
    return sum(not job.outputs.run(key).is_evaluated for key in keys)


def plan_study(
    config: RunConfig,
    runtime: Runtime,
    recordings: int,
    recording_seconds: float,
    trainings: Mapping[str, int],
    evaluations: int,
    baselines: int,
) -> Iterator[str]:
    """Yield the remaining work of the study and its estimated duration, line by line as it is measured.

    Args:
        config: a run of the study.
        runtime: accelerator and precision of the trainings.
        recordings: number of remaining recordings.
        recording_seconds: time to record them [s].
        trainings: number of remaining trainings of each of the paper's networks.
        evaluations: number of remaining runs to evaluate.
        baselines: number of remaining classical baselines.
    """
    total, left = recording_seconds, sum(trainings.values())
    at_once = min(left, trainings_at_once(config, runtime.accelerator))
    yield f"  {recordings} recordings: {duration(total)}" if recordings else "  recordings: done"
    for name, count in trainings.items():
        if count:
            run = replace(config, model=paper_model(name))
            seconds = count * training_seconds(run, runtime.precision, runtime.accelerator)
            total += seconds / at_once
            yield f"  {count} x {name}: {duration(seconds)}"
        else:
            yield f"  {name}: done"
    if at_once > 1:
        yield f"  {at_once} trainings run at the same time, one per core"
    if evaluations:
        per_run = EVALUATION_SECONDS[min(EVALUATION_SECONDS, key=lambda px: abs(px - config.data.size_px))]
        seconds = evaluations * (per_run * config.data.pairs.test / 500 + ANALYSIS_SECONDS)
        total += seconds
        yield f"  evaluation and analysis of {evaluations} runs: {duration(seconds)}"
    if baselines:
        pairs, size = config.data.pairs.val + config.data.pairs.test, config.data.size_px / 64
        seconds = baselines * BASELINE_SECONDS * pairs * size**3
        total += seconds
        yield f"  {baselines} classical baselines, which task=analysis evaluates: {duration(seconds)}"
    if total:
        yield f"About {duration(total)} on idle cores, at {usual_epochs(config)} epochs a training;"
        yield "it can be interrupted, the same command resumes"
