"""Skip work whose inputs have not changed: a stamp beside the results holds a hash of the runs, files and code."""

import hashlib
from collections.abc import Iterable
from pathlib import Path

from repro.runs.outputs import Outputs
from repro.system.files import write_text

SOURCE = Path(__file__).parents[1]
STAMP = ".inputs"


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
