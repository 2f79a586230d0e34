"""The shift of a reference that is learnt, in the inertial axes, the motion it makes, and what is learnt of forces.

Along an axis with a wanted force the plan is not where the end effector is to go, so its error is nothing to be learnt.
The deflection y of the compliant frame is: it is where the surface was, and all that the force control had to do, late
and with the error D ẏ of the force. Where the next motion is shifted by y there is nothing left for it to do.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.contact import Admittance, AdmittanceStage
from dqcontrol.errors import ShapeError
from dqcontrol.files.output_file import whole_file
from dqcontrol.loop import Record
from dqcontrol.measures.metrics import low_passed
from dqcontrol.plants.plant import WRENCH_READINGS
from dqcontrol.plants.sensors import TOUCH_FORCE
from dqcontrol.references import POSE, TIME, Points
from dqcontrol.references.points import DUAL_QUATERNION
from dqcontrol.robots import Robot
from dqcontrol.tuning.learning_convergence import Convergence

_TAPER = 1.0  # s, in which errors fade beyond both ends of a record
TRACKED_POSE = "tracked_pose"  # among the readings of a record: where a tracker saw the end effector, (N, 8)
LEVER = 0.3  # m: so far from its axis a turn counts as a way


def hand_error(desired: Array, poses: Array) -> Array:
    """Return [rotation vector of r_d r*; p_d − p] of poses (N, 8), shape (N, 6), rad and m, inertial axes."""
    relative = algebra.multiply(_rotations(desired), algebra.conjugate(_rotations(poses)))
    relative = relative * np.where(relative[:, :1] < 0, -1.0, 1.0)
    turns = 2 * algebra.log_body(relative)[:, :3]
    return np.hstack([turns, algebra.translation(desired) - algebra.translation(poses)])


def shifted_poses(desired: Array, shift: Array) -> Array:
    """Return [exp(w_rot) r_d ; p_d + w_p] of poses (N, 8) and shifts (N, 6)."""
    half = np.zeros((len(shift), 6))
    half[:, :3] = shift[:, :3] / 2
    turned = algebra.multiply(algebra.exp_screw(half), _rotations(desired))
    return algebra.pose(turned[:, :4], algebra.translation(desired) + shift[:, 3:])


def _rotations(poses: Array) -> Array:
    out = np.zeros_like(poses)
    out[:, :4] = poses[:, :4]
    return out


def motion_of(samples: Array, shift: Array) -> Points:
    """Return the motion that goes through shifted samples: its twists are those from each to the next."""
    return Points(samples[:, TIME], shifted_poses(samples[:, POSE], shift))


def increment(convergence: Convergence, time: Array, error: Array) -> Array:
    """Return Q L Q e, the change of the shift that an error (N, 6) asks for."""
    count = len(time)
    beyond = max(int(_TAPER / convergence.shape.period), 1)
    fade = (0.5 + 0.5 * np.cos(np.pi * np.arange(1, beyond + 1) / (beyond + 1)))[:, None]
    smooth = low_passed(time, error, convergence.cutoff)
    size = 1 << int(np.ceil(np.log2(2 * count + 2 * beyond)))
    joined = np.zeros((size, error.shape[1]))
    joined[:count] = smooth
    joined[count : count + beyond] = fade * smooth[-1]  # a jump to 0 would be learnt
    joined[size - beyond :] = fade[::-1] * smooth[0]  # before the start, as the transform goes round
    spectrum = np.fft.rfft(joined, axis=0)
    frequencies: Array = np.asarray(np.fft.rfftfreq(size, convergence.shape.period), dtype=np.float64)
    spectrum *= convergence.operator(frequencies)[:, None]
    wanted = np.fft.irfft(spectrum, size, axis=0)[:count]
    return low_passed(time, wanted, convergence.cutoff)


def weighted_norm(error: Array) -> float:
    """Return the root of the mean square of errors (N, 6) as ways, m: turns at the end of a lever."""
    turns, ways = np.sum(error[:, :3] ** 2, axis=1), np.sum(error[:, 3:] ** 2, axis=1)
    return float(np.sqrt(np.mean(ways + LEVER**2 * turns)))


def start_weights(time: Array, skip: float) -> Array:
    """Return 0 up to a time, 1 from its double on, smooth between, shape (N, 1)."""
    if not skip:
        return np.ones((len(time), 1))
    share = np.clip((time - skip) / skip, 0.0, 1.0)
    return (share * share * (3 - 2 * share))[:, None]


def write_motion(path: str | os.PathLike[str], motion: Points, notes: Sequence[str]) -> None:
    """Write a points file that gives the same motion to the last digits; comments first."""
    rows = np.column_stack([np.asarray(motion.times), np.asarray(motion.poses)])
    lines = [f"# {note}" for note in notes] + [", ".join(("time", *DUAL_QUATERNION))]
    lines += [", ".join(f"{value:.17g}" for value in row) for row in rows.tolist()]
    with whole_file(Path(path)) as draft:
        draft.write_text("\n".join(lines) + "\n", encoding="utf-8")


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
        first_touch = float(time[touched[0]]) if len(touched) else np.inf
        return Pressed(deflection, force - self._wanted(time), first_touch)

    def errors(self, record: Record) -> Array:
        """Return the error of the true force, N, shape (N, axes); of the measured one where no other is known."""
        time = record.time - record.time[0]
        if TOUCH_FORCE not in record.readings:
            return self.pressed(record).error
        touch = record.readings[TOUCH_FORCE].values
        force = self.contact.turned_to_axes(touch, record.pose, record.desired[:, POSE])
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
