"""Device, precision, compiler, clock, memory and hardware of a computation."""

import logging
import os
import platform
import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import torch

from repro.system.errors import InputError
from repro.system.threads import count_threads

log = logging.getLogger(__name__)


def resolve_device(accelerator: str = "auto") -> str:
    """Return the device for an accelerator setting on this machine.

    Args:
        accelerator: `auto` (cuda if a CUDA GPU is visible, else cpu), `cpu` or `gpu`.

    Returns:
        `cuda` or `cpu`.

    Raises:
        InputError: the accelerator is unknown, or it is `gpu` and no CUDA GPU is visible.
    """
    if accelerator not in ("auto", "cpu", "gpu"):
        raise InputError(f"runtime.accelerator must be auto, cpu or gpu, got {accelerator!r}")
    if accelerator == "gpu" and not torch.cuda.is_available():
        raise InputError("runtime.accelerator=gpu, but no CUDA GPU is visible: use auto or cpu")
    return "cuda" if accelerator != "cpu" and torch.cuda.is_available() else "cpu"


def resolve_precision(precision: str, device: str) -> str:
    """Return the precision for a device; `auto` is bf16-mixed if the device has native bfloat16, else 32-true."""
    if precision != "auto":
        if "bf16" in precision and not has_bfloat16(device):
            log.warning(
                "warning: runtime.precision=%s is emulated on this device, many times slower than 32-true", precision
            )
        return precision
    return "bf16-mixed" if has_bfloat16(device) else "32-true"


def has_bfloat16(device: str) -> bool:
    """Check whether a device multiplies in bfloat16 natively; a CPU does with AVX-512 BF16 or AMX."""
    if device == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    capabilities = torch.cpu.get_capabilities()
    return bool(capabilities.get("avx512_bf16") or capabilities.get("amx_bf16"))


@contextmanager
def few_threads(number: int | None = None) -> Iterator[None]:
    """Compute on a number of CPU threads, those of `system.threads` if it is None, and restore that of the caller."""
    before = torch.get_num_threads()
    torch.set_num_threads(number or count_threads())
    try:
        yield
    finally:
        torch.set_num_threads(before)


one_thread = partial(few_threads, 1)  # as the trainings of a sweep


def clock(device: str) -> float:
    """Return the time of a clock [s] after the device has finished all queued work."""
    if device == "cuda":
        torch.cuda.synchronize()
    return time.perf_counter()


def forget_peak_memory() -> None:
    """Reset `peak_memory_gb` if the system supports it (Linux); otherwise it covers the life of the process."""
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="utf-8")
    except OSError:
        return


def peak_memory_gb() -> float:
    """Return the peak resident memory of this process [GB], without GPU memory."""
    try:
        status = Path("/proc/self/status").read_text(encoding="utf-8")
        return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e9
    except (OSError, IndexError):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9


def hardware() -> dict[str, Any]:
    """Describe the machine and the number of threads, which affect the last digits; `gpu` is None without one."""
    return {
        "machine": platform.machine(),
        "cpu": torch.cpu.get_capabilities().get("cpu_name"),
        "cpu_cores": os.cpu_count(),
        "threads": torch.get_num_threads(),
        "gpu": torch.cuda.get_device_name() if torch.cuda.is_available() else None,
    }
