"""Networks that are adapted to logs and tested on others: as many as folds, each to the logs outside of its fold."""

from pathlib import Path

from repro.learning import adaptation
from repro.learning.adaptation import Labeled, adapt, label
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
    paths = list(logs)
    code = origin | {"adaptation": sha256(Path(adaptation.__file__))}
    windows: dict[Path, tuple[Labeled, Labeled]] = {}
    found: dict[Path, Predictor] = {}
    for fold in range(folds):
        others = [path for number, path in enumerate(paths) if number % folds != fold]
        source = {**code, **{path.name: logs[path] for path in others}}
        directory = kept / f"fold-{fold}"
        if not (directory / SOURCE).is_file() or read_mapping(directory / SOURCE, "networks adapted to logs") != source:
            for path in others:
                if path not in windows:
                    windows[path] = label(*log_of(path, predictor), predictor, VIEW, seed=paths.index(path))
            print(f"adapting to {', '.join(path.name for path in others)}", flush=True)
            precision = resolve_precision("auto", "cpu")
            network, _, _ = adapt(predictor, [windows[path] for path in others], precision=precision)
            directory.mkdir(parents=True, exist_ok=True)
            network.save(directory / "model")
            write_json(directory / SOURCE, source)
        found |= {path: load_predictor(directory / "model") for path in paths[fold::folds]}
    return found
