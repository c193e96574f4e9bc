"""Images of two gray values in an eighth of their memory: one bit per pixel."""

import numpy as np
import torch
from torch import Tensor


def pack_bits(images: Tensor) -> Tensor:
    """Pack images of 0 and 255, uint8, (..., W), into bits, uint8, (..., W / 8), rounded up; on the same device."""
    return torch.from_numpy(np.packbits(images.cpu().numpy() > 0, axis=-1)).to(images.device)


def unpack_bits(bits: Tensor, width: int) -> Tensor:
    """Return the images of 0 and 255, uint8, (..., W), that were packed into bits, given their width W."""
    shifts = torch.arange(7, -1, -1, dtype=torch.uint8, device=bits.device)
    return (bits[..., None] >> shifts).bitwise_and_(1).mul_(255).flatten(-2)[..., :width]
