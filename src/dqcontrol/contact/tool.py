"""Tools on a force sensor: the files that describe them, and finding them from readings at rest."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np
from msgspec import Meta
from msgspec.structs import replace
from numpy.typing import ArrayLike

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array
from dqcontrol.files.yaml_file import read_yaml
from dqcontrol.named_fields import NamedFields, Three


class Tool(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What hangs beyond a force sensor, and what the sensor shows without it, as `identify_tool` finds them.

    One type for all that take a weight off a measured wrench: `ForceSensor` and a supervisor's ``payload``. In specs
    it may be the name of a file that ``dqcontrol identify tool`` wrote.

    Parameters
    ----------
    mass, center
        kg, and m in the sensor's axes.
    force_bias, torque_bias
        N and N·m.
    tared
        Day on which the bias was measured, as ``2026-11-27``: `dqcontrol check` says how old it is.
    """

    spec_key: ClassVar[str] = "tool"
    mass: Annotated[float, Meta(ge=0, le=1e4, description="kg")] = 0.0
    center: Annotated[Three, Meta(description="m")] = (0.0, 0.0, 0.0)
    force_bias: Annotated[Three, Meta(description="N")] = (0.0, 0.0, 0.0)
    torque_bias: Annotated[Three, Meta(description="N·m")] = (0.0, 0.0, 0.0)
    tared: Annotated[str, Meta(pattern=r"^\d{4}-\d\d-\d\d$", description="YYYY-MM-DD")] | None = None


class _ToolFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    tool: Tool
    identified: dict[str, Any] = {}


def load_tool(path: str | Path) -> Tool:
    """Return the tool that a file holds.

    Parameters
    ----------
    path
        A YAML file with the mapping ``tool`` and perhaps ``identified``: where its numbers are from.

    Raises
    ------
    FileFormatError
        If it cannot be read or holds something else.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "my_pen.yaml"
    >>> _ = file.write_text("tool: {mass: 0.3, center: [0, 0, 0.04]}")
    >>> load_tool(file).mass
    0.3
    """
    return read_yaml(path, _ToolFile).tool


WORST_CONDITION = 5.0  # of the fits: six poses have 1.0 and 1.2; poses within 20° have 15, and leave 0.8 N


@dataclass(frozen=True)
class IdentifiedTool:
    """A tool as its readings show it.

    Attributes
    ----------
    tool
        Mass, centre and bias, as `ForceSensor` takes it; a supervisor's ``payload`` takes its mass and centre.
    force_left, torque_left
        Root mean square of what it does not explain, N and N·m.
    force_condition, torque_condition
        Of the two fits.
    """

    tool: Tool
    force_left: float
    torque_left: float
    force_condition: float
    torque_condition: float


def identify_tool(
    poses: ArrayLike, wrenches: ArrayLike, gravity: ArrayLike = (0.0, 0.0, -9.81)
) -> IdentifiedTool:
    """Find what hangs on a force sensor, and what it shows without load.

    f = m Rᵀg + b_f gives m and b_f, τ = (m c) × Rᵀg + b_τ then m c and b_τ: two linear least squares, of 4 and 6
    unknowns.

    Parameters
    ----------
    poses
        Of the sensor at rest, shape (N, 8), in the base frame; `tool_orientations` proposes six.
    wrenches
        Force and torque that it shows there, its axes, shape (N, 6), N and N·m; better the mean of a hundred readings
        each.
    gravity
        m/s² in the base frame.

    Raises
    ------
    ShapeError, ValueRangeError
        If shapes do not fit, the orientations are too much alike, or the mass comes out negative.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> poses = [dqc.algebra.pose(turn, [0.5, 0, 0.4]) for turn in dqc.contact.tool_orientations()]
    >>> turns = [dqc.algebra.matrix_from_pose(pose)[:3, :3] for pose in poses]
    >>> weights = [0.8 * turn.T @ [0, 0, -9.81] for turn in turns]
    >>> wrenches = [[*(w + [0.3, 0, 0]), *np.cross([0, 0, 0.05], w)] for w in weights]
    >>> found = dqc.contact.identify_tool(poses, wrenches).tool
    >>> round(found.mass, 9), round(found.center[2], 9), round(found.force_bias[0], 9)
    (0.8, 0.05, 0.3)
    """
    placed, measured = _readings(poses, wrenches)
    by_mass, by_moment = _columns(placed, as_array("gravity", gravity, (3,)))
    mass, force_bias, force_left = _fit(by_mass, measured[:, :3], 1)
    moment, torque_bias, torque_left = _fit(by_moment, measured[:, 3:], 3)
    of_force, of_torque = _condition(by_mass), _condition(by_moment)
    if not max(of_force, of_torque) <= WORST_CONDITION:
        raise ValueRangeError(
            f"poses: their orientations are too much alike (condition {max(of_force, of_torque):.3g}, at most "
            f"{WORST_CONDITION:g}); turn the sensor so that each of its axes points up and down once"
        )
    if not mass[0] > 0:
        raise ValueRangeError(
            f"wrenches: the mass comes out as {mass[0]:.3g} kg; they must be what the tool exerts on the sensor"
        )
    tool = Tool(
        mass=float(mass[0]),
        center=_three(moment / mass[0]),
        force_bias=_three(force_bias),
        torque_bias=_three(torque_bias),
    )
    return IdentifiedTool(tool, force_left, torque_left, of_force, of_torque)


def tare_tool(
    known: Tool, poses: ArrayLike, wrenches: ArrayLike, gravity: ArrayLike = (0.0, 0.0, -9.81)
) -> IdentifiedTool:
    """Return a known tool with the bias that explains wrenches in the air best: one pose is enough.

    Parameters
    ----------
    known
        Its mass and centre are kept.
    poses, wrenches, gravity
        As for `identify_tool`.

    Raises
    ------
    ShapeError
        If shapes do not fit.
    """
    placed, measured = _readings(poses, wrenches)
    by_mass, by_moment = _columns(placed, as_array("gravity", gravity, (3,)))
    force = measured[:, :3] - known.mass * by_mass[:, :, 0]
    torque = measured[:, 3:] - by_moment[:, :, :3] @ (known.mass * np.array(known.center))
    biases = [rest.mean(axis=0) for rest in (force, torque)]
    left = [
        float(np.sqrt(np.mean((rest - bias) ** 2)))
        for rest, bias in zip((force, torque), biases, strict=True)
    ]
    tool = replace(known, force_bias=_three(biases[0]), torque_bias=_three(biases[1]))
    return IdentifiedTool(tool, left[0], left[1], np.nan, np.nan)


def gravity_condition(poses: ArrayLike, gravity: ArrayLike = (0.0, 0.0, -9.81)) -> float:
    """Return the condition of the worse one of the two fits of `identify_tool`, from poses (N, 8) alone."""
    placed = as_array("poses", poses, (None, 8))
    return max(_condition(each) for each in _columns(placed, as_array("gravity", gravity, (3,))))


def tool_orientations() -> Array:
    """Return six orientations, each axis of the sensor up and down once, shape (6, 4): the best conditioned set."""
    quarter = np.pi / 2
    turns = [
        (0, 0, 0),
        (2 * quarter, 0, 0),
        (quarter, 0, 0),
        (-quarter, 0, 0),
        (0, quarter, 0),
        (0, -quarter, 0),
    ]
    return np.array([algebra.rotation_from_rpy(turn)[:4] for turn in turns])


def _readings(poses: ArrayLike, wrenches: ArrayLike) -> tuple[Array, Array]:
    placed, measured = as_array("poses", poses, (None, 8)), as_array("wrenches", wrenches, (None, 6))
    if placed.ndim != 2 or placed.shape[0] != measured.shape[0] or measured.ndim != 2:
        raise ShapeError(f"wrenches: expected one a pose, ({len(placed)}, 6), got {measured.shape}")
    return placed, measured


def _columns(poses: Array, fall: Array) -> tuple[Array, Array]:
    """Return what mass and bias, and what moment and bias, are multiplied by in each pose: (N, 3, 4) and (N, 3, 6)."""
    seen = np.array([algebra.matrix_from_pose(pose)[:3, :3].T @ fall for pose in poses])
    by_mass, by_moment = np.zeros((len(seen), 3, 4)), np.zeros((len(seen), 3, 6))
    by_mass[:, :, 0], by_mass[:, :, 1:] = seen, np.eye(3)
    for k, (x, y, z) in enumerate(seen):  # c × g = −g × c
        by_moment[k, :, :3] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    by_moment[:, :, 3:] = np.eye(3)
    return by_mass, by_moment


def _condition(columns: Array) -> float:
    """Return the condition of a fit with columns of equal length; infinite where something is not told at all."""
    matrix = columns.reshape(-1, columns.shape[-1])
    lengths = np.linalg.norm(matrix, axis=0)
    if matrix.shape[0] < matrix.shape[1] or not lengths.all():
        return np.inf
    singular = np.linalg.svd(matrix / lengths, compute_uv=False)
    return float(singular[0] / singular[-1]) if singular[-1] > 1e-9 * singular[0] else np.inf


def _fit(columns: Array, values: Array, first: int) -> tuple[Array, Array, float]:
    """Return the first unknowns, the bias, and what is left."""
    matrix, flat = columns.reshape(-1, columns.shape[-1]), values.ravel()
    found = np.asarray(np.linalg.lstsq(matrix, flat, rcond=None)[0], dtype=np.float64)
    return found[:first], found[first:], float(np.sqrt(np.mean((matrix @ found - flat) ** 2)))


def _three(values: Array) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
