"""How long the rest of a study takes on this machine."""

from collections import Counter
from dataclasses import replace

from repro.baselines.registry import PREDICTORS, applies
from repro.cli.jobs import Job
from repro.learning.cost import training_seconds
from repro.networks.model import paper_model
from repro.parallel import count_cores, parallel_trainings
from repro.recordings.format import recordings_in
from repro.runs.keys import RunKey
from repro.system.devices import resolve_device
from repro.world_config import world_spec

SECONDS_PER_READING = 2e-6  # of the recorder on one core
EVALUATION_SECONDS = {64: 2.0, 128: 8.0, 256: 30.0}  # per run and 500 test pairs, by resolution [px]
ANALYSIS_SECONDS = 3.0  # per evaluated run
BASELINE_SECONDS = 0.036  # per baseline and validation or test pair at 64 px; grows with size^3, as dilations do


def seconds_left(job: Job) -> float:
    """Estimate what is left of the study of a job on idle cores [s], measuring each network that is to be trained.

    These are its recordings, trainings, evaluations, and the classical baselines that task=analysis evaluates.
    """
    call, study, outputs = job.call, job.study, job.outputs
    scale, runtime, runs = call.scale, call.runtime, study.runs()
    specs = {name: world_spec(call.world, name) for name in call.world["experiments"]}
    missing = {name: sum(job.pairs.values()) - recordings_in(outputs.recordings(name), job.pairs) for name in specs}
    readings = sum(count * specs[name].steps * specs[name].lidar.number for name, count in missing.items())

    trained = {key: run for key, run in runs.items() if study.is_trained(run)}
    untrained = Counter(key.model for key in runs if key not in trained)
    size = (scale.size_px, call.train.batch_size, scale.pairs.train + scale.pairs.val)
    is_cuda = resolve_device(runtime.accelerator) == "cuda"  # on which a sweep has one training after the other
    at_once = 1 if is_cuda else min(untrained.total(), parallel_trainings(*size, call.encoding.most_channels))
    training = sum(
        count * training_seconds(replace(job.config, model=paper_model(name)), runtime.precision, runtime.accelerator)
        for name, count in untrained.items()
    )

    evaluations = len(runs) - sum(run.is_evaluated for run in trained.values())
    per_run = EVALUATION_SECONDS[min(EVALUATION_SECONDS, key=lambda px: abs(px - scale.size_px))]
    evaluation = evaluations * (per_run * scale.pairs.test / 500 + ANALYSIS_SECONDS)
    keys = [RunKey(name, each) for name, spec in specs.items() for each in PREDICTORS if applies(each, spec)]
    baselines = sum(not outputs.run(key).is_evaluated for key in keys)
    per_baseline = BASELINE_SECONDS * (scale.pairs.val + scale.pairs.test) * (scale.size_px / 64) ** 3
    workers = min(runtime.workers, count_cores())
    return readings * SECONDS_PER_READING / workers + training / max(1, at_once) + evaluation + baselines * per_baseline
