"""Planning while a loop runs: again where constraints hold a robot on its way, or a way out for a law that has none."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dqcontrol.algebra import DualQuaternion
from dqcontrol.arrays import Array
from dqcontrol.constraints.constraint_layout import report_of
from dqcontrol.controller.controller import Controller
from dqcontrol.errors import NoteWarning, PlanError, ValueRangeError, from_extra
from dqcontrol.loop.signals import HELD_WINDOW, Signal, is_held
from dqcontrol.references import Reference
from dqcontrol.references.drive_through import DriveThrough
from dqcontrol.references.drive_to import PlannedWay
from dqcontrol.references.reference import SNAP
from dqcontrol.references.sample import POSE, TIME, TWIST, TWIST_RATE

if TYPE_CHECKING:
    from dqcontrol.planning import PlanTo

PLAN = "plan"
_PARTS, _UNITS = ("number", "edges", "seed", "room"), ("", "", "", "m")
_THERE = 1e-3  # rad or m: of all coordinates from where a way ends; the law removes the rest
_LATER = 5.0  # s: for each plan, until a run without duration ends though the robot is not there
_TRIES = 8  # of `escape: plan`, as of other escapes
_GAIN, _PULL = 2.0, 5.0  # 1/s: of the law that follows a way out; those of docs/planning.md


class MadePlan(NamedTuple):
    """A plan and the sample from which it counts."""

    sample: int
    way: PlanTo


class Replanning:
    """Plans where constraints hold a robot, and leads a loop along what it finds.

    Parameters
    ----------
    law
        What commands.
    reference
        What it follows.
    lasts
        Whether the run lasts until the robot has gone its way: one without a duration.

    Attributes
    ----------
    plans
        Those that were made.
    """

    def __init__(self, law: Controller, reference: Reference, *, lasts: bool) -> None:
        from dqcontrol.planning import PlanTo  # few runs plan

        self._way = reference if isinstance(reference, PlanTo) else None
        self._following: PlannedWay | None = self._way
        self._lasts = lasts and self._way is not None
        self.left: int = self._way.again.most if self._way and self._way.again else _TRIES
        self.plans: list[MadePlan] = [MadePlan(0, self._way)] if self._way else []
        self._first_law = law
        self._first_samples = np.zeros((0, 0))
        self._held, self._end, self._refused = 0.0, 0, ("", "")

    @classmethod
    def of(cls, law: Controller, reference: Reference | None, *, lasts: bool) -> Replanning | None:
        """Return what plans in a run; None where nothing asks for that."""
        again = getattr(reference, "again", None)
        kept = law.constraints
        if reference is None or kept is None or (again is None and kept.given.escape != "plan"):
            return None
        for library in ("ompl.geometric", "toppra"):  # now, not where the robot is held
            from_extra(library, "plan", "plans while the robot moves")
        return cls(law, reference, lasts=lasts)

    def with_room(self, samples: Array) -> Array:
        """Return samples of a run, (N, 21), with as many at rest behind them as later plans may take."""
        self._end = len(samples)
        count = self.left * (len(samples) + round(_LATER / self._first_law.period)) if self._lasts else 0
        more = np.repeat(samples[-1:], count, axis=0)
        more[:, TWIST] = more[:, TWIST_RATE] = 0.0
        more[:, TIME] = self._first_law.period * np.arange(len(samples), len(samples) + count)
        self._first_samples = samples
        return np.vstack([samples, more])

    def is_over(self, k: int, q: Array) -> bool:
        """Return whether there is no sample k: the way is gone, and the robot, at q (n,), is where it ends."""
        return self._lasts and k >= self._end and self._is_there(q)

    def _is_there(self, q: Array) -> bool:
        return self.plans[-1].way.is_there(q, _THERE)

    def look(
        self,
        k: int,
        law: Controller,
        state: Array,
        measured: Array,
        seen: Mapping[str, Array],
        samples: Array,
    ) -> tuple[Controller, Array] | None:
        """Return another controller and its state from sample k on, with the samples from there written; None: go on.

        Parameters
        ----------
        k
            Number of the sample.
        law, state
            What commanded last.
        measured
            Configuration, shape (n,).
        seen
            Where bodies of the world are measured.
        samples
            Desired motion; those from k on are replaced if there is a plan.
        """
        following, time = self._following, float(samples[k, TIME])
        if self._way is None and following and time >= following.duration and self._is_there(measured):
            self._following = None
            samples[k:] = self._first_samples[k:]
            return self._first_law, self._first_law.taking_over(measured, state)
        self._held = self._held + law.period if is_held(law.report) else 0.0
        if self._held < HELD_WINDOW or not self.left:
            return None
        self._held = 0.0
        try:
            found = self._planned(law, time, measured, seen)
        except PlanError as error:
            why = error.reason, error.pair
            if why != self._refused:  # once, however long it stands there
                self._say(time, law, f"no other way: {error}")
            self._refused = why
            return None
        self._refused = ("", "")
        return self._along(found, k, law, state, measured, samples)

    def _planned(self, law: Controller, time: float, measured: Array, seen: Mapping[str, Array]) -> PlanTo:
        """Return a way from a configuration around what stands there at a time."""
        from dqcontrol.planning import PlanTo
        from dqcontrol.planning.plan import way_now

        assert law.constraints is not None
        if self._way is not None:
            return self._way.again_from(law.constraints, measured, time, seen)
        goal = DualQuaternion(self._first_samples[-1, POSE])
        return PlanTo(way_now(law.constraints, measured, goal, time, seen))

    def _along(
        self, way: PlanTo, k: int, law: Controller, state: Array, measured: Array, samples: Array
    ) -> tuple[Controller, Array]:
        """Return the controller along a new way, and write what it desires."""
        from dqcontrol.laws import GuidedProportional
        from dqcontrol.planning.plan_to import ResumedWay

        time = float(samples[k, TIME])
        before = self._following
        reference = ResumedWay(before, time, way)
        other = None
        if self._way is None:
            assert law.constraints is not None
            other = GuidedProportional(gain=_GAIN, pull=_PULL, constraints=law.constraints.given)
        new = law.along(reference, other)
        samples[k:] = reference.samples(samples[k:, TIME])
        self._following = reference
        self.left -= 1
        self.plans.append(MadePlan(k, way))
        self._end = k + round(way.duration / law.period) + 1
        self._say(time, law, f"planned again: {way.plan}; {way.duration:.3g} s more")
        return new, new.taking_over(measured, state)

    def _say(self, time: float, law: Controller, what: str) -> None:
        """Note what held the robot, and what became of that."""
        assert law.constraints is not None
        names = law.constraints.names
        pressure = report_of(law.report, len(names)).pressure
        by = names[int(pressure.argmax())] if pressure.size and pressure.max() > 0 else "joint limits"
        warnings.warn(f"t = {time:.3g} s: held by {by}, {what}", NoteWarning, stacklevel=2)


def refuse_replanning(law: Controller, reference: Reference | None, why: str) -> None:
    """Refuse `again` of a reference and `escape: plan` of constraints where nothing plans while the robot moves.

    Raises
    ------
    ValueRangeError
        If one of them is asked for; ``why`` says why nothing does.
    """
    again = getattr(reference, "again", None) is not None
    if again or (law.constraints is not None and law.constraints.given.escape == "plan"):
        key = "reference.again" if again else "constraints.escape"
        raise ValueRangeError(f"{key}: plans while the robot moves, {why}; leave it out")


def plan_signals(
    reference: Reference | None, replanning: Replanning | None, times: Array
) -> dict[str, Signal]:
    """Return which plan counted at each sample, at times (N,), s, and what is known of it; nothing without plans."""
    made = replanning.plans if replanning else _plans_of(reference, times)
    if not made:
        return {}
    values = np.full((len(times), len(_PARTS)), np.nan)
    values[:, 0] = 0.0
    for number, each in enumerate(made, 1):
        known = each.way.plan.certificate
        values[each.sample :] = number, known.edges, known.seed, known.room
    return {PLAN: Signal(PLAN, _PARTS, _UNITS, values)}


def _plans_of(reference: Reference | None, times: Array) -> list[MadePlan]:
    """Return the plans of a reference, which was planned before the run."""
    steps = isinstance(reference, DriveThrough)
    if reference is None or not (steps or reference.plans_around):
        return []
    from dqcontrol.planning.drive_and_plan import DriveAndPlan
    from dqcontrol.planning.plan_to import PlanTo

    ways = zip(reference.ways, reference.begins, strict=True) if steps else [(reference, 0.0)]
    found = [(each.arm if isinstance(each, DriveAndPlan) else each, begin) for each, begin in ways]
    plans = [(way, begin) for way, begin in found if isinstance(way, PlanTo)]
    return [MadePlan(int(np.searchsorted(times, begin - SNAP)), way) for way, begin in plans]
