"""Adaptation of a network to logs: what task=adapt reads, prints and writes."""

import math
import shutil
from pathlib import Path

from repro.cli.inputs import find
from repro.cli.jobs import Job
from repro.cli.prediction import read
from repro.cli.prediction_report import printed_messages
from repro.learning.adaptation import Labeled, adapt, label
from repro.learning.held_out import View
from repro.networks.predictor import Predictor, load_predictor
from repro.runs.provenance import environment
from repro.system.devices import few_threads, resolve_device, resolve_precision
from repro.system.errors import InputError
from repro.system.files import lock, sha256, write_json

FOV_DEG = 90.0  # of a view, where the statistics of the training do not have it


def adapt_to_logs(job: Job, paths: list[Path], target: Path) -> None:
    """Adapt the network of a call to logs.

    Args:
        job: the call.
        paths: the logs.
        target: the directory of the adapted network, which does not exist.

    Raises:
        InputError: a log cannot be used, or the network gets no better.
    """
    settings, seed = job.call.prediction, job.call.seed
    predictor = load_predictor(find("prediction.weights", settings.weights))
    origin = environment()
    parts = []
    for number, path in enumerate(paths):
        print(f"reading {path}", flush=True)
        with printed_messages(), few_threads():
            parts.append(_parts(path, predictor, job, seed=seed + number))
        print(f"  {len(parts[-1][0].pairs)} windows for training, {len(parts[-1][1].pairs)} for validation", flush=True)
    device = resolve_device(job.call.runtime.accelerator)
    precision = resolve_precision(job.call.runtime.precision, device)
    work = target.with_name(f".{target.name}.training")
    target.parent.mkdir(parents=True, exist_ok=True)
    with lock(target.parent, f".{target.name}.lock"):
        try:
            with few_threads():
                adapted, before, after = adapt(predictor, parts, work, seed=seed, device=device, precision=precision)
            adapted.save(target)
            logs = {path.name: sha256(path) for path in paths if path.is_file()}
            losses = {"validation_loss": after, "validation_loss_before": before}
            write_json(target / "source.json", {"weights": settings.weights, "logs": logs, **losses, **origin})
        finally:
            shutil.rmtree(work, ignore_errors=True)
    print(f"validation loss: {before:.4f} before, {after:.4f} adapted")
    print(f"{target}: prediction.weights={target} uses it")


def _parts(path: Path, predictor: Predictor, job: Job, *, seed: int) -> tuple[Labeled, Labeled]:
    log, windows = read(path, predictor, job.call.prediction)
    fov_deg = predictor.statistics.quantiles["fov_deg"][2] if predictor.statistics else FOV_DEG
    try:
        return label(log, windows, predictor, View(math.radians(fov_deg)), seed=seed)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
