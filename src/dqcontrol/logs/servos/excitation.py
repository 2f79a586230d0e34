"""A motion that tells what servos are: within limits, and with the precision to expect before anything moves."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from dqcontrol.algebra import rotation, translation
from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array, as_each, as_positive, unknown_name
from dqcontrol.experiments.parameter_units import suspected_degrees
from dqcontrol.experiments.results_folder import made_folder
from dqcontrol.experiments.run_comparison import unit_of_way
from dqcontrol.files.output_file import yaml_text
from dqcontrol.logs.joint_log import arm_of
from dqcontrol.logs.servos.joint_fit import NORMAL_95, QUANTUM
from dqcontrol.logs.servos.servo_orders import FIRST_ORDER, MOST_DELAY, held
from dqcontrol.measures.metric_tables import fitting_unit
from dqcontrol.references.points import POSITION, QUATERNION
from dqcontrol.references.straight import progress
from dqcontrol.robots import Robot, SerialArm
from dqcontrol.tables.tables import Cell, Column, Table

MOTION, HAND = "motion.csv", "hand.csv"

_HAND_STEP = 0.02  # s between the poses of the end effector's reference


def write_joint_motion(
    spec: Path,
    robot: Robot,
    time: Array,
    positions: Array,
    start: Array,
    plant: dict[str, Any],
    note: str,
    gain: float = 0.0,
    more: Mapping[str, Any] | None = None,
) -> None:
    """Write a spec, and beside it the joint positions and the poses of the end effector that it names.

    Parameters
    ----------
    spec
        The file; its name is that of the experiment.
    robot
        An arm with an origin, or one that comes with dqcontrol.
    time, positions
        Shape (N,), s, regular, from 0; (N, n), rad or m.
    start
        Configuration, shape (n,).
    plant
        As the spec says it.
    note
        First line of the spec.
    gain
        Of the law, 1/s.
    more
        Further keys of the spec.
    """
    period, folder = float(time[1] - time[0]), spec.parent
    write_table(folder / MOTION, ["time", *robot.joint_names], np.column_stack([time, positions]))
    step = max(round(_HAND_STEP / period), 1)
    rows = np.append(np.arange(0, len(time) - 1, step), len(time) - 1)
    poses = robot.fkm(positions[rows])
    hand = np.column_stack([time[rows], translation(poses), rotation(poses)])
    write_table(folder / HAND, ["time", *POSITION, *QUATERNION], hand)
    source, base_link, tip_link = robot.origin or (robot.name, None, None)
    ends = {key: value for key, value in (("base_link", base_link), ("tip_link", tip_link)) if value}
    data = {
        "name": spec.stem,
        "robot": {"source": source} | ends if ends else source,
        "start": [round(float(value), 9) for value in start],
        "period": round(period, 9),
        "reference": {"kind": "points", "file": HAND},
        "law": {"kind": "joint-motion", "file": MOTION} | ({"gain": gain} if gain else {}),
        "plant": plant,
        **(more or {}),
    }
    spec.write_text(f"# {note}\n{yaml_text(data)}", encoding="utf-8")


def write_table(path: Path, names: list[str], rows: Array) -> None:
    """Write columns with a line of their names."""
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="", fmt="%.9g")


Signal = Literal["zigzag", "multisine", "chirp"]

SIGNALS: tuple[Signal, ...] = ("zigzag", "multisine", "chirp")
SPEC = "excite.yaml"

_REST = 0.5  # s before and behind
_TOGETHER = 0.35  # of the time, in which all joints move together
_INSIDE = 0.05  # rad or m that stay free before the joints' limits
_LINES = 12  # frequencies of a multisine
_LOWEST, _HIGHEST = 0.15, 4.0  # Hz
_SMOOTH = 0.04  # s over which jumps of the acceleration are spread
_LEAST_SHARE = 1e-3  # of the way to the wall: twelve halvings found none inside
_TRADED, _UNSURE = 0.9, 0.15  # correlation of lag and delay, and of a lag its standard error


class Expected(NamedTuple):
    """What a log of the motion would tell of a joint: half widths of 95 % intervals, s, and the correlation."""

    name: str
    range: float
    speed: float
    acceleration: float
    lag: float
    delay: float
    correlation: float
    is_enough: bool


@dataclass(frozen=True, eq=False)
class Excitation:
    """A motion of the joints that `identify` learns from.

    Attributes
    ----------
    robot
        The arm.
    period
        T, s.
    time
        Shape (N,), s from 0.
    q
        Wanted positions, shape (N, n), rad or m.
    expected
        One a joint.
    assumed
        Lag (s), delay (s) and noise (rad or m) that the expectation is for.
    share
        Of the motion that the joints' limits allow, what the workspace left; 1 without one.

    Examples
    --------
    >>> motion = dqc.excite("iiwa7", [0, 0.6, 0, 1.6, 0, 0.6, 0])  # doctest: +SKIP
    >>> motion.save("results/excite")  # doctest: +SKIP
    """

    robot: Robot
    period: float
    time: Array
    q: Array
    expected: tuple[Expected, ...]
    assumed: tuple[float, float, float]
    share: float = 1.0

    def __repr__(self) -> str:
        return f"Excitation({self.robot.name!r}, {self.time[-1]:g} s)"

    def __str__(self) -> str:
        return "\n".join([str(self.table), *self.remarks])

    def _repr_markdown_(self) -> str:
        return "\n\n".join([self.table.markdown(), *self.remarks])

    @cached_property
    def table(self) -> Table:
        """One row a joint: how it moves, and what that tells."""
        lag, delay, noise = self.assumed
        unit = unit_of_way([self.robot])
        columns = [
            Column("joint"),
            Column("range", fitting_unit("rad or m", unit), ".3g"),
            Column("top speed", fitting_unit("rad/s or m/s", unit), ".3g"),
            Column("top acceleration", fitting_unit("rad/s² or m/s²", unit), ".3g"),
            Column("lag ± 95 %", "ms", ".2g"),
            Column("delay ± 95 %", "ms", ".2g"),
            Column("correlation", "", ".3f"),
            Column("enough"),
        ]
        rows: list[list[Cell]] = [
            [*each[:4], 1e3 * each.lag, 1e3 * each.delay, each.correlation, "yes" if each.is_enough else "no"]
            for each in self.expected
        ]
        title = (
            f"{self.robot.name}: {self.time[-1]:.3g} s of motion, to expect at lag {1e3 * lag:g} ms, "
            f"delay {1e3 * delay:g} ms, noise {1e3 * noise:.2g} mrad"
        )
        return Table(columns, rows, title)

    @property
    def remarks(self) -> list[str]:
        """What the table does not show, a line each."""
        lines = []
        if self.share < 1:
            lines.append(f"the workspace leaves {100 * self.share:.3g} % of what the joints' limits allow")
        short = [each.name for each in self.expected if not each.is_enough]
        if short:
            lines.append(
                f"{', '.join(short)}: lag and delay could not be told; allow more amplitude, speed or time, or start "
                "elsewhere"
            )
        return lines

    def save(self, folder: str | Path, *, force: bool = False) -> Path:
        """Write the motion and a spec that runs it.

        ``motion.csv`` has the wanted joint positions over time, for law ``joint-motion`` and any other program;
        ``hand.csv`` the poses that the end effector has then, a points file; ``excite.yaml`` runs both, on servos as
        assumed.

        Raises
        ------
        ExistsError
            If the folder exists (without ``force``).
        """
        folder = made_folder(folder, force=force)
        lag, delay, noise = self.assumed
        plant = {"kind": "servo", "time_constant": lag, "delay": delay, "encoder_noise": noise}
        note = "A motion for dqcontrol identify; the plant is assumed, put your own in its place."
        write_joint_motion(folder / SPEC, self.robot, self.time, self.q, self.q[0], plant, note)
        return folder


def excite(
    robot: str | Path | Robot,
    start: Sequence[float] | None = None,
    *,
    base_link: str | None = None,
    tip_link: str | None = None,
    signal: Signal = "zigzag",
    together: bool = False,
    duration: float = 60.0,
    period: float = 0.008,
    amplitude: float | Sequence[float] = 0.3,
    speed: float | Sequence[float] = 1.0,
    acceleration: float | Sequence[float] = 6.0,
    workspace: Sequence[float] | None = None,
    lag: float = 0.05,
    delay: float = 0.02,
    noise: float = 1e-4,
    resolution: float = 0.0,
    seed: int = 1,
) -> Excitation:
    """Return a motion of the joints that makes `identify` tell lag from delay.

    Joints move one after the other by the signal, then all together by a multisine whose lines are one joint's each
    (for sag, which depends on all, and to check the model on). Every joint begins and ends at rest at the start.

    Parameters
    ----------
    robot
        As for `load_robot`, or an arm; without mobile base.
    start
        Configuration about which it moves, rad or m; the middle of the joints' limits if omitted (0 where there are
        none).
    base_link, tip_link
        Ends of the chain in a URDF file.
    signal
        ``"zigzag"``: always at the limit of acceleration, from turning point to random turning point, which tells most;
        ``"multisine"`` or ``"chirp"``, which are smoother.
    together
        True: all joints at once, the whole time.
    duration, period
        s.
    amplitude
        Largest distance of a joint from its start, rad or m, each.
    speed, acceleration
        Largest of a joint, rad/s and rad/s² or m/s and m/s², each; no more than 0.9 of the robot's velocity limits.
    workspace
        Box ``x0, x1, y0, y1, z0, z1`` that the end effector does not leave, m, base frame; no box if omitted.
    lag, delay, noise, resolution
        Of the servos and encoders to expect, s, rad or m: what the expected precision is for.
    seed
        Of the random turning points and phases.

    Raises
    ------
    ValueRangeError
        If a limit leaves no room, or a number is out of its range.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> motion = dqc.excite("iiwa7", [0, 0.6, 0, 1.6, 0, 0.6, 0], duration=20)
    >>> all(each.is_enough for each in motion.expected)
    True
    """
    arm = arm_of(robot, "has a mobile base; excite its arm alone", base_link, tip_link)
    if signal not in SIGNALS:
        raise unknown_name("signal", str(signal), SIGNALS)
    n, period = arm.configuration_size, as_positive("period", period)
    if as_positive("duration", duration) < 2 * n:
        raise ValueRangeError(f"duration: must be ≥ {2 * n} s for {n} joints, got {duration:g}")
    middle = _start(arm, start)
    free = np.minimum(middle - arm.limits.lower, arm.limits.upper - middle) - _INSIDE
    room = np.minimum(as_each("amplitude", amplitude, n), free)
    speeds = np.minimum(as_each("speed", speed, n), 0.9 * arm.limits.velocity)
    accelerations = as_each("acceleration", acceleration, n)
    for field, values in (("amplitude", room), ("speed", speeds), ("acceleration", accelerations)):
        if (values <= 0).any():
            k = int(np.argmin(values))
            raise ValueRangeError(
                f"{field}: {arm.joint_names[k]} is left {values[k]:.3g}; start it elsewhere"
            )
    bounds = np.column_stack([room, speeds, accelerations])
    moves = _motion(np.random.default_rng(seed), signal, together, round(duration / period), period, bounds)
    share = _share_in(arm, middle, moves, workspace)
    q = middle + share * moves
    time = _grid(len(q), period)
    usual = math.hypot(as_positive("noise", noise, zero_allowed=True), resolution * QUANTUM)
    assumed = as_positive("lag", lag), as_positive("delay", delay, zero_allowed=True), usual
    expected = tuple(_expected(arm.joint_names[i], time, q[:, i], assumed, period) for i in range(n))
    return Excitation(arm, period, time, q, expected, assumed, share)


def middle_of_limits(arm: SerialArm) -> Array:
    """Return the middle of the joints' limits, shape (n,), rad or m; 0 of those without."""
    lower, upper = arm.limits.lower, arm.limits.upper
    return np.where(np.isfinite(lower + upper), 0.5 * (np.nan_to_num(lower) + np.nan_to_num(upper)), 0.0)


def _start(arm: SerialArm, start: Sequence[float] | None) -> Array:
    if start is None:
        return middle_of_limits(arm)
    lower, upper = arm.limits.lower, arm.limits.upper
    q0 = as_array("start", start, (arm.configuration_size,))
    for k in np.flatnonzero((q0 < lower) | (q0 > upper))[:1]:
        raise ValueRangeError(
            f"start: {arm.joint_names[k]} = {q0[k]:g} is beyond its limits {lower[k]:.4g} … "
            f"{upper[k]:.4g}{suspected_degrees(q0, arm)}"
        )
    return q0


def _motion(
    rng: np.random.Generator, signal: Signal, together: bool, count: int, period: float, bounds: Array
) -> Array:
    """Return the moves (N, n) away from the start, within bounds (n, 3) of distance, speed and acceleration."""
    n, rest = len(bounds), max(round(_REST / period), 1)
    out = np.zeros((count, n))
    make = _SIGNALS[signal]
    first = rest
    alone = 0 if together else round((count - 2 * rest) * (1 - _TOGETHER) / n)
    for i in range(n if alone else 0):
        out[first : first + alone, i] = _within(make(rng, alone, period, bounds[i], i, 1), period, bounds[i])
        first += alone
    left = count - rest - first
    for i in range(n):
        shape = (make if together else _multisine)(rng, left, period, bounds[i], i, n)
        out[first : first + left, i] = _within(shape, period, bounds[i])
    return out


def _within(shape: Array, period: float, bounds: Array) -> Array:
    """Return a shape as large as its bounds allow, from rest to rest."""
    rates = np.diff(shape, prepend=0.0, append=0.0) / period
    largest = np.abs(shape).max(), np.abs(rates).max(), np.abs(np.diff(rates)).max() / period
    scale = min(bound / max(size, 1e-12) for bound, size in zip(bounds, largest, strict=True))
    return shape * scale


def _zigzag(rng: np.random.Generator, count: int, period: float, bounds: Array, i: int, n: int) -> Array:
    """Return moves to turning points on alternating sides, each half sped up and half slowed down at the limit."""
    room, speed, acceleration = (float(value) for value in 0.95 * bounds)
    width = max(round(_SMOOTH / period), 1)
    parts, at, side, left = list[Array](), 0.0, 1.0, count - 2 * width
    while True:
        goal = side * room * rng.uniform(0.25, 1.0)
        there, back = _move(goal - at, speed, acceleration, period), _move(-goal, speed, acceleration, period)
        if len(there) + len(back) > left:
            break
        parts.append(there)
        at, side, left = goal, -side, left - len(there)
    parts.append(_move(-at, speed, acceleration, period))
    path, moved = np.cumsum(np.concatenate(parts)), np.zeros(count)
    moved[width : width + len(path)] = path
    return np.convolve(moved, np.full(width, 1 / width), mode="same")


def _move(way: float, speed: float, acceleration: float, period: float) -> Array:
    """Return the steps of a move, which sum to its way, with the speed of a triangle or trapezium."""
    if not way:
        return np.zeros(0)
    ramp = min(math.sqrt(abs(way) / acceleration), speed / acceleration)
    steps = max(math.ceil((ramp + abs(way) / (acceleration * ramp)) / period), 4)
    at = np.arange(steps) + 0.5
    shape = np.minimum(np.minimum(at, steps - at) / max(ramp / period, 1.0), 1.0)
    return shape * way / shape.sum()


def _multisine(rng: np.random.Generator, count: int, period: float, bounds: Array, i: int, n: int) -> Array:
    """Return sines, amplitudes as 1/f; lines of joint i of n lie between those of the others."""
    time = _grid(count, period)
    top = min(_HIGHEST, 0.2 / period)
    frequency = np.geomspace(_LOWEST, top, _LINES * n)[i::n]
    phase = rng.uniform(0, 2 * math.pi, len(frequency))
    waves = np.sin(2 * math.pi * frequency * time[:, None] + phase) @ (1 / frequency)
    return waves * _swell(time)


def _chirp(rng: np.random.Generator, count: int, period: float, bounds: Array, i: int, n: int) -> Array:
    """Return a sine whose frequency grows from line to line, its amplitude as its bounds allow at each frequency."""
    time = _grid(count, period)
    length, top = max(time[-1], period), min(_HIGHEST, 0.2 / period)
    ratio = math.log(top / _LOWEST)
    phase = 2 * math.pi * _LOWEST * length / ratio * np.expm1(ratio * time / length)
    rate = 2 * math.pi * _LOWEST * np.exp(ratio * time / length)
    size = np.minimum(np.minimum(bounds[0], bounds[1] / rate), bounds[2] / rate**2)
    return size * np.sin(phase + 2 * math.pi * i / n) * _swell(time)


def _grid(count: int, period: float) -> Array:
    return period * np.arange(count, dtype=np.float64)


def _swell(time: Array) -> Array:
    return progress(np.clip(np.minimum(time, time[-1] - time) / 0.5, 0, 1))


_SIGNALS: dict[Signal, Callable[[np.random.Generator, int, float, Array, int, int], Array]] = {
    "zigzag": _zigzag,
    "multisine": _multisine,
    "chirp": _chirp,
}


def _share_in(arm: SerialArm, middle: Array, moves: Array, workspace: Sequence[float] | None) -> float:
    """Return the largest share of the moves, 1 at most, with which the end effector stays in its box."""
    if workspace is None:
        return 1.0
    box = np.asarray(workspace, dtype=np.float64)
    if box.shape != (6,) or not np.isfinite(box).all() or (box[::2] >= box[1::2]).any():
        raise ShapeError(
            f"workspace: expected x0, x1, y0, y1, z0, z1 with x0 < x1 and so on, got {box.tolist()}"
        )
    lower, upper = box[::2], box[1::2]

    def is_inside(share: float) -> bool:
        points = translation(arm.fkm(middle + share * moves))
        return bool((points >= lower).all() and (points <= upper).all())

    if not is_inside(0.0):
        point = translation(arm.fkm(middle))
        raise ValueRangeError(
            f"workspace: the end effector starts outside of it, at {np.round(point, 4).tolist()} m"
        )
    if is_inside(1.0):
        return 1.0
    inside, outside = 0.0, 1.0
    for _ in range(12):
        trial = (inside + outside) / 2
        inside, outside = (trial, outside) if is_inside(trial) else (inside, trial)
    if inside < _LEAST_SHARE:
        raise ValueRangeError(
            "workspace: the end effector starts at its side and cannot move; start elsewhere"
        )
    return inside


def _expected(
    name: str, time: Array, positions: Array, assumed: tuple[float, float, float], period: float
) -> Expected:
    """Return what least squares would tell of a joint, from the information of the model at its assumed numbers."""
    lag, delay, noise = assumed
    times = time[time >= MOST_DELAY]
    answer = FIRST_ORDER.answer(held(time, positions), np.array([lag, delay]), times)
    columns = np.column_stack([answer.slopes, answer.output, answer.transients, np.ones(len(times))])
    sizes = np.linalg.norm(columns, axis=0)
    sizes[sizes == 0] = 1.0
    scaled = columns / sizes
    covariance = noise**2 * np.linalg.pinv(scaled.T @ scaled, rcond=1e-13) / np.outer(sizes, sizes)
    errors = np.sqrt(np.diag(covariance))
    correlation = float(covariance[0, 1] / (errors[0] * errors[1])) if errors[0] * errors[1] else 0.0
    rates = np.diff(positions) / period
    enough = (abs(correlation) < _TRADED or errors[0] < _UNSURE * lag) and errors[1] < period
    return Expected(
        name=name,
        range=float(np.ptp(positions)),
        speed=float(np.abs(rates).max()),
        acceleration=float(np.abs(np.diff(rates)).max() / period),
        lag=float(NORMAL_95 * errors[0]),
        delay=float(NORMAL_95 * errors[1]),
        correlation=correlation,
        is_enough=bool(enough),
    )
