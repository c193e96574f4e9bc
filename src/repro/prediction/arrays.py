"""The arrays of an npz log, whose headers are checked before an array is read: a small file may promise a huge one."""

import math
import zipfile
from pathlib import Path

import numpy as np

from repro.system.errors import InputError
from repro.system.files import first_line, open_arrays
from repro.system.memory import available_memory_gb

ARRAYS = ("ranges", "angles", "poses", "stamps")
RANGE_MAX = "range_max_m"
RESOLUTION_M = 0.01  # of a position
HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """Read the arrays of an npz log as float64.

    Args:
        path: the file.

    Returns:
        `ARRAYS` and `range_max_m`, the maximum range [m], shape (), which is inf where the file has none.

    Raises:
        ValueError: the file is damaged, lacks an array, or has one that is not of real numbers or too large.
    """
    try:
        with open_arrays(path) as content:
            missing = [name for name in ARRAYS if name not in content]
            if missing:
                raise InputError(f"{path}: lacks {', '.join(missing)}: expected {', '.join(ARRAYS)}")
            assert content.zip, "it is open"
            names = (*ARRAYS, RANGE_MAX) if RANGE_MAX in content else ARRAYS
            for name in names:
                _check_header(path, content.zip, name)
            arrays = {name: content[name] for name in names}
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
    needed_gb, available_gb = count * 8 / 1e9, available_memory_gb()
    if needed_gb > available_gb:
        raise InputError(f"{path}: {name}: needs {needed_gb:.3g} GB of memory, {available_gb:.3g} GB are available")
