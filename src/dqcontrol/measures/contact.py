"""Numbers that judge what happens when something touches the end effector."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dqcontrol.loop.record import Record
from dqcontrol.plants.mujoco.world_model import FORCE

RECOVERED = 2e-3  # m


def contact_force(record: Record) -> NDArray[np.float64] | None:
    """Return the largest force on any body at each sample, N; None where links touch nothing."""
    return record.readings[FORCE].values.max(axis=1) if FORCE in record.readings else None


def peak_contact(record: Record) -> float:
    """Return the largest force on a body, N; NaN where links touch nothing."""
    force = contact_force(record)
    return math.nan if force is None else float(force.max())


def recovery_time(record: Record) -> float:
    """Return how long after the last contact the end effector is back, s.

    It is back once its distance |p_d − p| stays, to the end of the run, within 2 mm of what it was at the last sample
    before the first contact. NaN without contact, or if it never is.
    """
    force = contact_force(record)
    touched = np.flatnonzero(force > 0) if force is not None else np.zeros(0, dtype=np.intp)
    if not len(touched):
        return math.nan
    first, last = int(touched[0]), int(touched[-1])
    error = record.position_error
    outside = np.flatnonzero(~(error <= error[max(first - 1, 0)] + RECOVERED))  # NaN is outside
    back = max(last, int(outside[-1]) if len(outside) else 0) + 1
    return float(record.time[back] - record.time[last]) if back < len(record) else math.nan
