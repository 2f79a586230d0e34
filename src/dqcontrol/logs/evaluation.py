"""The user's own data, measured: a joint log of any robot held against where its end effector should have been."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypedDict

import msgspec
import numpy as np
import yaml

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import NoteWarning, ShapeError, ValueRangeError, as_positive
from dqcontrol.experiments.load_results import EvaluationSpec
from dqcontrol.experiments.run import Run
from dqcontrol.experiments.spec import RobotSpec, Spec, Start, as_spec, start_configuration
from dqcontrol.experiments.spec.key_types import kinds_of, numbers_for_quantities
from dqcontrol.experiments.spec.reference_spec import AnyReference, Part
from dqcontrol.files.input_file import read_text
from dqcontrol.files.yaml_file import convert, parse_yaml
from dqcontrol.logs.joint_log import JointLog, is_own, read_joint_log
from dqcontrol.logs.joint_messages import holds_joint_states, is_recording, read_joint_states, read_poses
from dqcontrol.logs.joint_table import Angles, column_names
from dqcontrol.logs.text_table import Missing
from dqcontrol.loop import Record
from dqcontrol.recording import load_metadata
from dqcontrol.references import Points, Reference, SetPoint, load_points
from dqcontrol.references.sample import TIME
from dqcontrol.robots import Robot

_LEVER = 0.3  # m; points so far from the end effector's origin turn with it
_SAMPLES = 500  # of the log that are compared
_SHIFTS = 400  # that are tried before the best one is refined
_STILL = 1e-4  # m; motions below it have no time to be found


class Alignment(NamedTuple):
    """When the reference begins, s after the log's first sample; RMS distances of points there and at 0, m."""

    begin: float
    rms: float
    unshifted_rms: float


def align_with(time: Array, poses: Array, reference: Reference) -> Alignment:
    """Return the begin of the reference at which it is nearest to the logged poses, over the whole log.

    Compared are three points of the end effector, its origin and one 0.3 m along each of two axes, so that turns count.
    The reference rests at its ends. Where the robot lags behind, its lag counts as part of the shift.

    Parameters
    ----------
    time
        Of the log, shape (N,), s from 0.
    poses
        Of the end effector, shape (N, 8).
    reference
        With an end.

    Raises
    ------
    ValueRangeError
        If the reference has no end, or one of the two hardly moves.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> circle = dqc.references.Circle(start=[1, 0, 0, 0, 0, 0, 0, 0], radius=0.1, duration=2.0)
    >>> late = circle.samples(np.maximum(np.arange(0, 4, 0.01) - 0.7, 0))[:, :8]
    >>> round(align_with(np.arange(0, 4, 0.01), late, circle).begin, 3)
    0.7
    """
    if not np.isfinite(reference.duration):
        raise ValueRangeError(
            "align: the reference has no end and no motion to find in the log; give --start-time"
        )
    chosen = np.unique(np.linspace(0, len(time) - 1, _SAMPLES).round().astype(int))
    at, logged = time[chosen], _points(poses[chosen])
    grid = np.linspace(0.0, reference.duration, 4 * _SAMPLES)
    from scipy.optimize import minimize_scalar

    desired = _points(reference.samples(grid)[:, :8])
    for name, points in (("the reference", desired), ("the logged hand", logged)):
        if np.ptp(points, axis=0).max() < _STILL:
            raise ValueRangeError(f"align: {name} hardly moves; give --start-time")

    def cost(begin: float) -> float:
        shifted = np.column_stack([np.interp(at - begin, grid, each) for each in desired.T])
        return float(np.mean(np.sum((shifted - logged) ** 2, axis=1)) / 3)

    shifts = np.linspace(-reference.duration, float(time[-1]), _SHIFTS)
    best = int(np.argmin([cost(shift) for shift in shifts]))
    bounds = shifts[max(best - 1, 0)], shifts[min(best + 1, _SHIFTS - 1)]
    found = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-5})
    return Alignment(float(found.x), float(np.sqrt(found.fun)), float(np.sqrt(cost(0.0))))


def _points(poses: Array) -> Array:
    """Return three points that turn with the end effector, shape (N, 9), m."""
    frames = algebra.matrix_from_pose(poses)
    x, y, origin = (frames[:, :3, column] for column in (0, 1, 3))
    return np.concatenate([origin, origin + _LEVER * x, origin + _LEVER * y], axis=1)


STOPPED = "end of the log"
LOW_PASS = 10.0  # Hz; arms and their tasks are slower, and encoders' noise faster
_SNAP = 1e-9  # s; a sample this little before the start belongs to it


class ReferenceFile(Part, frozen=True, kw_only=True):
    """A reference in a file of its own.

    Parameters
    ----------
    reference
        As in the spec of an experiment.
    start
        Configuration in which the end effector is where the reference begins, rad or m; default: the log's first.
    """

    reference: AnyReference
    start: Start | None = None


def evaluate_log(
    log: str | Path,
    robot: str | Path | None = None,
    reference: str | Path | None = None,
    *,
    base_link: str | None = None,
    tip_link: str | None = None,
    reference_topic: str | None = None,
    reference_joints: str | Sequence[str] | None = None,
    joints: Sequence[str] | None = None,
    joint_topic: str | None = None,
    command_topic: str | None = None,
    angles: Angles | None = None,
    missing: Missing = "interpolate",
    start: float = 0.0,
    align: bool = False,
    duration: float | None = None,
    skip_initial: float | None = None,
    low_pass: float | None = None,
) -> Run:
    """Measure a joint log against a reference.

    The first sample is time 0. The reference begins there, or ``start`` seconds later; what was logged before is
    left out. Where the reference has ended, it rests at its last pose. Poses logged in the same recording keep
    its clock: samples before the first pose are left out. What was recognised in a log, left out or joined, and gaps
    and samples far from their neighbours, are told as `NoteWarning`.

    Parameters
    ----------
    log
        See `read_joint_log`.
    robot
        As for `load_robot`; may be left out for recordings of dqcontrol, which name it.
    reference
        A ``.yaml`` file with the key ``reference`` as in the spec of an experiment, and perhaps ``start``, or a whole
        spec; a points file (`load_points`); or another joint log, whose end effector shows the desired motion
        (``joints``, ``joint_topic`` and ``angles`` hold for both logs). May be left out for recordings of dqcontrol:
        they hold their own.
    base_link, tip_link
        Ends of the chain in a URDF file.
    reference_topic
        Topic of geometry_msgs/PoseStamped with the desired poses, robot base frame, or of sensor_msgs/JointState with
        the commanded positions, in ``reference`` or, if that is left out, in the log.
    reference_joints
        Columns of the log with the commanded positions: what their names begin with, as ``"target_"``, or all names in
        the robot's order. Where they put the end effector is where it should have been.
    joints, joint_topic, command_topic, angles, missing
        As for `read_joint_log`.
    start
        s after the log's first sample.
    align
        True: find the start at which the reference fits the log best; how late the
        robot is then no longer counts as error.
    duration
        s from there on; the rest is left out. Default: to the end of the log.
    skip_initial
        Length of the start that the settled errors leave out, s; default: as the spec says, if the reference or the
        recording has one, else 0.
    low_pass
        Cut-off of the filter behind speed and acceleration of the end effector and joint steps, Hz; 0 for none.
        Default: 10, and none for recordings of dqcontrol.

    Returns
    -------
    Run
        With metrics, and `Run.save` for record, plots and report. Its commands are NaN where the log has none.

    Raises
    ------
    Error
        If something is missing, malformed or does not fit.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> run = dqc.logs.evaluate_log("log.csv", "iiwa7", "circle.yaml")  # doctest: +SKIP
    >>> run.metrics.position.rms  # mm  # doctest: +SKIP
    """
    path = Path(log)
    about = about_log(path)
    if robot is not None:
        chosen = RobotSpec(source=str(robot), base_link=base_link, tip_link=tip_link)
    elif "robot" in about:
        chosen = convert(path, about["robot"], RobotSpec)
    else:
        raise ValueRangeError(f"robot: {path} does not name its robot; give one (--robot)")
    arm = chosen.load()
    options = _LogOptions(joints=joints, angles=angles, joint_topic=joint_topic, missing=missing)
    data = read_joint_log(path, arm, command_topic=command_topic, targets=reference_joints, **options)
    notes = list(data.notes)
    file = Path(reference) if reference is not None else None
    if low_pass is None:
        cutoff = LOW_PASS if data.record is None else None
    else:
        cutoff = as_positive("low_pass", low_pass, zero_allowed=True) or None
    begin = as_positive("start", start, zero_allowed=True)
    # what is wanted; if that is on the clock of the log, when it begins, s after the log's first sample
    wanted, begins, its_skipped = None, None, None
    if reference_joints is not None:
        if file is not None or reference_topic is not None:
            raise ValueRangeError("reference_joints: a reference is given, too; give one of them")
        assert data.target is not None
        wanted, begins = Points(data.time, arm.fkm(data.target)), 0.0
    elif reference_topic is not None:
        wanted, begins = _from_topic(data, arm, file, reference_topic, joints)
    elif file is not None:
        first = data.q[min(np.searchsorted(data.time, begin - _SNAP), len(data.q) - 1)]
        wanted, its_skipped = _from_file(file, arm, first, options)
    if align:
        if begin or wanted is None or begins is not None:
            raise ValueRangeError(
                "align: the start is given, too (--start-time); give one of them"
                if begin
                else "align: the reference is in the log itself and keeps its clock; leave it out"
            )
        found = align_with(data.time, arm.fkm(data.q), wanted)
        begin = found.begin
        notes.append(
            f"aligned: the reference begins at {begin:.4g} s of the log, where it is {1e3 * found.rms:.3g} mm RMS from "
            f"the end effector and its axes (at 0 s: {1e3 * found.unshifted_rms:.3g}); a robot's delay is part of that"
        )
    elif begins is not None:
        begin = max(begin, begins)
    end = np.inf if duration is None else begin + as_positive("duration", duration)
    kept = (data.time >= begin - _SNAP) & (data.time <= end + _SNAP)
    if kept.sum() < 2:
        raise ValueRangeError(
            f"{data.path}: fewer than two samples between {begin:g} and {end:g} s; the log has 0 … {data.time[-1]:g} s"
        )
    time = data.time[kept] - begin if align else np.maximum(data.time[kept] - begin, 0.0)
    q = data.q[kept]
    if skip_initial is not None and as_positive("skip_initial", skip_initial, zero_allowed=True) > time[-1]:
        raise ValueRangeError(
            f"skip_initial: must be ≤ the {time[-1]:g} s that are judged, got {skip_initial:g}"
        )
    if wanted is not None:
        desired = wanted.samples(time + (begin - begins if begins is not None else 0.0))
    elif data.record is not None:
        desired = data.record.desired[kept].copy()
    else:
        raise ValueRangeError(
            f"reference: {data.path} holds none; give a file (--reference), a topic (--reference-topic) "
            "or its columns of commanded positions (--reference-joints target_)"
        )
    for note in notes:
        warnings.warn(f"{path}: {note}", NoteWarning, stacklevel=2)
    desired[:, TIME] = time
    command = np.full((len(time), arm.input_size), np.nan) if data.command is None else data.command[kept]
    record = Record(time, q, q, command, arm.fkm(q), desired, arm.joint_names, stopped=STOPPED)
    skipped = float(about.get("skip_initial", 0.0)) if its_skipped is None else its_skipped
    columns = reference_joints if isinstance(reference_joints, str | None) else list(reference_joints)
    spec = EvaluationSpec(
        log=str(data.path.resolve()),
        robot=_absolute(chosen),
        reference=str(file.resolve()) if file is not None else None,
        reference_topic=reference_topic,
        reference_joints=columns,
        joints=list(joints) if joints is not None else None,
        joint_topic=joint_topic,
        command_topic=command_topic,
        angles=angles,
        missing=missing,
        start=begin if align else start,
        align=align,
        duration=duration,
        skip_initial=skipped if skip_initial is None else skip_initial,
        low_pass=cutoff,
    )
    text = yaml.safe_dump({"evaluation": msgspec.to_builtins(spec)}, sort_keys=False, allow_unicode=True)
    return Run(text, arm, record, spec.skip_initial, path.stem, low_pass=cutoff)


class _LogOptions(TypedDict):
    """How logs are read."""

    joints: Sequence[str] | None
    angles: Angles | None
    joint_topic: str | None
    missing: Missing


def about_log(path: Path) -> dict[str, Any]:
    """Return what a recording of ours, or the folder of a run, says about its run; nothing for other logs."""
    path = path / "record.mcap" if path.is_dir() else path
    data = parse_yaml(path, load_metadata(path)["spec"]) if is_own(path) else None
    if not isinstance(data, dict):
        return {}
    data = data.get("evaluation", data)
    robot = data.get("robot")
    return data | {"robot": {"source": robot} if isinstance(robot, str) else robot}


def _absolute(robot: RobotSpec) -> RobotSpec:
    if robot.source is None:
        return robot
    file = Path(robot.source)
    return msgspec.structs.replace(robot, source=str(file.resolve())) if file.is_file() else robot


def _from_topic(
    data: JointLog, robot: Robot, file: Path | None, topic: str, joints: Sequence[str] | None
) -> tuple[Reference, float | None]:
    """Return poses of a topic, or where positions of one put the end effector, in the file or else in the log."""
    source = file or data.path
    if not is_recording(source):
        raise ShapeError(f"reference_topic: {source} is no recording and has no topics, got '{topic}'")
    if holds_joint_states(source, topic):
        stamps, q = read_joint_states(source, joints or robot.joint_names, topic)
        poses = robot.fkm(q)
    else:
        stamps, poses = read_poses(source, topic)
    seconds = (stamps - stamps[0]) / 1e9
    reference = Points(seconds, poses) if len(poses) > 1 else SetPoint(poses[0])
    return reference, None if file is not None else (int(stamps[0]) - data.origin) / 1e9


def _from_file(
    file: Path, robot: Robot, start: Array, options: _LogOptions
) -> tuple[Reference, float | None]:
    """Return the reference of a file, and the start that the errors leave out, s, if the file says so."""
    names = (*(options["joints"] or robot.joint_names), "q1")
    if file.suffix.lower() in (".yaml", ".yml"):
        return _from_yaml(file, robot, start)
    if not is_recording(file) and set(names).isdisjoint(column_names(file, names)):
        return load_points(file, robot.fkm(start)), None
    options = {**options, "angles": None} if is_recording(file) else {**options, "joint_topic": None}
    taught = read_joint_log(file, robot, **options)
    return Points(taught.time, robot.fkm(taught.q)), None


def _from_yaml(file: Path, robot: Robot, start: Array) -> tuple[Reference, float | None]:
    data = parse_yaml(file, read_text(file))
    whole = isinstance(data, dict) and not data.keys().isdisjoint({"name", "law", "laws", "plant", "plants"})
    folder = file.resolve().parent
    if whole:
        spec: Spec | ReferenceFile = as_spec(str(file), data, folder)
    else:
        data = numbers_for_quantities(str(file), data, list(kinds_of(ReferenceFile)))
        spec = convert(file, data, ReferenceFile)
    if spec.start is not None:
        start = start_configuration(spec.start, robot, f"{file}: start")
    skipped = spec.skip_initial if isinstance(spec, Spec) else None
    return spec.reference.build(robot.fkm(start), folder), skipped
