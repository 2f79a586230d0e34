"""References of every kind for the tests, and finite differences of their poses."""

import functools

import numpy as np

from dqcontrol import algebra, references as r

START = algebra.pose(
    np.array([0.5, 0.1, -0.7, 0.5]) / np.linalg.norm([0.5, 0.1, -0.7, 0.5]), [0.4, -0.2, 0.6]
)
TILTED = [[1.0, 2.0, 0.5], [-2.0, 1.0, 0.0]]
STROKES = [
    r.Rest(0.4),
    r.StraightStroke(0.1, 0.0, speed=0.05),
    r.Arc(0.1, 0.1, 0.1, 0.05, clockwise=False, speed=0.05),  # goes on along the tangent
    r.Arc(0.1, 0.1, 0.06, 0.1, clockwise=True, speed=0.08),  # full circle
    r.Rest(0.3),
    r.StraightStroke(0.02, 0.17, speed=0.1),
    r.StraightStroke(0.0, 0.0, speed=0.07),
]
QUARTER = algebra.pose([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0], [0.1, 0.0, -0.2])


def _random_poses(count):
    random = np.random.default_rng(3)
    rotations = random.normal(size=(count, 4))
    rotations /= np.linalg.norm(rotations, axis=1, keepdims=True)
    return algebra.pose(rotations, random.normal(size=(count, 3)))


def _near_poses(count):
    """Return poses of which two in succession are 60 to 100 degrees apart."""
    random = np.random.default_rng(8)
    axes = random.normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    poses = algebra.pose([1.0, 0.0, 0.0, 0.0], 0.3 * random.normal(size=(count, 3)))
    turns = algebra.rotation_from_axis_angle(axes, random.uniform(1.0, 1.7, count))
    for i in range(1, count):
        whole = np.zeros((2, 8))
        whole[:, :4] = turns[i], poses[i - 1, :4]
        rotation = algebra.multiply(whole[0], whole[1])[:4]
        poses[i] = algebra.pose(rotation, algebra.translation(poses[i]))
    return poses


NAMES = (  # known without making them: tests have parameters before they run
    *("set-point", "circle", "counterclockwise", "spiral", "square"),
    *("drawing", "following", "points", "transformed", "sequence"),
    *("repeat", "rounds", "start ramp", "corner stops", "stops at points"),
    *(
        "via points",
        "jerk-limited square",
        "jerk-limited sequence",
        "jerk-limited follower",
        "jerk-limited points",
    ),
    *("jerk-limited via points", "jerk-limited turns", "straight", "search"),
)


@functools.cache
def references():
    circle = r.Circle(START, radius=0.07, duration=9.0, plane=TILTED, turns=2.0)
    square = r.Square(START, side=0.1, duration=8.0, shares=[5, 3, 5, 3], plane="yz", clockwise=False)
    drawing = r.Drawing(START, STROKES, plane=TILTED)
    follower = r.Drawing(START, STROKES, plane=TILTED, orientation="path", turn_speed=2.0, repeat=2)
    round_ = r.Drawing(START, [r.Arc(0, 0, 0, 0.1, clockwise=False, speed=0.2)], orientation="path")
    points = r.Points([2.0, 3.0, 5.0, 5.5, 7.0], _random_poses(5))
    via = r.ViaPoints([2.0, 3.0, 5.0, 5.5, 7.0], _near_poses(5))
    limits = {"velocity": 0.1, "acceleration": 0.3, "jerk": 2.0}
    angular = {"angular_velocity": 0.8, "angular_acceleration": 3.0, "angular_jerk": 20.0}
    made = {
        "set-point": r.SetPoint(START, duration=3.0),
        "circle": circle,
        "counterclockwise": r.Circle(START, radius=0.07, duration=9.0, clockwise=False, turns=0.3),
        "spiral": r.Spiral(START, radius=0.05, length=-0.1, axis=[1, 1, 3], duration=12.0),
        "square": square,
        "drawing": drawing,
        "following": follower,
        "points": points,
        "transformed": r.Transformed(follower, by=QUARTER),
        "sequence": r.Sequence([r.SetPoint(START, duration=1.0), drawing, circle, square]),
        "repeat": r.Repeat(square, 3),
        "rounds": r.Repeat(round_, 3),
        "start ramp": r.StartRamp(follower, seconds=3.7),
        "corner stops": r.CornerStops(r.Transformed(follower, by=QUARTER), seconds=0.4),
        "stops at points": r.CornerStops(points, seconds=0.6),
        "via points": via,
        "jerk-limited square": r.JerkLimited(square, **limits),
        "jerk-limited sequence": r.JerkLimited(
            r.Sequence([r.SetPoint(START, duration=1.0), drawing, circle, square]), **limits
        ),
        "jerk-limited follower": r.JerkLimited(r.Transformed(follower, by=QUARTER), **limits, **angular),
        "jerk-limited points": r.JerkLimited(points, **limits, **angular),
        "jerk-limited via points": r.JerkLimited(via, **limits),
        "jerk-limited turns": r.JerkLimited(via, **limits, **angular),
        "straight": r.Straight(START, way=(0.1, -0.2, 0.05), duration=3.0),
        "search": r.Search(START, radius=0.1, pitch=0.04, speed=0.15, plane=TILTED),
    }
    assert tuple(made) == NAMES
    return made


def times_inside(reference, count=400, margin=1e-3):
    """Return random times at least a margin away from the start, the end and every corner."""
    end = reference.duration
    times = np.random.default_rng(5).uniform(margin, end - margin, size=count)
    away = np.abs(times[:, None] - reference.corners[None, :]).min(axis=1, initial=np.inf)
    return times[away > margin]


def differentiated_twist(reference, times, step):
    """Return vec6(2ẋx*) with ẋ by central differences."""
    before, now, after = (reference.samples(times + h)[:, :8] for h in (-step, 0.0, step))
    twist = algebra.multiply((after - before) / step, algebra.conjugate(now))
    return twist[:, [1, 2, 3, 5, 6, 7]]
