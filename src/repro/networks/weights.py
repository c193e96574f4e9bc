"""Where weights are: those of this package by their names, directories and files, and repositories of the Hugging Face
Hub.

The directories in repro/weights/ are links to the published ones in reproduce/results; an installed package has copies.
"""

import os
import re
from pathlib import Path

from repro.system.errors import InputError
from repro.system.files import first_line
from repro.system.project import project_directory

DIRECTORY = Path(__file__).parents[1] / "weights"
NAMED_NETWORKS = tuple(sorted(path.name for path in DIRECTORY.iterdir()))
ONNX = "model.onnx"
REPOSITORY = re.compile(r"[\w-][\w.-]*/[\w-][\w.-]*")  # owner/name
FILES = ("*.json", "*.safetensors", "*.onnx")  # nothing else is downloaded


def locate(weights: str | Path) -> Path:
    """Return the path of weights, which are downloaded to the user's cache if they are in a repository of the Hub.

    Args:
        weights: one of `NAMED_NETWORKS`; or a path, which may be relative to the project; or owner/name of a repository
            of the Hugging Face Hub, which is asked for a name that is no path, and whose owner is no directory.

    Raises:
        InputError: there are none of this name, or they cannot be downloaded.
    """
    name = str(weights)
    if name in NAMED_NETWORKS:
        return DIRECTORY / name
    paths = Path(os.path.expanduser(name)), project_directory() / name
    if found := [path for path in paths if name and path.exists()]:
        return found[0]
    if not REPOSITORY.fullmatch(name) or any(path.parent.exists() for path in paths):
        known = ", ".join(NAMED_NETWORKS)
        raise InputError(
            f"{name}: no such weights, expected one of {known}, a directory or ONNX file that exists, or a repository "
            "of the Hugging Face Hub, owner/name"
        )
    return _downloaded(name)


def _downloaded(name: str) -> Path:
    try:
        from huggingface_hub import snapshot_download
    except ModuleNotFoundError as error:
        raise InputError(f"{name}: no such path, and the Hub needs a package: pip install huggingface-hub") from error
    try:
        return Path(snapshot_download(name, allow_patterns=list(FILES)))
    except Exception as error:  # of the Hub and of the network, without a common base
        raise InputError(f"{name}: no such path, and not to be had from the Hub ({first_line(error)})") from error


def onnx_file(path: Path) -> Path | None:
    """Return the ONNX file at a path or in its directory; None if there is none, as in a run."""
    return path if path.is_file() else next((path / name for name in (ONNX,) if (path / name).is_file()), None)
