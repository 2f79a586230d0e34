"""Times at which constraints held the end effector of a run, and the plans that counted in it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.loop.record import Record
from dqcontrol.loop.replanning import PLAN
from dqcontrol.loop.signals import EFFECT, HELD_WINDOW, PRESSURE, is_held

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


class PlanOfRun(NamedTuple):
    """A plan that counted in a run.

    Attributes
    ----------
    time
        From when on, s.
    place
        Where the end effector was then, shape (3,), m.
    held_by
        The constraint that held the robot then; empty of a plan made before the run.
    edges, seed
        How many edges were looked at, and the seed of the random configurations.
    room
        The least room of the way beyond what is asked, m; infinite if nothing stands around.
    """

    time: float
    place: Array
    held_by: str
    edges: int
    seed: int
    room: float

    @property
    def cause(self) -> str:
        """Why it was made, in a few words; empty of a plan made before the run."""
        return f"planned again at {self.time:.3g} s, held by {self.held_by}" if self.held_by else ""

    @property
    def proof(self) -> str:
        """What is proved of it, in a few words."""
        room = f"least room {1e3 * self.room:.3g} mm beyond what is asked"
        known = room if np.isfinite(self.room) else "nothing stands around"
        return f"certified: {known}; {self.edges} edges, seed {self.seed}"


def plans_of_run(record: Record) -> list[PlanOfRun]:
    """Return the plans of a run in their order; none of a run without."""
    if PLAN not in record.readings:
        return []
    values = record.readings[PLAN].values
    found = []
    for k in np.flatnonzero(np.diff(values[:, 0], prepend=0.0) > 0):
        _, edges, seed, room = values[k]
        by = _held_by(record, int(k)) if k and is_held(record.readings[EFFECT].values[k - 1]) else ""
        place = np.array(record.position[k])
        found.append(PlanOfRun(float(record.time[k]), place, by, int(edges), int(seed), float(room)))
    return found


def apart_at_plans(record: Record, points: Array) -> list[Array]:
    """Return what is desired at each sample, shape (N, 3), in parts: at each further plan it begins anew."""
    again = np.searchsorted(record.time, [each.time for each in plans_of_run(record) if each.held_by])
    return np.split(points, again) if len(points) == len(record) else [points]


def _held_by(record: Record, k: int) -> str:
    pressure = record.readings[PRESSURE]
    pressed = pressure.values[k - 1]
    return pressure.parts[int(pressed.argmax())] if pressed.max(initial=0.0) > 0 else "joint limits"
