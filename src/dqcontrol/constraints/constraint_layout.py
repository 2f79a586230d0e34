"""Arrays of compiled constraints: shapes, obstacles, rows, limits of joints; and the memory they work in."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import inline
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.constraints.active_set import program_size, scratch_size
from dqcontrol.constraints.levels import levels_size, room_for_levels
from dqcontrol.geometry.distance_kernels import FOUND, SHAPE
from dqcontrol.robots.kinematics.driving import DRIVE_COLUMNS
from dqcontrol.robots.kinematics.pose_task_kernels import COLUMNS

# kinds of rows
APART, INSIDE, AT_MOST, AT_LEAST, SIGHT = 0.0, 1.0, 2.0, 3.0, 4.0

# how an obstacle moves
STILL, STRAIGHT, BY_TABLE = 0.0, 1.0, 2.0

BALL = SHAPE  # of a shape's numbers: centre (3) and radius of a ball around it; none around a plane: infinite
BODY = SHAPE + 4

MOST_ROWS = 160  # of distances and angles in one program; of more the nearest
MOST_CUTS = 48  # rows that verification adds
ROUNDS = 12  # of it


class Head(NamedTuple):
    """Sizes, and numbers that belong to no row.

    Attributes
    ----------
    inputs, frames, screws, tree, shapes, obstacles, rows, names, moving, capacity, drives
        How many there are of each; of rows in one program.
    hull
        How many numbers the corners of the largest hull among obstacles have.
    program, solver, levels, sets
        How many numbers these parts of the scratch have.
    integrates
        1 where commands move a target that joints follow with a lag.
    points, late
        Of the way to that target, and how late it is, s: see `WayToTargets`.
    rate
        η, 1/s.
    recovery
        Largest speed at which a distance that is too small is asked to grow, m/s or rad/s.
    escape
        Speed at which the hand goes aside where constraints hold it, m/s; 0: it does not.
    angular, free
        l² and ρ² of the objective, m².
    """

    period: float
    inputs: int
    frames: int
    screws: int
    tree: int
    shapes: int
    obstacles: int
    hull: int
    rows: int
    names: int
    moving: int
    capacity: int
    drives: int
    program: int
    solver: int
    levels: int
    sets: int
    integrates: float
    points: int
    late: float
    rate: float
    recovery: float
    escape: float
    angular: float
    free: float


class Row(NamedTuple):
    """One distance or angle that is to be kept; lengths in m, angles in rad.

    Attributes
    ----------
    kind
        `APART`: shapes a and b of the world; `INSIDE`: ball a in round shape b; `AT_MOST`, `AT_LEAST`: an angle
        between an axis of frame a and a direction; `SIGHT`: between an axis of frame a and the way to obstacle b.
    a, b
        Numbers of shapes, of robot shapes first; or of a frame.
    kept
        What is kept: the distance asked for, and what samples must keep beyond it; of angles the room.
    level
        Its priority, 0 is the highest.
    name
        Number of its name.
    speed
        At which b may come nearer by itself, m/s.
    bend
        How much more the value curves than points of the robot do, over the square of their speed: 1/m, none of angles.
    limit
        Of an angle.
    axis, other
        Axis in the frame; direction in the world, or place of the camera in the frame.
    """

    kind: float
    a: float
    b: float
    kept: float
    level: float
    name: float
    speed: float
    bend: float
    limit: float
    axis: Annotated[Array, 3]
    other: Annotated[Array, 3]


head: MemoryLayout[Head] = MemoryLayout(Head)
row_of: MemoryLayout[Row] = MemoryLayout(Row)
HEAD, ROW = head.size(), row_of.size()
# of a shape's numbers: when it is there, s; before and afterwards it is out of the way
FROM, UNTIL = BODY, BODY + 1
THERE = BODY + 2
# of an obstacle's numbers: how it moves, place in the table of motions, its velocity
MOTION, PLACE, VELOCITY = THERE, THERE + 1, THERE + 2
OBSTACLE = THERE + 5


class Screw(NamedTuple):
    """What moves frames: a joint.

    Attributes
    ----------
    above
        The screw that carries it, of a lower number; −1 for none.
    input
        What moves it, −1 for none.
    scale
        How far it moves for one unit of that.
    heading
        Coordinate φ of a drive that moves along its heading, −1 of others.
    """

    above: float
    input: float
    scale: float
    heading: float


screw_of: MemoryLayout[Screw] = MemoryLayout(Screw)
SCREW = screw_of.size()


class InputLimits(NamedTuple):
    """Limits of each input, infinite where it has none."""

    lower: Annotated[Array, "m"]
    upper: Annotated[Array, "m"]
    velocity: Annotated[Array, "m"]
    acceleration: Annotated[Array, "m"]


class Way(NamedTuple):
    """The way to targets.

    Attributes
    ----------
    times
        Of each coordinate: time constant of its lag, s.
    shares, meets, bent
        See `WayToTargets`.
    coordinate
        The one that each input moves.
    """

    times: Annotated[Array, "n"]
    shares: Annotated[Array, "settings.points", "n"]
    meets: Annotated[Array, "settings.points", 2]
    bent: Annotated[Array, "n"]
    coordinate: Annotated[Array, "m"]


class KeptRows(NamedTuple):
    """What commands keep beside their limits.

    Attributes
    ----------
    rows
        See `Row`.
    levers
        Of each row: how fast it can change per unit of each input, not growing from the first input on.
    drives
        As the robot has them.
    rims
        Speed limit of each drive's rim.
    """

    rows: Annotated[Array, "settings.rows", ROW]
    levers: Annotated[Array, "settings.rows", "m"]
    drives: Annotated[Array, "settings.drives", DRIVE_COLUMNS]
    rims: Annotated[Array, "settings.drives"]


class RobotScene(NamedTuple):
    """Shapes, what moves them, and what stands around them.

    Attributes
    ----------
    carriers
        Of each frame, the base's first, the last screw that moves it; −1 for none.
    screws
        A `Screw` each.
    tree
        What of a tree all frames are found from; no rows of a chain, whose screws are the columns of its Jacobian.
    bodies
        Frame of each shape of the robot, and its numbers in that frame.
    obstacles
        Numbers of each, where it is at the start; of hulls the corners last.
    table
        Shift and velocity (6) of each obstacle that moves by it, one row a sample.
    """

    carriers: Annotated[Array, "settings.frames + 1"]
    screws: Annotated[Array, "settings.screws", SCREW]
    tree: Annotated[Array, "settings.tree", COLUMNS]
    bodies: Annotated[Array, "settings.shapes", THERE + 1]
    obstacles: Annotated[Array, "settings.obstacles", f"settings.hull + {OBSTACLE}"]
    table: Annotated[Array, ..., "6 * settings.moving + 1"]


limits_of: MemoryLayout[InputLimits] = MemoryLayout(InputLimits, "m")
way_of: MemoryLayout[Way] = MemoryLayout(Way, "n", "m", "settings")
kept_of: MemoryLayout[KeptRows] = MemoryLayout(KeptRows, "m", "settings")
scene_of: MemoryLayout[RobotScene] = MemoryLayout(RobotScene, "settings")


class ConstraintParameters(NamedTuple):
    """What is given.

    Attributes
    ----------
    head
        See `Head`.
    limits, way, kept, scene
        See `InputLimits`, `Way`, `KeptRows`, `RobotScene`.
    """

    head: Annotated[Array, HEAD]
    limits: Annotated[Array, limits_of.sized("m")]
    way: Annotated[Array, way_of.sized("n", "m", "settings")]
    kept: Annotated[Array, kept_of.sized("m", "settings")]
    scene: Annotated[Array, ...]


class ConstraintMemory(NamedTuple):
    """What is kept from sample to sample, behind the law's state.

    Attributes
    ----------
    started
        1 after the first sample.
    target
        Where commands have led, if they move a target.
    joint
        Where the joints are by what is known of their lag, but for the delay.
    escape
        For how long the hand has been held, for how long it still goes aside, s, and how often it has.
    aside
        Where to; 0 while the joints go to another posture.
    sent
        The last command that left.
    """

    started: Annotated[Array, 1]
    target: Annotated[Array, "n"]
    joint: Annotated[Array, "n"]
    escape: Annotated[Array, 3]
    aside: Annotated[Array, 3]
    sent: Annotated[Array, "m"]


NUMBERS = 6  # of a report that belong to no name


class Report(NamedTuple):
    """What happened in the last sample.

    Attributes
    ----------
    numbers
        How many rows and ends of joints' ranges pressed, how often the program was solved, share of the command that
        was left by scaling, largest excess of an acceleration limit (as a share), speed of the hand as the law asks and
        as it leaves, both as |[lω ; v]|, m/s.
    least, pressure, slack
        Of each name: least distance or angle, sum of its multipliers, and how much it gave way (m/s or rad/s).
    """

    numbers: Annotated[Array, NUMBERS]
    least: Annotated[Array, "names"]
    pressure: Annotated[Array, "names"]
    slack: Annotated[Array, "names"]


report_of: MemoryLayout[Report] = MemoryLayout(Report, "names")


class InputBox(NamedTuple):
    """What each input may be, with its limit of acceleration and without."""

    low: Annotated[Array, "m"]
    high: Annotated[Array, "m"]
    rough_low: Annotated[Array, "m"]
    rough_high: Annotated[Array, "m"]


class Placed(NamedTuple):
    """Where everything of a `RobotScene` is.

    Attributes
    ----------
    frames, places
        Of all joints, as dual quaternions, and as rotation matrix and position (12) from the base's on.
    screws, first_screws
        What moves frames, in the world; and those at the configuration where rows are made.
    world
        All shapes.
    drift
        Velocities of obstacles.
    found
        Of one pair.
    buffer
        Kinematics of the chain.
    """

    frames: Annotated[Array, "8 * (settings.frames + 1)"]
    places: Annotated[Array, "settings.frames + 1", 12]
    screws: Annotated[Array, 6, "settings.screws"]
    first_screws: Annotated[Array, 6, "settings.screws"]
    world: Annotated[Array, "settings.shapes + settings.obstacles", f"settings.hull + {OBSTACLE}"]
    drift: Annotated[Array, "settings.obstacles", 3]
    found: Annotated[Array, FOUND]
    buffer: Annotated[Array, "8 + 14 * m"]


class Path(NamedTuple):
    """Where a `Way` leads.

    Attributes
    ----------
    start, trial
        Configuration where rows are made, and another one that is looked at.
    joint
        Where the joints are.
    step, reach, off
        Of each input, from the last point of the way to this one: what it has to make, what it has to make at most with
        the next command, and how much of that off the line between both.
    """

    start: Annotated[Array, "n"]
    trial: Annotated[Array, "n"]
    joint: Annotated[Array, "n"]
    step: Annotated[Array, "m"]
    reach: Annotated[Array, "m"]
    off: Annotated[Array, "m"]


class Lines(NamedTuple):
    """Rows of the program, those that verification adds at the end.

    Attributes
    ----------
    gradients, bounds, owners, points, required, value, press
        Gradient of the distance, bound, which row of the constraints, at which point of the way, what it has to be
        after this period, what it is, multiplier.
    alone
        How fast the value of each of them changes by itself.
    nearest, dips
        Of each row of the constraints: least value on the way, and how much less it may be between points of it.
    line
        How the inputs change one distance.
    """

    gradients: Annotated[Array, "settings.capacity", "m"]
    bounds: Annotated[Array, "settings.capacity"]
    owners: Annotated[Array, "settings.capacity"]
    points: Annotated[Array, "settings.capacity"]
    required: Annotated[Array, "settings.capacity"]
    value: Annotated[Array, "settings.capacity"]
    press: Annotated[Array, "settings.capacity"]
    alone: Annotated[Array, "settings.capacity"]
    nearest: Annotated[Array, "settings.rows"]
    dips: Annotated[Array, "settings.rows"]
    line: Annotated[Array, "m"]


class Objective(NamedTuple):
    """What the command is to be near to.

    Attributes
    ----------
    wish, best
        What the law asks, and the best of several answers.
    hand, jacobian
        Jacobian of the hand's [ω ; ṗ], and of twists, at the configuration.
    hessian
        H.
    """

    wish: Annotated[Array, "m"]
    best: Annotated[Array, "m"]
    hand: Annotated[Array, 6, "m"]
    jacobian: Annotated[Array, 6, "m"]
    hessian: Annotated[Array, "m", "m"]


box_of: MemoryLayout[InputBox] = MemoryLayout(InputBox, "m")
placed_of: MemoryLayout[Placed] = MemoryLayout(Placed, "m", "settings")
path_of: MemoryLayout[Path] = MemoryLayout(Path, "n", "m")
lines_of: MemoryLayout[Lines] = MemoryLayout(Lines, "m", "settings")
objective_of: MemoryLayout[Objective] = MemoryLayout(Objective, "m")


class ConstraintWork(NamedTuple):
    """Scratch.

    Attributes
    ----------
    report
        See `Report`.
    box, placed, path, lines, objective
        See `InputBox`, `Placed`, `Path`, `Lines`, `Objective`.
    program, solver, levels, sets
        Memory of the solvers.
    """

    report: Annotated[Array, report_of.sized("settings.names")]
    box: Annotated[Array, box_of.sized("m")]
    placed: Annotated[Array, placed_of.sized("m", "settings")]
    path: Annotated[Array, path_of.sized("n", "m")]
    lines: Annotated[Array, lines_of.sized("m", "settings")]
    objective: Annotated[Array, objective_of.sized("m")]
    program: Annotated[Array, "settings.program"]
    solver: Annotated[Array, "settings.solver"]
    levels: Annotated[Array, "settings.levels"]
    sets: Annotated[Array, "settings.sets"]


parameters_of: MemoryLayout[ConstraintParameters] = MemoryLayout(ConstraintParameters, "n", "m", "settings")
memory_of: MemoryLayout[ConstraintMemory] = MemoryLayout(ConstraintMemory, "n", "m")
work_of: MemoryLayout[ConstraintWork] = MemoryLayout(ConstraintWork, "n", "m", "settings")


def solver_sizes(m: int, capacity: int, drives: int) -> dict[str, int]:
    """Return how many numbers programs of so many rows, their solvers, and their sets of active constraints need."""
    rows = capacity + 2 * m + 4 * drives
    return {
        "program": program_size(m, rows),
        "solver": scratch_size(m, rows, room_for_soft(m)),
        "levels": levels_size(m, rows),
        "sets": room_for_levels(m, rows) + 2 + rows,
    }


@inline
def room_for_soft(m: int) -> int:
    """Return how many constraints can be active: independent ones, and soft limits of acceleration."""
    return 3 * m + 2
