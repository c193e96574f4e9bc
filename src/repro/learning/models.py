"""The four image-to-image networks of the paper, from segmentation-models-pytorch."""

import contextlib
import io
import time
from pathlib import Path

import segmentation_models_pytorch as smp
import torch
from segmentation_models_pytorch.base import SegmentationModel

ARCHITECTURES = ("unet", "fpn", "upernet", "segformer")


def create_model(
    architecture: str, *, encoder_name: str = "mit_b0", encoder_weights: str | None = None
) -> SegmentationModel:
    """Creates a network from one gray image (B, 1, H, W) to one map of logits (B, 1, H, W).

    Paper: "Prediction Models". Encoder weights and channels are not stated: DEVIATIONS D9.

    Args:
        architecture: one of `ARCHITECTURES`.
        encoder_name: an smp encoder.
        encoder_weights: None to start from scratch, or `imagenet`.

    Raises:
        ValueError: the architecture is unknown, or the encoder weights cannot be had.
    """
    if architecture not in ARCHITECTURES:
        raise ValueError(f"architecture must be one of {', '.join(ARCHITECTURES)}, got {architecture!r}")
    try:
        return smp.create_model(
            architecture, encoder_name=encoder_name, encoder_weights=encoder_weights, in_channels=1, classes=1
        )
    except Exception as error:
        if encoder_weights is None:
            raise
        raise ValueError(
            f"the {encoder_weights} weights of {encoder_name} could not be had ({type(error).__name__}: {error}); "
            "connect to the internet once, or train from scratch with model.encoder_weights=null"
        ) from error


def load_model(directory: Path) -> SegmentationModel:
    """Loads a network from the weights that `save_pretrained` wrote."""
    with contextlib.redirect_stdout(io.StringIO()):  # huggingface_hub prints where the weights come from
        return smp.from_pretrained(directory)


def resolve_device(accelerator: str = "auto") -> str:
    """The device an accelerator (auto, cpu, gpu) means here: cuda where there is one and it is not ruled out."""
    return "cuda" if accelerator != "cpu" and torch.cuda.is_available() else "cpu"


def clock(device: str) -> float:
    """Seconds on a clock, read once the device has done all it was given."""
    if device == "cuda":
        torch.cuda.synchronize()
    return time.perf_counter()


def resolve_precision(precision: str, device: str) -> str:
    """What `auto` means on a device: bf16-mixed where it computes in bfloat16 natively, else 32-true."""
    if precision != "auto":
        return precision
    native = torch.cuda.is_bf16_supported(including_emulation=False) if device == "cuda" else _cpu_has_bf16()
    return "bf16-mixed" if native else "32-true"


def _cpu_has_bf16() -> bool:
    """Whether the CPU multiplies in bfloat16 itself: with AVX-512 BF16 or AMX."""
    capabilities = torch.cpu.get_capabilities()
    return bool(capabilities.get("avx512_bf16") or capabilities.get("amx_bf16"))


def compiles(architecture: str, encoder_name: str, size_px: int, device: str) -> bool:
    """Tries torch.compile on a network of its own, forward and backward; says why where it fails."""
    network = create_model(architecture, encoder_name=encoder_name).to(device)
    network.compile()
    try:
        network(torch.zeros(2, 1, size_px, size_px, device=device)).sum().backward()
    except Exception as error:  # whatever the compiler raises, the network itself works without it
        print(f"torch.compile fails here ({type(error).__name__}), going on without it")
        return False
    return True
