"""From measured poses of the end effector to corrections of an arm's geometry, and their worth elsewhere."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from dqcontrol.algebra import conjugate, multiply
from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError
from dqcontrol.experiments.results_folder import made_folder
from dqcontrol.files.output_file import finite_or_none, write_json, yaml_text
from dqcontrol.logs.calibration.correctable_chain import BASE, TOOL, CorrectableChain
from dqcontrol.logs.calibration.measured_poses import MeasuredPoses, read_measured_poses, searched_frames
from dqcontrol.logs.joint_log import arm_of
from dqcontrol.logs.joint_table import Angles
from dqcontrol.robots import Robot, SerialArm
from dqcontrol.robots.files.robot_file import plain_arm
from dqcontrol.robots.poses import pose8, positions, shift
from dqcontrol.tables.tables import Cell, Column, PlusMinus, Table
from dqcontrol.version import __version__

Interval = tuple[float, float]

_MILLI = 1e-3  # corrections are weighed and shown in mm and mrad
_UNTOLD = 3.0  # mm or mrad, standard error from which on a correction cannot be told
_SHARE = 0.1  # of a correction that another one does the work of, from which on that one is named
_FAR = 6.0  # times the median, a pose that does not belong
_FOLDS = 5  # parts of the poses, each of which is once not fitted
_NEAR = (0.1, 0.2)  # m and rad: up to there, frames of base and tool are known and only corrected
_ROUNDS = 3  # of weights by the noise that the round before left
_FIRST_NOISE = (1e-3, 3e-3)  # m and rad, before it is known
_LEAST_NOISE = (1e-7, 1e-7)
_NORMAL_95 = 1.96  # standard deviations: 95 % of a normal distribution
CALIBRATION, ROBOT = "calibration.json", "robot.yaml"


@dataclass(frozen=True)
class Correction:
    """One number of the geometry.

    Attributes
    ----------
    part
        ``"base"``, ``"tool"`` or the name of a joint.
    name
        ``x``, ``y``, ``z``, ``rz``, ``ry``, ``rx`` of base and tool; ``theta``, ``d``, ``a``, ``alpha``, ``beta`` of a
        joint: see `calibrate`.
    status
        ``"fitted"``; or ``"tied"``: it cannot be told from others, and stays 0.
    value, interval
        What is added, and its 95 % interval, m or rad.
    tied_with
        The corrections that do the work of this one.
    """

    part: str
    name: str
    status: Literal["fitted", "tied"]
    value: float = 0.0
    interval: Interval = (math.nan, math.nan)
    tied_with: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.part}.{self.name}"


@dataclass(frozen=True)
class HandErrors:
    """How far measured poses are from those of a robot; turns are NaN where positions alone were measured.

    Attributes
    ----------
    position_rms, position_max
        m.
    rotation_rms, rotation_max
        rad.
    """

    position_rms: float
    position_max: float
    rotation_rms: float = math.nan
    rotation_max: float = math.nan


@dataclass(frozen=True)
class Calibration:
    """What measured poses tell of the geometry of an arm.

    Attributes
    ----------
    robot
        The name of the arm.
    path
        The file with the poses.
    arm
        The arm with its corrections; with those of its base and tool, unless these frames were far from the arm's.
    corrections
        All that were asked for, fitted or tied.
    base, tool
        Poses (8,) of the arm's base in the measuring frame, and of the target in the arm's end effector.
    base_is_known, tool_is_known
        Whether the arm's own frames were near those, so that ``arm`` has them.
    before, after
        Errors of the end effector with frames alone fitted and with all corrections, each on poses that were not
        fitted.
    poses
        How many were used.
    noise
        Standard deviation of a measured coordinate (m) and angle (rad), from what is left.
    notes
        What else should be known.

    Examples
    --------
    >>> found = dqc.calibrate("poses.csv", "ur5")  # doctest: +SKIP
    >>> found.before.position_rms, found.after.position_rms  # doctest: +SKIP
    >>> found.arm.fkm(q)  # doctest: +SKIP
    """

    robot: str
    path: Path
    arm: SerialArm
    corrections: tuple[Correction, ...]
    base: Array
    tool: Array
    base_is_known: bool
    tool_is_known: bool
    before: HandErrors
    after: HandErrors
    poses: int
    noise: tuple[float, float]
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"Calibration({self.robot!r}, {self.poses} poses, {len(self.fitted)} corrections)"

    def __str__(self) -> str:
        """Return corrections and errors as tables, and what else should be known."""
        return "\n".join([str(self.table), str(self.error_table), *self.remarks])

    def _repr_markdown_(self) -> str:
        return "\n\n".join([self.table.markdown(), self.error_table.markdown(), *self.remarks])

    @property
    def fitted(self) -> list[Correction]:
        """Corrections that could be told."""
        return [each for each in self.corrections if each.status == "fitted"]

    @cached_property
    def table(self) -> Table:
        """One row a part, mm and mrad; those that are tied are empty."""
        rows: list[list[Cell]] = []
        for part in dict.fromkeys(each.part for each in self.corrections if each.part not in (BASE, TOOL)):
            own = {each.name: each for each in self.fitted if each.part == part}
            rows.append([part, *(_shown(own[name]) if name in own else None for name, _ in _COLUMNS)])
        columns = [Column("joint"), *(Column(name, f"{unit} ± 95 %") for name, unit in _COLUMNS)]
        return Table(columns, rows, f"{self.robot}: corrections from {self.poses} poses")

    @cached_property
    def error_table(self) -> Table:
        """Errors of the hand on poses that were not fitted."""
        columns = [Column("hand on poses not fitted")]
        for what, unit in (("position", "mm"), ("angle", "mrad")):
            columns += [Column(f"{what} {which}", unit, ".3g") for which in ("RMS", "max")]
        rows: list[list[Cell]] = []
        for name, errors in (("frames fitted alone", self.before), ("all corrections", self.after)):
            values = [value / _MILLI for value in asdict(errors).values()]
            rows.append([name, *(value if math.isfinite(value) else None for value in values)])
        return Table(columns, rows)

    @property
    def improves(self) -> bool:
        """Whether the corrections make the end effector's error smaller on poses that were not fitted."""
        return self.after.position_rms < self.before.position_rms

    @property
    def remarks(self) -> list[str]:
        """What the tables do not show, a line each."""
        lines = list(self.notes)
        for what, place, known in (
            (f"{BASE}: the arm's base in the measuring frame", self.base, self.base_is_known),
            (f"{TOOL}: the target in the arm's hand", self.tool, self.tool_is_known),
        ):
            x, y, z = positions(place)
            where = "is in" if known else "is not in"
            why = "" if known else ": it is far from the arm's own"
            lines.append(f"{what} is at {x:.4f}, {y:.4f}, {z:.4f} m; that {where} the robot file{why}")
        tied = [each for each in self.corrections if each.status == "tied"]
        if found := [f"{each} ({', '.join(each.tied_with)})" for each in tied if each.tied_with]:
            lines.append(f"kept at 0, as these poses cannot tell them from others: {'; '.join(found)}")
        if found := [str(each) for each in tied if not each.tied_with]:
            lines.append(f"kept at 0, as these poses do not depend on them: {', '.join(found)}")
        if not self.improves:
            lines.append(
                "the corrections do not help on poses that were not fitted: the geometry is right as far as these "
                "poses tell, and the robot file has corrected frames only"
            )
        return lines

    def to_dict(self) -> dict[str, Any]:
        """Return nested dictionaries fit for JSON: ``None`` for what is unknown; m and rad."""
        return {
            "robot": self.robot,
            "log": str(self.path.resolve()),
            "poses": self.poses,
            "noise": {"position": self.noise[0], "rotation": finite_or_none(self.noise[1])},
            "before": finite_or_none(self.before),
            "after": finite_or_none(self.after),
            "improves": self.improves,
            "base": {"pose": self.base.tolist(), "in_robot_file": self.base_is_known},
            "tool": {"pose": self.tool.tolist(), "in_robot_file": self.tool_is_known},
            "notes": list(self.notes),
            "corrections": finite_or_none(self.corrections),
        }

    def save(self, folder: str | Path, *, force: bool = False) -> Path:
        """Write ``calibration.json`` and the corrected arm, ``robot.yaml``.

        Parameters
        ----------
        folder, force
            A new folder; with ``force`` one whose ``calibration.json`` and ``robot.yaml`` are replaced.

        Raises
        ------
        ExistsError
            If the folder exists (without ``force``).
        """
        folder = made_folder(folder, force=force)
        write_json(folder / CALIBRATION, self.to_dict())
        digest = hashlib.sha256(self.path.read_bytes()).hexdigest() if self.path.is_file() else ""
        plain = plain_arm(self.arm) | {
            "description": f"{self.robot}, geometry corrected by dqcontrol {__version__}",
            "sources": [f"{self.path.resolve()} (SHA-256 {digest})", CALIBRATION],
        }
        head = "# An arm with geometry calibrated from measured poses; calibration.json says how. m, rad.\n"
        (folder / ROBOT).write_text(head + yaml_text(plain), encoding="utf-8")
        return folder


_COLUMNS = (("theta", "mrad"), ("d", "mm"), ("a", "mm"), ("alpha", "mrad"), ("beta", "mrad"))


class _Solution(NamedTuple):
    """Values (P,) of all parameters, which of them were fitted, their covariance, and what of the others they do."""

    values: Array
    kept: NDArray[np.bool_]
    covariance: Array
    tied: dict[int, Array]
    noise: tuple[float, float]


def calibrate(
    log: str | Path,
    robot: str | Path | Robot,
    *,
    base_link: str | None = None,
    tip_link: str | None = None,
    joints: Sequence[str] | None = None,
    angles: Angles | None = None,
    joint_topic: str | None = None,
    pose_topic: str | None = None,
) -> Calibration:
    """Find small corrections of an arm's geometry from poses of its end effector that a camera or tracker measured.

    Corrected are the frames of base and tool (three shifts ``x``, ``y``, ``z`` and three turns ``rz``, ``ry``, ``rx``
    each) and of each joint ``theta`` (zero of the joint) and ``d`` about and along its axis, ``a`` and ``alpha`` along
    and about the x axis of the next joint's frame, those of a standard Denavit–Hartenberg row, and ``beta`` about that
    frame's y axis, which parallel axes need (Hayati and Mirmirani 1985). Least squares over all poses; positions and
    turns are weighed by what they leave. Corrections whose standard error beside those before them (base, tool, a,
    alpha, theta, d, beta) is above 3 mm or 3 mrad cannot be told from these and stay 0. Where camera or target are far
    from the arm's own frames, they are searched first.

    Parameters
    ----------
    log
        See ``dqcontrol.logs.calibration.read_measured_poses``.
    robot
        As for `load_robot`, or an arm; without mobile base.
    base_link, tip_link
        Ends of the chain in a URDF file.
    joints, angles, joint_topic, pose_topic
        As for ``read_measured_poses``.

    Raises
    ------
    ValueRangeError
        If there are too few poses, or the robot has a mobile base.
    Error
        If something is missing or malformed.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> found = dqc.calibrate("poses.csv", "ur5")  # doctest: +SKIP
    >>> found.save("results/calibrated")  # doctest: +SKIP
    """
    arm = arm_of(robot, "has a mobile base; calibrate its arm alone", base_link, tip_link)
    measured = read_measured_poses(
        log, arm, joints=joints, angles=angles, joint_topic=joint_topic, pose_topic=pose_topic
    )
    return calibration_of(arm, measured)


def calibration_of(arm: SerialArm, measured: MeasuredPoses) -> Calibration:
    """Return the calibration of an arm from measured poses; see `calibrate`."""
    notes = list(measured.notes)
    fit = _fit_near(arm, measured)
    fit.check_count()
    solution = fit.solved()
    far = fit.far_off(solution.values)
    if far.any():
        fit = fit._replace(measured=measured.chosen(~far))
        fit.check_count()
        notes.append(f"{int(far.sum())} poses more than {_FAR:g} times as far off as usual were left out")
        solution = fit.solved()
    before, after = fit.checked()
    chain, measured = fit
    corrections = tuple(_correction(chain, solution, k) for k in range(len(chain.parameters)))
    values, turned = solution.values, measured.rotation is not None
    base, tool = chain.end(BASE, values), chain.end(TOOL, values)
    base_is_known, tool_is_known = _is_small(base, turned=True), _is_small(tool, turned=turned)
    if not after.position_rms < before.position_rms:
        values = fit.solved(frames_only=True).values
    return Calibration(
        robot=arm.name,
        path=measured.path,
        arm=chain.corrected(values, base=base_is_known, tool=tool_is_known),
        corrections=corrections,
        base=pose8(base),
        tool=pose8(tool),
        base_is_known=base_is_known,
        tool_is_known=tool_is_known,
        before=before,
        after=after,
        poses=len(measured.q),
        noise=(solution.noise[0], solution.noise[1] if turned else math.nan),
        notes=tuple(notes),
    )


class _Fit(NamedTuple):
    """A chain that is fitted to measured poses."""

    chain: CorrectableChain
    measured: MeasuredPoses

    @property
    def frames(self) -> NDArray[np.bool_]:
        """Which parameters are those of base and tool."""
        return np.array([each.part in (BASE, TOOL) for each in self.chain.parameters])

    def check_count(self) -> None:
        """Raise if there are too few poses."""
        arm, measured = self.chain.arm, self.measured
        each = 3 if measured.rotation is None else 6
        least = math.ceil(1.5 * (4 * arm.configuration_size + 6) / each * _FOLDS / (_FOLDS - 1))
        if len(measured.q) < least:
            raise ValueRangeError(
                f"{measured.path}: too few poses: {arm.name} needs at least {least}, better twice as many, all over "
                f"its workspace; got {len(measured.q)}"
            )

    def left(self, values: Array, noise: tuple[float, float] = (1.0, 1.0)) -> Array:
        """Return what is left of all poses, in standard deviations: turns of all, then positions."""
        measured, found = self.measured, self.chain.poses(self.measured.q, values)
        moved = ((positions(found) - measured.position) / noise[0]).ravel()
        if measured.rotation is None:
            return moved
        seen = np.zeros_like(found)
        seen[:, :4] = measured.rotation
        between = multiply(found, conjugate(seen))[:, :4]
        between = np.where(between[:, :1] < 0, -between, between)
        size = np.linalg.norm(between[:, 1:], axis=1, keepdims=True)
        angle = 2 * np.arctan2(size, between[:, :1])
        turns = np.where(size > 1e-12, between[:, 1:] * angle / np.maximum(size, 1e-12), 2 * between[:, 1:])
        return np.concatenate([turns.ravel() / noise[1], moved])

    def slopes(self, values: Array, noise: tuple[float, float]) -> Array:
        """Return the derivatives of `left`, by mm and mrad."""
        both = self.chain.jacobian(self.measured.q, values) * _MILLI
        moved = both[:, 3:].reshape(-1, both.shape[2]) / noise[0]
        if self.measured.rotation is None:
            return moved
        return np.concatenate([both[:, :3].reshape(-1, both.shape[2]) / noise[1], moved])

    def descended(self, kept: NDArray[np.bool_], noise: tuple[float, float], start: Array) -> Array:
        """Return the values of least squares, others than those kept at 0."""

        def full(some: Array) -> Array:
            values = np.zeros(len(kept))
            values[kept] = some * _MILLI
            return values

        done = least_squares(
            lambda some: self.left(full(some), noise),
            start[kept] / _MILLI,
            jac=lambda some: self.slopes(full(some), noise)[:, kept],  # type: ignore[arg-type]
            method="lm",
            xtol=1e-9,
            ftol=1e-12,
        )
        return full(done.x)

    def solved(self, *, frames_only: bool = False) -> _Solution:
        """Return the corrections, and which cannot be told."""
        count = len(self.chain.parameters)
        noise, values = _FIRST_NOISE, np.zeros(count)
        allowed = self.frames if frames_only else np.ones(count, dtype=bool)
        kept, tied = allowed, dict[int, Array]()
        for _ in range(_ROUNDS):
            kept, tied = _told(self.slopes(values, noise), allowed)
            values = self.descended(kept, noise, values)
            noise = self.noise(values, int(kept.sum()))
        slopes = self.slopes(values, noise)[:, kept]
        covariance = np.zeros((count, count))
        covariance[np.ix_(kept, kept)] = np.linalg.inv(slopes.T @ slopes) * _MILLI**2
        return _Solution(values, kept, covariance, tied, noise)

    def noise(self, values: Array, count: int) -> tuple[float, float]:
        """Return the standard deviations that are left of a coordinate and an angle."""
        left = self.left(values)
        freedom = max(1 - count / len(left), 0.1)
        half = 0 if self.measured.rotation is None else len(left) // 2
        turned = math.sqrt(np.mean(left[:half] ** 2) / freedom) if half else _FIRST_NOISE[1]
        moved = math.sqrt(np.mean(left[half:] ** 2) / freedom)
        return max(moved, _LEAST_NOISE[0]), max(turned, _LEAST_NOISE[1])

    def far_off(self, values: Array) -> NDArray[np.bool_]:
        """Return which poses do not belong: a target taken for another, a robot that still moved."""
        sizes = np.linalg.norm(self.left(values).reshape(-1, len(self.measured.q), 3), axis=2)
        usual = np.median(sizes, axis=1, keepdims=True)
        return (sizes > _FAR * np.maximum(usual, 1e-9)).any(axis=0)

    def checked(self) -> tuple[HandErrors, HandErrors]:
        """Return the errors with frames alone and all corrections, of each fifth of the poses by fits of the rest."""
        measured, count = self.measured, len(self.measured.q)
        left = np.zeros((2, 2, count, 3))
        for fold in range(_FOLDS):
            out = np.arange(count) % _FOLDS == fold
            rest, tried = (self._replace(measured=measured.chosen(rows)) for rows in (~out, out))
            for which, frames_only in enumerate((True, False)):
                found = tried.left(rest.solved(frames_only=frames_only).values).reshape(-1, int(out.sum()), 3)
                left[which][2 - len(found) :, out] = found
        alone, whole = (_errors(each, turned=measured.rotation is not None) for each in left)
        return alone, whole


def _fit_near(arm: SerialArm, measured: MeasuredPoses) -> _Fit:
    """Return the arm between its own frames, or between those that the poses tell, whichever is nearer to these."""
    tried = []
    for base, tool in ((shift(), shift()), searched_frames(arm, measured)):
        fit = _Fit(CorrectableChain(arm, base, tool), measured)
        values = fit.descended(fit.frames, _FIRST_NOISE, np.zeros(len(fit.frames)))
        left = fit.left(values, _FIRST_NOISE)
        tried.append((float(left @ left), fit))
    nearer = min(tried, key=lambda each: each[0])
    return tried[0][1] if tried[0][0] < 1.001 * nearer[0] else nearer[1]


def _told(slopes: Array, allowed: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], dict[int, Array]]:
    """Return which parameters can be told from those before them, and what these do for each other one."""
    kept, basis = np.zeros(len(allowed), dtype=bool), np.zeros((len(slopes), 0))
    for k in np.flatnonzero(allowed):
        own = slopes[:, k] - basis @ (basis.T @ slopes[:, k])
        own -= basis @ (basis.T @ own)
        size = float(np.linalg.norm(own))
        if size * _UNTOLD > 1:
            kept[k] = True
            basis = np.column_stack([basis, own / size])
    while kept.any():  # what came later may have made them unsure
        some = slopes[:, kept]
        errors = np.sqrt(np.diag(np.linalg.inv(some.T @ some)))
        if errors.max() < _UNTOLD:
            break
        kept[np.flatnonzero(kept)[np.flatnonzero(errors >= _UNTOLD)[-1]]] = False
    tied = dict[int, Array]()
    for k in np.flatnonzero(allowed & ~kept):
        tied[int(k)] = np.zeros(len(allowed))
        tied[int(k)][kept] = np.linalg.lstsq(slopes[:, kept], slopes[:, k], rcond=None)[0]
    return kept, tied


def _errors(left: Array, *, turned: bool) -> HandErrors:
    turns, moved = np.linalg.norm(left, axis=2)
    errors = float(np.sqrt(np.mean(moved**2))), float(moved.max())
    if not turned:
        return HandErrors(*errors)
    return HandErrors(*errors, float(np.sqrt(np.mean(turns**2))), float(turns.max()))


def _correction(chain: CorrectableChain, solution: _Solution, k: int) -> Correction:
    part, name = chain.parameters[k]
    if not solution.kept[k]:
        shares = np.abs(solution.tied[k])
        order = np.argsort(-shares, kind="stable")
        named = [str(chain.parameters[i]) for i in order if shares[i] > _SHARE][:4]
        return Correction(part, name, "tied", tied_with=tuple(named))
    value, error = float(solution.values[k]), math.sqrt(solution.covariance[k, k])
    return Correction(part, name, "fitted", value, (value - _NORMAL_95 * error, value + _NORMAL_95 * error))


def _is_small(end: Array, *, turned: bool) -> bool:
    """Whether a frame is near the arm's own; without measured turns the target's own are not known."""
    angle = 2 * math.atan2(float(np.linalg.norm(end[1:4])), abs(float(end[0]))) if turned else 0.0
    return float(np.linalg.norm(end[4:])) < _NEAR[0] and angle < _NEAR[1]


def _shown(correction: Correction) -> PlusMinus:
    return PlusMinus(correction.value / _MILLI, (correction.interval[1] - correction.value) / _MILLI)
