"""Prediction of dynamic maps from the scans of a lidar, and the study that reproduces its paper.

    predictor = repro.load_predictor("indoor")
    stream = repro.PredictionStream(predictor, angles, center="robot", range_max_m=30)

The names below are imported at their first use. CONTRIBUTING.md lists the packages in the order of their dependencies.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from repro.maps.grid import Grid
    from repro.networks.predictor import load_predictor
    from repro.prediction.drawing import draw_map
    from repro.prediction.stream import PredictionStream
    from repro.scans import Scans

__all__ = ["Grid", "PredictionStream", "Scans", "draw_map", "load_predictor"]

_MODULES = {
    "Grid": "repro.maps.grid",
    "PredictionStream": "repro.prediction.stream",
    "Scans": "repro.scans",
    "draw_map": "repro.prediction.drawing",
    "load_predictor": "repro.networks.predictor",
}


def __getattr__(name: str) -> Any:
    """Import a public name (PEP 562): torch takes seconds, and not every use of the package needs it."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_MODULES[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
