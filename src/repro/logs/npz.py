"""Scans of npz logs."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from repro.logs.log_scan import LogScan
from repro.system.arrays import open_arrays, real
from repro.system.errors import InputError
from repro.system.files import first_line

ARRAYS = ("ranges", "angles", "poses", "stamps")
RANGE_MAX = "range_max_m"
MAX_NAMED = 10  # arrays of a file that a message names
RESOLUTION_M, RESOLUTION_S = 0.01, 0.02  # of a position and of a time


def array_scans(path: Path, pose: tuple[float, float, float] | None = None) -> Iterator[LogScan]:
    """Read the scans of an npz log.

    Args:
        pose: x, y [m] and heading [rad] of a lidar that stands, whose log needs no poses; None for one that moves.

    Raises:
        InputError: the file is damaged, lacks an array, or has one of another shape, type or size.
    """
    content = _read(path, needs_poses=pose is None)
    ranges, angles, stamps = (content[name].astype(float) for name in ("ranges", "angles", "stamps"))
    poses = content.get("poses", np.zeros((stamps.size, 3)))
    range_max_m = np.asarray(content.get(RANGE_MAX, math.inf))
    shapes = [array.shape for array in (ranges, angles, poses, stamps)]
    if ranges.ndim != 2 or shapes[1:] != [ranges.shape[1:], (len(ranges), 3), (len(ranges),)]:
        raise InputError(f"{path}: expected ranges (S, N), angles (N,), poses (S, 3), stamps (S,), got {shapes}")
    if range_max_m.size != 1:
        raise InputError(f"{path}: {RANGE_MAX}: expected one number, got an array of shape {range_max_m.shape}")
    _check_resolution(path, poses)
    _check_stamps(path, content["stamps"])
    gaps = np.diff(angles)
    if not len(gaps) or not np.isfinite(gaps).all() or np.abs(gaps - gaps.mean()).max() > 0.01 * abs(gaps.mean()):
        raise InputError(f"{path}: the beam angles are not evenly spaced: resample the scans first")
    beams = float(angles[0]), float(gaps.mean()), 0.0, float(range_max_m.item())
    for stamp, scan, (x, y, heading) in zip(stamps, ranges, poses.astype(float), strict=True):
        yield LogScan(float(stamp), scan, *beams, (x, y, heading))


def _read(path: Path, *, needs_poses: bool) -> dict[str, np.ndarray]:
    """Return the arrays of an npz log that are used, of real numbers; poses and maximum range may be missing."""
    try:
        with open_arrays(path) as content:
            missing = [name for name in ARRAYS if name not in content and (needs_poses or name != "poses")]
            if missing:
                hint = ". For a lidar that stands, set prediction.pose=fixed" if missing == ["poses"] else ""
                raise InputError(
                    f"{path}: lacks {', '.join(missing)}: expected {', '.join(ARRAYS)}, got "
                    f"{', '.join(list(content)[:MAX_NAMED]) or 'no array'}{hint}"
                )
            arrays = {name: content[name] for name in (*ARRAYS, RANGE_MAX) if name in content}
    except InputError:
        raise
    except Exception as error:  # NumPy and zipfile raise many types for damaged files
        if "pickle" in str(error):
            raise InputError(f"{path}: has Python objects: expected arrays of numbers, {', '.join(ARRAYS)}") from error
        expected = f"expected {', '.join(ARRAYS)}"
        raise InputError(f"{path}: cannot be read ({type(error).__name__}: {first_line(error)}): {expected}") from error
    kinds = {"ranges": "f"}  # whole numbers are rounded, or mm
    return {name: real(f"{path}: {name}", array, kinds=kinds.get(name, "fiu")) for name, array in arrays.items()}


def _check_stamps(path: Path, stamps: np.ndarray) -> None:
    """Refuse times whose type does not resolve them, as float32 since 1970 or float16."""
    last_s = np.abs(stamps[np.isfinite(stamps)]).max(initial=0)
    if stamps.dtype.kind == "f" and np.spacing(last_s) > RESOLUTION_S:
        raise InputError(
            f"{path}: stamps: {stamps.dtype} resolves {np.spacing(last_s):.2g} s at {last_s:.4g} s: expected seconds, "
            "stored as float64"
        )


def _check_resolution(path: Path, poses: np.ndarray) -> None:
    """Refuse poses whose type does not resolve positions of their size, as float32 in coordinates of a country."""
    places = poses[..., :2]
    farthest_m = np.abs(places[np.isfinite(places)]).max(initial=0)
    step_m = np.spacing(farthest_m) if poses.dtype.kind == "f" else 1
    if step_m > RESOLUTION_M:
        raise InputError(
            f"{path}: poses: {poses.dtype} resolves {step_m:.2g} m at positions of {farthest_m:.3g} m: "
            "store them as float64, relative to a near origin"
        )
