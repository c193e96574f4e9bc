"""Outlines of obstacles: polygons and line strings in the frame of their obstacle, padded to one number of vertices."""

import numpy as np


def placed(outlines: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Transform outlines to the frame of the world.

    Args:
        outlines: outlines in their own frames [m], (..., V, 2).
        states: obstacle poses x, y [m], heading [rad], (..., 3); the leading axes broadcast.

    Returns:
        outlines in the world [m], (..., V, 2).
    """
    x, y, heading = (states[..., axis, None] for axis in range(3))
    own_x, own_y = outlines[..., 0], outlines[..., 1]
    cos, sin = np.cos(heading), np.sin(heading)
    return np.stack([own_x * cos - own_y * sin + x, own_x * sin + own_y * cos + y], -1)


def standing(states: np.ndarray) -> np.ndarray:
    """Return which obstacles do not move during a recording, bool, (K,), from their poses at each step, (K, T, 3)."""
    return ~(np.ptp(states, axis=1) > 0).any(-1)


def padded(outlines: np.ndarray, vertices: int) -> np.ndarray:
    """Pad outlines (O, V, 2) to more vertices by repeating the last one."""
    return np.pad(outlines, ((0, 0), (0, vertices - outlines.shape[1]), (0, 0)), mode="edge")
