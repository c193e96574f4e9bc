"""Files of a prediction: probabilities, and a map for map_server."""

from pathlib import Path

import numpy as np
import yaml

from repro.prediction.stream_map import StreamMap

OCCUPIED_ABOVE = 0.65  # map_server's default probability of an obstacle
FREE_BELOW = 0.05  # probability of an obstacle; map_server's 0.25 would include pixels out of sight
UNKNOWN = 255  # in a map for map_server


def write_probabilities(path: Path, predicted: StreamMap) -> None:
    """Write a map as npz: `free`, `unknown` (H, W), row 0 at the top, origin [m], resolution [m] and stamp [s]."""
    np.savez_compressed(
        path,
        free=predicted.free.astype(np.float32),
        unknown=predicted.unknown,
        origin=np.array(predicted.origin),
        resolution=np.array(predicted.resolution_m),
        stamp=np.array(predicted.stamp),
    )


def write_map(stem: Path, predicted: StreamMap) -> None:
    """Write <stem>.pgm and <stem>.yaml as map_server reads them, in mode `raw`.

    A pixel is 0 below `FREE_BELOW`, 100 above `OCCUPIED_ABOVE`, in proportion between them, and `UNKNOWN` where no
    reading supports the map and no obstacle is predicted. Row 0 is the top. The origin is the lower left corner of the
    map in the frame of the log [m].

    Source: nav2_map_server, map_io.cpp.
    """
    occupied = 1 - predicted.free.astype(float)
    share = ((occupied - FREE_BELOW) / (OCCUPIED_ABOVE - FREE_BELOW)).clip(0, 1)
    is_unknown = predicted.unknown & (occupied <= OCCUPIED_ABOVE)
    pixels = np.where(is_unknown, UNKNOWN, np.rint(100 * share)).astype(np.uint8)
    height, width = pixels.shape
    stem.with_suffix(".pgm").write_bytes(b"P5\n%d %d\n255\n" % (width, height) + pixels.tobytes())
    content = {
        "image": stem.with_suffix(".pgm").name,
        "mode": "raw",
        "resolution": predicted.resolution_m,
        "origin": [*predicted.origin, 0.0],
        "negate": 0,
        "occupied_thresh": OCCUPIED_ABOVE,
        "free_thresh": FREE_BELOW,
    }
    stem.with_suffix(".yaml").write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
