"""Records for other programs: CSV, Parquet and MATLAB files of all signals with their units.

CSV and Parquet hold one row a sample and these columns, each named ``NAME [unit]`` (no brackets without a unit):

====================================  ===============================================================
column                                holds
====================================  ===============================================================
``time``                              s
``JOINT``                             true configuration, rad or m; one column for each joint
``measured.JOINT``                    configuration as the law saw it
``command.INPUT``                     inputs after all limits, rad/s or m/s
``pose.pw`` … ``pose.dz``             pose of the end effector, primary part, then dual part (m), inertial frame
``desired.pw`` … ``desired.dz``       desired pose
``desired_twist.wx`` … ``.vz``        ω + ε(ṗ + p × ω), rad/s and m/s, inertial frame
``desired_twist_rate.wx`` … ``.vz``   its derivative, rad/s² and m/s²
``disturbance.wx`` … ``.vz``          twist of a disturbance, if there was one, as the desired twist
``error``                             |1 − x* x_d|
``position_error``                    m
``orientation_error``                 rad
``NAME.PART``                         what else the plant senses, if it does: ``wrist_force.x``, …
====================================  ===============================================================

A MATLAB file holds the same as matrices, one row a sample, of the names before the dot (``q`` for the
configuration), ``joint_names``, ``input_names``, ``stopped``, and in the structure ``units`` the unit of each
column, ``'1'`` where there is none. All numbers keep all their digits.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import ExistsError, ShapeError, from_extra, unknown_name, writing
from dqcontrol.files.lerobot_dataset import ACTION, COMMAND, POSE, REFERENCE, STATE, Feature
from dqcontrol.files.output_file import whole_file
from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import Signal
from dqcontrol.references.sample import TWIST, TWIST_RATE
from dqcontrol.robots.robot import Robot

DUAL_QUATERNION = ("pw", "px", "py", "pz", "dw", "dx", "dy", "dz")
_POSE_UNITS = ("",) * 4 + ("m",) * 4
_ROWS = 1 << 13  # at a time: what is written takes no more memory for longer runs
_TWIST = ("wx", "wy", "wz", "vx", "vy", "vz")


def signals(
    record: Record, joint_units: Sequence[str] | None = None, input_units: Sequence[str] | None = None
) -> tuple[Signal, ...]:
    """Return all signals of a record.

    Parameters
    ----------
    record
        The run.
    joint_units, input_units
        ``"rad"`` or ``"m"`` for each configuration variable and each input (meaning rad/s or m/s); rad if omitted.

    Raises
    ------
    ShapeError
        If there are too few or too many units.

    Examples
    --------
    >>> [signal.name for signal in signals(run.record)][:3]  # doctest: +SKIP
    ['time', 'q', 'measured']
    """
    joints = _units("joint_units", joint_units, record.joint_names)
    inputs = tuple(f"{unit}/s" for unit in _units("input_units", input_units, record.input_names))
    twist, rate = ("rad/s",) * 3 + ("m/s",) * 3, ("rad/s²",) * 3 + ("m/s²",) * 3
    moved = record.disturbance
    disturbed = () if moved is None else (Signal("disturbance", _TWIST, twist, moved),)
    return (
        Signal("time", (), ("s",), record.time[:, None]),
        Signal("q", record.joint_names, joints, record.q),
        Signal("measured", record.joint_names, joints, record.measured),
        Signal("command", record.input_names, inputs, record.command),
        Signal("pose", DUAL_QUATERNION, _POSE_UNITS, record.pose),
        Signal("desired", DUAL_QUATERNION, _POSE_UNITS, record.desired_pose),
        Signal("desired_twist", _TWIST, twist, record.desired[:, TWIST]),
        Signal("desired_twist_rate", _TWIST, rate, record.desired[:, TWIST_RATE]),
        *disturbed,
        Signal("error", (), ("",), record.error[:, None]),
        Signal("position_error", (), ("m",), record.position_error[:, None]),
        Signal("orientation_error", (), ("rad",), record.orientation_error[:, None]),
        *record.readings.values(),
    )


def export_record(
    record: Record,
    path: str | Path,
    *,
    joint_units: Sequence[str] | None = None,
    input_units: Sequence[str] | None = None,
    notes: Mapping[str, str] | None = None,
    force: bool = False,
) -> Path:
    """Write all signals of a record to a file for another program; the file appears whole or not at all.

    Parameters
    ----------
    record
        The run.
    path
        Its suffix chooses the format: ``.csv``, ``.parquet`` (needs pyarrow) or ``.mat`` (needs SciPy). Missing
        folders are made.
    joint_units, input_units
        As for `signals`.
    notes
        Texts kept with the data in Parquet and MATLAB files, as the spec; the names are letters and ``_``.
    force
        Replace an existing file.

    Returns
    -------
    The path.

    Raises
    ------
    UnknownNameError
        If the suffix is none of these.
    ExistsError
        If the file exists, without ``force``.
    MissingExtraError
        If the library that writes the format is not installed.
    ShapeError
        If the units do not fit the record, or two columns would have one name.

    Examples
    --------
    >>> export_record(run.record, "circle.parquet")  # doctest: +SKIP
    """
    path = Path(path)
    if path.suffix.lower() not in WRITERS:
        raise unknown_name(f"{path}: suffix", path.suffix, WRITERS)
    if path.is_dir():
        raise ExistsError(f"{path}: is a folder; choose another name")
    if path.exists() and not force:
        raise ExistsError(f"{path}: exists; choose another name, or replace it with --force (force=True)")
    texts = {"stopped": record.stopped} | dict(notes or {})
    columns = signals(record, joint_units, input_units)
    _headings(columns)
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path, overwrite=force) as draft:
            WRITERS[path.suffix.lower()](draft, record, columns, texts)
    return path


def _csv(path: Path, record: Record, columns: Sequence[Signal], notes: Mapping[str, str]) -> None:
    heading = io.StringIO()
    csv.writer(heading, lineterminator="\n").writerow(_headings(columns))
    with open(path, "wb") as stream:
        stream.write(heading.getvalue().encode())
        for rows in _blocks(columns):
            if np.isfinite(rows).all():  # msgspec writes numbers with all digits, 30 times as fast as Python
                lines = msgspec.json.encode(rows.tolist())[2:-2].replace(b"],[", b"\n")
            else:
                lines = "\n".join(",".join(map(repr, row)) for row in rows.tolist()).encode()
            stream.write(lines + b"\n")


def _parquet(path: Path, record: Record, columns: Sequence[Signal], notes: Mapping[str, str]) -> None:
    pyarrow, parquet = (from_extra(name, "data", "Parquet files") for name in ("pyarrow", "pyarrow.parquet"))
    metadata = {f"dqcontrol.{name}": text for name, text in notes.items()}
    schema = pyarrow.schema([(name, pyarrow.float64()) for name in _headings(columns)], metadata=metadata)
    with open(path, "wb") as stream, parquet.ParquetWriter(stream, schema, compression="zstd") as writer:
        for rows in _blocks(columns):
            writer.write_table(pyarrow.table(list(np.ascontiguousarray(rows.T)), schema=schema))


def _blocks(columns: Sequence[Signal]) -> Iterator[NDArray[np.float64]]:
    """Yield the rows of all columns, some at a time."""
    for first in range(0, len(columns[0].values), _ROWS):
        yield np.hstack([signal.values[first : first + _ROWS] for signal in columns])


def _mat(path: Path, record: Record, columns: Sequence[Signal], notes: Mapping[str, str]) -> None:
    from scipy.io import savemat

    content: dict[str, Any] = {signal.name: signal.values for signal in columns}
    content["units"] = {signal.name: _cell([unit or "1" for unit in signal.units]) for signal in columns}
    content["joint_names"], content["input_names"] = _cell(record.joint_names), _cell(record.input_names)
    with open(path, "wb") as stream:
        savemat(stream, content | dict(notes), do_compression=True)


def _headings(columns: Sequence[Signal]) -> list[str]:
    """Return the names of all columns; none may stand for two of them."""
    headings = [heading for signal in columns for heading in signal.headings()]
    for heading in headings:
        if headings.count(heading) > 1:
            raise ShapeError(f"joint_names: two columns would be named '{heading}'; rename a joint")
    return headings


def _cell(texts: Sequence[str]) -> NDArray[np.object_]:
    return np.array(texts, dtype=object)[None, :]


def _units(field: str, units: Sequence[str] | None, names: Sequence[str]) -> tuple[str, ...]:
    if units is None:
        return ("rad",) * len(names)
    if len(units) != len(names):
        raise ShapeError(f"{field}: expected {len(names)} units, got {len(units)}")
    return tuple(units)


WRITERS: dict[str, Callable[[Path, Record, Sequence[Signal], Mapping[str, str]], None]] = {
    ".csv": _csv,
    ".parquet": _parquet,
    ".mat": _mat,
}


_POSE_FEATURE = Feature(DUAL_QUATERNION, ("",) * 4 + ("m",) * 4)
# s: stamps of a recording are whole nanoseconds, and floats of a million seconds 1e-10 apart
_TAKEN_EARLY = 1e-6


def record_columns(robot: Robot, record: Record) -> dict[str, tuple[Feature, Array]]:
    """Return the columns of a run; see `motion_columns`."""
    motion = record.time, record.measured, record.command
    return motion_columns(robot, *motion, None, record.desired_pose, record.readings.values())


def motion_columns(
    robot: Robot,
    time: Array,
    measured: Array,
    command: Array | None,
    target: Array | None = None,
    desired: Array | None = None,
    readings: Iterable[Signal] = (),
) -> dict[str, tuple[Feature, Array]]:
    """Return the columns of a motion of N samples, by their names in a dataset.

    ``observation.state`` are measured positions, ``observation.pose`` the end effector's pose there (unit dual
    quaternion), ``observation.NAME`` what else was sensed (a wrench), ``action`` the commanded positions: ``target``,
    or the first measured position and what the commanded velocities add up to, q₀ + Σ T u; of robots whose inputs are
    no rates of their coordinates, the inputs. ``command`` are the commanded velocities, ``reference.pose`` the desired
    pose.

    Parameters
    ----------
    robot
        Names and units are its.
    time
        (N,), s.
    measured, target
        (N, n), rad or m.
    command
        (N, m), rad/s or m/s.
    desired
        (N, 8).
    readings
        What else was sensed, N samples.
    """
    units = tuple("rad" if kind == "revolute" else "m" for kind in robot.joint_types)
    rates = tuple("rad/s" if kind == "revolute" else "m/s" for kind in robot.input_types)
    positions = Feature(tuple(f"{name}.pos" for name in robot.joint_names), units)
    speeds = Feature(tuple(f"{name}.vel" for name in robot.input_names), rates)
    columns = {STATE: (positions, measured), POSE: (_POSE_FEATURE, robot.fkm(measured))}
    for signal in readings:
        names = tuple(signal.parts or (signal.name,))
        columns[f"observation.{signal.name}"] = Feature(names, tuple(signal.units)), signal.values
    if target is None and command is not None and tuple(robot.input_names) == tuple(robot.joint_names):
        steps = np.diff(time, append=2 * time[-1] - time[-2])[:, None]
        target = measured[0] + np.cumsum(steps * command, axis=0)
    if target is not None:
        columns[ACTION] = positions, target
        if command is not None:
            columns[COMMAND] = speeds, command
    elif command is not None:
        columns[ACTION] = speeds, command
    if desired is not None:
        columns[REFERENCE] = _POSE_FEATURE, desired
    return columns


def at_rate(time: Array, columns: Mapping[str, tuple[Feature, Array]], fps: int) -> dict[str, Array]:
    """Return the values of columns at a number of frames a second: at each the latest sample, as a recorder sees it."""
    count = int(np.floor((time[-1] - time[0]) * fps + _TAKEN_EARLY)) + 1
    rows = np.searchsorted(time - time[0], np.arange(count) / fps + _TAKEN_EARLY, side="right") - 1
    return {name: values[rows] for name, (_, values) in columns.items()}
