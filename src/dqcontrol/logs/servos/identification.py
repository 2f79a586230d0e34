"""From a log to a plant: what each joint's servo is, how sure that is, and the files that say so."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from operator import attrgetter
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError, ShapeError, ValueRangeError
from dqcontrol.experiments.results_folder import made_folder
from dqcontrol.files.lerobot_dataset import episode_of, episode_paths
from dqcontrol.files.output_file import finite_or_none, write_json, yaml_text
from dqcontrol.logs.joint_log import JointLog, read_joint_log
from dqcontrol.logs.joint_messages import is_recording, read_targets
from dqcontrol.logs.joint_table import Angles, column_names
from dqcontrol.logs.servos.joint_fit import fit, thinned
from dqcontrol.logs.servos.joint_gates import JointIdentification, identify_joint
from dqcontrol.logs.servos.replay import CommandedLog, Mode, Replay, save_replay
from dqcontrol.measures.metric_tables import fitting_unit
from dqcontrol.plants.servo import Servo
from dqcontrol.robots import Robot, load_robot
from dqcontrol.tables.tables import Cell, Column, Table
from dqcontrol.version import __version__

# samples that tell what velocities mean; rad or m that a joint must be told to move
_MODE_SAMPLES, _MOVED = 1500, 1e-3
# gains of joints that go as far as told; share of the motion that may be left
_WHOLE, _EXPLAINED = (0.7, 1.4), 0.3
_RIGID = 1e9  # N·m/rad: the stiffness of joints without sag
_LEAST_COMPLIANCE = 1e-9  # rad/(N·m): 1/`_RIGID`
IDENTIFICATION, PLANT = "identification.json", "plant.yaml"


@dataclass(frozen=True)
class Identification:
    """What one or more logs tell of the servos of a robot.

    Attributes
    ----------
    robot
        Its name.
    logs
        The files.
    mode
        What was commanded: ``"positions"``; velocities from the last target (``"integrated"``) or from the measured
        position (``"measured"``), whichever explains the logs better.
    period
        Median time between commands, s.
    joints
        One a joint, in the robot's order.
    notes
        What was found out about the logs on reading them.
    first_log, arm
        What `save_replay` runs.

    Examples
    --------
    >>> found = dqc.identify("log.csv", "iiwa7")  # doctest: +SKIP
    >>> found.joints[0].lag, found.joints[0].lag_interval  # doctest: +SKIP
    >>> found.plant()  # doctest: +SKIP
    """

    robot: str
    logs: tuple[Path, ...]
    mode: Mode
    period: float
    joints: tuple[JointIdentification, ...]
    notes: tuple[str, ...] = ()
    first_log: CommandedLog | None = field(default=None, repr=False, compare=False)
    arm: Robot | None = field(default=None, repr=False, compare=False)

    def __repr__(self) -> str:
        return f"Identification({self.robot!r}, {len(self.fitted)} of {len(self.joints)} joints)"

    def __str__(self) -> str:
        """Return the joints as a table, and why others were refused."""
        return "\n".join([str(self.table), *self.remarks])

    def _repr_markdown_(self) -> str:
        return "\n\n".join([self.table.markdown(), *self.remarks])

    @property
    def fitted(self) -> list[JointIdentification]:
        """Joints whose servo could be told."""
        return [each for each in self.joints if each.status == "fitted"]

    @cached_property
    def table(self) -> Table:
        """One row a joint."""

        def has_any(value: Callable[[JointIdentification], float]) -> bool:
            return any(math.isfinite(value(joint)) for joint in self.fitted)

        shown = [each for each in _SHOWN if each[0][0] in _ALWAYS or has_any(each[1])]
        units = {joint.unit for joint in self.joints}
        unit = units.pop() if len(units) == 1 else "rad or m"
        columns = [Column("joint")]
        columns += [Column(title, fitting_unit(of, unit), form) for (title, of, form), _ in shown]
        rows: list[list[Cell]] = []
        for each in self.joints:
            numbers: list[Cell] = ["refused", *[None] * (len(shown) - 1)]
            if each.status == "fitted":
                values = [value(each) for _, value in shown]
                numbers = [value if math.isfinite(value) else None for value in values]
            rows.append([each.name, *numbers])
        return Table(columns, rows, f"{self.robot}: servos behind {_WORDS[self.mode]}")

    @property
    def remarks(self) -> list[str]:
        """What the table does not show, a line each."""
        refused = [f"{each.name}: {each.reason}" for each in self.joints if each.reason]
        noted = [f"{each.name}: {note}" for each in self.joints for note in each.notes]
        return [*self.notes, *refused, *noted]

    def plant(self) -> Servo:
        """Return the servos as a plant; refused joints get the medians of the others.

        Of ambiguous joints lag and delay together are known: their lag is what the median delay leaves of that.

        Raises
        ------
        ValueRangeError
            If no joint was identified.
        """
        if not self.fitted:
            raise ValueRangeError(
                "identification: no joint could be identified, so there is no plant; see the reasons"
            )

        def usual(field: str) -> float:
            return float(np.median([getattr(joint, field) for joint in self.fitted]))

        def each(field: str, of_refused: Callable[[JointIdentification], float]) -> list[float]:
            own = attrgetter(field)
            values = [own(each) if each.status == "fitted" else of_refused(each) for each in self.joints]
            return [round(float(value), 9) for value in values]

        def delay(joint: JointIdentification) -> float:
            return min(usual("delay"), joint.late) if math.isfinite(joint.late) else usual("delay")

        def lag(joint: JointIdentification) -> float:
            return joint.late - delay(joint) if math.isfinite(joint.late) else usual("lag")

        sags = [joint.sag if joint.sag > _LEAST_COMPLIANCE else 0.0 for joint in self.joints]
        sagging: dict[str, Any] = {}
        if any(sags):
            sagging = {"sag": 1.0, "stiffness": [float(f"{1 / sag:.6g}") if sag else _RIGID for sag in sags]}
        of_second: dict[str, Any] = {}
        if any(joint.order == 2 for joint in self.fitted):
            of_second["bandwidth"] = [_known(joint.bandwidth, 0.0) for joint in self.joints]
            of_second["damping_ratio"] = [_known(joint.damping_ratio, 1.0) for joint in self.joints]
        if any(joint.friction for joint in self.fitted):
            of_second["friction"] = [round(joint.friction, 9) for joint in self.joints]
        return Servo(
            command_mode="measured" if self.mode == "measured" else "integrated",
            time_constant=each("lag", lag),
            delay=each("delay", delay),
            **of_second,
            gain=each("gain", lambda _: usual("gain")),
            encoder_resolution=each("resolution", lambda _: usual("resolution")),
            encoder_noise=each("noise", lambda _: usual("noise")),
            **sagging,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return nested dictionaries fit for JSON: ``None`` for what is unknown; s, rad and m."""
        return {
            "robot": self.robot,
            "logs": [str(path.resolve()) for path in self.logs],
            "mode": self.mode,
            "period": self.period,
            "notes": list(self.notes),
            "joints": [
                finite_or_none({key: value for key, value in vars(joint).items() if key != "trace"})
                for joint in self.joints
            ],
        }

    def save(self, folder: str | Path, *, force: bool = False) -> Path:
        """Write ``identification.json`` and, unless all joints were refused, ``plant.yaml``.

        Parameters
        ----------
        folder, force
            A new folder; with ``force`` one whose ``identification.json`` and ``plant.yaml`` are replaced.

        Raises
        ------
        ExistsError
            If the folder exists (without ``force``).
        """
        folder = made_folder(folder, force=force)
        write_json(folder / IDENTIFICATION, self.to_dict())
        if self.fitted:
            (folder / PLANT).write_text(self.plant_text(), encoding="utf-8")
        else:
            (folder / PLANT).unlink(missing_ok=True)
        return folder

    def save_replay(self, folder: str | Path) -> Replay:
        """Run the commands of the first log on the identified servos, and save log and replay as runs.

        Parameters
        ----------
        folder
            As it was given to `save`; takes ``log`` and ``replay``, which ``dqcontrol compare`` and ``view`` read.

        Raises
        ------
        ValueRangeError
            If no joint was identified.
        """
        folder = Path(folder)
        self.plant()
        if self.first_log is None or self.arm is None or not (folder / PLANT).is_file():
            raise ValueRangeError(f"folder: {folder} has no {PLANT}; save the identification there first")
        return save_replay(self.first_log, self.arm, self.mode, folder)

    def plant_text(self) -> str:
        """Return the plant as the text of a file that specs name: ``plant: {kind: servo, file: plant.yaml}``."""
        plain = msgspec.to_builtins(self.plant())
        changed = {key: value for key, value in plain.items() if value != _DEFAULTS.get(key)}
        assumed = [joint.name for joint in self.joints if joint.status == "refused"]
        identified = {
            "robot": self.robot,
            "joints": [joint.name for joint in self.joints],
            "logs": [
                {"file": str(path.resolve()), "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
                for log in self.logs
                for path in _files(log)
            ],
            "by": f"dqcontrol {__version__}",
            "assumed": assumed,
        }
        head = "# Servos identified from logs; in specs: plant: {kind: servo, file: …}. s, rad, N·m/rad.\n"
        if assumed:
            head += "# Joints under 'assumed' could not be identified and have the medians of the others.\n"
        return head + yaml_text({"plant": {"kind": "servo"} | changed, "identified": identified})


def _files(log: Path) -> list[Path]:
    """Return the files of a log: of a run its recording, of a bag all."""
    if not log.is_dir():
        return [log]
    recording = log / "record.mcap"
    return [recording] if recording.is_file() else sorted(path for path in log.iterdir() if path.is_file())


_SHOWN: list[tuple[tuple[str, str, str], Callable[[JointIdentification], float]]] = [
    (("lag", "ms", ".4g"), lambda joint: 1e3 * joint.lag),
    (("± 95 %", "ms", ".2g"), lambda joint: 1e3 * (joint.lag_interval[1] - joint.lag)),
    (("delay", "ms", ".4g"), lambda joint: 1e3 * joint.delay),
    (("± 95 %", "ms", ".2g"), lambda joint: 1e3 * (joint.delay_interval[1] - joint.delay)),
    (("ω", "rad/s", ".4g"), lambda joint: joint.bandwidth),
    (("ζ", "", ".3f"), lambda joint: joint.damping_ratio),
    (("correlation", "", ".3f"), lambda joint: joint.correlation),
    (("gain", "", ".4f"), lambda joint: joint.gain),
    (("sag", "mrad/(N·m) or mm/N", ".3g"), lambda joint: 1e3 * joint.sag),
    (("play", "mrad or mm", ".2g"), lambda joint: 1e3 * joint.friction or math.nan),
    (("step", "mrad or mm", ".3g"), lambda joint: 1e3 * joint.resolution),
    (("noise", "mrad or mm", ".2g"), lambda joint: 1e3 * joint.noise),
    (("left, checked", "mrad or mm", ".2g"), lambda joint: 1e3 * joint.residual),
    (("floor", "mrad or mm", ".2g"), lambda joint: 1e3 * joint.floor),
]  # columns of the table, and what stands in them
_ALWAYS = ("lag", "± 95 %", "delay")
_WORDS = {
    "positions": "commanded positions",
    "integrated": "commanded velocities, added up",
    "measured": "commanded velocities, from the measured positions",
}
_DEFAULTS = msgspec.to_builtins(Servo())


def identify(
    log: str | Path | Sequence[str | Path],
    robot: str | Path | Robot,
    *,
    base_link: str | None = None,
    tip_link: str | None = None,
    targets: str | Sequence[str] | None = None,
    target_topic: str | None = None,
    joints: Sequence[str] | None = None,
    joint_topic: str | None = None,
    command_topic: str | None = None,
    angles: Angles | None = None,
) -> Identification:
    """Find what the servos of a robot are from logs of commands and measured positions.

    Each joint's servo is y(t) = g F[r(t − D)] + b − s F[τ_g]: F a first-order lag τ, r the commanded position, held
    from each command to the next, D a delay of any length, g a gain, b an offset and s a sag under the gravity torque,
    if the robot has masses. Intervals are 95 %. Joints that hardly moved, were clamped, or whose lag and delay trade
    off are refused with the reason.

    Parameters
    ----------
    log
        One or more logs, see `read_joint_log`, of the same robot; a dataset stands for all its episodes. Commanded
        positions count before velocities. Samples with empty cells are left out. A clock of the commands that is not
        that of the positions counts as delay.
    robot
        As for `load_robot`, or a robot.
    base_link, tip_link
        Ends of the chain in a URDF file.
    targets
        Columns of commanded positions of tables, see `read_joint_log`.
    target_topic
        Topic of JointState or std_msgs/Float64MultiArray with commanded positions.
    joints, joint_topic, command_topic, angles
        As for `read_joint_log`; ``command_topic`` holds commanded velocities.

    Raises
    ------
    Error
        If something is missing, malformed or does not fit, or what is called a command is none.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> found = dqc.identify("log.csv", "iiwa7")  # doctest: +SKIP
    >>> found.save("results/servos")  # doctest: +SKIP
    """
    arm = robot if isinstance(robot, Robot) else load_robot(robot, base_link, tip_link)
    paths = [Path(log)] if isinstance(log, str | Path) else [Path(each) for each in log]
    paths = [part for path in paths for part in episode_paths(path)]
    if not paths:
        raise ShapeError("log: expected at least one file, got none")
    commanded, notes = [], []
    for path in paths:
        data = read_joint_log(
            path,
            arm,
            joints=joints,
            angles=angles,
            targets=targets,
            joint_topic=joint_topic,
            command_topic=command_topic,
            missing="skip",
        )
        _check_joints(path, arm)
        notes += [f"{path.name}: {note}" for note in data.notes]
        commanded.append(_commanded(data, joints or arm.joint_names, target_topic))
    if len({each.are_positions for each in commanded}) > 1:
        raise FileFormatError(
            f"{paths[0]}: holds other commands than {paths[1]}; give logs with positions, or with velocities"
        )
    for each in commanded:
        each.check(arm.joint_names)
    period = float(np.median([each.period for each in commanded]))
    torques = [arm.gravity_forces(each.q) if arm.inertia is not None else None for each in commanded]
    modes: tuple[Mode, ...] = commanded[0].modes
    if "integrated" in modes and all(_adds_up(each) for each in commanded):
        modes = ("integrated",)
    tried: dict[Mode, list[JointIdentification]] = {
        mode: _identified(arm, commanded, mode, torques, period) for mode in modes
    }
    mode = _best_mode(tried)
    joints_found, told = tuple(tried[mode]), tuple(notes)
    return Identification(arm.name, tuple(paths), mode, period, joints_found, told, commanded[0], arm)


def _check_joints(path: Path, arm: Robot) -> None:
    """Raise if a table has a column of a joint that the robot has not."""
    if is_recording(path) or episode_of(path) is not None:
        return
    more = f"q{arm.configuration_size + 1}"
    if more in column_names(path, [more]):
        raise FileFormatError(
            f"{path}:1: column {more}: {arm.name} has {arm.configuration_size} joints; is this another robot's log?"
        )


def _commanded(data: JointLog, names: Sequence[str], target_topic: str | None) -> CommandedLog:
    """Return a log with its commands, or say that it has none."""
    if target_topic is not None:
        stamps, values = read_targets(data.path, names, target_topic)
        return CommandedLog(data.path, data.time, data.q, (stamps - data.origin) / 1e9, values, True)
    q = data.q if data.record is None else data.record.measured
    if data.target is not None:
        return CommandedLog(data.path, data.time, q, data.time, data.target, True)
    if data.command is None or data.command.shape != q.shape or not np.isfinite(data.command).all():
        raise FileFormatError(
            f"{data.path}: holds no commands of the joints: columns target_JOINT, r1 … (positions) or command.JOINT, "
            "u1 … (velocities), or --targets; in recordings --target-topic or --command-topic"
        )
    return CommandedLog(data.path, data.time, q, data.time, data.command, False)


def _identified(
    robot: Robot, logs: list[CommandedLog], mode: Mode, torques: list[Array | None], period: float
) -> list[JointIdentification]:
    found = []
    for i, name in enumerate(robot.joint_names):
        each_log = zip(logs, torques, strict=True)
        segments = [part for log, torque in each_log for part in log.segments(i, mode, torque)]
        if not segments:
            raise FileFormatError(
                f"{logs[0].path}: too short or too full of gaps: no part without a gap lasts a second and a half"
            )
        if any(part.torque is None for part in segments):
            segments = [part._replace(torque=None) for part in segments]
        unit = "rad" if robot.joint_types[i] == "revolute" else "m"
        found.append(identify_joint(name, unit, segments, period))
    return found


def _adds_up(logged: CommandedLog) -> bool:
    """Whether most joints that are told to move go as far as their velocities add up to: then targets grow.

    Targets that begin at the measured position explain any joint well, as all that is to be told is one period; but the
    lags of servos let their joints move by a small share of such targets.
    """
    good, moved = 0, 0
    for joint in range(logged.q.shape[1]):
        segments = thinned(logged.segments(joint, "integrated", None), _MODE_SAMPLES)
        if not segments or np.ptp(np.concatenate([each.target.values for each in segments])) < _MOVED:
            continue
        moved += 1
        found = fit(segments, logged.period)
        spread = float(np.std(np.concatenate([each.positions for each in segments])))
        good += _WHOLE[0] < found.gain < _WHOLE[1] and found.rms < _EXPLAINED * spread
    return good > moved / 2


def _best_mode(tried: dict[Mode, list[JointIdentification]]) -> Mode:
    """Return the mode that leaves least of most joints that every mode explains, or else that explains most joints.

    What targets that follow the measured positions leave of servos that do not is more, by the noise in these.
    """
    modes = list(tried)
    left = {
        mode: np.array([each.residual if each.status == "fitted" else np.nan for each in tried[mode]])
        for mode in modes
    }
    both = np.all([np.isfinite(each) & (each > 0) for each in left.values()], axis=0)
    if both.any():
        least = np.min([each[both] for each in left.values()], axis=0)
        return max(modes, key=lambda mode: int((left[mode][both] == least).sum()))
    return max(modes, key=lambda mode: int(np.isfinite(left[mode]).sum()))


def _known(value: float, otherwise: float) -> float:
    return round(value, 9) if math.isfinite(value) else otherwise
