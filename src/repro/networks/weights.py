"""Where weights are: those of this package by their names, and directories and files.

The directories in repro/weights/ are links to the published ones in reproduce/results; an installed package has copies.
"""

import os
from pathlib import Path

from repro.system.errors import InputError
from repro.system.project import project_directory

DIRECTORY = Path(__file__).parents[1] / "weights"
NAMED_NETWORKS = tuple(sorted(path.name for path in DIRECTORY.iterdir()))
ONNX = "model.onnx"


def locate(weights: str | Path) -> Path:
    """Return the path of weights.

    Args:
        weights: one of `NAMED_NETWORKS`; or a path, which may be relative to the project.

    Raises:
        InputError: there are none of this name.
    """
    name = str(weights)
    if name in NAMED_NETWORKS:
        return DIRECTORY / name
    paths = Path(os.path.expanduser(name)), project_directory() / name
    if found := [path for path in paths if name and os.path.exists(path)]:
        return found[0]
    known = ", ".join(NAMED_NETWORKS)
    raise InputError(f"{name}: no such weights, expected one of {known}, or a directory or ONNX file that exists")


def onnx_file(path: Path) -> Path | None:
    """Return the ONNX file at a path or in its directory; None if there is none, as in a run."""
    file = path if path.is_file() else path / ONNX
    return file if file.is_file() else None
