"""Adaptation of a network to logs: what task=adapt reads, prints and writes."""

import math
import os
import tempfile
from pathlib import Path

from repro.cli.jobs import Job
from repro.cli.log_prediction import read
from repro.cli.prediction_report import describe
from repro.cli.settings import Prediction
from repro.learning.adaptation import SCHEDULE, adapt, label
from repro.learning.held_out import View
from repro.learning.labels import Labeled
from repro.learning.networks.trained import load_trained, save_trained
from repro.learning.rehearsal import rehearsed
from repro.networks.predictor import Predictor
from repro.runs.devices import few_threads, resolve_device, resolve_precision
from repro.runs.provenance import environment
from repro.system.errors import InputError
from repro.system.files import sha256, write_json


def adapt_to_logs(job: Job, target: Path) -> None:
    """Adapt the network of a call to its logs, and write it to a new directory.

    Raises:
        InputError: a log cannot be used, the directory exists, or the validation loss does not fall.
    """
    settings, runtime, origin = job.call.prediction, job.call.runtime, environment()
    paths = [Path(log) for log in job.call.adaptation.logs or ()]
    if target.exists():
        raise InputError(f"{target} exists: set adaptation.name to another one, or delete it")
    predictor = load_trained(settings.weights)
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as directory:  # which is refused before hours of work
        save_trained(predictor, Path(directory) / target.name)
    device = resolve_device(runtime.accelerator)
    with few_threads():
        logs = [_labeled(path, predictor, settings, seed=number) for number, path in enumerate(paths)]
        if (count := sum(len(train.pairs) for train, _ in logs)) < SCHEDULE.batch_size:
            raise InputError(f"the logs have {count} windows for training, expected {SCHEDULE.batch_size} or more")
        precision = resolve_precision(runtime.precision, device)
        simulated = rehearsed(predictor, count)
        adapted, before, after = adapt(predictor, logs, simulated, device=device, precision=precision)
    with tempfile.TemporaryDirectory(dir=target.parent) as directory:
        new = Path(directory) / target.name
        save_trained(adapted, new)
        checksums = {path.name: sha256(path) for path in paths if path.is_file()}
        losses = {"validation_loss": after, "validation_loss_before": before}
        write_json(new / "source.json", {"weights": settings.weights, "logs": checksums, **losses, **origin})
        os.rename(new, target)  # fails if another process has written it since
    print(f"validation loss: {before:.4f} before, {after:.4f} adapted")
    print(f"{target}: prediction.weights={target} uses it")


def _labeled(path: Path, predictor: Predictor, settings: Prediction, *, seed: int) -> tuple[Labeled, Labeled]:
    """Read a log and label its windows, for training and for validation."""
    print(f"reading {path}", flush=True)
    log, windows = read(path, predictor, settings)
    describe(log, windows, predictor.reach_m)
    known = predictor.statistics
    view = View(math.radians(known.quantiles["fov_deg"][2])) if known else View()
    try:
        train, val = label(log, windows, predictor, view, seed=seed)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    print(f"  {len(train.pairs)} windows for training, {len(val.pairs)} for validation", flush=True)
    return train, val
