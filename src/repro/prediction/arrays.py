"""Scans of npz logs, whose headers are checked before an array is read: a small file may promise a huge one."""

import math
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from repro.prediction.intake import LogScan
from repro.system.errors import InputError
from repro.system.files import first_line, open_arrays
from repro.system.memory import available_memory_gb

BYTES_PER_READING = 25  # of memory while a log is read, measured
ARRAYS = ("ranges", "angles", "poses", "stamps")
RANGE_MAX = "range_max_m"
MAX_NAMED = 10  # arrays of a file that a message names
RESOLUTION_M = 0.01  # of a position
HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def array_scans(path: Path, pose: tuple[float, float, float] | None = None) -> Iterator[LogScan]:
    """Read the scans of an npz log.

    Args:
        path: the file.
        pose: x, y [m] and heading [rad] of a lidar that stands, whose log needs no poses; None for one that moves.

    Raises:
        InputError: the file is damaged, lacks an array, or has one of another shape or size.
    """
    content = read_arrays(path, needs_poses=pose is None)
    ranges, angles, poses, stamps = (content[name] for name in ARRAYS)
    shapes = [array.shape for array in (ranges, angles, poses, stamps)]
    if ranges.ndim != 2 or shapes[1:] != [ranges.shape[1:], (len(ranges), 3), (len(ranges),)]:
        raise InputError(f"{path}: expected ranges (S, N), angles (N,), poses (S, 3), stamps (S,), got {shapes}")
    gaps = np.diff(angles)
    if not len(gaps) or not np.isfinite(gaps).all() or np.abs(gaps - gaps.mean()).max() > 0.01 * abs(gaps.mean()):
        raise InputError(f"{path}: the beam angles are not evenly spaced: resample the scans first")
    first, spacing, range_max_m = float(angles[0]), float(gaps.mean()), float(content[RANGE_MAX])
    for stamp, scan, (x, y, heading) in zip(stamps, ranges, poses, strict=True):
        yield LogScan(float(stamp), scan, first, spacing, 0.0, range_max_m, (x, y, heading))


def read_arrays(path: Path, *, needs_poses: bool = True) -> dict[str, np.ndarray]:
    """Read the arrays of an npz log as float64.

    Args:
        path: the file.
        needs_poses: whether poses must be there; they are zero where they are not.

    Returns:
        `ARRAYS` and `range_max_m`, the maximum range [m], shape (), which is inf where the file has none.

    Raises:
        ValueError: the file is damaged, lacks an array, or has one that is not of real numbers or too large.
    """
    try:
        with open_arrays(path) as content:
            missing = [name for name in ARRAYS if name not in content and (needs_poses or name != "poses")]
            if missing:
                hint = ". For a lidar that stands, set prediction.pose=fixed" if missing == ["poses"] else ""
                raise InputError(
                    f"{path}: lacks {', '.join(missing)}: expected {', '.join(ARRAYS)}, got "
                    f"{', '.join(list(content)[:MAX_NAMED]) or 'no array'}{hint}"
                )
            assert content.zip, "it is open"
            names = [name for name in (*ARRAYS, RANGE_MAX) if name in content]
            for name in names:
                _check_header(path, content.zip, name)
            arrays = {name: content[name] for name in names}
            arrays.setdefault("poses", np.zeros((len(arrays["stamps"].ravel()), 3)))
            _check_resolution(path, arrays["poses"])
            found = {name: np.asarray(array, dtype=float) for name, array in arrays.items()}
    except InputError:
        raise
    except Exception as error:  # NumPy and zipfile raise many types for damaged files
        expected = f"expected {', '.join(ARRAYS)}"
        raise InputError(f"{path}: cannot be read ({type(error).__name__}: {first_line(error)}): {expected}") from error
    range_max_m = found.get(RANGE_MAX, np.array(math.inf))
    if range_max_m.size != 1:
        raise InputError(f"{path}: {RANGE_MAX}: expected one number, got an array of shape {range_max_m.shape}")
    return found | {RANGE_MAX: range_max_m.reshape(())}


def _check_resolution(path: Path, poses: np.ndarray) -> None:
    """Check that the type of the poses resolves positions of their size.

    Raises:
        ValueError: it does not, as float32 in coordinates of a whole country.
    """
    places = poses[..., :2]
    farthest_m = np.abs(places[np.isfinite(places)]).max(initial=0)
    step_m = np.spacing(farthest_m)
    if step_m > RESOLUTION_M:
        raise InputError(
            f"{path}: poses: {poses.dtype} resolves {step_m:.2g} m at positions of {farthest_m:.3g} m: "
            "store them as float64, relative to a near origin"
        )


def _check_header(path: Path, archive: zipfile.ZipFile, name: str) -> None:
    """Check the type and the size of an array without reading it.

    Raises:
        ValueError: it is not of real numbers, or larger than its data or the memory.
    """
    member = archive.getinfo(f"{name}.npy")
    with archive.open(member) as file:
        shape, _, dtype = HEADERS[np.lib.format.read_magic(file)](file)
        stored_bytes = member.file_size - file.tell()
    if dtype.kind not in "fiu":
        raise InputError(f"{path}: {name}: expected real numbers, got {dtype}")
    count = math.prod(shape)
    if count * dtype.itemsize > stored_bytes:
        raise InputError(f"{path}: {name}: is damaged: shape {shape} of {dtype}, but {stored_bytes} bytes of data")
    needed_gb, available_gb = count * BYTES_PER_READING / 1e9, available_memory_gb()
    if needed_gb > available_gb:
        raise InputError(f"{path}: {name}: needs {needed_gb:.3g} GB of memory, {available_gb:.3g} GB are available")
