"""What is left of the study at a scale, and how long it takes on this machine."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from repro.baselines.laws import applies
from repro.baselines.registry import PREDICTORS
from repro.cli.jobs import Job
from repro.cli.notes import recording_seconds
from repro.learning.cost import training_seconds, usual_epochs
from repro.networks.model import NETWORKS, paper_model
from repro.parallel import count_cores, parallel_trainings
from repro.recordings.format import recordings_in
from repro.reporting.names import duration
from repro.runs.keys import RunKey
from repro.system.devices import resolve_device
from repro.world_config import world_spec

EVALUATION_SECONDS = {64: 2.0, 128: 8.0, 256: 30.0}  # per run and 500 test pairs, by resolution [px]
ANALYSIS_SECONDS = 3.0  # per evaluated run
BASELINE_SECONDS = 0.036  # per baseline and validation or test pair at 64 px; grows with size^3, as dilations do


@dataclass(frozen=True)
class Left:
    """What is left of a study.

    Args:
        recordings: number of recordings.
        recording_seconds: time to record them [s].
        trainings: number of trainings of each of the paper's networks.
        evaluations: number of runs to evaluate.
        baselines: number of classical baselines that task=analysis would evaluate.
    """

    recordings: int
    recording_seconds: float
    trainings: Mapping[str, int]
    evaluations: int
    baselines: int

    @classmethod
    def of(cls, job: Job) -> "Left":
        """Count what is left of the study of a job."""
        study, outputs, workers = job.study, job.outputs, min(job.call.runtime.workers, count_cores())
        specs = {name: world_spec(job.call.world, name) for name in job.call.world["experiments"]}
        missing = {name: sum(job.pairs.values()) - recordings_in(outputs.recordings(name), job.pairs) for name in specs}
        seconds = sum(recording_seconds(spec, missing[name]) for name, spec in specs.items()) / workers
        runs = study.runs()
        trained = {key: run for key, run in runs.items() if study.is_trained(run)}
        untrained = Counter(key.model for key in runs if key not in trained)
        evaluations = len(runs) - sum(run.is_evaluated for run in trained.values())
        keys = [RunKey(name, each) for name, spec in specs.items() for each in PREDICTORS if applies(each, spec)]
        baselines = sum(not outputs.run(key).is_evaluated for key in keys)
        return cls(sum(missing.values()), seconds, {name: untrained[name] for name in NETWORKS}, evaluations, baselines)


def plan_study(job: Job, left: Left) -> Iterator[str]:
    """Yield what is left of a study and its estimated duration, line by line as it is measured."""
    scale, runtime, total = job.call.scale, job.call.runtime, left.recording_seconds
    size = (scale.size_px, job.call.train.batch_size, scale.pairs.train + scale.pairs.val)
    is_cuda = resolve_device(runtime.accelerator) == "cuda"  # on which a sweep has one training after the other
    at_once = 1 if is_cuda else parallel_trainings(*size, job.call.encoding.most_channels)
    at_once = min(sum(left.trainings.values()), at_once)
    yield f"  {left.recordings} recordings: {duration(total)}" if left.recordings else "  recordings: done"
    for name, count in left.trainings.items():
        if count:
            run = replace(job.config, model=paper_model(name))
            seconds = count * training_seconds(run, runtime.precision, runtime.accelerator)
            total += seconds / at_once
            yield f"  {count} x {name}: {duration(seconds)}"
        else:
            yield f"  {name}: done"
    if at_once > 1:
        yield f"  {at_once} trainings run at the same time, one per core"
    if left.evaluations:
        per_run = EVALUATION_SECONDS[min(EVALUATION_SECONDS, key=lambda px: abs(px - scale.size_px))]
        seconds = left.evaluations * (per_run * scale.pairs.test / 500 + ANALYSIS_SECONDS)
        total += seconds
        yield f"  evaluation and analysis of {left.evaluations} runs: {duration(seconds)}"
    if left.baselines:
        pairs = scale.pairs.val + scale.pairs.test
        seconds = left.baselines * BASELINE_SECONDS * pairs * (scale.size_px / 64) ** 3
        total += seconds
        yield f"  {left.baselines} classical baselines, which task=analysis evaluates: {duration(seconds)}"
    if total:
        yield f"About {duration(total)} on idle cores, at {usual_epochs(job.call.train)} epochs a training;"
        yield "it can be interrupted, the same command resumes"
