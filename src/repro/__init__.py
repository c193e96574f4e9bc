"""Prediction of dynamic maps from the scans of a lidar, and the study that reproduces its paper.

    predictor = repro.load_predictor("indoor")
    stream = repro.PredictionStream(predictor, angles, center="robot", range_max_m=30)

The names below are imported at their first use. CONTRIBUTING.md lists the packages in the order of their dependencies.
"""

from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

from repro.system.errors import InputError

if TYPE_CHECKING:
    from repro.maps.grid import Grid
    from repro.networks.predictor import Predictor, load_predictor
    from repro.networks.weights import NAMED_NETWORKS
    from repro.prediction.drawing import draw_map
    from repro.prediction.stream import PredictionStream
    from repro.prediction.stream_map import StreamMap
    from repro.scans import Scans

    __version__: str

__all__ = [
    "NAMED_NETWORKS",
    "Grid",
    "InputError",
    "PredictionStream",
    "Predictor",
    "Scans",
    "StreamMap",
    "__version__",
    "draw_map",
    "load_predictor",
]

_MODULES = {
    "NAMED_NETWORKS": "repro.networks.weights",  # of the networks that the package has
    "Grid": "repro.maps.grid",
    "PredictionStream": "repro.prediction.stream",
    "Predictor": "repro.networks.predictor",
    "Scans": "repro.scans",
    "StreamMap": "repro.prediction.stream_map",
    "draw_map": "repro.prediction.drawing",
    "load_predictor": "repro.networks.predictor",
}


def __getattr__(name: str) -> Any:
    """Import a public name (PEP 562), since not every use of the package needs all of them."""
    if name == "__version__":
        return _version()
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_MODULES[name]), name)
    return value


def _version() -> str:
    """Return the version of the installed package; of a source that is not installed, `0+unknown`."""
    try:
        return version("dynamic-map-prediction")
    except PackageNotFoundError:
        return "0+unknown"


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
