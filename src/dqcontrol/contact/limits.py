"""Limits of contact loops, found before anything touches: from the poles of their sampled linear model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.contact.admittance import Admittance, ForceReference, exact_step
from dqcontrol.errors import ValueRangeError, as_array, as_positive

if TYPE_CHECKING:
    from dqcontrol.controller import Controller
    from dqcontrol.plants import Plant
    from dqcontrol.plants.linear_model import LinearModel

_SOFTEST, _STIFFEST = 10.0, 1e8  # N/m that are looked at: a sponge, and beyond steel on steel
_LOOKED_AT = 49  # between them: seven a decade, so that a window of instability is not stepped over
_HALVINGS = 14  # of a step of that grid: the limit to 2e-5 of its value, of which three digits are printed
_FACTORIALS = 1 / np.cumprod(np.arange(1.0, 14.0))  # 1/k!
_ROUNDING = 1e-7  # of a pole's modulus: double poles at 1, of redundant joints at rest, are found to that
_MASSES = tuple(np.geomspace(0.1, 100.0, 7).tolist())  # kg of loose parts: a pen to a machine
# K θ v / w at which a contact at speed v peaks at 3 w, where the reference stops at the second sample with a force and
# force control acts meanwhile: 2.85 to 3.0 over lags of 14 and 59 ms (tests/contact/test_limit_formulas.py)
_IMPACT = 2.8
_LONGEST_LAG = 2.0  # s in which a plant follows a steady motion steadily
_STEP = 1e-6  # of an argument, for slopes


class LoosePart(NamedTuple):
    """Something free to move, behind a contact spring: the mass (kg) of which least stiffness (N/m) is borne."""

    stiffness: float
    mass: float


@dataclass(frozen=True)
class ContactLimits:
    """What a contact loop bears.

    Attributes
    ----------
    stiffness
        Largest of what stands still, N/m, on the worst axis; infinite where none fails. N·m/rad where the stage moves
        about axes only.
    axis
        The worst axis: x, y or z; mx, my or mz where the stage moves about axes only.
    loose_part
        Worst of what is free to move behind a spring.
    least_damping
        D of the worst axis with which the environment that was asked about is just borne; 0 where any does.
    approach_speed
        At which a reference may run into it, so that the force peaks at three times the wanted one, m/s; None where no
        force is wanted.
    """

    stiffness: float
    axis: str
    loose_part: LoosePart
    least_damping: float
    approach_speed: float | None


_AXES = ("mx", "my", "mz", "x", "y", "z")


def contact_limits(
    admittance: Admittance,
    law: Controller,
    plant: Plant,
    q: ArrayLike,
    environment: float = 1e4,
    at: ArrayLike = (),
) -> ContactLimits:
    """Return what an admittance bears before a law and a plant near a configuration.

    The model is that of small motions, sampled: of all joints, as `Plant.linear_model` has them; the law by its slopes,
    with feed-forward and null space as they are; the admittance's exact step; the sensor's filter; and what is touched,
    in one axis at a time, and along the wanted force at each of the points beside the end effector, where a contact
    couples all axes: what touches at several of them at once bears more than the worst of them alone. A loop is stable
    where all its poles lie in the unit circle. What is not in it: friction, contact that is lost.

    Parameters
    ----------
    admittance
        The stage.
    law
        A law made ready, without contact.
    plant
        What follows its commands.
    q
        Configuration, shape (n,), rad or m.
    environment
        Stiffness of what is to be touched, N/m, for ``least_damping`` and ``approach_speed``.
    at
        Where it may be touched, as seen from the end effector, shape (N, 3), m; at its origin alone if omitted.

    Raises
    ------
    ValueRangeError
        If the plant has no linear model, or no force is wanted along which points are touched.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), [0, 0.6, 0, -1.6, 0, 0.9, 0]
    >>> law = dqc.laws.ProportionalFeedforward(gain=1.0).prepare(arm, None, 0.004)
    >>> push = dqc.contact.Admittance(
    ...     translation=dqc.contact.Compliance(damping=200.0, stiffness=["rigid", "rigid", 0.0]),
    ...     force=dqc.contact.WantedWrench(z=2.0))
    >>> slow = dqc.plants.Servo(time_constant=0.04, delay=0.012)
    >>> limits = dqc.contact.contact_limits(push, law, slow, q)
    >>> 15000 < limits.stiffness < 18000, limits.axis
    (True, 'z')
    """
    robot, period = law.robot, law.period
    start = as_array("q", q, (robot.configuration_size,))
    asked = as_positive("environment", environment)
    model = plant.linear_model(robot, start, period)
    if model is None:
        raise ValueRangeError(
            "contact: the plant has no linear model, so what stiffness it bears is unknown; set allow_unstable"
        )
    found, soft = [], plant.compliance(robot, start)
    axes = np.flatnonzero(~admittance.rigid)
    # N/m and N·m/rad are no more comparable than metres and radians: what is touched has a stiffness in N/m.
    for i in axes[axes >= 3] if axes.max() >= 3 else axes:
        loop = _loop_of(admittance, law, model, start, int(i), soft)
        found.append((loop.limit(), int(i), loop))
    for point in as_array("at", at).reshape(-1, 3):
        loop, along = _beside(admittance, law, model, start, point, soft)
        found.append((loop.limit(), along, loop))
    stiffness, worst, loop = min(found, key=lambda each: each[0])
    loose = [LoosePart(loop.limit(mass), mass) for mass in _MASSES] if worst >= 3 else []
    lag = max(sum(plant.lag(robot).mean), _lateness(model, robot.configuration_size, period))
    wanted = [abs(each) for each in _largest(admittance) if each]
    late = period / 2 + lag + admittance.sensor.filter
    return ContactLimits(
        stiffness,
        _AXES[worst],
        min(loose, default=LoosePart(np.inf, 0.0)),
        loop.least_damping(asked),
        float(_IMPACT * max(wanted) / (asked * late)) if wanted else None,
    )


def bears(
    admittance: Admittance, law: Controller, model: LinearModel, q: ArrayLike, stiffness: float, soft: Array
) -> bool:
    """Return whether the loops of `contact_limits` are stable against one stiffness, N/m, in a hundredth of its time.

    With the plant's compliance. Loops about turning axes, whose stiffnesses are others, are left out.
    """
    start = as_array("q", q, (law.robot.configuration_size,))
    axes = np.flatnonzero(~admittance.rigid)
    loops = (_loop_of(admittance, law, model, start, int(i), soft) for i in axes if i >= 3)
    return all(loop.radius(loop.effective_stiffness(stiffness)) <= 1 + _ROUNDING for loop in loops)


def _lateness(model: LinearModel, joints: int, period: float) -> float:
    """Return how late the slowest joint follows a steady motion, s."""
    state, command = np.zeros(len(model.transition)), np.ones(model.inputs.shape[1])
    steps = round(_LONGEST_LAG / period)
    for _ in range(steps):
        state = model.transition @ state + model.inputs @ command
    return max(float(steps * period - state[: min(joints, len(command))].min()), 0.0)


def _largest(admittance: Admittance) -> list[float]:
    """Return the largest wanted force along x, y and z, N, with its sign; 0 where none is."""
    return [
        float(max(each.values, key=abs)) if isinstance(each, ForceReference) else each or 0.0
        for each in admittance.force.components[3:]
    ]


def _beside(
    admittance: Admittance, law: Controller, model: LinearModel, q: Array, point: Array, soft: Array
) -> tuple[_Loop, int]:
    """Return the loop of all axes, touched at a point along the wanted force, and the axis that is most along it."""
    wanted = np.array(_largest(admittance))
    if not wanted.any():
        raise ValueRangeError("at: is touched along the wanted force, and none is wanted")
    normal = wanted / np.linalg.norm(wanted)
    if admittance.axes == "base":
        point = algebra.matrix_from_pose(law.robot.fkm(q))[:3, :3] @ point
    row = np.concatenate([np.cross(point, normal), normal])
    along = 3 + int(np.abs(normal).argmax())
    axes = [along, *(int(i) for i in np.flatnonzero(~admittance.rigid) if i != along)]
    return _Loop(admittance, law, model, q, axes, row[None], soft), along


def _loop_of(
    admittance: Admittance, law: Controller, model: LinearModel, q: Array, axis: int, soft: Array
) -> _Loop:
    """Return the loop along one axis alone."""
    return _Loop(admittance, law, model, q, [axis], np.eye(6)[axis : axis + 1], soft)


class _Loop:
    """The loop along axes that give way: plant, law, admittance and sensor; what is touched comes last.

    ``contacts`` are springs of what is touched: each by the row by which it moves with the axes φx φy φz x y z, and by
    which its force acts along them. Joints that give way by ``soft`` are springs behind one: 1/K grows by what they let
    it move.
    """

    def __init__(
        self,
        admittance: Admittance,
        law: Controller,
        model: LinearModel,
        q: Array,
        axes: list[int],
        contacts: Array,
        soft: Array,
    ) -> None:
        self._rows, self._period = admittance.axis_rows[axes], law.period
        self._filter = admittance.sensor.filter
        self._steps = [exact_step(row[0], row[1], row[2], law.period) for row in self._rows]
        robot, n = law.robot, law.robot.configuration_size
        a, b = model.transition, model.inputs
        pose = robot.fkm(q)
        place = algebra.translation(pose)
        turn = algebra.matrix_from_pose(pose)[:3, :3] if admittance.axes != "base" else np.eye(3)
        jacobian = np.vstack([turn.T @ part for part in np.split(robot.hand_jacobian(q), 2)])
        ways, self._acts = contacts @ jacobian, contacts[:, axes]
        self._soft = float(ways[0] ** 2 @ soft) if len(ways) == 1 else 0.0
        m, state = robot.input_size, law.initial_state(q)

        def command(angles: Array, axis: int, way: float, speed: float, more: float) -> Array:
            sample, out, direction = np.zeros(21), np.empty(m), turn[:, axis % 3]
            if axis < 3:
                turned = algebra.pose(algebra.rotation_from_axis_angle(direction, way), np.zeros(3))
                sample[:8] = algebra.pose(algebra.rotation(algebra.multiply(turned, pose)), place)
                screw = np.concatenate([direction, np.cross(place, direction)])
            else:
                sample[:8] = algebra.multiply(algebra.pose([1, 0, 0, 0], way * direction), pose)
                screw = np.concatenate([np.zeros(3), direction])
            sample[8:14], sample[14:20] = speed * screw, more * screw
            law.step(angles, sample, 0, state.copy(), out)
            return out

        def slope(axis: int, *change: Any) -> Array:
            moved, *given = (_STEP * each for each in change)
            behind = command(q - moved, axis, *(-each for each in given))
            return (command(q + moved, axis, *given) - behind) / (2 * _STEP)

        by_joints = np.column_stack([slope(axes[0], each, 0.0, 0.0, 0.0) for each in np.eye(n)])
        # of each axis by way, speed and its rate
        by_sample = np.array([[slope(axis, np.zeros(n), *each) for each in np.eye(3)] for axis in axes])
        if b.shape[1] == 1 and n > 1:  # one joint stands for all
            along = ways[0]
            answer, size = along @ by_joints, along @ along
            share = answer @ along / size
            alone = len(axes) == len(ways) == 1
            # and for the way along the axis
            if alone and np.abs(answer - share * along).max() < _STEP * abs(share):
                by_sample, ways = (by_sample @ along)[..., None], np.ones((1, 1))
                by_joints = np.array([[share]])
            else:
                a, b = np.kron(a, np.eye(n)), np.kron(b, np.eye(n))
        self._by_joints = np.zeros((b.shape[1], len(a)))
        self._by_joints[:, : ways.shape[1]] = by_joints
        self._ways = np.zeros((len(ways), len(a)))
        self._ways[:, : ways.shape[1]] = ways
        self._plant, self._by_sample = (a, b), by_sample

    def radius(self, stiffness: float, mass: float = 0.0, factor: float = 1.0) -> float:
        """Return the largest modulus of the loop's poles; with a mass the stiffness is that of springs to it.

        ``factor`` multiplies the damping.
        """
        (a, b), period = self._plant, self._period
        inner, by_begin, by_end, force, direct = _environment(stiffness, mass, self._filter, period)
        size, count, parts, axes = len(a), len(self._ways), len(inner), len(self._rows)
        by_force = size + count * parts  # then deflection and rate of each axis
        total = by_force + 2 * axes
        forces = np.zeros((count, total))
        forces[:, :size] = direct * self._ways
        forces[:, size:by_force] = np.kron(np.eye(count), force)
        command, step = np.zeros((b.shape[1], total)), np.zeros((total, total))
        command[:, :size] = self._by_joints
        for i, row in enumerate(self._rows):
            c = by_force + 2 * i
            f = self._steps[i] if factor == 1 else exact_step(row[0], factor * row[1], row[2], period)
            ahead, after = f[2] * self._acts[:, i] @ forces, f[5] * self._acts[:, i] @ forces
            ahead[c : c + 2] += f[:2]
            after[c : c + 2] += f[3:5]
            step[c], step[c + 1] = ahead, after
            by_way, by_speed, by_rate = self._by_sample[i]
            command[:, c] += by_way - by_speed / period
            command += np.outer(by_speed, ahead / period)
            if row[0]:
                command += np.outer(by_rate, after / period)
                command[:, c + 1] -= by_rate / period
        step[:size, :size] = a
        step[:size] += b @ command
        if parts:
            step[size:by_force, size:by_force] = np.kron(np.eye(count), inner)
            step[size:by_force, :size] += np.kron(self._ways, by_begin[:, None])
            step[size:by_force] += np.kron(self._ways @ step[:size], by_end[:, None])
        return float(np.abs(np.linalg.eigvals(step)).max())

    def limit(self, mass: float = 0.0) -> float:
        """Return the stiffness from which on the loop is unstable, N/m or N·m/rad; infinite if none is."""
        limit = _first_failure(lambda stiffness: self.radius(stiffness, mass))
        return limit / (1 - self._soft * limit) if self._soft * limit < 1 else np.inf

    def effective_stiffness(self, stiffness: float) -> float:
        """Return the stiffness of what is touched and of the joints behind it."""
        return stiffness / (1 + self._soft * stiffness)

    def least_damping(self, stiffness: float) -> float:
        """Return the damping from which on a stiffness is borne, N·s/m or N·m·s/rad; infinite if none bears it."""
        stiffness = self.effective_stiffness(stiffness)
        if (damping := self._rows[0, 1]) == 0:
            return np.nan
        share = _first_failure(lambda less: self.radius(stiffness, factor=1e4 / less), 1.0, 1e8)
        if share == 0:  # the loop is unstable with 10⁴ times the damping, too
            return np.inf
        return 0.0 if np.isinf(share) else float(1e4 / share * damping)


def _first_failure(
    radius: Callable[[float], float], least: float = _SOFTEST, most: float = _STIFFEST
) -> float:
    """Return where a loop first becomes unstable between two values: over a grid, then by halving."""
    grid = np.geomspace(least, most, _LOOKED_AT)
    failed = next((k for k, value in enumerate(grid) if not radius(value) <= 1 + _ROUNDING), None)
    if failed is None:
        return np.inf
    if failed == 0:
        return 0.0
    low, high = grid[failed - 1], grid[failed]
    for _ in range(_HALVINGS):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if radius(middle) <= 1 + _ROUNDING else (low, middle)
    return float(np.sqrt(low * high))


def _environment(
    stiffness: float, mass: float, lag: float, period: float
) -> tuple[Array, Array, Array, Array, float]:
    """Return filter and loose part over a period, by the hand's way at its begin and end, straight between them.

    And the force that is read at its begin, by their state and by the way there.
    """
    states = (1 if lag else 0) + (2 if mass else 0)
    if not states:
        return np.zeros((0, 0)), np.zeros(0), np.zeros(0), np.zeros(0), -stiffness
    rates, by_way = np.zeros((states, states)), np.zeros(states)
    x, frequency = states - 2, np.sqrt(stiffness / mass) if mass else 0.0
    if mass:  # its place, and its speed over the frequency: all states have the size of the way
        rates[x, x + 1], rates[x + 1, x], by_way[x + 1] = frequency, -frequency, frequency
    if lag:  # of the force over the stiffness
        rates[0, 0], by_way[0] = -1 / lag, -1 / lag
        if mass:
            rates[0, x] = 1 / lag
    # A decay and an oscillation are never equal, so the modes span the states. SciPy's matrix exponential takes a
    # hundred times as long where its BLAS wakes threads for a matrix of three rows.
    modes, shapes = np.linalg.eig(rates * period)
    inverse = np.linalg.inv(shapes)
    constant, straight = _phi(modes)

    def of_states(values: Array) -> Array:
        return (shapes * values @ inverse).real

    by_end = period * of_states(straight) @ by_way
    by_begin = period * of_states(constant) @ by_way - by_end
    force = stiffness * np.eye(states)[0 if lag else x]
    return of_states(np.exp(modes)), by_begin, by_end, force, 0.0 if lag else -stiffness


def _phi(z: Array) -> tuple[Array, Array]:
    """Return (exp z − 1)/z and (exp z − 1 − z)/z²; by their series near 0, where the differences lose digits."""
    near = np.abs(z) < 0.1  # the series leave out less than 1e-16 there
    powers = np.where(near, z, 0.0)[..., None] ** np.arange(12)
    far = np.where(near, 1.0, z)
    first = np.where(near, powers @ _FACTORIALS[:-1], np.expm1(far) / far)
    second = np.where(near, powers @ _FACTORIALS[1:], (np.expm1(far) - far) / far**2)
    return first, second
