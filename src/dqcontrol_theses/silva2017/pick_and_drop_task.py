"""A cube into a basket, where the camera sees them. [S17 Fig. 5.1]"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import as_array
from dqcontrol.laws import FeedbackLinearization, Law
from dqcontrol.limits import CommandLimits
from dqcontrol.loop import Record, simulate, simulate_prepared
from dqcontrol.plants import Camera, Gripper, GripperEvent, MobilePlant, lagging_mode
from dqcontrol.references import POSE, TIME, Points
from dqcontrol.robots import load_robot
from dqcontrol.world import Body, World
from dqcontrol_theses.printed import PRINTED_IN_BODY_TWISTS

ROBOT, PERIOD = "little-john", 0.02
START = (0.0, 0.0, 0.0, 0.0, -0.504, 1.397, 0.0, 0.0)
LAW = FeedbackLinearization(stiffness=16.0, damping=6.0, inverse=PRINTED_IN_BODY_TWISTS)
CAMERA = Camera(rate=30.0, delay=0.04, position_noise=0.002, angle_noise=0.004, filter_time=0.1)
LINK_MASS = [0.125, 0.405, 0.18, 0.12, 0.13]
CUBE = Body(box=0.03, position=(0.8, 0.2, 0.015), rpy=(0.0, 0.0, 0.3), mass=0.02)
BASKET = Body(container=(0.16, 0.16, 0.08), position=(0.5, 0.9, 0.0))
HOLDS = 40.0, 32.0, 40.0, 43.0  # s; of the set-points above the cube, at it, above it, above the basket
_GRIPPING, _DROPPING = 2.0, 3.0  # s; before the end of its set-point the gripper closes, and opens
_OTHER_NOISE = 1000  # things are seen with other noise than the base
_UNSCALED = CommandLimits(velocity=False)

# how far the hand looks down where it grips, and where it carries
_STEEP, _FLAT = math.radians(72), math.radians(50)
_REACH = 0.27, 0.34  # m; from the axle to the hand there
_ABOVE, _GRIP, _CARRY = 0.09, 0.02, 0.22  # m; heights of the hand
_SPEED, _TURN_RATE = 0.12, 0.4  # m/s, rad/s
_LEAST = 1.5  # s; of every move and pause


@dataclass(frozen=True, eq=False)
class Errand:
    """Hand poses over time, and when the gripper opens and closes.

    Attributes
    ----------
    times
        Shape (N,), s.
    poses
        Shape (N, 8), inertial frame, m.
    schedule
        Of the gripper.
    """

    times: Array
    poses: Array
    schedule: list[GripperEvent]


@dataclass(frozen=True, eq=False)
class PickAndDrop:
    """What came of it.

    Attributes
    ----------
    plant, record
        As in any run.
    seen
        The cube and the basket as the camera showed them, x, y and yaw, shape (2, 3), m and rad.
    errand
        What was planned from that.
    """

    plant: MobilePlant
    record: Record
    seen: Array
    errand: Errand

    @property
    def path(self) -> Array:
        """Where the cube was over time, shape (N, 3), m."""
        return self.record.readings["cube_position"].values

    @property
    def is_in_basket(self) -> bool:
        """Whether the cube ended up in the basket."""
        return bool(self.plant.bodies["basket"].holds(self.path[-1]))


def plan(hand: ArrayLike, cube: ArrayLike, basket: ArrayLike) -> Errand:
    """Return the errand of a hand that starts somewhere, takes a cube and drops it into a basket.

    The hand goes straight from pose to pose, rests above the cube, at it and above the basket, and always looks away
    from where the base should stand. It comes from the side of the cube that faces it best.

    Parameters
    ----------
    hand
        Pose of the hand at the start, shape (8,).
    cube, basket
        x, y and yaw, shape (3,), m and rad; the yaw of the basket does not matter.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> hand = dqc.load_robot("little-john").fkm(START)
    >>> errand = plan(hand, [0.8, 0.2, 0.3], [0.5, 0.9, 0])
    >>> [event.closed for event in errand.schedule]
    [True, False]
    """
    first = as_array("hand", hand, (8,))
    above, grip, lifted, over = stops_of(first, cube, basket)
    stops = [first, first, above, above, grip, grip, lifted, over, over]
    times = np.cumsum([0.0, *(_time(a, b) for a, b in pairwise(stops))])
    times[-1] += 1.0
    close, open_ = times[4] + 0.5, times[7] + 1.2
    schedule = [GripperEvent(time=float(close), closed=True), GripperEvent(time=float(open_), closed=False)]
    return Errand(times, np.array(stops), schedule)


def stops_of(hand: ArrayLike, cube: ArrayLike, basket: ArrayLike) -> tuple[Array, Array, Array, Array]:
    """Return the hand's poses above the cube, at it, above it again, and above the basket; arguments as of `plan`."""
    first = as_array("hand", hand, (8,))
    thing, goal = as_array("cube", cube, (3,)), as_array("basket", basket, (3,))
    bearing = _bearing(algebra.translation(first)[:2], thing[:2])
    side = thing[2] + math.pi / 2 * round((bearing - thing[2]) / (math.pi / 2))
    stand = thing[:2] - _REACH[0] * np.array([math.cos(side), math.sin(side)])
    way = side + math.remainder(_bearing(stand, goal[:2]) - side, 2 * math.pi)
    return (
        _pose(thing, _ABOVE, side, _STEEP),
        _pose(thing, _GRIP, side, _STEEP),
        _pose(thing, _CARRY, side, _FLAT),
        _pose(goal, _CARRY, way, _FLAT),
    )


def pick_and_drop(
    cube: Body = CUBE, basket: Body = BASKET, camera: Camera = CAMERA, seed: int = 0
) -> PickAndDrop:
    """Let Little John put a cube into a basket, in physics, from what a camera at the ceiling measures.

    One frame tells where cube and basket are. On the way the camera measures the base, and the encoders the joints; the
    cube is held by friction alone.

    Parameters
    ----------
    cube, basket
        Where they really are.
    camera
        Its noise is that of the frame and of the measured base.
    seed
        Of that noise.

    Examples
    --------
    >>> from dqcontrol_theses.silva2017.pick_and_drop_task import pick_and_drop
    >>> pick_and_drop().is_in_basket  # doctest: +SKIP
    True
    """
    robot = load_robot(ROBOT)
    seen = camera.glance([_on_floor(cube), _on_floor(basket)], seed)
    errand = plan(robot.fkm(START), *seen)
    plant = _plant(cube, basket, camera, errand.schedule)
    reference = Points(errand.times, errand.poses)
    record = simulate(robot, reference, LAW, plant, START, PERIOD, limits=_UNSCALED, seed=seed)
    return PickAndDrop(plant, record, seen, errand)


def regulate(
    law: Law, cube: Body = CUBE, basket: Body = BASKET, camera: Camera = CAMERA, seed: int = 0
) -> PickAndDrop:
    """Let a law put the cube into the basket by set-points, cube and basket measured all the time. [S17 5.1]

    The law knows "only the desired end-effector pose": above the cube, at it, above it again and above the basket, each
    for as long as `HOLDS` says. Every frame of the camera measures cube and basket anew, and the desired pose moves
    with its noise, filtered as the base's pose is. The gripper closes and opens at the end of its set-point, whether
    the hand is there or not; the cube is not looked for once it has been gripped.

    Parameters
    ----------
    law
        What drives the robot.
    cube, basket, camera, seed
        As of `pick_and_drop`.
    """
    robot = load_robot(ROBOT)
    ends = np.cumsum(HOLDS)
    times: Array = PERIOD * np.arange(round(ends[-1] / PERIOD), dtype=np.float64)
    schedule = [
        GripperEvent(time=float(ends[1] - _GRIPPING), closed=True),
        GripperEvent(time=float(ends[3] - _DROPPING), closed=False),
    ]
    seen = _watched(camera, [_on_floor(cube), _on_floor(basket)], len(times), seed)
    gripped = int((ends[1] - _GRIPPING) / PERIOD)
    seen[gripped:, 0] = seen[gripped, 0]
    stage = np.minimum(np.searchsorted(ends, times, side="right"), len(ends) - 1)
    hand = robot.fkm(START)
    samples = np.zeros((len(times), TIME + 1))
    samples[:, TIME] = times
    for k, at in enumerate(stage):
        samples[k, POSE] = stops_of(hand, *seen[k])[at]
    plant = _plant(cube, basket, camera, schedule)
    prepared = law.prepare(robot, None, PERIOD, _UNSCALED, lagging_mode(plant))
    record = simulate_prepared(prepared, plant, np.array(START), samples, seed=seed)
    starts = np.searchsorted(times, np.r_[0.0, ends[:-1]])
    errand = Errand(times[starts], samples[starts][:, POSE], schedule)
    return PickAndDrop(plant, record, seen[0], errand)


def _watched(camera: Camera, poses: list[list[float]], steps: int, seed: int) -> Array:
    """Return the camera's estimate of things at rest at each sample, shape (steps, things, 3)."""
    true = np.array(poses)
    plan = camera.schedule(PERIOD, steps, len(true), seed + _OTHER_NOISE)
    seen, estimate = np.zeros((steps, *true.shape)), camera.glance(true, seed)
    for k in range(steps):
        if plan.arrives[k]:
            estimate = estimate + plan.weight * (true + plan.errors[k].reshape(-1, 3) - estimate)
        seen[k] = estimate
    return seen


def _plant(cube: Body, basket: Body, camera: Camera, schedule: list[GripperEvent]) -> MobilePlant:
    return MobilePlant(
        location="camera",
        camera=camera,
        link_mass=LINK_MASS,
        gripper=Gripper(closes="y", schedule=schedule),
        world=World(bodies={"cube": cube, "basket": basket}),
    )


def _on_floor(body: Body) -> list[float]:
    """Return where the camera sees a body: x, y (m) and yaw (rad)."""
    return [*body.position[:2], body.rpy[2]]


def _bearing(start: Array, end: Array) -> float:
    return math.atan2(end[1] - start[1], end[0] - start[0])


def _pose(place: Array, height: float, heading: float, down: float) -> Array:
    """Return the pose of a hand whose x axis points along a heading, and down."""
    about_z = [math.cos(heading / 2), 0, 0, math.sin(heading / 2), 0, 0, 0, 0]
    about_y = [math.cos(down / 2), 0, math.sin(down / 2), 0, 0, 0, 0, 0]
    return algebra.pose(algebra.multiply(about_z, about_y)[:4], [place[0], place[1], height])


def _time(start: Array, end: Array) -> float:
    """Return how long the hand takes from pose to pose, s."""
    way = float(np.linalg.norm(algebra.translation(end) - algebra.translation(start)))
    turn = 2 * math.acos(min(1.0, abs(float(start[:4] @ end[:4]))))
    return max(_LEAST, way / _SPEED, turn / _TURN_RATE)
