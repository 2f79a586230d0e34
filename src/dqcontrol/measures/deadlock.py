"""When constraints held the end effector against what its law asked, and which they were."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dqcontrol.loop.constraint_signals import EFFECT, HELD_WINDOW, PRESSURE, is_held
from dqcontrol.loop.record import Record

_HOLDS = 0.1  # share of the largest pressure from which a name counts


class Deadlock(NamedTuple):
    """A time in which the end effector was held.

    Attributes
    ----------
    begin, end
        s.
    names
        Of the constraints that pressed, the hardest first.
    """

    begin: float
    end: float
    names: tuple[str, ...]


def deadlocks(record: Record) -> list[Deadlock]:
    """Return when the end effector was held: it went slower than a tenth of what the law asked, for 0.4 s and longer.

    At such a point the wish is balanced by the rows that press (their multipliers are positive): a law that looks at
    one sample only can stand there for ever, though a way round may exist.

    Parameters
    ----------
    record
        Of a run with constraints; of others there are none.
    """
    if EFFECT not in record.readings:
        return []
    effect, pressure = record.readings[EFFECT].values, record.readings[PRESSURE]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_held(effect), [False]]).astype(int)))
    found = []
    for first, beyond in edges.reshape(-1, 2):
        begin, end = float(record.time[first]), float(record.time[beyond - 1])
        if end - begin >= HELD_WINDOW:
            total = pressure.values[first:beyond].sum(axis=0)
            order = np.argsort(-total, kind="stable")
            names = tuple(pressure.parts[i] for i in order if total[i] > _HOLDS * total.max(initial=0.0))
            found.append(Deadlock(begin, end, names or ("joint limits",)))
    return found
