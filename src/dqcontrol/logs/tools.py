"""Tools on force sensors: a motion that tells their weight and bias, and what its log says of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import replace
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from dqcontrol import algebra, contact
from dqcontrol.arrays import Array
from dqcontrol.contact.tool import WORST_CONDITION
from dqcontrol.errors import FileFormatError, ValueRangeError, as_array, as_positive
from dqcontrol.experiments.results_folder import made_folder
from dqcontrol.files.output_file import whole_file, yaml_text
from dqcontrol.logs.joint_log import JointLog, arm_of, read_joint_log
from dqcontrol.logs.joint_messages import is_recording, read_wrenches
from dqcontrol.logs.servos.excitation import middle_of_limits, write_joint_motion
from dqcontrol.references.straight import PEAK_SPEED, progress
from dqcontrol.robots import Robot, SerialArm
from dqcontrol.tables.tables import Cell, Column, Table

SPEC = "tool.yaml"

_STRAIGHT = np.array([1.0, 0.0, 0.0, 0.0])
_YAWS = 24  # about the vertical at which each orientation is tried
_ROOM = 0.02  # rad or m that stay free before the limits of joints
_REST = 1.5  # s in each pose: half a second to settle, then a hundred readings at 100 Hz
_SPEED = 0.5  # rad/s or m/s, no more than half of the robot's limits
# rad or m that no joint leaves for so many seconds: at rest, noise of encoders included
_STILL, _AROUND = 2e-3, 0.2
# s that are left out behind a motion, for lags and filters; s that are enough to read
_SETTLED, _SHORTEST = 0.4, 0.3


@dataclass(frozen=True, eq=False, repr=False)
class ToolMotion:
    """Rests in orientations that tell a tool's weight, centre and the bias of its sensor, and the way between them.

    Attributes
    ----------
    robot
        The arm.
    period
        T, s.
    q
        Wanted positions, shape (N, n), rad or m, one row a period.
    rests
        Configurations in which it rests, shape (K, n).
    condition
        Of the worse one of the two fits.

    Examples
    --------
    >>> motion = dqc.logs.tool_motion("iiwa7", [0, 0.6, 0, -1.6, 0, 0.9, 0])  # doctest: +SKIP
    >>> motion.save("results/tool")  # doctest: +SKIP
    """

    robot: Robot
    period: float
    q: Array
    rests: Array
    condition: float

    def __repr__(self) -> str:
        return f"ToolMotion({self.robot.name!r}, {len(self.rests)} rests)"

    def __str__(self) -> str:
        return str(self.table)

    @cached_property
    def table(self) -> Table:
        """One row a rest."""
        columns = [Column("rest"), *(Column(name, "", ".4g") for name in self.robot.joint_names)]
        rows: list[list[Cell]] = [[k + 1, *rest.round(6).tolist()] for k, rest in enumerate(self.rests)]
        seconds = self.period * (len(self.q) - 1)
        title = (
            f"{self.robot.name}: {len(rows)} rests in {seconds:.3g} s, condition {self.condition:.3g} "
            f"(1 is best, above {WORST_CONDITION:g} is refused)"
        )
        return Table(columns, rows, title)

    def save(self, folder: str | Path, *, force: bool = False) -> Path:
        """Write the joint positions over time, ``motion.csv``, and ``tool.yaml``, which runs them on servos.

        Raises
        ------
        ExistsError
            If the folder exists (without ``force``).
        """
        folder = made_folder(folder, force=force)
        plant = {"kind": "servo", "time_constant": 0.05, "wrist": {"mass": 0.5, "force_noise": 0.1}}
        note = "Rests that tell a tool on a force sensor; plant and tool are assumed, put your own in their place."
        time = self.period * np.arange(len(self.q), dtype=np.float64)
        write_joint_motion(folder / SPEC, self.robot, time, self.q, self.q[0], plant, note)
        return folder


def tool_motion(
    robot: str | Path | Robot,
    start: Sequence[float] | None = None,
    sensor: contact.ForceSensor | None = None,
    *,
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
    period: float = 0.008,
) -> ToolMotion:
    """Propose a motion that tells a tool: the end effector stays and turns each axis of the sensor up and down.

    About the vertical it may stand anyhow: of 24 such ways it takes the nearest one within the joints' limits. Links
    and surroundings are not looked at: a run of the spec that `ToolMotion.save` writes does that.

    Parameters
    ----------
    robot
        An arm, or its name or file.
    start
        Configuration (n,) from which it goes and to which it comes back, rad or m; the middle of its limits if omitted.
    sensor
        Where the force sensor is, as a contact stage has it; at the end effector if omitted.
    gravity
        m/s² in the base frame.
    period
        T, s.

    Raises
    ------
    ValueRangeError
        If the orientations that it reaches are too much alike (condition above 5).

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> motion = dqc.logs.tool_motion("iiwa7", [0, 0.6, 0, -1.6, 0, 0.9, 0])
    >>> len(motion.rests), motion.condition < 1.3
    (6, True)
    """
    arm = arm_of(robot, "is no arm on a fixed base; a tool is told by turning its end effector")
    period, fall = as_positive("period", period), as_array("gravity", gravity, (3,))
    if not fall.any():
        raise ValueRangeError("gravity: is 0, so nothing weighs anything")
    begin = middle_of_limits(arm) if start is None else as_array("start", start, (arm.configuration_size,))
    at_sensor = (sensor or contact.ForceSensor()).pose
    place = algebra.pose(_STRAIGHT, algebra.translation(arm.fkm(begin)))
    back = algebra.conjugate(algebra.pose(algebra.rotation(at_sensor), np.zeros(3)))
    spins = np.arange(_YAWS) * (2 * np.pi / _YAWS)
    down = fall / np.linalg.norm(fall)
    yaws = algebra.pose([algebra.rotation_from_axis_angle(down, spin) for spin in spins], np.zeros(3))
    rests, at = list[Array](), begin
    left = list(algebra.multiply(_from_down(fall), algebra.pose(contact.tool_orientations(), np.zeros(3))))
    while left:
        turned = [algebra.multiply(yaws, algebra.multiply(turn, back)) for turn in left]
        near = [_nearest(arm, algebra.multiply(place, each), at) for each in turned]
        ways = [np.inf if q is None else float(np.abs(q - at).max()) for q in near]
        k = int(np.argmin(ways))
        if (q := near[k]) is None:
            break
        rests.append(q)
        at = q
        del left[k]
    found = np.array(rests).reshape(-1, len(begin))
    condition = (
        contact.gravity_condition(algebra.multiply(arm.fkm(found), at_sensor), fall) if rests else np.inf
    )
    if not condition <= WORST_CONDITION:
        raise ValueRangeError(
            f"start: from there {arm.name} reaches {len(rests)} of 6 orientations, which are too much alike (condition "
            f"{condition:.3g}, at most {WORST_CONDITION:g}); start where its end effector can turn over"
        )
    stops = [begin, *rests, begin]
    speed = np.minimum(_SPEED, 0.5 * arm.limits.velocity)
    parts = [stops[0][None]]
    for before, after in pairwise(stops):
        seconds = max(PEAK_SPEED * float((np.abs(after - before) / speed).max()), period)
        at_times = np.linspace(0.0, 1.0, max(int(np.ceil(seconds / period)), 1) + 1)[1:, None]
        at_rest = np.repeat(after[None], round(_REST / period), axis=0)
        parts += [before + progress(at_times) * (after - before), at_rest]
    return ToolMotion(arm, period, np.vstack(parts), found, condition)


def _from_down(fall: Array) -> Array:
    """Return what turns −z to where things fall, as a pose."""
    down = fall / np.linalg.norm(fall)
    axis = np.cross([0.0, 0.0, -1.0], down)
    size, angle = np.linalg.norm(axis), np.arccos(np.clip(-down[2], -1.0, 1.0))
    about = axis / size if size > 1e-9 else np.array([1.0, 0.0, 0.0])
    return algebra.pose(algebra.rotation_from_axis_angle(about, angle), np.zeros(3))


def _nearest(arm: SerialArm, poses: Array, at: Array) -> Array | None:
    """Return the nearest configuration with any of these poses, shape (K, 8); None if there is none."""
    found = arm.solve(poses, at, restarts=10)
    room = np.minimum(found.q - arm.limits.lower, arm.limits.upper - found.q).min(axis=1)
    reached = np.flatnonzero(found.success & (room >= _ROOM))
    if not len(reached):
        return None
    return found.q[reached[np.abs(found.q[reached] - at).max(axis=1).argmin()]]


@dataclass(frozen=True, eq=False, repr=False)
class ToolIdentification:
    """What logs say of a tool.

    Attributes
    ----------
    robot
        Name of the arm.
    logs
        The files.
    found
        Tool, what it leaves, and how well the orientations tell it; with a known tool only the bias is new.
    rests
        How often the arm was at rest.
    readings
        How many readings that were in all.
    """

    robot: str
    logs: tuple[Path, ...]
    found: contact.IdentifiedTool
    rests: int
    readings: int

    def __repr__(self) -> str:
        return f"ToolIdentification({self.robot!r}, {self.found.tool})"

    def __str__(self) -> str:
        return str(self.table)

    @cached_property
    def table(self) -> Table:
        """Name, value and unit of each number."""
        tool, found = self.found.tool, self.found
        rows: list[list[Cell]] = [["mass", f"{tool.mass:.4g}", "kg"]]
        for name, values, unit, scale in (
            ("centre", tool.center, "mm", 1e3),
            ("force bias", tool.force_bias, "N", 1.0),
            ("torque bias", tool.torque_bias, "N·m", 1.0),
        ):
            rows.append([name, ", ".join(f"{scale * each:.3f}" for each in values), unit])
        rows.append(["left of force", f"{found.force_left:.3g}", "N"])
        rows.append(["left of torque", f"{found.torque_left:.3g}", "N·m"])
        if np.isfinite(found.force_condition):
            rows.append(["condition", f"{max(found.force_condition, found.torque_condition):.3g}", ""])
        title = f"{self.robot}: tool from {self.rests} rests, {self.readings} readings"
        return Table([Column("tool"), Column("value"), Column("unit")], rows, title)

    def save(self, path: str | Path, *, force: bool = False) -> Path:
        """Write a file that ``contact.sensor.tool`` and ``supervisor.payload`` of a spec may name.

        Raises
        ------
        ExistsError
            If the file exists (without ``force``).
        """
        target = Path(path)
        found = self.found
        identified: dict[str, Any] = {
            "robot": self.robot,
            "logs": [each.name for each in self.logs],
            "rests": self.rests,
            "force_left": round(found.force_left, 6),
            "torque_left": round(found.torque_left, 6),
        }
        plain = msgspec.to_builtins(found.tool)
        tool = {key: _rounded(value) for key, value in plain.items() if value is not None}
        text = yaml_text({"tool": tool, "identified": identified})
        head = "# A tool on a force sensor, by dqcontrol identify tool: kg, m, N, N·m\n"
        with whole_file(target, overwrite=force) as draft:
            draft.write_text(head + text, encoding="utf-8")
        return target


def tool_from_logs(
    logs: str | Path | Sequence[str | Path],
    robot: str | Path | Robot,
    sensor: contact.ForceSensor | None = None,
    *,
    known: contact.Tool | None = None,
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
    wrench_topic: str | None = None,
    **options: Any,
) -> ToolIdentification:
    """Find a tool in logs of a robot that rests in several orientations; of a known one, the bias in any one of them.

    Where no joint leaves 2 mrad for 0.2 s the arm is at rest; of each rest the readings from 0.4 s on are one mean.

    Parameters
    ----------
    logs
        Recordings of ours or of ROS, or tables with columns fx, fy, fz, tx, ty, tz: see `read_joint_log`.
    robot
        The arm, its name or file.
    sensor
        Where the force sensor is, as a contact stage has it; at the end effector if omitted. Its tool is not asked.
    known
        A tool whose mass and centre are kept: a tare, for which one rest in the air is enough.
    gravity
        m/s² in the base frame.
    wrench_topic
        Of WrenchStamped, in recordings of ROS; the only one if omitted.
    options
        Of `read_joint_log`: ``joints``, ``angles``, ``joint_topic``.

    Raises
    ------
    FileFormatError, ShapeError, ValueRangeError
        If a log cannot be read, holds no wrench or no rest, or its orientations are too much alike.
    """
    arm = arm_of(robot, "is no arm on a fixed base")
    paths = [Path(logs)] if isinstance(logs, str | Path) else [Path(each) for each in logs]
    if not paths:
        raise FileFormatError("logs: expected at least one file, got none")
    configurations, wrenches, readings, day = list[Array](), list[Array](), 0, 0
    for path in paths:
        data = read_joint_log(path, arm, **options)
        times, forces = _wrenches(data, wrench_topic)
        q = data.q if data.record is None else data.record.measured
        day = max(day, data.origin)
        for begin, end in rests(data.time, q):
            rows = (times >= begin + _SETTLED) & (times <= end)
            if rows.any():
                still = (data.time >= begin + _SETTLED) & (data.time <= end)
                configurations.append(q[still].mean(axis=0))
                wrenches.append(forces[rows].mean(axis=0))
                readings += int(rows.sum())
    if not wrenches:
        raise FileFormatError(
            f"{paths[0]}: the robot nowhere rests for {_SETTLED + _SHORTEST:g} s; dqcontrol identify tool-motion "
            "proposes a motion that does"
        )
    poses = algebra.multiply(arm.fkm(np.array(configurations)), (sensor or contact.ForceSensor()).pose)
    read = poses, wrenches, gravity
    found = contact.tare_tool(known, *read) if known else contact.identify_tool(*read)
    stamp = datetime.fromtimestamp(day / 1e9, UTC) if day > _FIRST_STAMP else datetime.now(UTC)
    whole = dataclasses.replace(found, tool=replace(found.tool, tared=f"{stamp:%Y-%m-%d}"))
    return ToolIdentification(arm.name, tuple(paths), whole, len(wrenches), readings)


_FIRST_STAMP = 10**18  # ns, in the year 2001: smaller ones are of simulations, not of clocks


def rests(time: Array, q: Array) -> list[tuple[float, float]]:
    """Return begin and end, s, of the times in which no joint moves, long enough to be read."""
    if len(time) < 2:
        return []
    width = 2 * max(round(0.5 * _AROUND / float(np.median(np.diff(time)))), 1) + 1
    most, least = (each(q, width, axis=0, mode="nearest") for each in (maximum_filter1d, minimum_filter1d))
    spread = most - least
    still = np.concatenate([[False], (spread <= _STILL).all(axis=1), [False]])
    edges = np.flatnonzero(np.diff(still)).reshape(-1, 2)
    spans = [(float(time[first]), float(time[last - 1])) for first, last in edges]
    return [(begin, end) for begin, end in spans if end - begin >= _SETTLED + _SHORTEST]


def _wrenches(data: JointLog, topic: str | None) -> tuple[Array, Array]:
    """Return times, s as those of the log, and wrenches."""
    if data.wrench is not None and topic is None:
        return data.time, data.wrench
    if data.record is None and is_recording(data.path):
        stamps, values = read_wrenches(data.path, topic)
        return (stamps - data.origin) / 1e9, values
    raise FileFormatError(
        f"{data.path}: holds no wrench: columns fx, fy, fz, tx, ty, tz of tables, readings wrist_force and "
        "wrist_torque of a run, or a topic of WrenchStamped"
    )


def _rounded(value: Any) -> Any:
    """Return plain data with the digits that a sensor has."""
    if isinstance(value, list | tuple):
        return [_rounded(each) for each in value]
    return round(value, 9) if isinstance(value, float) else value
