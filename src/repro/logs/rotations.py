"""Rotations and poses in space, of the few operations that frames need, with the names that SciPy gives them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Rotation:
    """A rotation as a quaternion of length one: x, y, z, w."""

    quaternion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)

    @classmethod
    def from_quat(cls, quaternion: Sequence[float]) -> "Rotation":
        """Return the rotation of a quaternion x, y, z, w of any length but zero."""
        x, y, z, w = (float(value) / math.hypot(*quaternion) for value in quaternion)
        return cls((x, y, z, w))

    @classmethod
    def about_z(cls, angle: float) -> "Rotation":
        """Return the rotation by an angle [rad] about z."""
        return cls((0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2)))

    def __mul__(self, other: "Rotation") -> "Rotation":
        """Return the rotation that does the other one first."""
        (x1, y1, z1, w1), (x2, y2, z2, w2) = self.quaternion, other.quaternion
        return Rotation.from_quat(
            (
                w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
                w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
                w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
                w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
            )
        )

    def inv(self) -> "Rotation":
        x, y, z, w = self.quaternion
        return Rotation((-x, -y, -z, w))

    def magnitude(self) -> float:
        """Return the angle of the rotation [rad], from 0 to pi."""
        *axis, w = self.quaternion
        return 2 * math.atan2(math.hypot(*axis), abs(w))

    def as_matrix(self) -> np.ndarray:
        """Return the matrix, (3, 3), whose columns are the turned axes."""
        x, y, z, w = self.quaternion
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )

    def toward(self, other: "Rotation", share: float) -> "Rotation":
        """Return the rotation at a share of the shortest way to another one (Shoemake, 1985)."""
        dot = sum(a * b for a, b in zip(self.quaternion, other.quaternion, strict=True))
        angle, sign = math.acos(min(abs(dot), 1.0)), math.copysign(1.0, dot)
        if angle < 1e-9:
            return self
        own, others = math.sin((1 - share) * angle), sign * math.sin(share * angle)
        mixed = [own * a + others * b for a, b in zip(self.quaternion, other.quaternion, strict=True)]
        return Rotation.from_quat(mixed)


UPSIDE_DOWN = Rotation((1.0, 0.0, 0.0, 0.0))  # half a turn about x


@dataclass(frozen=True, eq=False)
class RigidTransform:
    """A pose: a translation [m], (3,), and a rotation."""

    translation: np.ndarray = field(default_factory=lambda: np.zeros(3))
    rotation: Rotation = Rotation()

    @classmethod
    def from_components(cls, translation: Sequence[float] | np.ndarray, rotation: Rotation) -> "RigidTransform":
        return cls(np.array(translation, dtype=float), rotation)

    @classmethod
    def identity(cls) -> "RigidTransform":
        return cls()

    def __mul__(self, other: "RigidTransform") -> "RigidTransform":
        """Return the pose of what has the other one in the frame of this one."""
        moved = self.translation + self.rotation.as_matrix() @ other.translation
        return RigidTransform(moved, self.rotation * other.rotation)
