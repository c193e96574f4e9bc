"""A trained network together with its encoding and grid, which can be applied to any scans.

    predictor = load_predictor("buildings")
    free = predictor.predict(Scans(ranges, angles, poses))

The directory has the format of segmentation-models-pytorch (`smp.from_pretrained` can read it, except for an own
architecture) and one additional file, predictor.json, with the encoding of the scans, the grid of the map, and the
statistics and the window of the training scans, see `torch_files`. The other form is an ONNX file, see `onnx_files`.
"""

import copy
import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import torch
from huggingface_hub import PyTorchModelHubMixin
from torch import Tensor, nn

from repro.maps.encodings import Encoding, create_encoding
from repro.maps.grid import Grid
from repro.maps.statistics import Statistics
from repro.maps.validity import check_windows
from repro.networks.torch_files import DESCRIPTION, read_torch, write_torch
from repro.networks.weights import locate
from repro.scans import Scans
from repro.system.devices import few_threads
from repro.system.errors import InputError
from repro.system.progress import progress

ONNX = "model.onnx"
LARGEST_CHECKED_PX = 512  # side of the images with which a network of torch is checked, since a file may claim any


@dataclass(frozen=True)
class Predictor:
    """A network from encoded scans to logits, with the encoding of its input and the grid of its maps.

    Args:
        network: a network of torch, or one in ONNX Runtime.
        encoding: the encoding of the scans.
        grid: the grid of the maps.
        statistics: statistics of the training scans; None if they are unknown.
        steps: steps of a window in training, T.
        step_s: time of a step in training [s].
        has_fixed: the worlds of the training have fixed obstacles, whose place on the map the network has learned.
        is_centered: the network takes the robot to be in the middle of the map.
    """

    network: nn.Module
    encoding: Encoding
    grid: Grid
    statistics: Statistics | None = None
    steps: int = 100
    step_s: float = 0.1
    has_fixed: bool = False
    is_centered: bool = False

    @property
    def reach_m(self) -> float:
        """Return how far the encoding takes the pixels on the way of a miss as free [m], 0 if it does not."""
        return self.encoding.reach_m

    def with_range(self, range_max_m: float) -> "Predictor":
        """Return a predictor for a lidar that may reach less far than that of the training.

        Args:
            range_max_m: maximum range of the lidar [m], up to which a miss shows free space.

        Raises:
            ValueError: the range is not positive.
        """
        if not range_max_m > 0:
            raise InputError(f"range_max_m: expected a positive range [m], got {range_max_m}")
        if range_max_m >= self.reach_m:
            return self
        return dataclasses.replace(self, encoding=self.encoding.with_range(range_max_m))

    def check_center(self, center: str | tuple[float, float]) -> None:
        """Check that the map may have this center in the frame of the poses: `robot`, `start`, or x, y [m].

        Raises:
            ValueError: the network has learned another one.
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

    def predict(self, scans: Scans, batch: int = 32, *, allow_empty: bool = False) -> Tensor:
        """Predict the map at the last step of each window of scans.

        Args:
            scans: one window or a batch, in meters and radians; a miss is inf, an invalid reading NaN. The accuracy
                falls where a window has fewer or more steps than those of the training, `steps`.
            batch: windows per forward pass.
            allow_empty: accept windows of few valid readings, or of a robot outside the map.

        On the CPU, one thread computes unless the user has chosen more, see `devices.chosen_threads`.

        Returns:
            probability of free, (B, H, W), on the CPU; row 0 is the top of the map, and below 0.5 is an obstacle.

        Raises:
            TypeError: the scans are arrays instead of `Scans`.
            ValueError: the scans cannot be those of a lidar on this map, see `validity.check_windows`, or `batch` is
                less than 1.
        """
        if not isinstance(scans, Scans):
            raise TypeError(f"expected Scans(ranges, angles, poses), got {type(scans).__name__}")
        if batch < 1:
            raise InputError(f"batch: expected 1 window or more, got {batch}")
        with few_threads():
            device = next((weights.device for weights in self.network.parameters()), torch.device("cpu"))
            windows = scans.tensors(device)
            check_windows(windows, self.grid, allow_empty=allow_empty)
            parts = (windows[first : first + batch] for first in range(0, len(windows), batch))
            return self.predict_images(self.encoding.encode(part, self.grid) for part in parts)[:, 0]

    @torch.inference_mode()
    def predict_images(self, images: Tensor | Iterable[Tensor], batch: int = 32) -> Tensor:
        """Predict the probability of free, (M, 1, H, W), on the CPU, from encoded scans, uint8, (M, C, H, W).

        Args:
            images: all encoded scans, or batches of them.
            batch: images that the network receives at once, where `images` are no batches.
        """
        self.network.eval()
        batches = images.split(batch) if isinstance(images, Tensor) else images
        shown = progress(batches, "predicting")
        return torch.cat([self.network(self.encoding.to_input(each)).sigmoid().cpu() for each in shown])

    def to(self, device: str) -> "Predictor":
        """Move the network to a device, in place, and return the predictor."""
        self.network.to(device)
        return self

    def save(self, directory: Path | str, dtype: torch.dtype = torch.float32) -> str:
        """Write the network with its encoding and grid to a directory, atomically.

        Args:
            directory: directory to create, or to replace if it is empty or holds a predictor.
            dtype: type of the stored weights.

        Returns:
            the SHA-256 checksum of the weights file.

        Raises:
            ValueError: the network was loaded from an ONNX file, or the directory holds something else.
        """
        return write_torch(Path(directory), self.copied_network().to(dtype), self._description())

    def save_onnx(self, path: Path | str, card: str = "") -> float:
        """Write the network with its encoding and grid to an ONNX file, see `onnx_files.write_onnx`.

        Args:
            path: the file to create or replace.
            card: the model card, which the metadata of the file hold.

        Returns:
            the largest difference of a probability from that of torch.

        Raises:
            ValueError: the network was loaded from an ONNX file, or ONNX Runtime gives other maps than torch.
        """
        description = self._description() | {"channels": self.encoding.channels}
        return _onnx_files().write_onnx(Path(path), self.copied_network(), description, card)

    def copied_network(self) -> nn.Module:
        """Return a copy of the network.

        Raises:
            InputError: it is in ONNX Runtime.
        """
        if not isinstance(self.network, PyTorchModelHubMixin):
            raise InputError("the network is in ONNX Runtime: save or export the predictor of torch that it came from")
        return copy.deepcopy(self.network)

    def _description(self) -> dict[str, Any]:
        content: dict[str, Any] = {
            "encoding": {"name": self.encoding.name, "parameters": vars(self.encoding)},
            "grid": dataclasses.asdict(self.grid),
            "window": {"steps": self.steps, "step_s": self.step_s, "has_fixed": self.has_fixed},
        }
        if self.is_centered:
            content["window"]["is_centered"] = True
        return content | ({"statistics": dataclasses.asdict(self.statistics)} if self.statistics else {})


def load_predictor(weights: str | Path) -> Predictor:
    """Load a predictor in float32 on the CPU; the content of its path decides its kind.

    Args:
        weights: `buildings`, `rooms`, `drive`, `exp1` to `exp4`; a directory that `Predictor.save` wrote, a run that
            has one, or an ONNX file; or owner/name of a repository of the Hugging Face Hub.

    Raises:
        InputError: there are no such weights, their files differ from the saved checksum, or the network is not one
            from encoded scans to one map of finite logits.
    """
    with few_threads():
        path = locate(weights)
        if path.is_dir() and not (path / DESCRIPTION).is_file():
            path = next((path / name for name in (ONNX, "model") if (path / name).exists()), path)
        network, content = _onnx_files().read_onnx(path) if path.is_file() else read_torch(path)
        try:
            encoding, grid = create_encoding(**content["encoding"]), Grid(**content["grid"])
            statistics = Statistics(**content["statistics"]) if "statistics" in content else None
            predictor = Predictor(network, encoding, grid, statistics, **content.get("window", {}))
            size_px = grid.size_px if path.is_file() else min(grid.size_px, LARGEST_CHECKED_PX)
            _check_logits(network, encoding.channels, size_px)
        except Exception as error:  # of torch or ours: the files are complete, and describe no predictor
            raise InputError(f"{path} cannot be used ({error}): train or export it again") from error
        return predictor


@torch.inference_mode()
def _check_logits(network: nn.Module, channels: int, size_px: int) -> None:
    """Refuse weights that are not finite, and a network that does not map images to one map of finite logits."""
    if not all(torch.isfinite(weights).all() for weights in network.state_dict().values()):
        raise InputError("some of its weights are not finite")
    logits = network.eval()(torch.zeros(1, channels, size_px, size_px))
    if logits.shape != (1, 1, size_px, size_px) or not torch.isfinite(logits).all():
        raise InputError(f"it must map {channels} images of {size_px} px to one map of finite logits")


def _onnx_files() -> ModuleType:
    from repro.networks import onnx_files  # imports onnx and ONNX Runtime, which nothing else needs

    return onnx_files
