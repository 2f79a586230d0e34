"""What pushes and hangs on an arm, and which sensors fail, over time."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

import msgspec
import numpy as np
from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, unknown_name
from dqcontrol.named_fields import NamedFields

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
    rows = np.zeros((len(pushes), 6))
    for row, push in zip(rows, pushes, strict=True):
        start = push.time
        end = start + push.duration
        if push.point not in bodies:
            raise unknown_name("plant.pushes.point", push.point, bodies)
        row[:3] = start, end, bodies[push.point]
        row[3:] = push.force
    return rows


def payload_table(payload: Payload | list[Payload] | None) -> Array:
    """Return the rows [from, until, mass], shape (N, 3), or name what does not fit."""
    payloads = [payload] if isinstance(payload, Payload) else payload or []
    rows = np.zeros((len(payloads), 3))
    for row, each in zip(rows, payloads, strict=True):
        row[:2] = span("plant.payload", each.begin, each.until)
        row[2] = each.mass
    return rows


def span(field: str, begin: float, until: float | None) -> tuple[float, float]:
    """Return when something begins and ends, s, or say that it does not."""
    end = math.inf if until is None else until
    if end <= begin:
        raise ValueRangeError(f"{field}.until: must be after 'from', {begin:g} s, got {end:g} s")
    return begin, end


def loss_table(losses: list[EncoderLoss], joints: int) -> Array:
    """Return the rows [from, until, joint from 0], shape (N, 3), or name what does not fit."""
    rows = np.zeros((len(losses), 3))
    for row, loss in zip(rows, losses, strict=True):
        start = loss.time
        end = start + loss.duration
        if not 1 <= loss.joint <= joints:
            raise ValueRangeError(f"plant.encoder_losses.joint: must lie in 1 … {joints}, got {loss.joint}")
        row[:] = start, end, loss.joint - 1
    return rows
