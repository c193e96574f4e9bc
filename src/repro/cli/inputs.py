"""What tasks read: files that the user names, and whether the inputs of earlier results have changed.

A stamp beside the results holds a hash of the runs, files and code that they were made from.
"""

import hashlib
from collections.abc import Iterable
from pathlib import Path

from repro.cli.jobs import ROOT
from repro.networks.weights import DIRECTORY as WEIGHTS
from repro.networks.weights import NAMES
from repro.reporting.paper import WORLDS
from repro.runs.outputs import Outputs
from repro.system.errors import InputError
from repro.system.files import write_text

SOURCE = Path(__file__).parents[1]
STAMP = ".inputs"
GENERALIZATION = "generalization"  # rows of task=generalization, and the name of their file


def find(key: str, name: str) -> Path:
    """Return the path that a key names; it may be relative to the project, and weights may have a name alone.

    Raises:
        ValueError: there is none.
    """
    for path in (*(WEIGHTS / known for known in NAMES if known == name), Path(name), ROOT / name):
        if path.exists():
            return path
    raise InputError(f"{key}: {name}: no such file or directory")


def analysis_inputs(outputs: Outputs) -> str:
    """Return a hash of everything that the analysis depends on."""
    others = [outputs.analysis / f"{GENERALIZATION}.csv", WORLDS, *sorted(outputs.figures.glob("*.png"))]
    return inputs_hash(outputs, others)


def inputs_hash(outputs: Outputs, files: Iterable[Path] = ()) -> str:
    """Hash the provenance and metrics of all runs, the recordings, further files, and the package with its tables."""
    inputs = [path for kind in ("*.py", "*.html", "*.csv") for path in sorted(SOURCE.rglob(kind))]
    inputs += files
    inputs += [directory / "manifest.json" for directory in outputs.recorded().values()]
    inputs += [run.path / name for run in outputs.runs() for name in ("provenance.json", "metrics.csv")]
    digest = hashlib.sha256()
    for path in inputs:
        digest.update(str(path).encode())
        digest.update(path.read_bytes() if path.is_file() else b"")
    return digest.hexdigest()


def is_up_to_date(directory: Path, inputs: str) -> bool:
    """Return whether the results in a directory were written from these inputs."""
    stamp = directory / STAMP
    return stamp.is_file() and stamp.read_text(encoding="utf-8") == inputs


def mark_up_to_date(directory: Path, inputs: str) -> None:
    """Note from which inputs the results in a directory were written."""
    write_text(directory / STAMP, inputs)
