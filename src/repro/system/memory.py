"""Memory of this machine and of this process, without importing torch."""

import ctypes
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import psutil

CGROUP = Path("/sys/fs/cgroup")  # version 2, in which containers and batch systems limit memory
OWN_GROUP = Path("/proc/self/cgroup")
M_TRIM_THRESHOLD, M_MMAP_MAX = -1, -4  # parameters of mallopt in the GNU C library


def keep_freed_memory() -> bool:
    """Let the C library keep the memory that this process frees, instead of returning it to the system.

    By default, every array of more than some megabytes is mapped anew and unmapped when it is freed, and its pages are
    cleared at their first use. For the activations of a training step this takes a quarter of the time of U-Net at
    256 px. The memory is reused within the process and returned when it ends.

    Returns:
        whether the C library has this setting; others than that of GNU do not.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    return mallopt is not None and bool(mallopt(M_MMAP_MAX, 0) and mallopt(M_TRIM_THRESHOLD, -1))


def available_memory_gb() -> float:
    """Return the memory that new processes can take [GB], within the limits of a container or a batch job."""
    limits = [limit - _used_bytes(group) for group, limit in _memory_limits()]
    return max(0, min([psutil.virtual_memory().available, *limits])) / 1e9


def total_memory_gb() -> float:
    """Return the memory of this machine [GB], within the limits of a container or a batch job."""
    return min([psutil.virtual_memory().total, *(limit for _, limit in _memory_limits())]) / 1e9


def _memory_limits() -> Iterator[tuple[Path, int]]:
    """Yield the control groups of this process that limit its memory, from its own up, and their limits [bytes]."""
    own = ""
    with suppress(OSError):
        lines = OWN_GROUP.read_text(encoding="utf-8").splitlines()
        own = next((line[3:].strip("/") for line in lines if line.startswith("0::")), "")
    for group in (CGROUP / own, *(CGROUP / own).parents):
        with suppress(OSError, ValueError):  # the group is outside of the container, or it has no limit: "max"
            yield group, int((group / "memory.max").read_text(encoding="utf-8"))
        if group == CGROUP:
            return


def _used_bytes(group: Path) -> int:
    """Return the memory of a control group that the kernel cannot take back, which excludes read files."""
    used = int((group / "memory.current").read_text(encoding="utf-8"))
    lines = (group / "memory.stat").read_text(encoding="utf-8").splitlines()
    return used - int(dict(line.split() for line in lines)["inactive_file"])
