"""What tasks read: files that the user names, and what the analysis of an outputs directory depends on."""

from pathlib import Path

from repro.cli.jobs import ROOT
from repro.networks.weights import DIRECTORY as WEIGHTS
from repro.networks.weights import NAMES
from repro.reporting.paper import WORLDS
from repro.reporting.uptodate import inputs_hash
from repro.runs.outputs import Outputs
from repro.system.errors import InputError

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
    others = [*outputs.curves.glob("*.csv"), outputs.analysis / f"{GENERALIZATION}.csv", WORLDS]
    return inputs_hash(outputs, [*others, *sorted(outputs.figures.glob("*.png"))])
