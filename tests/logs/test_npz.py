"""Arrays of npz logs that are damaged, of other types, or larger than the file or the memory."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
from log_files import ANGLES, BEAMS, POSES, RANGES, SCANS, STAMPS, npz, read


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"angles": None}, "lacks angles"),
        ({"poses": POSES[:-1]}, "expected ranges"),
        ({"ranges": RANGES[0]}, "expected ranges"),
        ({"angles": ANGLES**3}, "not evenly spaced"),
        ({"angles": np.degrees(ANGLES)}, "in radians"),
        ({"angles": np.full(BEAMS, np.nan)}, "not evenly spaced"),
        ({"ranges": np.array([[object()]])}, "log.npz: has Python objects: expected arrays of numbers"),
        ({"range_max_m": -1.0}, "positive maximum range"),
        ({"range_max_m": np.array([12.0, 13.0])}, r"range_max_m: expected one number, got an array of shape \(2,\)"),
        ({"range_max_m": np.array("far")}, "range_max_m: expected real numbers, got <U3"),
        ({"ranges": RANGES + 1j}, "ranges: expected floating-point numbers, got complex128"),
        ({"ranges": RANGES > 2.5}, "ranges: expected floating-point numbers, got bool"),
        ({"ranges": RANGES.astype(np.int16)}, "ranges: expected floating-point numbers, got int16"),
        ({"ranges": RANGES.astype("m8[s]")}, r"ranges: expected floating-point numbers, got timedelta64\[s\]"),
        (
            {"stamps": STAMPS.astype(np.float16)},
            r"stamps: float16 resolves 0\.062 s at 102\.9 s: expected seconds, stored",
        ),
        ({"poses": POSES > 0}, "poses: expected real numbers, got bool"),
        ({"poses": POSES.astype(int)}, "poses: int64 resolves 1 m at positions"),
        (
            {"poses": (POSES + np.array([5e5, 5.4e6, 0])).astype(np.float32)},
            r"poses: float32 resolves 0\.5 m at positions of 5\.4e\+06 m: store them as float64",
        ),
        ({"poses": POSES * 1e300}, "poses: float64 resolves .* m at positions of"),
        ({"stamps": STAMPS.astype("datetime64[s]")}, r"stamps: expected real numbers, got datetime64\[s\]"),
    ],
)
def test_arrays_that_are_no_log_are_refused(change, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        read(npz(tmp_path / "log.npz", **change))


def test_a_member_that_is_no_array_and_one_that_would_fill_the_memory_are_refused(tmp_path):
    path = npz(tmp_path / "log.npz", ranges=None)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("ranges", b"no array")
    with pytest.raises(ValueError, match=r"ranges: expected floating-point numbers, got .S8"):
        read(path)
    npz(path, ranges=None)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive, archive.open("ranges.npy", "w") as member:
        for _ in range(300):
            member.write(bytes(2**20))
    with pytest.raises(ValueError, match=r"log.npz: its arrays have 0\.3 GB, \d+ times as much as the file"):
        read(path)


def write(path: Path, shape: str, data: bytes, method: int = zipfile.ZIP_DEFLATED) -> None:
    """Write a log whose ranges have a header and data that may not belong together."""
    npz(path, ranges=None)
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    with zipfile.ZipFile(path, "a", method) as archive:
        archive.writestr("ranges.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + data)


@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA])
def test_npz_files_with_damaged_data_are_refused(method, tmp_path):
    """Bytes at many places are altered; the checksum of the archive finds all of them."""
    path = tmp_path / "log.npz"
    write(path, f"({SCANS}, {BEAMS})", RANGES.tobytes(), method)
    with zipfile.ZipFile(path) as archive:
        member = archive.getinfo("ranges.npy")
    begin, end = member.header_offset + 40, member.header_offset + member.compress_size
    data = path.read_bytes()
    assert len(read(path)) == SCANS
    for place in range(begin, end, (end - begin) // 40):
        path.write_bytes(data[:place] + b"\xff" * 20 + data[place + 20 :])
        with pytest.raises(ValueError, match=r"cannot be read|is damaged|expected real numbers"):
            read(path)
