"""Networks that are adapted to logs and tested on others: as many as folds, each to the logs outside of its fold."""

from pathlib import Path

from repro.learning import adaptation
from repro.learning.adaptation import adapt, label
from repro.networks.predictor import Predictor, load_predictor
from repro.system.devices import resolve_precision
from repro.system.files import read_mapping, sha256, write_json
from reproduce.real.logs import VIEW, log_of

SOURCE = "adapted_to.json"


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
    for fold in range(folds):
        others = {path: logs[path] for number, path in enumerate(paths) if number % folds != fold}
        found |= dict.fromkeys(paths[fold::folds], adapted_to(predictor, origin, others, kept / f"fold-{fold}"))
    return found


def adapted_to(predictor: Predictor, origin: dict[str, str], logs: dict[Path, str], directory: Path) -> Predictor:
    """Return a network that is adapted to logs, from a directory or into it, see `adapted`."""
    names = {path.name: checksum for path, checksum in logs.items()}
    source = {**origin, "adaptation": sha256(Path(adaptation.__file__)), **names}
    if not (directory / SOURCE).is_file() or read_mapping(directory / SOURCE, "networks adapted to logs") != source:
        print(f"adapting to {', '.join(names)}", flush=True)
        windows = [label(*log_of(path, predictor), predictor, VIEW, seed=number) for number, path in enumerate(logs)]
        network, before, after = adapt(predictor, windows, precision=resolve_precision("auto", "cpu"))
        print(f"validation loss: {before:.4f} before, {after:.4f} adapted", flush=True)
        network.save(directory / "model")
        write_json(directory / SOURCE, source)
    return load_predictor(directory / "model")
