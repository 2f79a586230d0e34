"""Steps of a sequence planned one after the other, each with what stands around, and is in the hand, when it begins."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import msgspec
import numpy as np

from dqcontrol.algebra import DualQuaternion
from dqcontrol.arrays import Array
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.errors import NoteWarning, PlanError
from dqcontrol.planning.drive_and_plan import DriveAndPlan
from dqcontrol.planning.plan import plan
from dqcontrol.planning.plan_to import PlanTo
from dqcontrol.planning.standing_world import standing
from dqcontrol.references.drive_through import DriveThrough
from dqcontrol.references.drive_to import PlannedWay
from dqcontrol.references.gripping import GripperStep, held_by_steps
from dqcontrol.robots import Robot, postures
from dqcontrol.world import World

# A step from a configuration, (n,), in a world, with what is kept then.
Step: TypeAlias = Callable[[Robot, Array, World | None, PreparedConstraints], PlannedWay]


class _Gone(NamedTuple):
    """Steps so far: their ways and the rests behind them, where they end and when, and what the gripper did."""

    ways: tuple[PlannedWay, ...]
    rests: tuple[float, ...]
    q: Array
    time: float
    gripper: tuple[GripperStep, ...]


class StepsInTurn:
    """Plans steps from a start configuration, (n,), on; each lasts whole periods, the end of it at rest."""

    def __init__(self, robot: Robot, kept: PreparedConstraints, world: World | None, start: Array) -> None:
        self._robot, self._kept, self._world = robot, kept, world
        self._gone = _Gone((), (), start, 0.0, ())

    @property
    def way(self) -> DriveThrough:
        """All of them, as one; what is proved of its plans is told."""
        for way in self._gone.ways:
            if isinstance(way, PlanTo | DriveAndPlan):
                warnings.warn(
                    f"plan: {way.plan if isinstance(way, PlanTo) else way}", NoteWarning, stacklevel=2
                )
        return DriveThrough(self._gone.ways, self._gone.rests)

    def go(self, steps: Sequence[Step]) -> None:
        """Go on by steps, of which only the first may be a plan.

        If it leads to a pose, from where the others do not go, to the nearest configuration there from which they do.

        Raises
        ------
        PlanError
            If there is no way.
        """
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NoteWarning)  # of plans that lead nowhere
            first = self._then(self._gone, steps[0])
            try:
                self._gone = self._all(first, steps[1:])
            except PlanError as error:
                way = first.ways[-1]
                if not isinstance(way, PlanTo) or not isinstance(way.plan.goal, DualQuaternion):
                    raise
                self._gone = self._elsewhere(way, way.plan.goal, steps[1:], error)

    def _elsewhere(self, way: PlanTo, goal: DualQuaternion, steps: Sequence[Step], error: PlanError) -> _Gone:
        """Return steps by another configuration at the goal of the first of them, or raise the error."""
        old = way.plan
        found = [each.q for each in postures(self._robot, goal.vec8, seed=old.certificate.seed)]
        for q in sorted(found, key=lambda q: float(np.linalg.norm(q - self._gone.q))):
            try:
                self._all(self._gone._replace(q=q), steps)  # which is quick, and mostly says no
                options = (old.certificate.seed, old.effort)
                other = plan(self._robot, old.kept, self._gone.q, q, *options, clearance=old.clearance)
                first = self._after(self._gone, PlanTo(other, way.speed_fraction, way.approach))
                return self._all(first, steps)
            except PlanError:
                continue
        raise error

    def _all(self, gone: _Gone, steps: Sequence[Step]) -> _Gone:
        for step in steps:
            gone = self._then(gone, step)
        return gone

    def _then(self, gone: _Gone, step: Step) -> _Gone:
        world, kept = self._world, self._kept
        if kept.given.world is not None and gone.time > 0:
            bodies = held_by_steps(kept.given.world.bodies, gone.gripper)
            still = standing(msgspec.structs.replace(kept.given, world=World(bodies=bodies)), gone.time)
            kept = PreparedConstraints(still, kept.robot, kept.period, kept.command_mode, kept.lag)
            world = World(bodies={**bodies, **(still.world.bodies if still.world else {})})
        return self._after(gone, step(self._robot, gone.q, world, kept))

    def _after(self, gone: _Gone, way: PlannedWay) -> _Gone:
        period = self._kept.period
        whole = period * math.ceil(way.duration / period - 1e-9)
        gripper = tuple(each.later(gone.time) for each in way.gripper_steps)
        return _Gone(
            (*gone.ways, way),
            (*gone.rests, max(whole - way.duration, 0.0)),
            way.configurations([way.duration])[0],
            gone.time + whole,
            (*gone.gripper, *gripper),
        )
