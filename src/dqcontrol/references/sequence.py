"""References one after the other, and guarded moves, which end where they touch or drop."""

from __future__ import annotations

from collections.abc import Sequence as Several
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.algebra import translation
from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array, as_positive
from dqcontrol.references.reference import Reference, corners_between
from dqcontrol.references.sample import POSE, SAMPLE_SIZE, TWIST
from dqcontrol.references.set_points import SetPoint
from dqcontrol.references.straight import Straight

if TYPE_CHECKING:
    from dqcontrol.references.set_points import GripperStep

_SAME_POSE = 1e-6  # largest difference of the eight coefficients between an end and the next start


@dataclass(frozen=True, eq=False, repr=False)
class Sequence(Reference):
    """References one after the other, each from where the one before it ends.

    Parameters
    ----------
    references
        At least one; all but the last of finite duration. ``SetPoint(pose, duration=2.0)`` makes a pause.

    Raises
    ------
    ValueRangeError
        If there is none, one that is not the last never ends, or one starts elsewhere than the one before it
        ends.

    Examples
    --------
    >>> from dqcontrol.references import Circle, SetPoint
    >>> start = [1, 0, 0, 0, 0, 0, 0, 0]
    >>> Sequence([SetPoint(start, duration=2.0), Circle(start, radius=0.1, duration=10.0)]).duration
    12.0
    """

    references: Several[Reference]
    _times: Array = field(init=False, repr=False)
    _signs: Array = field(init=False, repr=False)
    # a repeated reference is sampled at once
    _distinct: tuple[Reference, ...] = field(init=False, repr=False)
    _which: NDArray[np.intp] = field(init=False, repr=False)  # of these each one is

    def __post_init__(self) -> None:
        parts = tuple(self.references)
        if not parts:
            raise ValueRangeError("references: expected at least one, got none")
        for i, part in enumerate(parts[:-1]):
            if not np.isfinite(part.duration):
                raise ValueRangeError(f"references[{i}]: never ends, so nothing can follow it")
        distinct = tuple({id(part): part for part in parts}.values())
        numbers = {id(part): i for i, part in enumerate(distinct)}
        which = np.array([numbers[id(part)] for part in parts])
        times = np.concatenate([[0.0], np.cumsum([part.duration for part in parts])])
        starts = np.concatenate([part.motion(np.zeros(1)) for part in distinct])[which]
        lasting = [part.duration if np.isfinite(part.duration) else 0.0 for part in distinct]
        ends = np.concatenate(
            [part.motion(np.array([end])) for part, end in zip(distinct, lasting, strict=True)]
        )
        ends = ends[which[:-1]]
        signs = _signs(ends[:, POSE], starts[1:, POSE])
        seams = corners_between(ends[:, TWIST], starts[1:, TWIST], times[1:-1])
        within = [part.corners[part.corners < part.duration] for part in distinct]
        inner = [within[i] + time for i, time in zip(which, times, strict=False)]
        last = parts[-1].corners[parts[-1].corners == parts[-1].duration] + times[-2]
        corners = np.sort(np.concatenate([seams, *inner, last]))
        corners.flags.writeable = False
        vars(self).update(references=parts, duration=float(times[-1]), corners=corners)
        vars(self).update(_times=times, _distinct=distinct, _which=which, _signs=signs)

    @property
    def guards(self) -> Guards:
        """Those of its parts."""
        found = [
            part.guards.later(float(time)) for part, time in zip(self.references, self._times, strict=False)
        ]
        planes = [each.plane for each in found if each.plane is not None]
        if len(planes) > 1:
            raise ValueRangeError(
                f"references: {len(planes)} of them have 'touch'; one plane is told in a run"
            )
        return Guards(tuple(move for each in found for move in each.moves), planes[0] if planes else None)

    @property
    def gripper_steps(self) -> tuple[GripperStep, ...]:
        """Those of its parts."""
        parts = zip(self.references, self._times, strict=False)
        return tuple(step.later(float(time)) for part, time in parts for step in part.gripper_steps)

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        place = np.clip(np.searchsorted(self._times, times, side="right") - 1, 0, len(self.references) - 1)
        inner_times, which = times - self._times[place], self._which[place]
        order = np.argsort(which, kind="stable")
        out = np.empty((len(times), SAMPLE_SIZE))
        for rows in np.split(order, np.flatnonzero(np.diff(which[order])) + 1):
            if len(rows):
                part = self._distinct[which[rows[0]]]
                out[rows] = part.motion(part.snapped(inner_times[rows])[0])
        out[:, POSE] *= self._signs[place, None]
        return out


class Repeat(Sequence):
    """A reference several times; it must end where it starts.

    Parameters
    ----------
    reference
        Of finite duration.
    count
        How often, ≥ 1.

    Raises
    ------
    ValueRangeError
        If the count is not a whole number ≥ 1, or the reference never ends, or not where it starts.

    Examples
    --------
    >>> from dqcontrol.references import Circle
    >>> circle = Circle([1, 0, 0, 0, 0, 0, 0, 0], radius=0.1, duration=10.0)
    >>> Repeat(circle, 3).corners.tolist()  # smooth where the rounds join
    [30.0]
    """

    def __init__(self, reference: Reference, count: int) -> None:
        if not isinstance(count, int) or count < 1:
            raise ValueRangeError(f"count: expected a whole number ≥ 1, got {count!r}")
        super().__init__((reference,) * count)


def _signs(ends: Array, starts: Array) -> Array:
    """Return the sign of each part that lets the pose go on without jumping between x and −x."""
    same = np.where(np.sum(ends[:, :4] * starts[:, :4], axis=1) < 0, -1.0, 1.0)
    gaps = np.abs(ends - same[:, None] * starts).max(axis=1, initial=0.0)
    for i in np.flatnonzero(gaps > _SAME_POSE):
        before, after = translation(ends[i]), translation(starts[i])
        turn = np.degrees(2 * np.arccos(min(1.0, abs(ends[i, :4] @ starts[i, :4]))))
        raise ValueRangeError(
            f"references[{i + 1}]: must start where references[{i}] ends, but starts "
            f"{np.linalg.norm(after - before):.6g} m and {turn:.6g} degrees from there"
        )
    signs = np.ones(len(starts) + 1)
    signs[1:] = np.cumprod(same)
    return signs


_TOUCHES = 3  # points make a plane
_REST = 0.3  # s after a touch, and above a point: for the lag of servos and filters of sensors


class Guard(NamedTuple):
    """A guarded move: begin and planned end, s, what ends it, and the pose of its planned end, (8,).

    That is a force, N, or how far the end effector has gone since its begin where the wanted force pushes it, m. From
    then on it stays until the planned end.
    """

    begin: float
    end: float
    force: float
    drop: float
    pose: Array


class TouchedPlane(NamedTuple):
    """When a plan goes over to a plane that its last three guarded moves tell, s, and that plane as planned.

    ``normal`` and ``origin``, a point on it, in the inertial frame, (3,).
    """

    begin: float
    end: float
    normal: Array
    origin: Array


class Guards(NamedTuple):
    """What of a reference touches end or displace; and delay and lag by which its twists lead, s, see `Previewed`."""

    moves: tuple[Guard, ...] = ()
    plane: TouchedPlane | None = None
    lead: tuple[float, float] = (0.0, 0.0)

    def later(self, by: float) -> Guards:
        """Return the same some seconds later."""
        moves = tuple(each._replace(begin=each.begin + by, end=each.end + by) for each in self.moves)
        plane = self.plane and self.plane._replace(begin=self.plane.begin + by, end=self.plane.end + by)
        return Guards(moves, plane, self.lead)


@dataclass(frozen=True, eq=False, repr=False)
class Guarded(Reference):
    """A motion that ends where a force is felt, or the end effector drops: it stays; what follows begins there.

    The time until its planned end passes all the same. It needs a law with ``contact``, whose sensor tells the force.

    Parameters
    ----------
    reference
        Of finite duration; where nothing is touched it goes on to its end.
    force
        N, of two samples one after the other.
    drop
        How far the end effector has gone since the begin where the wanted force pushes it, m: a peg that has found its
        hole.

    Raises
    ------
    ValueRangeError
        If neither is given, or the reference never ends or is guarded already.

    Examples
    --------
    >>> from dqcontrol.references import SetPoint
    >>> Guarded(SetPoint([1, 0, 0, 0, 0, 0, 0, 0], duration=2.0), force=1.0).guards.moves[0].end
    2.0
    """

    reference: Reference
    force: float | None = None
    drop: float | None = None

    def __post_init__(self) -> None:
        if self.force is None and self.drop is None:
            raise ValueRangeError("until: give what ends the motion, 'force' or 'drop'")
        if not np.isfinite(self.reference.duration):
            raise ValueRangeError("until: guards a motion that never ends; give its duration")
        if self.reference.guards.moves:
            raise ValueRangeError("until: guards a motion that is guarded already; leave one of them out")
        for name in ("force", "drop"):
            if (value := getattr(self, name)) is not None:
                vars(self)[name] = as_positive(f"until.{name}", value)
        vars(self).update(duration=self.reference.duration, corners=self.reference.corners)

    @property
    def guards(self) -> Guards:
        """Return the one that it is."""
        end = self.reference.samples([self.duration])[0, :8]
        return Guards((Guard(0.0, self.duration, self.force or np.inf, self.drop or np.inf, end),))

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21) as if nothing were touched; see `Reference.motion`."""
        return self.reference.motion(times)


@dataclass(frozen=True, eq=False, repr=False)
class OnTouchedPlane(Reference):
    """A reference on a plane that stands not quite where it was planned: three touches before it find it.

    From above each of three points the end effector goes down until it feels a force, and up again; then the whole
    reference is displaced so that its plane lies in the one touched, and the end effector goes to its start. The law
    needs ``contact``; what that gives way to, it does from the reference's start on.

    Parameters
    ----------
    reference
        On a plane, without guarded moves.
    force
        That ends a touch, N.
    normal
        Of the plane, away from what is touched, inertial frame, shape (3,).
    points
        Where to touch, inertial frame, m, shape (3, 3); a triangle around the reference if omitted.
    height
        m above the plane as planned, from where it goes down, and back to which it goes up.
    depth
        m below the plane as planned, to where it goes down at most: there nothing was touched, and the run ends.
    speed
        Going down, m/s: no more than the ``approach_speed`` of `contact_limits`.
    travel
        Mean speed between the points, m/s.

    Examples
    --------
    >>> import numpy as np
    >>> from dqcontrol.references import Circle
    >>> circle = Circle([1, 0, 0, 0, 0, 0.25, 0, 0.15], radius=0.04, duration=10.0)
    >>> found = OnTouchedPlane(circle)
    >>> len(found.guards.moves), bool(found.guards.plane.end < found.duration)
    (3, True)
    """

    reference: Reference
    force: float = 1.0
    normal: ArrayLike = (0.0, 0.0, 1.0)
    points: Several[Several[float]] | None = None
    height: float = 0.01
    depth: float = 0.01
    speed: float = 0.005
    travel: float = 0.05
    _guards: Guards = field(init=False, repr=False)
    _whole: Sequence = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.reference.guards.moves:
            raise ValueRangeError("touch: the reference has guarded moves of its own")
        given = as_array("touch.normal", self.normal, (3,))
        if not given.any():
            raise ValueRangeError("touch.normal: is 0")
        normal = given / np.linalg.norm(given)
        down, up = as_positive("touch.depth", self.depth), as_positive("touch.height", self.height)
        speed, travel = as_positive("touch.speed", self.speed), as_positive("touch.travel", self.travel)
        start = self.reference.samples([0.0])[0, :8]
        origin = translation(start)
        points = self._points(normal, origin)
        parts, guards, at, time = list[Reference](), list[Guard](), start, 0.0

        def go(way: Array, seconds: float, *, steady: bool = False) -> None:
            nonlocal at, time
            move = Straight(at, way=way, duration=seconds, steady=steady)
            at = move.samples([seconds])[0, :8]
            parts.extend([move, SetPoint(at, duration=_REST)])
            time += seconds + _REST

        go(up * normal, max(up / travel, _REST))
        for point in points:
            way = point + up * normal - translation(at)
            go(way, max(float(np.linalg.norm(way)) / travel, _REST))
            began = time
            go(-(up + down) * normal, (up + down) / speed, steady=True)
            # to the plane as planned: what is touched displaces that
            go(down * normal, max(down / travel, _REST))
            guards.append(Guard(began, time, self.force, np.inf, at))
            go(up * normal, max(up / travel, _REST))
        begin, way = time, origin - translation(at)
        go(way, max(float(np.linalg.norm(way)) / travel, 4 * _REST))
        # the last rest ends before the reference begins, so that it is on the plane by then
        whole = Sequence([*parts, self.reference])
        plane = TouchedPlane(begin, time - _REST, normal, origin)
        vars(self).update(duration=whole.duration, corners=whole.corners)
        vars(self).update(_whole=whole, _guards=Guards(tuple(guards), plane))

    def _points(self, normal: Array, origin: Array) -> Array:
        """Return the three points, on the plane as planned."""
        if self.points is None:
            lasts = self.reference.duration if np.isfinite(self.reference.duration) else 0.0
            path = translation(self.reference.samples(np.linspace(0.0, lasts, 200))[:, :8])
            middle = 0.5 * (path.min(axis=0) + path.max(axis=0))
            far = max(float(np.linalg.norm(path - middle, axis=1).max()), 0.02)
            first = np.cross(normal, [1.0, 0.0, 0.0] if abs(normal[0]) < 0.9 else [0.0, 1.0, 0.0])
            first /= np.linalg.norm(first)
            second = np.cross(normal, first)
            turns = 2 * np.pi / _TOUCHES * np.arange(_TOUCHES)
            found = middle + far * (np.cos(turns)[:, None] * first + np.sin(turns)[:, None] * second)
        else:
            found = as_array("touch.points", self.points, (3,))
            if found.shape != (_TOUCHES, 3):
                raise ShapeError(f"touch.points: expected three points, got shape {found.shape}")
            sides = np.cross(found[1] - found[0], found[2] - found[0])
            if np.linalg.norm(sides) < 1e-4:  # m²: 1 cm by 1 cm
                raise ValueRangeError("touch.points: lie on one line, or too near each other to tell a plane")
        return found - ((found - origin) @ normal)[:, None] * normal

    @property
    def guards(self) -> Guards:
        """Its three touches, and the plane that they tell."""
        return self._guards

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21) as if the plane were where it was planned; see `Reference.motion`."""
        return self._whole.motion(times)
