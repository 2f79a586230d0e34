"""Whole bodies: mobile bases and arms in a row, as one robot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, unknown_name
from dqcontrol.geometry import Box, Capsule
from dqcontrol.robots.bases import CarLikeBase, DifferentialDrive, HolonomicBase, RollerBase, SteeredTricycle
from dqcontrol.robots.kinematics import driving
from dqcontrol.robots.kinematics.kinematics_kernels import HEADING, SIDEWAYS
from dqcontrol.robots.limits import Inertia, Limits
from dqcontrol.robots.link_shapes import LinkShape, LinkShapes, carried_shapes, shapes_in_a_row
from dqcontrol.robots.poses import unit_poses
from dqcontrol.robots.robot import Form, NamedFrame, PlacedLinks, Robot, paired_rows
from dqcontrol.robots.serial_arm import SerialArm

Drive: TypeAlias = DifferentialDrive | CarLikeBase | SteeredTricycle
Base: TypeAlias = Drive | HolonomicBase
Mover: TypeAlias = Base | SerialArm
Part: TypeAlias = "Mover | WholeBody | ArrayLike"

_V, _OMEGA = "v", "omega"  # in place of x and phi


class WholeBody(Robot):
    """Mobile bases, arms and fixed poses in a row, each at the end of the one before. [S17 4.6, 4.7, generalised]

    x = x₁ x₂ … x_k. The configuration holds (x, y, φ) of each base and the joints of each arm, in the order of the
    parts. The inputs are their rates, but for bases that cannot move sideways (differential, car-like, tricycle), whose
    inputs are (v, ω): with one, m = n − 1.
    Jacobians have one column an input.

    Parameters
    ----------
    parts
        `DifferentialDrive`, `CarLikeBase`, `SteeredTricycle`, `HolonomicBase`, `MecanumBase`, `OmniBase`, `SerialArm`
        (also reversed ones), other whole bodies, and unit dual quaternions (8,) that stand for fixed poses, in any
        order and number.
    name
        The names of the parts joined by ``+`` if omitted.
    form
        ``"constrained"``: the inputs of a drive are v and ω, and the robot can do whatever they ask for.
        ``"unconstrained"``, as in S17: they are ẋ, ẏ and φ̇, as if it could move sideways (m = n). The robot then
        follows `feasible_inputs`: its displaced points move as asked, and each drive turns as that needs.

    Attributes
    ----------
    parts
        As given, but whole bodies taken apart, and poses as arrays.
    form
        As given.

    Raises
    ------
    ShapeError, ValueRangeError, UnknownNameError
        If there is no base and no arm, a part is none of the above, or the form has another name.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> base = dqc.DifferentialDrive(wheel_radius=0.04, half_track=0.13)
    >>> mount = dqc.DualQuaternion.from_translation([0, 0, 0.2])
    >>> body = dqc.WholeBody([base, mount, dqc.load_robot("panda")])
    >>> body.configuration_size, body.input_size, body.input_names[:3]
    (10, 9, ('v', 'omega', 'panda_joint1'))
    """

    def __init__(self, parts: Sequence[Part], name: str | None = None, form: Form = "constrained") -> None:
        if form not in get_args(Form):
            raise unknown_name("form", str(form), get_args(Form))
        self.parts: tuple[Mover | ArrayLike, ...] = tuple(_flatten_parts(parts))
        self.form: Form = form
        if not any(isinstance(part, Mover) for part in self.parts):
            raise ShapeError(
                f"parts: expected at least one base or arm, got {len(self.parts)} parts without any"
            )
        whole = SerialArm.join(
            [each.joints() if isinstance(each, Base) else each for each in self.parts], name
        )
        n = whole.configuration_size
        self.drives: Array = _drives(self.parts)
        firsts = self.drives[:, 0].astype(np.intp) if form == "constrained" else np.zeros(0, dtype=np.intp)
        chain = whole.chain.copy()
        chain[firsts, 7], chain[firsts + 1, 7], chain[n, 7] = HEADING, SIDEWAYS, len(firsts)
        kept = np.delete(np.arange(n), firsts + 1)
        names = list(whole.joint_names)
        for i in firsts:
            names[i] = names[i].removesuffix("x") + _V
            names[i + 2] = names[i + 2].removesuffix("phi") + _OMEGA

        self.name: str = whole.name
        self._keep_chain(chain)
        self.configuration_size, self.input_size = n, len(kept)
        self.joint_names, self.joint_types = whole.joint_names, whole.joint_types
        self.input_coordinates = kept
        self.input_names: tuple[str, ...] = tuple(names[i] for i in kept)
        self.input_types: tuple[str, ...] = tuple(whole.joint_types[i] for i in kept)
        limits = whole.limits
        self.limits: Limits = Limits(limits.lower, limits.upper, limits.velocity[kept], limits.effort[kept])
        self.inertia: Inertia | None = whole.inertia
        placed = list(parts_with_offsets(self.parts))
        self.bases = tuple((first, part.kind) for first, part in placed if not isinstance(part, SerialArm))
        self.driven_bases = tuple(part for _, part in placed if isinstance(part, Drive))
        rows = [
            [np.searchsorted(kept, first), first + 2, *row]
            for first, part in placed
            if isinstance(part, RollerBase) and np.isfinite(part.rim_speed)
            for row in part.wheel_matrix * part.wheel_radius / part.rim_speed
        ]
        self.rollers = np.array(rows, dtype=np.float64).reshape(-1, driving.ROLLER_COLUMNS)
        self.shapes: LinkShapes | None = whole_body_shapes(self.parts, self.chain)
        self.placed_links = _placed_links(parts)

    def __repr__(self) -> str:
        return f"WholeBody({self.name!r}, {self.configuration_size} coordinates, {self.input_size} inputs)"

    def in_form(self, form: Form) -> WholeBody:
        """Return the same robot with constrained or unconstrained inputs."""
        other = WholeBody(self.parts, self.name, form)
        other.placed_links = self.placed_links
        return other

    def feasible_inputs(self, q: ArrayLike, rates: ArrayLike) -> Array:
        """Return the inputs of the constrained form that follow rates of the configuration as far as the drives can.

        The displaced point of each drive, d ahead of its axle, moves as the rates say: v = ẋ cos φ + ẏ sin φ and
        ω = φ̇ + (ẏ cos φ − ẋ sin φ)/d. Sideways motion so becomes turning. [S17 4.24]

        Parameters
        ----------
        q
            Configurations, shape (…, n), rad or m.
        rates
            q̇, shape (…, n), rad/s or m/s; of a base ẋ, ẏ and φ̇.

        Returns
        -------
        Array
            Shape (…, n − k) for k drives.

        Raises
        ------
        ShapeError, ValueRangeError
            If a size is wrong, or a value not finite.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> base = dqc.WholeBody([dqc.DifferentialDrive(0.04, 0.13, displacement=0.2)])
        >>> base.feasible_inputs([0, 0, 0], [0.3, 0.1, 0]).round(12).tolist()
        [0.3, 0.5]
        """
        batch_shape, starts, wanted = paired_rows(self._rows("q", q), "rates", self._rows("rates", rates))
        size = self.configuration_size - len(self.drives)
        out = np.empty((len(starts), size))
        driving.feasible_inputs(self.drives, starts, wanted, out)
        return out.reshape(*batch_shape, size)

    def _base_accelerations(self) -> Array:
        rates = np.full(self.configuration_size, np.inf)
        if self.input_size == self.configuration_size and len(self.drives):
            return rates  # of drives that they cannot all follow
        for first, part in parts_with_offsets(self.parts):
            if not isinstance(part, SerialArm):
                rates[first : first + 3] = part.acceleration, part.acceleration, part.turn_acceleration
        return rates[self.input_coordinates]

    def input_map(self, q: ArrayLike) -> Array:
        """Return F, shape (…, n − k, n), from rates of the configuration to wheel and joint speeds. [S17 4.27]

        F = blockdiag(D C⁻¹ B, I) in the order of the parts: `wheel_speeds` of the `feasible_inputs`, as a matrix.
        """
        inputs = self.feasible_inputs(self._rows("q", q)[..., None, :], np.eye(self.configuration_size))
        return np.swapaxes(self.wheel_speeds(inputs), -1, -2)

    def wheel_speeds(self, u: ArrayLike) -> Array:
        """Return inputs with the speeds of the wheels in place of v and ω: ω_r = (v + bω)/r, ω_l = (v − bω)/r.

        Parameters
        ----------
        u
            Inputs of the constrained form, shape (…, n − k) for k drives, rad/s or m/s.

        Returns
        -------
        Array
            The same, with the right and the left wheel's speed (rad/s) in place of v and ω. [S17 4.25]

        Raises
        ------
        ShapeError, ValueRangeError
            If the size is wrong, or a value not finite.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> base = dqc.WholeBody([dqc.DifferentialDrive(wheel_radius=0.05, half_track=0.1)])
        >>> base.wheel_speeds([0.5, 1.0]).round(12).tolist()
        [12.0, 8.0]
        """
        out = self._constrained("u", u)
        for j, radius, half_track in self._pairs():
            v, turning = out[..., j].copy(), half_track * out[..., j + 1]
            out[..., j], out[..., j + 1] = (v + turning) / radius, (v - turning) / radius
        return out

    def from_wheel_speeds(self, speeds: ArrayLike) -> Array:
        """Return the inputs of wheel and joint speeds, the inverse of `wheel_speeds`."""
        out = self._constrained("speeds", speeds)
        for j, radius, half_track in self._pairs():
            right, left = out[..., j].copy(), out[..., j + 1].copy()
            out[..., j] = radius * (right + left) / 2
            out[..., j + 1] = radius * (right - left) / (2 * half_track)
        return out

    def _inputs(self, field: str, value: ArrayLike) -> Array:
        try:
            return super()._inputs(field, value)
        except ShapeError as error:
            names = ", ".join(self.input_names)
            raise ShapeError(f"{error}; the inputs of {self.name} are {names}") from None

    def _constrained(self, field: str, value: ArrayLike) -> Array:
        """Return a copy of inputs of the constrained form, checked."""
        body = self if self.form == "constrained" else self.in_form("constrained")
        return body._inputs(field, value).copy()

    def _pairs(self) -> Iterator[tuple[int, float, float]]:
        """Yield the index of each drive's v in the constrained form, its wheel radius and half its track."""
        for k, (first, _, radius, half_track, *_) in enumerate(self.drives):
            yield int(first) - k, radius, half_track


def parts_with_offsets(parts: Sequence[object]) -> Iterator[tuple[int, Mover]]:
    """Yield the parts that move, each with the index of its first coordinate."""
    first = 0
    for part in parts:
        if isinstance(part, Mover):
            yield first, part
            first += part.configuration_size


def whole_body_shapes(parts: Sequence[object], chain: Array) -> LinkShapes | None:
    """Return the shapes of all parts: of arms as they have them, of bases a capsule around a chassis, or a box.

    Shapes of different parts are kept apart unless they are neighbours: what stands on a base, and the base.
    """
    return shapes_in_a_row(
        (first, _part_shapes(part, chain, first)) for first, part in parts_with_offsets(parts)
    )


def _part_shapes(part: Mover, chain: Array, first: int) -> LinkShapes | None:
    """Return the shapes of a part whose coordinates begin at ``first``, in frames counted from there."""
    if isinstance(part, SerialArm):
        return carried_shapes(part.shapes, part.chain[0, :7], chain[first, :7])
    body = _body_of_base(part)
    return None if body is None else LinkShapes((LinkShape("chassis", 3, body),))


def _body_of_base(part: Mover) -> Capsule | Box | None:
    """Return what stands for a base, in the frame of its φ: a capsule upright around its chassis, or a box."""
    chassis = getattr(part, "chassis", None)
    if chassis is not None:
        half = 0.5 * chassis.height
        low, high = chassis.centre_height - half, chassis.centre_height + half
        ends = np.array([[chassis.centre_ahead, 0.0, low], [chassis.centre_ahead, 0.0, high]])
        return Capsule(ends[0], ends[1], chassis.radius)
    if isinstance(part, HolonomicBase) and part.size is not None:
        middle = np.array([0.0, 0.0, 0.5 * part.size[2]])
        return Box(algebra.pose(np.array([1.0, 0, 0, 0]), middle), np.array(part.size))
    return None


def _flatten_parts(parts: Sequence[Part]) -> Iterator[Mover | ArrayLike]:
    """Yield the parts, and those of whole bodies among them."""
    if not isinstance(parts, list | tuple):
        raise ShapeError(f"parts: expected a list of bases, arms and poses, got {parts!r:.80}")
    for i, part in enumerate(parts):
        if isinstance(part, WholeBody):
            yield from part.parts
        elif isinstance(part, Mover):
            yield part
        elif _shape(part) == (8,):
            yield unit_poses(f"parts[{i}]", part)
        else:
            raise ShapeError(
                f"parts[{i}]: expected a base, an arm, a whole body or a pose of shape (8,), got {part!r:.80}"
            )


def _placed_links(parts: Sequence[Part]) -> PlacedLinks | None:
    """Return the links of the file of the only whole body among parts that was read from one."""
    found, first = [], 0
    for part in parts:
        if isinstance(part, WholeBody) and part.placed_links is not None:
            found.append((first, part.placed_links))
        first += part.configuration_size if isinstance(part, WholeBody | Mover) else 0
    if len(found) != 1:
        return None
    first, links = found[0]
    frames = {
        link: NamedFrame(first + row if row >= 0 else row, pose) for link, (row, pose) in links.frames.items()
    }
    return PlacedLinks(links.path, frames)


def _shape(part: ArrayLike) -> tuple[int, ...] | None:
    try:
        return np.shape(getattr(part, "vec8", part))
    except ValueError:  # rows of different lengths
        return None


def _drives(parts: Sequence[object]) -> Array:
    """Return the table of drives."""
    rows = [
        [first, part.displacement, part.wheel_radius, part.half_track, part.turning_radius, part.rim_lever]
        for first, part in parts_with_offsets(parts)
        if isinstance(part, Drive)
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, driving.DRIVE_COLUMNS)
