"""Learning of forces: from each repeat, the way that the compliant frame had to give.

Along an axis with a wanted force the plan is not where the end effector is to go, so its error is nothing to be learnt.
The deflection y of the compliant frame is: it is where the surface was, and all that the force control had to do, late
and with the error D ẏ of the force. Where the next motion is shifted by y there is nothing left for it to do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.contact import Admittance
from dqcontrol.contact.admittance_stage import AdmittanceStage
from dqcontrol.errors import ShapeError
from dqcontrol.loop import Record
from dqcontrol.plants.plant import WRENCH_READINGS
from dqcontrol.plants.wrist import TOUCH_FORCE
from dqcontrol.references.sample import POSE
from dqcontrol.robots import Robot
from dqcontrol.tuning.learning.convergence import Convergence
from dqcontrol.tuning.learning.learnt_motion import increment

STIFFNESSES = 0.5, 2.0  # times the stiffness, where the model is uncertain: a pen's or a pad's counts as well


class Pressed(NamedTuple):
    """What a repeat tells.

    Attributes
    ----------
    deflection
        y of the force axes, metres, 0 of others, shape (N, 6), task axes.
    error
        Of the force as the sensor says it, N, shape (N, axes).
    first_touch
        s since the start; infinite if nothing was touched.
    """

    deflection: Array
    error: Array
    first_touch: float


@dataclass(frozen=True)
class ForceLearning:
    """The axes along which a law controls forces, and how each learns.

    Axes that give way without a wanted force, and those about which one turns, are not learnt: there neither the plan
    nor a force in newtons says what is right.

    Parameters
    ----------
    contact
        The admittance, with its sensor's filter.
    robot
        That has it.
    by_axis
        The operator along each axis x, y, z (3, 4, 5) with a wanted force.
    """

    contact: Admittance
    robot: Robot
    by_axis: dict[int, Convergence]

    def turned(self, error: Array, desired: Array, *, back: bool = False) -> Array:
        """Return errors (N, 6) of the inertial frame in task axes at poses (N, 8), or ``back``."""
        if self.contact.axes == "base":
            return error
        frame = algebra.matrix_from_pose(desired)[:, :3, :3]
        pairs = error.reshape(-1, 2, 3)
        return np.einsum("nij,npj->npi" if back else "nji,npj->npi", frame, pairs).reshape(-1, 6)

    def planned(self, error: Array) -> Array:
        """Return errors in task axes of what is to follow the plan: 0 along axes that give way."""
        return np.where(self.contact.rigid, error, 0.0)

    def pressed(self, record: Record) -> Pressed:
        """Return what the sensor of a repeat tells, from wrench and measured poses through the admittance once more.

        Raises
        ------
        ShapeError
            If the record has no wrench.
        """
        if any(name not in record.readings for name in WRENCH_READINGS):
            raise ShapeError(
                f"learn: the robot's record has no readings {' and '.join(WRENCH_READINGS)}, from which forces are "
                "learnt; learn in simulation, or give a runner whose records have them"
            )
        wrench = np.hstack([record.readings[name].values for name in WRENCH_READINGS])
        axes, count, poses = list(self.by_axis), len(record), self.robot.fkm(record.measured)
        stage = AdmittanceStage(self.contact, self.by_axis[axes[0]].shape.period)
        deflection, force, touches = np.zeros((count, 6)), np.zeros((count, len(axes))), np.zeros(count)
        for k in range(count):
            deflection[k, axes] = stage.state.y[axes]
            stage.step(poses[k], record.desired[k], wrench[k])
            force[k], touches[k] = stage.state.wrench[axes], stage.state.touches[0]
        touched = np.flatnonzero(touches)
        time = record.time - record.time[0]
        return Pressed(
            deflection, force - self._wanted(time), float(time[touched[0]]) if len(touched) else np.inf
        )

    def errors(self, record: Record) -> Array:
        """Return the error of the true force, N, shape (N, axes); of the measured one where no other is known."""
        time = record.time - record.time[0]
        if TOUCH_FORCE not in record.readings:
            return self.pressed(record).error
        force = self.contact.turned_to_axes(
            record.readings[TOUCH_FORCE].values, record.pose, record.desired[:, POSE]
        )
        return force[:, [axis - 3 for axis in self.by_axis]] - self._wanted(time)

    def _wanted(self, time: Array) -> Array:
        forces = self.contact.wanted_forces(time)
        return np.column_stack([forces["xyz"[axis - 3]] for axis in self.by_axis])

    def increment(self, plan: Convergence, time: Array, error: Array) -> Array:
        """Return what errors in task axes ask for: along force axes by their own operators, with the plan's cut-off."""
        asked = increment(plan, time, error)
        for axis, own in self.by_axis.items():
            asked[:, [axis]] = increment(replace(own, cutoff=plan.cutoff), time, error[:, [axis]])
        return asked
