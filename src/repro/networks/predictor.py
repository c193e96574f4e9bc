"""A trained network with all it needs to be used on anyone's scans: its encoding and its grid.

    predictor = load_predictor("outputs/laptop/runs/exp4/unet/decay/seed0/model")
    free = predictor.predict(Scans(ranges, angles, poses))

The directory is an ordinary one of segmentation-models-pytorch (`smp.from_pretrained` reads it too, but for a ConvLSTM)
with one file more, predictor.json, which says how scans are to be drawn for the network and how large the map is.
"""

import contextlib
import copy
import dataclasses
import io
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor
from tqdm import tqdm

from repro.maps.encodings import Encoding, create_encoding
from repro.maps.grid import Grid
from repro.networks.create import Network, load_network
from repro.scans import Scans
from repro.system.files import read_mapping, replacing_directory, sha256, write_json

WEIGHTS = "model.safetensors"


@dataclass(frozen=True)
class Predictor:
    """A network from encoded scans to logits, how it wants its scans drawn, and the map it draws."""

    network: Network
    encoding: Encoding
    grid: Grid

    def predict(self, scans: Scans, batch: int = 32) -> Tensor:
        """Predicts the whole map at the last step of each window of scans.

        Args:
            scans: one window or a batch, in metres and radians; a miss is inf.
            batch: windows at a time.

        Returns:
            probability of free, (B, H, W), on the CPU; row 0 is the top of the map, below 0.5 is an obstacle.
        """
        device = next(self.network.parameters()).device
        windows = scans.tensors(device)
        parts = [windows[first : first + batch] for first in range(0, len(windows), batch)]
        return torch.cat([self.predict_images(self.encoding.encode(part, self.grid)) for part in parts])[:, 0]

    @torch.inference_mode()
    def predict_images(self, images: Tensor, batch: int = 32) -> Tensor:
        """Predicts from encoded scans (M, C, H, W), uint8: probability of free, (M, 1, H, W), on the CPU."""
        self.network.eval()
        parts = tqdm(images.split(batch), desc="predicting", delay=2, leave=False, disable=None)
        return torch.cat([self.network(self.encoding.to_input(part)).sigmoid().cpu() for part in parts])

    def to(self, device: str) -> "Predictor":
        """Moves the network to a device."""
        return dataclasses.replace(self, network=self.network.to(device))

    def save(self, directory: Path, dtype: torch.dtype = torch.float32) -> str:
        """Writes the network with its encoding and grid, the directory whole or not at all.

        Args:
            directory: made or replaced.
            dtype: in which the weights are stored.

        Returns:
            the SHA-256 of the weights' file.
        """
        with replacing_directory(directory) as new:
            copy.deepcopy(self.network).to(dtype).save_pretrained(new)
            checksum = sha256(new / WEIGHTS)
            parameters = dataclasses.asdict(self.encoding)  # type: ignore[call-overload]
            content = {
                "encoding": {"name": self.encoding.name, "parameters": parameters},
                "grid": dataclasses.asdict(self.grid),
                "sha256": checksum,
            }
            write_json(new / "predictor.json", content)
        return checksum


def load_predictor(directory: str | Path) -> Predictor:
    """Loads what `Predictor.save` wrote, in float32 on the CPU.

    Raises:
        ValueError: the directory holds no predictor, or its weights are not those that were saved.
    """
    directory = Path(directory)
    fix = f"{directory} must be written by a training or by task=export"
    content = read_mapping(directory / "predictor.json", fix)
    if not (directory / WEIGHTS).is_file() or sha256(directory / WEIGHTS) != content.get("sha256"):
        raise ValueError(f"{directory / WEIGHTS} is not what was saved: put it back, or train or export it again")
    with contextlib.redirect_stdout(io.StringIO()):  # huggingface_hub prints where the weights come from
        network = load_network(directory)
    return Predictor(network, create_encoding(**content["encoding"]), Grid(**content["grid"]))
