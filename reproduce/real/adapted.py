"""Networks that are adapted to the logs of some places and tested on those of others."""

from dataclasses import replace
from functools import cache
from pathlib import Path

from repro.learning import adaptation, rehearsal
from repro.learning.adaptation import adapt, label
from repro.learning.labels import Labeled
from repro.learning.networks.trained import load_trained, save_trained
from repro.learning.rehearsal import rehearsed
from repro.maps.series import Counts
from repro.networks.predictor import Predictor
from repro.networks.weights import locate
from repro.runs.devices import resolve_precision
from repro.runs.provenance import environment
from repro.system.files import read_mapping, sha256, write_json
from reproduce.real.floors import is_floor
from reproduce.real.logs import FOLDS, VIEW, fold_of, log_of

SOURCE = "adapted_to.json"
CODE = {module.__name__: sha256(Path(str(module.__file__))) for module in (adaptation, rehearsal)}


def adapted(weights: str, paths: list[Path], kept: Path) -> dict[Path, Predictor]:
    """Return the network that is tested with each log: the one that is adapted to the logs of the other folds.

    Args:
        weights: the network before.
        paths: the logs, to which networks are adapted, and floors, with which that is tested which is adapted to all.
        kept: the directory from which adapted networks are read, or to which they are written.
    """
    logs = [path for path in paths if not is_floor(path)]
    networks: dict[int | None, Predictor] = {
        fold: adapted_to(weights, tuple(path for path in logs if fold_of(path) != fold), logs, kept / f"fold-{fold}")
        for fold in range(FOLDS)
    }
    of_logs = {path: networks[fold_of(path)] for path in logs}
    floors = [path for path in paths if is_floor(path)]
    return of_logs | (dict.fromkeys(floors, adapted_to_all(weights, paths, kept)) if floors else {})


def adapted_to_all(weights: str, paths: list[Path], kept: Path) -> Predictor:
    """Return the network that is adapted to all logs, from a directory `all` or into it."""
    logs = [path for path in paths if not is_floor(path)]
    return adapted_to(weights, tuple(logs), logs, kept / "all")


def adapted_to(weights: str, chosen: tuple[Path, ...], paths: list[Path], directory: Path) -> Predictor:
    """Return a network that is adapted to chosen ones of all logs, from a directory or into it."""
    source = {
        "weights": sha256(locate(weights) / "model.safetensors"),
        **CODE,
        **{path.name: sha256(path) for path in chosen},
    }
    done = directory / SOURCE
    if not done.is_file() or {k: v for k, v in read_mapping(done, "adapted").items() if k in source} != source:
        print(f"adapting to {', '.join(path.name for path in chosen)}", flush=True)
        labels = {path: labels_of(path, weights, seed) for seed, path in enumerate(paths)}
        simulated = rehearsed_of(weights, sum(len(train.pairs) for train, _ in labels.values()))
        precision = resolve_precision("auto", "cpu")
        known = [labels[path] for path in chosen]
        network, before, after = adapt(started(weights), known, simulated, precision=precision)
        print(f"validation loss: {before:.4f} before, {after:.4f} adapted", flush=True)
        save_trained(network, directory / "model")
        write_json(done, source | {"validation_loss_before": before, "validation_loss": after, **environment()})
    return load_trained(directory / "model")


@cache
def labels_of(path: Path, weights: str, seed: int) -> tuple[Labeled, Labeled]:
    """Label the windows of a log."""
    predictor = started(weights)
    return label(*log_of(path, predictor), predictor, VIEW, seed=seed)


@cache
def rehearsed_of(weights: str, windows: int) -> tuple[Labeled, ...]:
    """Record the simulated windows of each round for so many windows of logs."""
    return tuple(rehearsed(started(weights), windows))


def started(weights: str) -> Predictor:
    """Return the network that is adapted, with counts as its input, whatever encoding it was trained with."""
    predictor = load_trained(weights)
    encoding = predictor.encoding
    return replace(predictor, encoding=Counts(encoding.frames, encoding.reach_m))
