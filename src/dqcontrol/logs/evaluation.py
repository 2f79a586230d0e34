"""The user's own data, measured: a joint log of any robot held against where its hand should have been."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import yaml
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_positive
from dqcontrol.experiments.evaluation_spec import EvaluationSpec
from dqcontrol.experiments.run import Run
from dqcontrol.experiments.spec import RobotSpec, Spec, Start, as_spec, start_configuration
from dqcontrol.experiments.spec.key_types import kinds_of, numbers_for_quantities
from dqcontrol.experiments.spec.old_keys import rename_old_keys
from dqcontrol.experiments.spec.reference_spec import AnyReference, Part
from dqcontrol.files.text_file import read_text
from dqcontrol.files.yaml_file import convert, parse_yaml
from dqcontrol.logs.joint_log import JointLog, is_own, read_joint_log
from dqcontrol.logs.joint_messages import is_recording, read_poses
from dqcontrol.logs.joint_table import Angles, column_names
from dqcontrol.loop import Record
from dqcontrol.moved import renamed_parameters
from dqcontrol.recording import load_metadata
from dqcontrol.references import Points, Reference, SetPoint, load_points
from dqcontrol.references.sample import TIME
from dqcontrol.robots import Robot

STOPPED = "end of the log"
_SNAP = 1e-9  # s; a sample this little before the start belongs to it


class ReferenceFile(Part, frozen=True, kw_only=True):
    """A reference in a file of its own.

    Parameters
    ----------
    reference
        As in the spec of an experiment.
    start
        Configuration in which the hand is where the reference begins, rad or m; default: the log's first.
    """

    reference: AnyReference
    start: Start | None = None


@renamed_parameters(settle="skip_initial")
def evaluate_log(
    log: str | Path,
    robot: str | Path | None = None,
    reference: str | Path | None = None,
    *,
    base_link: str | None = None,
    tip_link: str | None = None,
    reference_topic: str | None = None,
    joints: Sequence[str] | None = None,
    joint_topic: str | None = None,
    command_topic: str | None = None,
    angles: Angles | None = None,
    start: float = 0.0,
    duration: float | None = None,
    skip_initial: float | None = None,
) -> Run:
    """Measure a joint log against a reference.

    The first sample is time 0. The reference begins there, or ``start`` seconds later; what was logged before is
    left out. Where the reference has ended, it rests at its last pose. Poses logged in the same recording keep
    its clock: samples before the first pose are left out.

    Parameters
    ----------
    log
        See `read_joint_log`.
    robot
        As for `load_robot`; may be left out for recordings of dqcontrol, which name it.
    reference
        A ``.yaml`` file with the key ``reference`` as in the spec of an experiment, and perhaps ``start``, or a whole
        spec; a points file (`load_points`); or another joint log, whose hand shows the desired motion (``joints``,
        ``joint_topic`` and ``angles`` hold for both logs). May be left out for recordings of dqcontrol: they hold
        their own.
    base_link, tip_link
        Ends of the chain in a URDF file.
    reference_topic
        Topic of geometry_msgs/PoseStamped with the desired poses, robot base frame, in ``reference`` or, if that
        is left out, in the log.
    joints, joint_topic, command_topic, angles
        As for `read_joint_log`.
    start
        s after the log's first sample.
    duration
        s from there on; the rest is left out. Default: to the end of the log.
    skip_initial
        Length of the start that the settled errors leave out, s; default: as the spec says, if the reference or the
        recording has one, else 0.

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
    data = read_joint_log(
        path, arm, joints=joints, angles=angles, joint_topic=joint_topic, command_topic=command_topic
    )
    file = Path(reference) if reference is not None else None
    begin = as_positive("start", start, zero_allowed=True)
    poses = _poses(data, file, reference_topic)
    if poses is not None and file is None:
        begin = max(begin, poses.begin)
    kept = _kept(data, begin, duration)
    time = np.maximum(data.time[kept] - begin, 0.0)
    q = data.q[kept]
    if skip_initial is not None and as_positive("skip_initial", skip_initial, zero_allowed=True) > time[-1]:
        raise ValueRangeError(
            f"skip_initial: must be ≤ the {time[-1]:g} s that are judged, got {skip_initial:g}"
        )
    skipped = float(about.get("skip_initial", 0.0))
    if poses is not None:
        desired = poses.reference.samples(time + (begin - poses.begin if file is None else 0.0))
    elif file is not None:
        target, its_own = _from_file(file, arm, q[0], joints, angles, joint_topic)
        skipped = skipped if its_own is None else its_own
        desired = target.samples(time)
    elif data.record is not None:
        desired = data.record.desired[kept].copy()
    else:
        raise ValueRangeError(
            f"reference: {data.path} holds none; give a file (--reference) or topic (--reference-topic)"
        )
    desired[:, TIME] = time
    command = np.full((len(time), arm.input_size), np.nan) if data.command is None else data.command[kept]
    record = Record(time, q, q, command, arm.fkm(q), desired, arm.joint_names, stopped=STOPPED)
    spec = EvaluationSpec(
        log=str(data.path.resolve()),
        robot=_absolute(chosen),
        reference=str(file.resolve()) if file is not None else None,
        reference_topic=reference_topic,
        joints=list(joints) if joints is not None else None,
        joint_topic=joint_topic,
        command_topic=command_topic,
        angles=angles,
        start=start,
        duration=duration,
        skip_initial=skipped if skip_initial is None else skip_initial,
    )
    text = yaml.safe_dump({"evaluation": msgspec.to_builtins(spec)}, sort_keys=False, allow_unicode=True)
    return Run(text, arm, record, spec.skip_initial, path.stem)


@dataclass(frozen=True)
class _LoggedPoses:
    """A reference out of messages; it begins so many seconds after the first sample of the log they are in."""

    reference: Reference
    begin: float


def about_log(path: Path) -> dict[str, Any]:
    """Return what a recording of ours, or the folder of a run, says about its run; nothing for other logs."""
    path = path / "record.mcap" if path.is_dir() else path
    data = parse_yaml(path, load_metadata(path)["spec"]) if is_own(path) else None
    if not isinstance(data, dict):
        return {}
    rename_old_keys(str(path), data)
    rename_old_keys(str(path), data)
    data = data.get("evaluation", data)
    return data | {
        "robot": {"source": data["robot"]} if isinstance(data.get("robot"), str) else data.get("robot")
    }


def _absolute(robot: RobotSpec) -> RobotSpec:
    if robot.source is None:
        return robot
    file = Path(robot.source)
    return msgspec.structs.replace(robot, source=str(file.resolve())) if file.is_file() else robot


def _kept(data: JointLog, begin: float, duration: float | None) -> NDArray[np.bool_]:
    """Return which samples lie in the part to be judged."""
    end = np.inf if duration is None else begin + as_positive("duration", duration)
    kept = (data.time >= begin - _SNAP) & (data.time <= end + _SNAP)
    if kept.sum() < 2:
        raise ValueRangeError(
            f"{data.path}: fewer than two samples between {begin:g} and {end:g} s; the log has 0 … {data.time[-1]:g} s"
        )
    return kept


def _poses(data: JointLog, file: Path | None, topic: str | None) -> _LoggedPoses | None:
    """Return the poses of a topic, in the file or else in the log itself."""
    if topic is None:
        return None
    source = file or data.path
    if not is_recording(source):
        raise ShapeError(f"reference_topic: {source} is no recording and has no topics, got '{topic}'")
    stamps, poses = read_poses(source, topic)
    seconds = (stamps - stamps[0]) / 1e9
    reference = Points(seconds, poses) if len(poses) > 1 else SetPoint(poses[0])
    return _LoggedPoses(reference, (int(stamps[0]) - data.origin) / 1e9)


def _from_file(
    file: Path,
    robot: Robot,
    q0: Array,
    joints: Sequence[str] | None,
    angles: Angles | None,
    joint_topic: str | None,
) -> tuple[Reference, float | None]:
    """Return the reference of a file, and the start that the errors leave out, s, if the file says so."""
    if file.suffix.lower() in (".yaml", ".yml"):
        return _from_yaml(file, robot, q0)
    if is_recording(file):
        taught = read_joint_log(file, robot, joints=joints, joint_topic=joint_topic)
    elif {*(joints or robot.joint_names), "q1"}.isdisjoint(column_names(file)):
        return load_points(file, robot.fkm(q0)), None
    else:
        taught = read_joint_log(file, robot, joints=joints, angles=angles)
    return Points(taught.time, robot.fkm(taught.q)), None


def _short_form(file: Path, data: Any) -> ReferenceFile:
    data = numbers_for_quantities(str(file), data, list(kinds_of(ReferenceFile)))
    return convert(file, data, ReferenceFile)


def _from_yaml(file: Path, robot: Robot, q0: Array) -> tuple[Reference, float | None]:
    data = parse_yaml(file, read_text(file))
    rename_old_keys(str(file), data)
    whole = isinstance(data, dict) and not data.keys().isdisjoint({"name", "law", "laws", "plant", "plants"})
    folder = file.resolve().parent
    spec: Spec | ReferenceFile = as_spec(str(file), data, folder) if whole else _short_form(file, data)
    if spec.start is not None:
        q0 = start_configuration(spec.start, robot, f"{file}: start")
    return spec.reference.build(robot.fkm(q0), folder), spec.skip_initial if isinstance(spec, Spec) else None
