"""[S17 Fig. 5.1] with the base driving: a cube from one table into a basket on another, two metres away."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.geometry import FloorMap
from dqcontrol.laws import GuidedProportional, Law
from dqcontrol.limits import CommandLimits
from dqcontrol.loop import Record, simulate
from dqcontrol.plants import Gripper, GripperEvent, MobilePlant
from dqcontrol.references import DriveThrough, DriveTo
from dqcontrol.robots import DifferentialDrive, Robot, WholeBody, load_robot
from dqcontrol.tables import Cell, Column, Table
from dqcontrol.world import Body, World
from dqcontrol_theses.catalogue import Conditions
from dqcontrol_theses.printed import PRINTED_INVERSE
from dqcontrol_theses.reproduced import Reproduced, Write
from dqcontrol_theses.silva2017.pick_and_drop_task import CAMERA, LINK_MASS, PERIOD, ROBOT, START
from dqcontrol_theses.silva2017.pictures import filmed, if_drawable

HEIGHT = 0.10  # m; of both tables
TABLES = (
    Body(box=[0.4, 0.6, HEIGHT], position=(1.2, 0.0, 0.5 * HEIGHT)),
    Body(box=[0.4, 0.6, HEIGHT], position=(-1.0, -0.6, 0.5 * HEIGHT)),
)
CUBE = Body(box=0.03, position=(1.04, 0.05, HEIGHT + 0.015), rpy=(0.0, 0.0, 0.2), mass=0.02)
BASKET = Body(container=(0.12, 0.12, 0.05), position=(-0.87, -0.6, HEIGHT))
WORLD = World(bodies={"cube": CUBE, "table 1": TABLES[0], "table 2": TABLES[1], "basket": BASKET})
GUIDED = "guided K along the plan"
_DOWN = math.radians(58)  # how far the hand looks down
_ABOVE, _GRIP, _DROP = 0.09, 0.02, 0.1  # m; of the hand above the table
_CLEARANCE, _SPEED, _ACCELERATION = 0.02, 0.35, 2.0  # m, of the limits, rad/s²
_RESTS = (1.0, 4.0, 0.5, 4.0)  # s; above the cube, at it, above it again, above the basket
_CLOSES, _OPENS = 2.5, 2.0  # s; after the arrival
# m; from the hand to the cube, while it is carried at most, at the end at least
_CARRIED, _LET_GO = 0.03, 0.05
_LAWS: dict[str, Law] = {GUIDED: GuidedProportional(gain=1.0, inverse=PRINTED_INVERSE)}


@dataclass(frozen=True, eq=False)
class Carried:
    """A run between the tables, and what it was to be.

    Attributes
    ----------
    plant, record, way
        As in any run.
    """

    plant: MobilePlant
    record: Record
    way: DriveThrough

    @property
    def cube(self) -> Array:
        """Where the cube was, shape (N, 3), m."""
        return self.record.readings["cube_position"].values

    @property
    def from_hand(self) -> Array:
        """Distance of the cube from the hand, shape (N,), m."""
        return np.linalg.norm(self.cube - algebra.translation(self.record.pose), axis=1)

    @property
    def while_carried(self) -> NDArray[np.bool_]:
        """Which samples are after the grip and before the drop, shape (N,)."""
        closed, opened = (event.time for event in _gripper(self.way).schedule)
        return (self.record.time > closed + 1.0) & (self.record.time < opened)

    @property
    def succeeded(self) -> bool:
        """Whether the cube was in the hand all the way and lies in the basket at the end, let go."""
        held = float(self.from_hand[self.while_carried].max()) < _CARRIED
        return held and bool(BASKET.holds(self.cube[-1])) and float(self.from_hand[-1]) > _LET_GO

    @property
    def room(self) -> float:
        """Least distance of the chassis from a table on the way, m."""
        robot = load_robot(ROBOT)
        assert isinstance(robot, WholeBody)
        drive = robot.parts[0]
        assert isinstance(drive, DifferentialDrive)
        assert drive.chassis is not None
        floor = _floor()
        return float(floor.clearance(self.record.q[:, :2]).min()) - drive.chassis.radius


def plan(robot: Robot, seed: int = 0) -> DriveThrough:
    """Return the way of the whole robot from cube to basket around both tables, both seen once by the camera.

    Parameters
    ----------
    robot
        Little John.
    seed
        Of the camera's noise.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> way = plan(dqc.load_robot(ROBOT))
    >>> len(way.arrivals)
    4
    """
    cube, basket = CAMERA.glance([[*CUBE.position[:2], CUBE.rpy[2]], [*BASKET.position[:2], 0.0]], seed)
    floor = _floor()
    limits = _SPEED, _ACCELERATION

    def drive(start: Array, pose: Array) -> DriveTo:
        return DriveTo.pose(robot, start, pose, *limits, floor=floor, clearance=_CLEARANCE)

    first = drive(np.array(START), _pose(cube, _ABOVE, cube[2]))
    above = np.asarray(first.goal)
    at_cube = _reached_by_the_arm(robot, above, np.array([*cube[:2], HEIGHT + _GRIP]))
    down, up = DriveTo(robot, above, at_cube, *limits), DriveTo(robot, at_cube, above, *limits)
    last = drive(above, _pose(basket, _DROP, math.pi))
    return DriveThrough([first, down, up, last], _RESTS)


def _floor() -> FloorMap:
    """Return what the tables take of the floor."""
    signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    return FloorMap(tuple(table.position[:2] + 0.5 * signs * table.size[:2] for table in TABLES), HEIGHT)


def carry(law: Law, seed: int = 0) -> Carried:
    """Let Little John carry the cube from table to table under a law, in physics, its base seen by the camera."""
    robot = load_robot(ROBOT)
    way = plan(robot, seed)
    plant = MobilePlant(
        location="camera",
        camera=CAMERA,
        link_mass=LINK_MASS,
        gripper=_gripper(way),
        world=WORLD,
    )
    limits = CommandLimits(velocity=isinstance(law, GuidedProportional))
    return Carried(plant, simulate(robot, way, law, plant, START, PERIOD, limits=limits, seed=seed), way)


def reproduce(conditions: Conditions) -> Reproduced:
    """Carry the cube along the plan."""
    progress = conditions.of("two-tables")
    done: dict[str, Carried] = {}
    for number, (label, law) in enumerate(_LAWS.items(), 1):
        done[label] = carry(law)
        if progress:
            progress(number, len(_LAWS))
    return Reproduced("silva2017/two-tables", [_table(done)], files=_files(done[GUIDED]))


def _table(done: dict[str, Carried]) -> Table:
    def row(label: str, run: Carried) -> list[tuple[Column, Cell]]:
        carried, record = run.while_carried, run.record
        held = float(run.from_hand[carried].max()) if carried.any() else math.nan
        beside = float(np.linalg.norm(run.cube[-1, :2] - BASKET.position[:2]))
        return [
            (Column("Law"), label),
            (Column("Carried, dropped into the basket"), "yes" if run.succeeded else "no"),
            (Column("Cube from the hand on the way, at most", "mm", ".3g"), 1e3 * held),
            (Column("Way of the cube", "m", ".3g"), _way(run.cube)),
            (Column("Way of the base", "m", ".3g"), _way(record.q[:, :2])),
            (Column("Chassis from the tables, at least", "mm", ".3g"), 1e3 * run.room),
            (Column("Cube beside the middle of the basket", "mm", ".3g"), 1e3 * beside),
            (
                Column("Hand from its desired pose, RMS", "mm", ".3g"),
                1e3 * float(np.sqrt(np.mean(record.position_error**2))),
            ),
            (Column("Time", "s", ".3g"), record.duration),
            (Column("Ended by"), record.stopped),
        ]

    title = (
        f"A cube from one table into a basket on another, {1e2 * HEIGHT:g} cm high, the base driving between them, in "
        "MuJoCo, the base seen by the camera, seed 0; S17 shows one floor: this is our extension of it"
    )
    return Table.of((row(*each) for each in done.items()), title)


def _way(places: Array) -> float:
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())


def _files(done: Carried) -> dict[str, Write]:
    """Return what draws the clip and the strip; nothing, and a warning, where there is no OpenGL."""
    end = float(done.record.time[-1])
    above, at_cube, lifted, over = done.way.arrivals.tolist()
    times = [0.5 * above, at_cube, lifted, 0.5 * (lifted + over), over, end]
    return if_drawable(filmed("two-tables", done.plant, done.record, times, speed=3))


def _gripper(way: DriveThrough) -> Gripper:
    _, at_cube, _, over = way.arrivals.tolist()
    schedule = [
        GripperEvent(time=at_cube + _CLOSES, closed=True),
        GripperEvent(time=over + _OPENS, closed=False),
    ]
    return Gripper(closes="y", schedule=schedule)


def _reached_by_the_arm(robot: Robot, q: Array, place: Array) -> Array:
    """Return the nearest configuration with the hand at a place (3,), m, without its base, which would swing it."""
    out, joints = q.copy(), len(q) - 3
    for _ in range(20):
        left = place - algebra.translation(robot.fkm(out))
        out[3:] += np.linalg.pinv(robot.translation_jacobian(out)[:, -joints:]) @ left
    return out


def _pose(place: Array, height: float, heading: float) -> Array:
    """Return the pose of a hand above the tables that looks along a heading and down."""
    about_z = [math.cos(heading / 2), 0, 0, math.sin(heading / 2), 0, 0, 0, 0]
    about_y = [math.cos(_DOWN / 2), 0, math.sin(_DOWN / 2), 0, 0, 0, 0, 0]
    turn = algebra.multiply(about_z, about_y)[:4]
    return algebra.pose(turn, [place[0], place[1], HEIGHT + height])
