"""Constraints made ready for one robot and period: everything checked, as compiled code takes it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.constraints import constraint_layout as layout
from dqcontrol.constraints.constrained_step import constraint_values, keep_constraints
from dqcontrol.constraints.constraints import HAND, Constraints, unit
from dqcontrol.constraints.lag_path import WayToTargets, lag_path
from dqcontrol.constraints.moving_frames import HandFrame, moving_frames
from dqcontrol.errors import ShapeError, ValueRangeError, as_array, error_prefix, unknown_name
from dqcontrol.geometry import Box, Capsule, Cylinder, Hull, Plane, Shape, Sphere
from dqcontrol.geometry.distance_kernels import FIRST_CORNER, KIND, PLANE, RADIUS, ROUND, SHAPE
from dqcontrol.robots.link_shapes import LinkShape, LinkShapes
from dqcontrol.robots.robot import AT_ONCE, Lag, Robot, base_coordinates
from dqcontrol.world import Motion
from dqcontrol.world.body import INSTANT

if TYPE_CHECKING:
    from dqcontrol.robots.robot import CommandMode

_FASTEST_RATE = 10.0  # 1/s
_ANGULAR = 0.3**2  # l²: 1 rad/s of the hand counts as much as 0.3 m/s
_FREE = 1e-4  # ρ², m²
_RECOVERY = 0.1  # m/s or rad/s
_NEAR = 0.1  # m: nearer than that to a camera no target's direction is expected to turn
_THINNEST = 1e-3  # m between cores, of which nothing smaller is known
_MOST_PAIRS = 20_000  # at half a microsecond each a period of 10 ms
# Of a path of a body: its table takes half a gigabyte then, and a day at 10 ms fits.
_MOST_PERIODS = 10_000_000
_SAID = 5  # violations in one message
SELF = "self-collision"
_STILL = Motion()
_ALWAYS = (-math.inf, math.inf)  # s


class _Line(NamedTuple):
    """A row before its levers and its place among names are known."""

    row: layout.Row
    label: str
    levers: Array
    curved: float  # share of (Σ lever u)² that an angle may curve beyond


class ShapePair(NamedTuple):
    """What a row is about: one or two shapes of the robot, or one and the number of what is around it."""

    links: list[LinkShape]
    obstacle: int | None


class PreparedConstraints:
    """Constraints for one robot and period.

    Attributes
    ----------
    names
        Of what is kept, in the order of the report.
    labels
        Of each row, as ``table: panda_link5``; several shapes of a link have one, and `pair` says which.
    owners
        Number of the name of each row.
    asked
        Distance or room that is asked for in each row, m or rad.
    is_angle
        Of each row.
    levers
        How far each row can change at most with an input, shape (rows, m): m/rad, m/m or rad/rad.
    allowances
        How much more than asked samples keep of each row, so that it holds between them too, m or rad.
    rate
        η, 1/s.
    command_mode, lag
        How commands move joints, and the lag of joints behind their targets.
    parameters
        For compiled code.
    """

    kernel = keep_constraints

    def __init__(
        self, given: Constraints, robot: Robot, period: float, command_mode: CommandMode, lag: Lag = AT_ONCE
    ) -> None:
        self.given = given
        self.robot = robot
        self.period = period
        self.command_mode: CommandMode = command_mode
        self.lag: Lag = lag if command_mode == "integrated" else AT_ONCE
        if len(robot.drives) and robot.input_size == robot.configuration_size:
            raise ValueRangeError(
                f"constraints: {robot.name} takes the rates of its configuration, which its drives cannot all follow; "
                "give it the form 'constrained'"
            )
        if robot.input_size > 30:
            raise ValueRangeError(
                f"constraints: at most 30 inputs are allowed, {robot.name} has {robot.input_size}"
            )
        self.way: WayToTargets = lag_path(self.lag, robot.configuration_size, period)
        self._frames = moving_frames(robot)
        self._velocity: Array = robot.limits.velocity
        self._acceleration: Array = robot.acceleration_limits("constraints.acceleration", given.acceleration)
        self._bodies: list[LinkShape] = list(robot.shapes.shapes) if robot.shapes else []
        self._there: dict[int, tuple[float, float]] = {}  # when bodies are, by number; always if it has none
        self._first_obstacle: dict[str, int] = {}  # by name
        self._points: list[int] = []  # numbers of bodies that are balls about named frames
        self._obstacles: list[tuple[Array, Motion]] = []
        # numbers of obstacles, shapes seen from their body
        self._watched: dict[str, list[tuple[int, Shape]]] = {}
        self._lines: list[_Line] = []
        self._body_levers: dict[int, Array] = {}  # of bodies against what stands, by number
        self.names: tuple[str, ...] = given.names
        self.rate: float = self._rate()
        self._held: list[int] = self._add_held()
        self._add_obstacles()
        self._add_zones()
        self._add_angles()
        self._add_sights()
        self._add_pairs()
        if len(self._lines) > _MOST_PAIRS:
            raise ValueRangeError(
                f"constraints: make {len(self._lines):,} pairs of shapes; at most {_MOST_PAIRS:,}, name fewer 'links'"
            )
        self.labels: tuple[str, ...] = tuple(each.label for each in self._lines)
        self.owners: NDArray[np.intp] = np.array([each.row.name for each in self._lines], dtype=np.intp)
        self.is_angle: Array = np.array([each.row.kind > layout.INSIDE for each in self._lines], dtype=bool)
        self.asked: Array = np.array([float(each.row.kept) for each in self._lines])
        self.levers: Array = np.array([each.levers for each in self._lines]).reshape(-1, robot.input_size)
        self.allowances: Array = self._allowances()
        self._pack()

    def of(self, given: Constraints) -> PreparedConstraints:
        """Return other constraints made ready for the same robot, period and lag."""
        return PreparedConstraints(given, self.robot, self.period, self.command_mode, self.lag)

    @property
    def report(self) -> int:
        """How many numbers a report has."""
        return layout.NUMBERS + 3 * len(self.names)

    def values(self, q: ArrayLike, times: ArrayLike) -> Array:
        """Return the distances and angles of all rows.

        Parameters
        ----------
        q
            Configurations, shape (N, n), rad or m.
        times
            Shape (N,), s: where obstacles are.

        Returns
        -------
        Array
            Shape (N, rows): signed distances, m, of zones and angles the room that is left, m or rad.

        Raises
        ------
        ShapeError, ValueRangeError
            If a size is wrong or a value not finite.
        """
        rows = as_array("q", q, (None, self.robot.configuration_size))
        when = as_array("times", times, (len(rows),))
        out = np.empty((len(rows), len(self.labels)))
        status = constraint_values(
            self.robot.table,
            np.ascontiguousarray(rows),
            np.ascontiguousarray(when),
            np.rint(when / self.period),
            self.parameters,
            np.zeros(self.scratch),
            out,
        )
        if status:
            self.robot.fkm(rows)  # says what is wrong
        return out

    def place(self, parameters: Array, name: str, pose: Array) -> None:
        """Write where a watched body is, pose (8,), into parameters for compiled code; others are left alone.

        It counts as standing there until the next time.
        """
        if name not in self._watched:
            return
        count = len(self._obstacles) * (layout.OBSTACLE + self._hull)
        first = self.parameters.size - self._after_obstacles - count
        rows = parameters[first : first + count].reshape(-1, layout.OBSTACLE + self._hull)
        for number, shape in self._watched[name]:
            _put_shape(shape.moved(pose), rows[number])

    def pair(self, row: int) -> ShapePair:
        """Return the shapes of a row that is a distance; obstacles are counted in their order, zones' walls after."""
        found = self._lines[row].row
        links = [self._bodies[int(found.a)]]
        if found.b >= 0:
            return ShapePair([*links, self._bodies[int(found.b)]], None)
        return ShapePair(links, int(-1 - found.b))

    def violations(self, q: ArrayLike) -> list[str]:
        """Return what a configuration, shape (n,), violates, one line each, the worst first."""
        values = self.values(np.asarray(q)[None], [0.0])[0]
        short = self.asked - values
        lines = []
        for i in np.argsort(-short, kind="stable"):
            if short[i] <= 1e-9:
                break
            lines.append(f"{self.labels[i]}: {self.text(i, values[i])}")
        return lines

    def text(self, row: int, value: float, asked: float | None = None) -> str:
        """Say what a row's distance or room is and what was asked: what the constraints ask if omitted."""
        asked = float(self.asked[row]) if asked is None else asked
        if self.is_angle[row]:
            limit = math.degrees(float(self._lines[row].row.limit))
            sign = 1.0 if self._lines[row].row.kind == layout.AT_LEAST else -1.0
            least = "least" if sign > 0 else "most"
            return f"{limit + sign * math.degrees(value):.3g}°, at {least} {limit:.3g}° are asked"
        if value < 0:
            return f"{-1000 * value:.3g} mm deep, {1000 * asked:.3g} mm of distance are asked"
        return f"{1000 * value:.3g} mm apart, {1000 * asked:.3g} mm are asked"

    def check_start(self, q: ArrayLike) -> None:
        """Raise a `ValueRangeError` if a run may not start at a configuration, shape (n,)."""
        if self.given.recovery is not None or not (found := self.violations(q)):
            return
        more = f"; and {len(found) - _SAID} more" if len(found) > _SAID else ""
        raise ValueRangeError(
            f"start: violates constraints: {'; '.join(found[:_SAID])}{more}. Start elsewhere, ask for less, or give "
            "constraints.recovery, the speed at which distances that are too small may grow (0.1 m/s)"
        )

    def _rate(self) -> float:
        if self.given.rate is not None:
            if self.given.rate * self.period > 1:
                raise ValueRangeError(
                    f"constraints.rate: must be ≤ {1 / self.period:g}, one over the period, got {self.given.rate:g}: "
                    "a distance could shrink beyond what is kept in one period"
                )
            return self.given.rate
        with np.errstate(invalid="ignore"):
            share = self._acceleration / self._velocity
        return float(np.nanmin([_FASTEST_RATE, 0.5 / self.period, *share[np.isfinite(share)]]))

    def _chosen(self, field: str, names: list[str] | None) -> list[int]:
        """Return the numbers of shapes by their names, of all that move without."""
        if names is None:
            found = [
                i
                for i, each in enumerate(self._bodies)
                if each.frame > 0 and each.name != HAND and i not in self._points
            ]
            if not found:
                raise ValueRangeError(
                    f"{field}: {self.robot.name} has no shapes that could keep away; give it some "
                    "('dqcontrol robots shapes' fits them to meshes), or links: [hand] for its point alone"
                )
            return found
        known: dict[str, list[int]] = {}
        for i, each in enumerate(self._bodies):
            if i not in self._points:
                for name in dict.fromkeys((each.name, each.link)):
                    known.setdefault(name, []).append(i)
        numbers, points = [], self._frames.point_names()
        for name in names:
            if name in known:
                found = known[name]
            elif name == HAND:
                found = [self._ball_at(hand, 0.0) for hand in self._frames.hands(field, None)]
            elif name in points:
                found = [self._ball_at(self._frames.hands(field, name)[0], 0.0)]
            else:
                raise unknown_name(f"{field}.links", name, dict.fromkeys((*known, HAND, *points)))
            if any(self._bodies[i].frame == 0 for i in found):
                raise ValueRangeError(f"{field}.links: '{name}' stands still, nothing can keep it away")
            numbers += found
        return numbers

    def _hand(self, field: str, name: str | None) -> tuple[int, Array, Array]:
        """Return the frame that carries a hand, and its rotation and position in that."""
        frame, pose = self._one_hand(field, name)
        matrix = algebra.matrix_from_pose(pose)
        return frame, matrix[:3, :3], matrix[:3, 3]

    def _one_hand(self, field: str, name: str | None) -> tuple[int, Array]:
        hands = self._frames.hands(field, name)
        if len(hands) > 1:
            names = " or ".join(each.name for each in hands)
            raise ShapeError(f"{field}: {self.robot.name} has several hands; give one as 'frame', {names}")
        return hands[0].frame, algebra.pose(hands[0].pose[:4], hands[0].pose[4:7])

    def _ball_at(self, hand: HandFrame, radius: float) -> int:
        name = hand.name if radius == 0.0 else f"{hand.name} ({1000 * radius:g} mm)"
        for i in self._points:
            if self._bodies[i].name == name:
                return i
        self._bodies.append(LinkShape(name, hand.frame, Sphere(hand.pose[4:7], radius)))
        self._points.append(len(self._bodies) - 1)
        return self._points[-1]

    def _end_balls(self, body: int) -> list[int]:
        """Return a ball at each end of a capsule in place of it: against planes each end has a smooth distance."""
        each = self._bodies[body]
        if not isinstance(each.shape, Capsule):
            return [body]
        found = []
        for k, end in enumerate((each.shape.start, each.shape.end)):
            name = f"{each.name} (end {k + 1})"
            if name not in (names := [other.name for other in self._bodies]):
                self._bodies.append(LinkShape(name, each.frame, Sphere(end, each.shape.radius)))
                names.append(name)
            found.append(names.index(name))
        return found

    def _add_held(self) -> list[int]:
        """Add what hands hold to the robot's shapes; return their numbers."""
        first = len(self._bodies)
        for name, each in self.given.held.items():
            frame, pose = self.hand_that_holds(name)
            for k, shape in enumerate(each.shapes):
                own = name if len(each.shapes) == 1 else f"{name}.{k + 1}"
                self._there[len(self._bodies)] = (each.held.since, each.held.ends)
                self._bodies.append(LinkShape(own, frame, _of_links(shape.moved(pose))))
        return list(range(first, len(self._bodies)))

    def hand_that_holds(self, name: str) -> tuple[int, Array]:
        """Return the frame that carries the hand that holds a body of the world, and the hand's pose (8,) in that."""
        return self._one_hand(f"world.{name}.held", self.given.held[name].held.frame)

    def _add_obstacle(
        self, shape: Shape, moving: Motion = _STILL, there: tuple[float, float] = _ALWAYS
    ) -> int:
        numbers = np.zeros(layout.OBSTACLE + max(len(shape.row) - SHAPE, 0))
        _put_shape(shape, numbers)
        numbers[[layout.FROM, layout.UNTIL]] = np.array(there) - INSTANT
        self._obstacles.append((numbers, moving))
        return len(self._obstacles) - 1

    def _add_distance(
        self,
        kind: float,
        a: int,
        obstacle: int,
        label: str,
        name: int,
        level: int,
        margin: float,
        speed: float = 0.0,
    ) -> None:
        body = self._bodies[a]
        if a not in self._body_levers:
            self._body_levers[a] = self._frames.levers(body.frame, body.extent)
        levers = self._body_levers[a]
        if levers.any():
            row = _row(kind=kind, a=a, b=-1 - obstacle, kept=margin, level=level, name=name, speed=speed)
            self._lines.append(_Line(row, label, levers, 0.0))

    def _add_obstacles(self) -> None:
        world = self.given.world
        for name, each in self.given.obstacles.items():
            field, clear = f"constraints.clear_of.{name}", each.clear
            margin = self.given.margin if clear.margin is None else clear.margin
            self._first_obstacle[name] = len(self._obstacles)
            beside = self.hand_that_holds(name)[0] if name in self.given.held else -1
            for k, (shape, there) in enumerate(zip(each.shapes, each.there, strict=True)):
                obstacle = self._add_obstacle(shape, each.moves, there)
                if world is not None and (body := world.bodies[name]).watch is not None:
                    seen_from = shape.moved(algebra.conjugate(body.pose))
                    self._watched.setdefault(name, []).append((obstacle, seen_from))
                part = f" {k + 1}" if len(each.shapes) > 1 else ""
                for chosen in self._chosen(field, clear.links):
                    if clear.links is None and (
                        self._bodies[chosen].frame == beside or self._stands_on(shape, self._bodies[chosen])
                    ):
                        continue
                    for body in self._end_balls(chosen) if isinstance(shape, Plane) else [chosen]:
                        label = f"{name}{part}: {self._bodies[chosen].link}"
                        number = self.names.index(name)
                        self._add_distance(
                            layout.APART, body, obstacle, label, number, clear.level, margin, each.moves.speed
                        )

    def _stands_on(self, shape: Shape, body: LinkShape) -> bool:
        """Return whether no joint changes a distance from a plane: of a base on its floor, of a link turning on it."""
        if not isinstance(shape, Plane):
            return False
        frame = np.array([1.0, 0, 0, 0, 0, 0, 0, 0])
        for row, turns in self._frames.joints_before(body.frame):
            frame = algebra.multiply(frame, algebra.pose(row[:4], row[4:7]))
            axis = algebra.matrix_from_pose(frame)[:3, 2]  # as it is at q = 0: those before it keep it so
            along = abs(float(axis @ shape.normal))
            if abs(along - float(turns)) > 1e-9:
                return False
        return True

    def _add_zones(self) -> None:
        for name, each in self.given.zones.items():
            field, number = f"constraints.zones.{name}", self.names.index(name)
            hands = self._frames.hands(field, each.frame)
            with error_prefix(field):
                walls = each.walls
            for k, wall in enumerate(walls):
                kind = layout.APART if isinstance(wall, Plane) else layout.INSIDE
                label = f"{name}: wall {k + 1}" if len(walls) > 1 else name
                obstacle = self._add_obstacle(wall)
                for hand in hands:
                    own = f"{label}: {hand.name}" if len(hands) > 1 else label
                    body = self._ball_at(hand, each.radius_of_hand)
                    self._add_distance(kind, body, obstacle, own, number, each.level, each.margin)

    def _add_angles(self) -> None:
        for name, each in self.given.angles.items():
            field = f"constraints.angles.{name}"
            frame, turn, _ = self._hand(field, each.frame)
            axis = turn @ unit(f"{field}.axis", each.axis)
            other = unit(f"{field}.direction", each.direction)
            for most, limit in each.limits:
                row = _row(
                    kind=layout.AT_MOST if most else layout.AT_LEAST,
                    a=frame,
                    b=0,
                    kept=0.0,
                    level=each.level,
                    name=self.names.index(name),
                    limit=limit,
                    axis=axis,
                    other=other,
                )
                bend = 1 / math.tan(limit) if 0 < limit < math.pi else 0.0
                # about a narrow cone an angle curves outwards
                curved = 1.0 + max(-bend if most else bend, 0.0)
                self._lines.append(_Line(row, name, self._frames.turning(frame), curved))

    def _add_sights(self) -> None:
        for name, each in self.given.sights.items():
            field = f"constraints.sights.{name}"
            frame, turn, shift = self._hand(field, each.frame)
            if (each.target is None) == (each.place is None):
                raise ShapeError(f"{field}: give either 'target', the name of a body, or 'place'")
            if each.target is not None:
                if each.target not in self._first_obstacle:
                    raise unknown_name(f"{field}.target", each.target, tuple(self._first_obstacle))
                target = self._first_obstacle[each.target]
                if math.isinf(self._obstacles[target][0][layout.BALL + 3]):
                    raise ValueRangeError(f"{field}.target: '{each.target}' has no middle to look at")
            else:
                target = self._add_obstacle(Sphere(np.array(each.place), 0.0))
            camera = shift + turn @ np.asarray(each.camera)
            row = _row(
                kind=layout.SIGHT,
                a=frame,
                b=target,
                kept=0.0,
                level=each.level,
                name=self.names.index(name),
                limit=each.at_most,
                axis=turn @ unit(f"{field}.axis", each.axis),
                other=camera,
            )
            reach = self._frames.levers(frame, float(np.linalg.norm(camera)))
            levers = self._frames.turning(frame) + reach / _NEAR
            curved = 1.0 + max(1 / math.tan(each.at_most), 0.0)
            self._lines.append(_Line(row, name, np.maximum.accumulate(levers[::-1])[::-1], curved))

    def _add_pairs(self) -> None:
        shapes, wanted = self.robot.shapes, self.given.self_collision
        if wanted is None:
            wanted = shapes is not None and bool(shapes.pairs)
        if not wanted:
            return
        if shapes is None or not shapes.pairs:
            raise ValueRangeError(
                f"constraints.self_collision: {self.robot.name} has no pairs of shapes to keep apart; give it some, "
                "or self_collision: false"
            )
        margin = self.given.margin if self.given.self_margin is None else self.given.self_margin
        self.names = (*self.names, SELF)
        for a, b in (*shapes.pairs, *self._held_pairs(shapes)):
            first, second = sorted((a, b), key=lambda i: self._bodies[i].frame, reverse=True)
            far, near = self._bodies[first], self._bodies[second]
            row = _row(kind=layout.APART, a=first, b=second, kept=margin, level=0, name=len(self.names) - 1)
            levers = self._frames.levers(far.frame, far.extent, near.frame, near.extent)
            if levers.any():
                self._lines.append(_Line(row, f"{near.link}, {far.link}", levers, 0.0))

    def _held_pairs(self, shapes: LinkShapes) -> list[tuple[int, int]]:
        """Return what is held with the links from which those of the frame that carries it are kept apart."""
        found = []
        for i in self._held:
            carrier = {k for k, each in enumerate(shapes.shapes) if each.frame == self._bodies[i].frame}
            others = {a if b in carrier else b for a, b in shapes.pairs if (a in carrier) != (b in carrier)}
            found += [(i, k) for k in sorted(others)]
        return found

    def _allowances(self) -> Array:
        """Return of each row κ T²/8 for the largest κ that limits of speed allow, and what is late."""
        if not np.isfinite(self.levers).all():
            limits, slides = self.robot.limits, np.array(self.robot.joint_types) == "prismatic"
            endless = slides & ~base_coordinates(self.robot) & ~np.isfinite(limits.upper - limits.lower)
            raise ValueRangeError(
                f"constraints: {self.robot.name} has no limits of {self.robot.joint_names[int(endless.argmax())]}, "
                "which slides, without which nothing is known of how fast distances change"
            )
        used = self.levers > 0
        unknown = used & ~np.isfinite(self._velocity)
        if unknown.any():
            j = int(unknown[int(unknown.any(axis=1).argmax())].argmax())
            raise ValueRangeError(
                f"constraints: {self.robot.name} has no velocity limit of {self.robot.input_names[j]}, without which "
                "nothing is known of what happens between samples"
            )
        speed = np.where(used, self._velocity, 0.0)
        before = np.cumsum(speed, axis=1) - speed
        bend = (self.levers * speed * (speed + 2 * before)).sum(axis=1)
        curved = np.array([line.curved for line in self._lines])
        bend = np.where(curved > 0, curved * (self.levers * speed).sum(axis=1) ** 2, bend)
        late = (self.levers * speed) @ self.way.apart[self.robot.input_coordinates]
        if len(self.way.shares) > 1:
            late += [self._lateness(line) for line in self._lines]
        return bend * self.period**2 / 8 + late

    def _lateness(self, line: _Line) -> float:
        """Return what delays that differ take of a row whose obstacle moves otherwise than straight on.

        What is met `WayToTargets.early` comes nearer by as much as it moves meanwhile; a path with corners is off the
        line between two of its points by a quarter of the time between them, times how much its velocity changes.
        """
        obstacle = int(line.row.b) if line.row.kind == layout.SIGHT else -1 - int(line.row.b)
        if obstacle < 0 or layout.AT_MOST <= line.row.kind <= layout.AT_LEAST:
            return 0.0
        moving, moved = self._obstacles[obstacle][1], 0.0
        if moving.velocity is not None:
            moved = self.way.early * float(np.linalg.norm(moving.velocity))
        elif moving.path is not None:
            path = np.asarray(moving.path, np.float64)
            speeds = np.diff(path[:, 1:], axis=0) / np.diff(path[:, 0])[:, None]
            at_rest = np.zeros((1, 3))
            turns = np.linalg.norm(np.diff(np.vstack([at_rest, speeds, at_rest]), axis=0), axis=1)
            between = float(np.diff(self.way.meets[:, 0] + self.period * self.way.meets[:, 1]).max())
            within = [turns[(path[:, 0] >= t) & (path[:, 0] <= t + between)].sum() for t in path[:, 0]]
            moved = self.way.early * float(np.linalg.norm(speeds, axis=1).max(initial=0.0))
            moved += 0.25 * between * max(within)
        return moved / (_NEAR if line.row.kind == layout.SIGHT else 1.0)

    def _bend(self, line: _Line) -> float:
        """Return `Row.bend`: of distances from what is round one over what is between the cores."""
        row = line.row
        if row.kind > layout.INSIDE:
            return line.curved - 1.0
        other = self._bodies[int(row.b)].shape.row if row.b >= 0 else self._obstacles[int(-1 - row.b)][0]
        if row.kind == layout.INSIDE or other[KIND] == PLANE:
            return 0.0
        rounds = [each[RADIUS] for each in (self._bodies[int(row.a)].shape.row, other) if each[KIND] == ROUND]
        return 1.0 / max(float(row.kept) + sum(rounds), _THINNEST)

    def _pack(self) -> None:
        robot, given, m = self.robot, self.given, self.robot.input_size
        n, shapes, obstacles = robot.configuration_size, len(self._bodies), len(self._obstacles)
        bodies = np.zeros((shapes, layout.THERE + 1))
        for number, (row, each) in enumerate(zip(bodies, self._bodies, strict=True)):
            row[0] = each.frame
            row[1 : 1 + len(each.shape.row)] = each.shape.row
            row[1 + layout.BALL : 1 + layout.BODY] = ball_around(each.shape)
            row[[1 + layout.FROM, 1 + layout.UNTIL]] = np.array(self._there.get(number, _ALWAYS)) - INSTANT
        table = self._motions()
        self._hull: int = (
            max((len(each) for each, _ in self._obstacles), default=layout.OBSTACLE) - layout.OBSTACLE
        )
        stored = np.zeros((obstacles, layout.OBSTACLE + self._hull))
        for row, (each, _) in zip(stored, self._obstacles, strict=True):
            row[: len(each)] = each
        packed = []
        for k, line in enumerate(self._lines):
            found = line.row
            b = found.b if found.kind > layout.INSIDE or found.b >= 0 else shapes - 1 - found.b
            kept = self.asked[k] + self.allowances[k]
            packed.append(found._replace(b=b, kept=kept, bend=self._bend(line)))
        rows = np.zeros((0, layout.row_of.size()))
        if packed:  # all at once: one by one they take longer than a plan
            columns = map(np.array, zip(*packed, strict=True))
            rows = layout.row_of.pack(**dict(zip(layout.Row._fields, columns, strict=True)))
        joints = robot.input_coordinates
        lower, upper, velocity = robot.limits.lower[joints], robot.limits.upper[joints], self._velocity
        if not given.joint_limits:
            lower, upper, velocity = np.full(m, -np.inf), np.full(m, np.inf), np.full(m, np.inf)
        drives, frames = len(robot.drives), self._frames
        capacity = min(len(rows) * len(self.way.shares), layout.MOST_ROWS) + layout.MOST_CUTS
        head = layout.head.pack(
            **layout.solver_sizes(m, capacity, drives),
            period=self.period,
            inputs=m,
            frames=frames.count,
            screws=len(frames.screws),
            tree=len(frames.tree),
            shapes=shapes,
            obstacles=obstacles,
            hull=self._hull,
            rows=len(rows),
            names=len(self.names),
            moving=(table.shape[1] - 1) // 6,
            capacity=capacity,
            drives=drives,
            integrates=self.command_mode == "integrated",
            points=len(self.way.shares),
            late=self.way.late,
            rate=self.rate,
            recovery=given.recovery or _RECOVERY,
            escape=0.0 if given.escape in (None, "plan") else given.escape,
            angular=_ANGULAR,
            free=_FREE,
        )
        self.parameters: Array = layout.parameters_of.pack(
            head=head,
            limits=layout.limits_of.pack(
                lower=lower, upper=upper, velocity=velocity, acceleration=self._acceleration
            ),
            way=layout.way_of.pack(
                times=self.lag.times or np.zeros(n),
                shares=self.way.shares,
                meets=self.way.meets,
                bent=self.way.bent,
                coordinate=robot.input_coordinates,
            ),
            kept=layout.kept_of.pack(
                rows=rows,
                levers=self.levers,
                drives=robot.drives,
                rims=[self._velocity[int(first) - k] for k, (first, *_) in enumerate(robot.drives)],
            ),
            scene=layout.scene_of.pack(
                carriers=frames.carriers,
                screws=frames.screws,
                tree=frames.tree,
                bodies=bodies,
                obstacles=stored,
                table=table,
            ),
        )
        self._after_obstacles: int = table.size
        self.scratch: int = layout.work_of.size(n, m, layout.head(head))
        self.memory: int = layout.memory_of.size(n, m)

    def _motions(self) -> Array:
        """Write how obstacles move into their numbers, and return the table of those that follow a path."""
        paths = []
        for numbers, each in self._obstacles:
            if each.velocity is not None:
                numbers[layout.MOTION] = layout.STRAIGHT
                numbers[layout.VELOCITY : layout.VELOCITY + 3] = each.velocity
            elif each.path is not None:
                numbers[layout.MOTION], numbers[layout.PLACE] = layout.BY_TABLE, len(paths)
                paths.append(np.asarray(each.path, np.float64))
        if not paths:
            return np.zeros((1, 1))
        lasts = max(path[-1, 0] for path in paths)
        if lasts > _MOST_PERIODS * self.period:
            raise ValueRangeError(
                f"world: a path ('moves') lasts {lasts:.3g} s; at most {_MOST_PERIODS:,} periods of {self.period:g} s "
                "may be"
            )
        count = math.ceil(lasts / self.period) + 2
        times = self.period * np.arange(count + 1)
        table = np.zeros((count, 6 * len(paths) + 1))
        for k, path in enumerate(paths):
            shifts = np.column_stack([np.interp(times, path[:, 0], path[:, i]) for i in (1, 2, 3)])
            table[:, 6 * k : 6 * k + 3] = shifts[:-1]
            table[:, 6 * k + 3 : 6 * k + 6] = np.diff(shifts, axis=0) / self.period
        return table


def _row(**values: float | Array) -> layout.Row:
    empty = {"speed": 0.0, "bend": 0.0, "limit": 0.0, "axis": np.zeros(3), "other": np.zeros(3)}
    return layout.Row(**(empty | values))  # type: ignore[arg-type]


def _put_shape(shape: Shape, numbers: Array) -> None:
    """Write the numbers of a shape into those of an obstacle, and of the ball around it; the corners of a hull last."""
    numbers[:SHAPE], numbers[layout.BALL : layout.BALL + 4] = shape.row[:SHAPE], ball_around(shape)
    if isinstance(shape, Hull):
        numbers[FIRST_CORNER] = layout.OBSTACLE
        numbers[layout.OBSTACLE : layout.OBSTACLE + len(shape.row) - SHAPE] = shape.row[SHAPE:]


def _of_links(shape: Shape) -> Sphere | Capsule | Box:
    """Return what is around a shape and may move as links do: round ends of a cylinder, the box of a hull."""
    if isinstance(shape, Cylinder):
        return Capsule(shape.start, shape.end, shape.radius)
    if isinstance(shape, Hull):
        low, high = shape.points.min(axis=0), shape.points.max(axis=0)
        return Box(algebra.multiply(shape.pose, algebra.pose([1, 0, 0, 0], 0.5 * (low + high))), high - low)
    assert isinstance(shape, Sphere | Capsule | Box)
    return shape


def ball_around(shape: Shape) -> Array:
    """Return centre and radius of a ball around a shape."""
    if isinstance(shape, Sphere):
        return np.array([*shape.center, shape.radius])
    if isinstance(shape, Cylinder | Capsule):
        half, radius = 0.5 * float(np.linalg.norm(shape.end - shape.start)), shape.radius
        far = math.hypot(half, radius) if isinstance(shape, Cylinder) else half + radius
        return np.array([*(0.5 * (shape.start + shape.end)), far])
    if isinstance(shape, Hull):
        middle = 0.5 * (shape.corners.min(axis=0) + shape.corners.max(axis=0))
        return np.array([*middle, np.linalg.norm(shape.corners - middle, axis=1).max()])
    if isinstance(shape, Box):
        return np.array([*shape.row[4:7], float(np.linalg.norm(shape.row[1:4]))])
    middle = np.zeros(3) if shape.row[0] == PLANE else shape.row[2:5]
    return np.array([*middle, np.inf])
