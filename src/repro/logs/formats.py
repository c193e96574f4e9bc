"""Reading of logs, by the content of the file: our npz, CARMEN (plain or gzipped), ROS 1 and ROS 2 bags, MCAP."""

import gzip
import math
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from types import ModuleType
from typing import Any

from repro.logs.carmen import GZIP, is_carmen, read_carmen
from repro.logs.log_scan import LogScan
from repro.logs.npz import array_scans
from repro.logs.options import ReadOptions, WindowSettings
from repro.logs.scan_log import ScanLog, collect
from repro.system.errors import InputError

KINDS = "an npz with ranges, angles, poses and stamps, a CARMEN log, or a ROS 1, ROS 2 or MCAP bag"
CARMEN = "CARMEN"
HEAD_BYTES = 4096
BAGS = (b"#ROSBAG V2.0", b"\x89MCAP", b"SQLite format 3")


def read_log(
    path: Path,
    settings: WindowSettings,
    options: ReadOptions = ReadOptions(),  # noqa: B008
    others: Sequence[Path] = (),
) -> ScanLog:
    """Read a log.

    Args:
        path: a file, or the directory of a ROS 2 bag.
        options: what its file does not say.
        others: its other files, of the same kind: bags, such as of scans and of transforms, or parts in their order.

    Raises:
        InputError: one is missing, unreadable, empty, damaged or of another kind, or they hold no usable scans; the
            message names it and what was expected.
    """
    paths, kind = (path, *others), kind_of(path)
    if strange := next((other for other in others if kind_of(other) != kind), None):
        raise InputError(f"{strange}: expected the files of one log, all of the kind {kind}")
    if kind == "bag":
        return collect(_bags(path).bag_scans(paths, options), path, settings)
    if options.frame or options.scan_topic or options.odometry_topic:
        raise InputError(f"{path}: expected a bag for a topic or a frame of its poses, got {kind}")
    parts = (array_scans(part, options.pose) if kind == "npz" else read_carmen(part) for part in paths)
    return collect(_placed(chain.from_iterable(parts), options), path, settings)


def kind_of(path: Path) -> str:
    """Return the kind of a log: bag, npz or CARMEN; refuse one of no known kind."""
    if not path.exists():
        raise InputError(f"{path}: no such file: expected {KINDS}")
    if path.is_dir():
        return "bag"
    if not path.is_file():
        raise InputError(f"{path}: is neither a file nor a directory: expected {KINDS}")
    head = _head(path, open)
    if not head:
        raise InputError(f"{path}: is empty: expected {KINDS}")
    if head.startswith(BAGS):
        return "bag"
    if head.startswith(b"PK"):
        return "npz"
    if is_carmen(head) or (head.startswith(GZIP) and is_carmen(_head(path, gzip.open))):
        return CARMEN
    words = head.split(maxsplit=1)[:1] if b"\0" not in head else []
    first = f", but its first word is {words[0][:20].decode(errors='replace')!r}" if words else ""
    convert = "np.savez(path, ranges=..., angles=..., poses=..., stamps=...) makes an npz of any scans"
    raise InputError(f"{path}: is of no known kind: expected {KINDS}, unpacked{first}; {convert}")


def _head(path: Path, opener: Callable[..., Any]) -> bytes:
    try:
        with opener(path, "rb") as file:
            return bytes(file.read(HEAD_BYTES))
    except (gzip.BadGzipFile, zlib.error, EOFError) as error:
        raise InputError(f"{path}: is damaged ({error})") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}): expected {KINDS}") from error


def _bags(path: Path) -> ModuleType:
    try:
        from repro.logs import bags
    except ModuleNotFoundError as error:
        raise InputError(f"{path}: reading a bag needs the package rosbags: pip install rosbags") from error
    return bags


def _placed(scans: Iterator[LogScan], options: ReadOptions) -> Iterator[LogScan]:
    """Yield the scans with the pose of a lidar that stands, or that is mounted on the robot whose poses they have."""
    for scan in scans:
        if options.pose is not None:
            yield replace(scan, pose=options.pose)
        elif options.mounting is not None and scan.pose is not None:
            (x, y, heading), (ahead, left, turn) = scan.pose, options.mounting
            c, s = math.cos(heading), math.sin(heading)
            yield replace(scan, pose=(x + c * ahead - s * left, y + s * ahead + c * left, heading + turn))
        else:
            yield scan
