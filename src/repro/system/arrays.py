"""Arrays from outside: only what was meant as numbers is taken as numbers."""

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from repro.system.errors import InputError
from repro.system.files import check_regular

UNPACKED_BYTES, PACKED = 2**28, 100  # of an npz: what is read of any file, and how many times more than the file


def real(name: str, values: Any, shape: tuple[int, ...] | None = None, *, kinds: str = "fiu") -> np.ndarray:
    """Return values as an array of real numbers; truth values, text, times, complex numbers and masks are none.

    Args:
        values: an array, or what becomes one.
        shape: the expected shape; None for any.
        kinds: of the types of NumPy that are taken, `f` where whole numbers would be rounded or of another unit.

    Raises:
        InputError: they are no such numbers, or have another shape.
    """
    expected = "real numbers" if "i" in kinds else "floating-point numbers"
    if isinstance(values, np.ma.MaskedArray):
        raise InputError(f"{name}: expected a plain array of {expected}, got a masked one")
    try:
        array = np.asarray(values)
    except (TypeError, ValueError) as error:  # of lists of different lengths, or of a tensor of a GPU
        raise InputError(f"{name}: expected an array of {expected}, got {type(values).__name__} ({error})") from error
    if array.dtype.kind not in kinds:
        raise InputError(f"{name}: expected {expected}, got {array.dtype}")
    if shape is not None and array.shape != shape:
        raise InputError(f"{name}: expected the shape {shape}, got {array.shape}")
    return array


@contextmanager
def open_arrays(path: Path) -> Iterator[np.lib.npyio.NpzFile]:
    """Open an npz file without executing code; unlike np.load(path), a damaged file is closed, too."""
    check_regular(path)
    _check_packed(path)
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
        yield arrays


def _check_packed(path: Path) -> None:
    """Refuse an npz whose arrays are far larger than the file, as zeros that fill the memory.

    Raises:
        InputError: they are.
        BadZipFile: it is no npz.
    """
    with zipfile.ZipFile(path) as archive:
        unpacked, size = sum(member.file_size for member in archive.infolist()), path.stat().st_size
    if unpacked > max(UNPACKED_BYTES, PACKED * size):
        raise InputError(
            f"{path}: its arrays have {1e-9 * unpacked:.1f} GB, {unpacked // size} times as much as the file"
        )
