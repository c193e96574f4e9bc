"""A trained network together with its encoding and grid, which can be applied to any scans.

predictor = load_predictor("indoor")
free = predictor.predict(Scans(ranges, angles, poses))
"""

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from repro.maps.encodings import Encoding, create_encoding, to_input
from repro.maps.grid import Grid
from repro.maps.statistics import Statistics
from repro.maps.validity import check_windows
from repro.networks.onnx_files import read_onnx
from repro.networks.weights import ONNX, locate, onnx_file
from repro.scans import Scans
from repro.system.errors import STUDY, InputError
from repro.system.progress import progress


class Network(Protocol):
    """A function from encoded scans in [0, 1], float32, (B, C, H, W), to logits, float32, (B, 1, H, W)."""

    def __call__(self, images: np.ndarray) -> np.ndarray: ...


@dataclass(frozen=True, repr=False)
class Predictor:
    """A network from encoded scans to logits, with the encoding of its input and the grid of its maps.

    Args:
        network: the network.
        encoding: the encoding of the scans.
        grid: the grid of the maps.
        statistics: statistics of the training scans; None if they are unknown.
        steps: steps of a window in training, T.
        step_s: time of a step in training [s].
        has_fixed: the worlds of the training have fixed obstacles, whose place on the map the network has learned.
        is_centered: the network takes the robot to be in the middle of the map.
    """

    network: Network
    encoding: Encoding
    grid: Grid
    statistics: Statistics | None = None
    steps: int = 100
    step_s: float = 0.1
    has_fixed: bool = False
    is_centered: bool = False

    def __repr__(self) -> str:
        size, window = f"{self.grid.size_px} px of {self.grid.size_m:g} m", f"{self.steps} steps of {self.step_s:g} s"
        return f"Predictor({self.encoding.name}, {window}, maps of {size})"

    @property
    def reach_m(self) -> float:
        """Return how far the encoding takes the pixels on the way of a miss as free [m], 0 if it does not."""
        return self.encoding.reach_m

    def with_range(self, range_max_m: float) -> "Predictor":
        """Return a predictor for a lidar that may reach less far than that of the training.

        Args:
            range_max_m: maximum range of the lidar [m], up to which a miss shows free space.

        Raises:
            InputError: the range is not positive.
        """
        if not range_max_m > 0:
            raise InputError(f"range_max_m: expected a positive range [m], got {range_max_m}")
        if range_max_m >= self.reach_m:
            return self
        return dataclasses.replace(self, encoding=self.encoding.with_range(float(range_max_m)))

    def check_center(self, center: str | tuple[float, float]) -> None:
        """Check that the map may have this center in the frame of the poses: `robot`, `start`, or x, y [m].

        Raises:
            InputError: the network has learned another one.
        """
        if self.is_centered and center != "robot":
            raise InputError(
                f"center: the network takes the robot to be in the middle: expected robot, got {center}, or other "
                "weights, such as rooms"
            )
        if self.has_fixed and isinstance(center, str):
            raise InputError(
                f"center: the network was trained with fixed obstacles: its map of {self.grid.size_m:g} x "
                f"{self.grid.size_m:g} m must lie where that of the training lies, expected x,y of its center in the "
                f"frame of the poses [m], got {center}"
            )

    def predict(self, scans: Scans, batch: int = 32, *, allow_empty: bool = False) -> np.ndarray:
        """Predict the map at the last step of each window of scans.

        Args:
            scans: one window or a batch, in meters and radians; a miss is inf, an invalid reading NaN. The accuracy
                falls where a window has fewer or more steps than those of the training, `steps`.
            batch: windows per call of the network.
            allow_empty: accept windows of few valid readings, or of a robot outside the map.

        Returns:
            probability of free, float32, (B, H, W); row 0 is the top of the map, and below 0.5 is an obstacle.

        Raises:
            TypeError: the scans are arrays instead of `Scans`.
            InputError: the scans cannot be those of a lidar on this map, see `validity.check_windows`, or `batch` is
                less than 1.
        """
        if not isinstance(scans, Scans):
            raise TypeError(f"expected Scans(ranges, angles, poses), got {type(scans).__name__}")
        if batch < 1:
            raise InputError(f"batch: expected 1 window or more, got {batch}")
        windows = scans.batched()
        check_windows(windows, self.grid, allow_empty=allow_empty)
        parts = (windows[first : first + batch] for first in range(0, len(windows), batch))
        return self.predict_images(self.encoding.encode(part, self.grid) for part in parts)[:, 0]

    def predict_images(self, batches: Iterable[np.ndarray]) -> np.ndarray:
        """Predict the probability of free, (M, 1, H, W), from batches of encoded scans, uint8, (B, C, H, W)."""
        shown, inverted = progress(batches, "predicting"), self.encoding.is_inverted
        return np.concatenate([_sigmoid(self.network(to_input(images, inverted=inverted))) for images in shown])


def _sigmoid(logits: np.ndarray) -> np.ndarray:
    small = np.exp(-np.abs(logits))  # which does not overflow
    return np.where(logits >= 0, 1, small) / (1 + small)


def load_predictor(weights: str | Path) -> Predictor:
    """Load a predictor from an ONNX file.

    Args:
        weights: `indoor`, `buildings`, `rooms`, `drive`, `exp1` to `exp4`; an ONNX file, or a directory with one.
            `learning.networks.trained.load_trained` reads weights of torch.

    Raises:
        InputError: there are no such weights, the file differs from its checksum, or the network is not one from
            encoded scans to one map of finite logits.
    """
    path = locate(weights)
    file = onnx_file(path)
    if file is None:
        raise InputError(
            f"{path} has no {ONNX}: weights of torch need the study, {STUDY}; there, task=predict takes them, "
            "repro.learning.networks.trained.load_trained reads them, and task=export format=onnx exports a run"
        )
    return create_predictor(*read_onnx(file), file)


def create_predictor(network: Network, description: dict[str, Any], path: Path, largest_px: int = 4096) -> Predictor:
    """Create a predictor from a network and its description, see `description_of`, and check that they fit.

    Args:
        description: the content of its file, see `description_of`.
        path: the file, for messages.
        largest_px: side of the images with which it is checked, if its maps are larger.

    Raises:
        InputError: the description is of no predictor, or the network does not map images to one map of finite logits.
    """
    try:
        encoding, grid = create_encoding(**description["encoding"]), Grid(**description["grid"])
        if not isinstance(description.get("window", {}), dict):
            raise InputError(f"window: must be a mapping, got {description['window']!r}")
        statistics = Statistics(**description["statistics"]) if "statistics" in description else None
        predictor = Predictor(network, encoding, grid, statistics, **description.get("window", {}))
        size_px = min(grid.size_px, largest_px)
        logits = network(np.zeros((1, encoding.channels, size_px, size_px), np.float32))
        if logits.shape != (1, 1, size_px, size_px) or not np.isfinite(logits).all():
            raise InputError(f"it must map {encoding.channels} images of {size_px} px to one map of finite logits")
    except Exception as error:  # of the network or ours: the files are complete, and describe no predictor
        raise InputError(f"{path} cannot be used ({error}): train or export it again") from error
    return predictor


def description_of(predictor: Predictor) -> dict[str, Any]:
    """Return the description of a predictor in its file: encoding, grid, window, statistics."""
    content: dict[str, Any] = {
        "encoding": {"name": predictor.encoding.name, "parameters": vars(predictor.encoding)},
        "grid": dataclasses.asdict(predictor.grid),
        "window": {"steps": predictor.steps, "step_s": predictor.step_s, "has_fixed": predictor.has_fixed},
    }
    if predictor.is_centered:
        content["window"]["is_centered"] = True
    return content | ({"statistics": dataclasses.asdict(predictor.statistics)} if predictor.statistics else {})
