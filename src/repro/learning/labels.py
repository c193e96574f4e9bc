"""Windows with labels of a part of their maps, from the beams of a log or from simulated worlds, see `adaptation`."""

from dataclasses import dataclass

import numpy as np
import torch

from repro.maps.statistics import Statistics, summarize
from repro.networks.predictor import Predictor
from repro.recordings.datasets import Pairs, packed
from repro.scans import Scans

UNKNOWN = 4  # added to the pixels of a map whose label is unknown; `datasets.HIDDEN` is 2
MOVER = 8  # added where something that moves and was in view lately can be


@dataclass(frozen=True)
class Labeled:
    """Windows of logs with partial labels.

    Args:
        pairs: encoded scans, and maps of which 1 is free, 0 an obstacle and 4 unknown, and 2 more where standing
            obstacles hide the pixel, as in `Pairs`, and 8 more where something that moves can be.
        statistics: those of the windows.
    """

    pairs: Pairs
    statistics: Statistics


def drawn(windows: list[Scans], labels: list[np.ndarray], predictor: Predictor) -> Labeled:
    """Encode windows, (T, N), on their maps, with the codes of their maps, (H, W), see `Labeled`."""
    encoding, grid = predictor.encoding, predictor.grid
    images = [packed(encoding.encode(scans.batched(), grid), encoding) for scans in windows]
    maps = torch.from_numpy(np.stack(labels).astype(np.uint8))[:, None]
    statistics = summarize((scans.batched() for scans in windows), grid)
    return Labeled(Pairs(torch.cat(images), maps, encoding), statistics)
