"""Networks that are adapted to logs and tested on others: as many as folds, each to the logs outside of its fold."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

from repro.learning import adaptation
from repro.learning.adaptation import Labeled, adapt, label
from repro.learning.networks.trained import load_trained, save_trained
from repro.networks.predictor import Predictor
from repro.runs.devices import resolve_precision
from repro.system.files import read_mapping, sha256, write_json
from reproduce.real.logs import VIEW, log_of

SOURCE = "adapted_to.json"
Labels = Callable[[Path], tuple[Labeled, Labeled]]


def adapted(
    predictor: Predictor, origin: dict[str, str], logs: dict[Path, str], kept: Path, folds: int
) -> dict[Path, Predictor]:
    """Return the network that is tested with each log.

    Args:
        predictor: the network before.
        origin: checksums of its weights, and of the code that labels windows.
        logs: checksums of the logs; log k is in fold k modulo the number of folds.
        kept: the directory from which adapted networks are read, or to which they are written.
        folds: number of folds.
    """
    paths, found = list(logs), dict[Path, Predictor]()
    labels = labels_of(predictor, paths)
    for fold in range(folds):
        others = {path: logs[path] for number, path in enumerate(paths) if number % folds != fold}
        network = adapted_to(predictor, origin, others, labels, kept / f"fold-{fold}")
        found |= dict.fromkeys(paths[fold::folds], network)
    return found


def labels_of(predictor: Predictor, paths: list[Path]) -> Labels:
    """Return a function that labels the windows of one of some logs, once, with its place among them as the seed."""
    return cache(lambda path: label(*log_of(path, predictor), predictor, VIEW, seed=paths.index(path)))


def adapted_to(
    predictor: Predictor, origin: dict[str, str], logs: dict[Path, str], labels: Labels, directory: Path
) -> Predictor:
    """Return a network that is adapted to logs with their labels, from a directory or into it, see `adapted`."""
    names = {path.name: checksum for path, checksum in logs.items()}
    source = {**origin, "adaptation": sha256(Path(adaptation.__file__)), **names}
    if not (directory / SOURCE).is_file() or read_mapping(directory / SOURCE, "networks adapted to logs") != source:
        print(f"adapting to {', '.join(names)}", flush=True)
        precision = resolve_precision("auto", "cpu")
        network, before, after = adapt(predictor, list(map(labels, logs)), precision=precision)
        print(f"validation loss: {before:.4f} before, {after:.4f} adapted", flush=True)
        save_trained(network, directory / "model")
        write_json(directory / SOURCE, source)
    return load_trained(directory / "model")
