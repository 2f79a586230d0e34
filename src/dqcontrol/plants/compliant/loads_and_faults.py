"""Loads on an arm and faults of its sensors, over time."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

import msgspec
import numpy as np
from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, unknown_name
from dqcontrol.named_fields import NamedFields
from dqcontrol.plants.compliant.controller_file import WristSensor
from dqcontrol.plants.compliant.elastic_model import Hand
from dqcontrol.robots.robot import Robot

Seconds = Annotated[float, Meta(ge=0, le=1e6, description="s")]
Newtons = Annotated[float, Meta(ge=-1e4, le=1e4, description="N, base frame")]


class Push(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A force for a while.

    Parameters
    ----------
    time, duration
        s.
    force
        N, base frame.
    point
        ``hand``: the tool's point; ``link 1`` …: that link's centre of mass.
    """

    spec_key: ClassVar[str] = "plant.pushes"
    time: Seconds
    duration: Annotated[float, Meta(gt=0, le=1e6, description="s")]
    force: tuple[Newtons, Newtons, Newtons]
    point: Annotated[
        str, Meta(pattern=r"^(hand|link [1-9]\d{0,2})\Z", description="hand, or link and its number")
    ] = "hand"


class Payload(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A mass at the tool's point for a while, unknown to the controllers.

    Parameters
    ----------
    mass
        kg.
    begin, until
        s; in a file, ``from`` and ``until``. For ever if ``until`` is omitted.
    """

    spec_key: ClassVar[str] = "plant.payload"
    mass: Annotated[float, Meta(gt=0, le=1e3, description="kg")]
    begin: Seconds = msgspec.field(default=0.0, name="from")
    until: Seconds | None = None


class EncoderLoss(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An encoder that stays silent for a while: its last reading stands.

    Parameters
    ----------
    time, duration
        s.
    joint
        Its number, from 1.
    """

    spec_key: ClassVar[str] = "plant.encoder_losses"
    time: Seconds
    duration: Annotated[float, Meta(gt=0, le=1e6, description="s")]
    joint: Annotated[int, Meta(ge=1, le=1000, description="number, from 1")]


class WristFault(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A wrist sensor that reads the same for a while, whatever it bears; its torques are 0.

    Parameters
    ----------
    time, duration
        s.
    force
        N, axes of the tool.
    """

    spec_key: ClassVar[str] = "plant.wrist_fault"
    time: Seconds
    duration: Annotated[float, Meta(gt=0, le=1e6, description="s")]
    force: tuple[Newtons, Newtons, Newtons] = (0.0, 0.0, 0.0)


def push_table(pushes: list[Push], bodies: dict[str, int]) -> Array:
    """Return the rows [from, until, body, force (3)], shape (N, 6), or name what does not fit."""
    for push in pushes:
        if push.point not in bodies:
            raise unknown_name("plant.pushes.point", push.point, bodies)
    rows = [(each.time, each.time + each.duration, bodies[each.point], *each.force) for each in pushes]
    return np.array(rows, dtype=np.float64).reshape(-1, 6)


def payload_table(payload: Payload | list[Payload] | None) -> Array:
    """Return the rows [from, until, mass], shape (N, 3), or name what does not fit."""
    payloads = [payload] if isinstance(payload, Payload) else payload or []
    rows = [(each.begin, math.inf if each.until is None else each.until, each.mass) for each in payloads]
    for begin, end, _ in rows:
        if end <= begin:
            raise ValueRangeError(f"plant.payload.until: must be after 'from', {begin:g} s, got {end:g} s")
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def loss_table(losses: list[EncoderLoss], joints: int) -> Array:
    """Return the rows [from, until, joint from 0], shape (N, 3), or name what does not fit."""
    for loss in losses:
        if loss.joint > joints:
            raise ValueRangeError(f"plant.encoder_losses.joint: must lie in 1 … {joints}, got {loss.joint}")
    rows = [(each.time, each.time + each.duration, each.joint - 1) for each in losses]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


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
        self._share = -math.expm1(-period / settings.time_constant)
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


class LiveWrist:
    """The sensor at work: what kernels filter at every tick gets bias and noise when it is read.

    Attributes
    ----------
    filtered
        The filtered wrench that the arm exerts on the hand, shape (6,).
    """

    def __init__(self, sensor: WristSensor, filtered: Array, fault: WristFault | None = None) -> None:
        self.filtered = filtered
        self._bias = np.array([*sensor.force_bias, *sensor.torque_bias])
        self._scale = np.repeat([sensor.force_noise, sensor.torque_noise], 3)
        self._noise = np.empty(6)
        self._fault = fault

    def read(self, time: float, rng: np.random.Generator, out: Array) -> None:
        """Write force and torque at a time, (6,), N and N·m, that the hand exerts on the arm, axes of the tool."""
        rng.standard_normal(out=self._noise)
        np.multiply(self._noise, self._scale, out=out)
        out += self._bias
        out -= self.filtered
        if self._fault is not None and self._fault.time <= time < self._fault.time + self._fault.duration:
            out[:3], out[3:] = self._fault.force, 0.0
