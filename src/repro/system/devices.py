"""What a computation runs on: device, precision, compiler, clock."""

import os
import platform
import resource
import time
from pathlib import Path
from typing import Any

import torch


def resolve_device(accelerator: str = "auto") -> str:
    """Finds the device that an accelerator means here.

    Args:
        accelerator: `auto` (cuda where there is one), `cpu` or `gpu`.

    Returns:
        `cuda` or `cpu`.

    Raises:
        ValueError: the accelerator is unknown, or it is `gpu` and no CUDA GPU is visible.
    """
    if accelerator not in ("auto", "cpu", "gpu"):
        raise ValueError(f"runtime.accelerator must be auto, cpu or gpu, got {accelerator!r}")
    if accelerator == "gpu" and not torch.cuda.is_available():
        raise ValueError("runtime.accelerator=gpu, but no CUDA GPU is visible: use auto or cpu")
    return "cuda" if accelerator != "cpu" and torch.cuda.is_available() else "cpu"


def resolve_precision(precision: str, device: str) -> str:
    """Finds what `auto` means on a device: bf16-mixed where it computes in bfloat16 natively, else 32-true."""
    if precision != "auto":
        if "bf16" in precision and not has_bfloat16(device):
            print(f"warning: runtime.precision={precision} is only emulated here, many times slower than 32-true")
        return precision
    return "bf16-mixed" if has_bfloat16(device) else "32-true"


def has_bfloat16(device: str) -> bool:
    """Says whether a device multiplies in bfloat16 itself; a CPU does with AVX-512 BF16 or AMX."""
    if device == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    capabilities = torch.cpu.get_capabilities()
    return bool(capabilities.get("avx512_bf16") or capabilities.get("amx_bf16"))


def clock(device: str) -> float:
    """Reads a clock [s] once the device has done all it was given."""
    if device == "cuda":
        torch.cuda.synchronize()
    return time.perf_counter()


def compiles(network: torch.nn.Module, image: torch.Tensor) -> bool:
    """Tries torch.compile on a network to spare, forward and backward; says why where it fails."""
    network.compile()
    try:
        network(image).sum().backward()
    except Exception as error:  # whatever the compiler raises, the network itself works without it
        print(f"torch.compile fails here ({type(error).__name__}), going on without it")
        return False
    return True


def forget_peak_memory() -> None:
    """Makes `peak_memory_gb` begin anew, where the system can (Linux); else it is that of the whole process."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return


def peak_memory_gb() -> float:
    """Reads the most memory that this process has held, of the machine's and not of a GPU's [GB]."""
    try:
        status = Path("/proc/self/status").read_text()
        return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e9
    except (OSError, IndexError):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9


def hardware() -> dict[str, Any]:
    """Describes the machine, and the threads it computes with here, on which the last digits depend; GPU or None."""
    return {
        "machine": platform.machine(),
        "cpu": torch.cpu.get_capabilities().get("cpu_name"),
        "cpu_cores": os.cpu_count(),
        "threads": torch.get_num_threads(),
        "gpu": torch.cuda.get_device_name() if torch.cuda.is_available() else None,
    }
