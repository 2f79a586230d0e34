"""What hangs on the hand, weighed by the wrist sensor, in the joint controllers' model of gravity."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, ClassVar

from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError
from dqcontrol.named_fields import NamedFields

if TYPE_CHECKING:
    from dqcontrol.plants.compliant.elastic_model import Hand
    from dqcontrol.robots.robot import Robot


class PayloadCompensation(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The controllers take the weight that the wrist sensor feels, beyond the hand's, for a mass at the tool's point.

    m⁺ = m + (1 − exp(−T/τ)) (f · g/|g|² − m), within 0 and the largest, f the force sensed less the hand's weight. The
    mass joins their model of gravity, so that the joint torques grow by Jᵀ(−m g), times its factor. A reading that is
    not finite, or with |f| above the largest weight, is no payload but a blow or a fault: m stays as it is.

    Parameters
    ----------
    time_constant
        τ, s. Pushes shorter than it, and inertia forces, are hardly taken for weight.
    max_mass
        kg.
    """

    spec_key: ClassVar[str] = "plant.payload_compensation"
    time_constant: Annotated[float, Meta(gt=0, le=100, description="τ, s")] = 0.5
    max_mass: Annotated[float, Meta(gt=0, le=1e3, description="kg")] = 2.0


class PayloadScale:
    """Payload compensation at work.

    Attributes
    ----------
    mass
        That is compensated, kg.
    """

    def __init__(
        self,
        settings: PayloadCompensation,
        robot: Robot,
        hand: Hand | None,
        bodies: Array,
        gravity: tuple[float, float, float],
        period: float,
    ) -> None:
        self.mass: float = 0.0
        self._robot, self._bare = robot, bodies[-1].copy()
        self._gravity, self._strength = gravity, math.hypot(*gravity)
        if not self._strength:
            raise ValueRangeError("plant.payload_compensation: nothing weighs without gravity")
        time_constant = settings.time_constant
        self._share = -math.expm1(-period / time_constant)
        self._most = settings.max_mass
        self._hand_mass = hand.mass if hand else 0.0

    def weigh(self, q: Array, wrench: Array, bodies: Array) -> None:
        """Take a reading of the wrist sensor, shape (6,), at the angles measured, and change the model of gravity.

        Parameters
        ----------
        bodies
            The model's table, shape (n, 4).
        """
        gx, gy, gz = _turned_back(self._robot.fkm(q), self._gravity)
        fx, fy, fz = (float(wrench[i]) - self._hand_mass * g for i, g in enumerate((gx, gy, gz)))
        if not fx * fx + fy * fy + fz * fz <= (self._most * self._strength) ** 2:  # NaN is not
            return
        sensed = (fx * gx + fy * gy + fz * gz) / self._strength**2
        self.mass = min(max(self.mass + self._share * (sensed - self.mass), 0.0), self._most)
        mass, center = self._bare[0], self._bare[1:]
        bodies[-1, 0] = mass + self.mass
        bodies[-1, 1:] = (mass * center + self.mass * self._robot.chain[-1, 4:7]) / (mass + self.mass)


def _turned_back(pose: Array, vector: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return a vector of the base's axes in the tool's; plain numbers, as NumPy takes ten times as long."""
    w, x, y, z = pose[:4].tolist()
    a, b, c = vector
    i, j, k = 2 * (z * b - y * c), 2 * (x * c - z * a), 2 * (y * a - x * b)
    return a + w * i - y * k + z * j, b + w * j - z * i + x * k, c + w * k - x * j + y * i
