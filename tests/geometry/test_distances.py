"""Signed distances against Coal, brute force, paper and finite differences."""

import itertools

import numpy as np
import pytest
from shape_samples import KINDS, coal_distance, random_pose, random_shape

import dqcontrol as dqc
from dqcontrol import algebra, geometry
from dqcontrol.geometry import distance_kernels

PAIRS = [
    pair
    for pair in itertools.product(KINDS, KINDS)
    if pair != ("plane", "plane") and not ("plane" in pair and {"line", "infinite cylinder"} & set(pair))
]


def check_points(found, tolerance=1e-9):
    assert abs(np.linalg.norm(found.normal) - 1) < 1e-12
    assert np.abs(found.on_a - found.on_b - found.distance * found.normal).max() < tolerance


@pytest.mark.parametrize(
    "kinds", [("capsule", "capsule"), ("sphere", "capsule"), ("sphere", "box")], ids="-".join
)
def test_coal_measures_the_same(kinds):
    coal = pytest.importorskip("coal", reason="Coal is the reference")
    rng = np.random.default_rng(1)
    for _ in range(100):
        a, b = (random_shape(kind, rng) for kind in kinds)
        found = geometry.distance(a, b)
        check_points(found)
        assert abs(found.distance - coal_distance(coal, a, b)) < 1e-9


@pytest.mark.slow
def test_a_hundred_thousand_pairs_of_capsules_against_coal():
    coal = pytest.importorskip("coal", reason="Coal is the reference")
    rng, count = np.random.default_rng(2), 100_000
    shapes = [random_shape("capsule", rng) for _ in range(2 * count)]
    rows = np.array([shape.row for shape in shapes])
    out = np.empty((count, distance_kernels.FOUND))
    assert distance_kernels.distances(rows[:count], rows[count:], out) == count
    theirs = [coal_distance(coal, a, b) for a, b in zip(shapes[:count], shapes[count:], strict=True)]
    assert np.abs(out[:, 0] - theirs).max() < 1e-9


@pytest.mark.parametrize("other", ["plane", "capsule", "box"])
def test_boxes_against_coal(other):
    """Coal's iterations stop at 1e-6."""
    coal = pytest.importorskip("coal", reason="Coal is the reference")
    rng = np.random.default_rng(3)
    for _ in range(100):
        a, b = random_shape("box", rng), random_shape(other, rng)
        found = geometry.distance(a, b)
        check_points(found)
        theirs = coal_distance(coal, a, b)
        if theirs > 0:
            assert abs(found.distance - theirs) < 2e-5
        else:  # EPA finds a depth that is at least the least one
            assert theirs - 2e-5 < found.distance < 1e-12


def support(shape, directions):
    """Return how far a cylinder, capsule or box reaches along directions (N, 3)."""
    if isinstance(shape, geometry.Hull):
        return (directions @ shape.corners.T).max(axis=1)
    if isinstance(shape, geometry.Box):
        half, centre, turn = shape.row[1:4], shape.row[4:7], shape.row[7:].reshape(3, 3)
        return directions @ centre + np.abs(directions @ turn) @ half
    ends = np.maximum(directions @ shape.start, directions @ shape.end)
    if isinstance(shape, geometry.Capsule):
        return ends + shape.radius
    axis = shape.end - shape.start
    return ends + shape.radius * np.sqrt(np.maximum(1 - (directions @ axis) ** 2 / (axis @ axis), 0))


@pytest.mark.parametrize(
    ("kind", "other"),
    [
        *(("cylinder", other) for other in ("sphere", "capsule", "plane", "box", "cylinder")),
        *(("hull", other) for other in ("sphere", "capsule", "plane", "box", "cylinder", "hull")),
    ],
)
def test_cylinders_and_hulls_against_coal(kind, other):
    """Apart they are as far as Coal says; in each other no direction separates them by less, and theirs does."""
    coal = pytest.importorskip("coal", reason="Coal is the reference")
    rng = np.random.default_rng(11)
    directions = rng.normal(size=(2000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    apart = inside = 0
    for _ in range(300):
        a, b = random_shape(kind, rng), random_shape(other, rng)
        found, back = geometry.distance(a, b), geometry.distance(b, a)
        check_points(found)
        assert abs(found.distance - back.distance) < 1e-9
        assert abs(geometry.distance(moved_apart(a, found), b).distance) < 1e-6
        if found.distance > 0:
            apart += 1
            theirs = coal_distance(coal, a, b)
            assert abs(found.distance - theirs) < 1e-6
        elif other in ("capsule", "box", "cylinder", "hull"):
            inside += 1
            depths = support(a, directions) + support(b, -directions)
            assert -found.distance <= depths.min() + 1e-9
            own = support(a, -found.normal[None]) + support(b, found.normal[None])
            assert abs(own[0] + found.distance) < 1e-8
    assert apart > 50
    assert inside > 10 or other in ("sphere", "plane")


def test_a_ball_and_a_cylinder_on_paper():
    rng = np.random.default_rng(12)
    for _ in range(500):
        can, ball = random_shape("cylinder", rng), random_shape("sphere", rng)
        axis = can.end - can.start
        length = np.linalg.norm(axis)
        along = (ball.center - can.start) @ axis / length
        across = np.linalg.norm(ball.center - can.start - along * axis / length)
        over, beside = abs(along - length / 2) - length / 2, across - can.radius
        expected = max(over, beside) if max(over, beside) < 0 else np.hypot(max(over, 0), max(beside, 0))
        assert abs(geometry.distance(can, ball).distance - (expected - ball.radius)) < 1e-9


@pytest.mark.parametrize("solid", ["cylinder", "hull"])
@pytest.mark.parametrize("kind", ["line", "infinite cylinder", "point"])
def test_a_cylinder_or_hull_and_what_has_no_end(kind, solid):
    rng = np.random.default_rng(13)
    for _ in range(50):
        can, other = random_shape(solid, rng), random_shape(kind, rng)
        found = geometry.distance(can, other)
        if kind == "point":
            long = geometry.Sphere(other.position, 0.0)
        else:
            radius = 0.0 if kind == "line" else other.radius
            long = geometry.Capsule(
                other.point - 9 * other.direction, other.point + 9 * other.direction, radius
            )
        assert abs(found.distance - geometry.distance(can, long).distance) < 1e-8


def moved_apart(a, found):
    """Shift a along the normal until it just touches."""
    shift = -found.distance * found.normal
    return a.moved(algebra.pose([1, 0, 0, 0], shift))


@pytest.mark.parametrize("kinds", PAIRS, ids="-".join)
def test_each_pair(kinds):
    """Order does not matter; a shift by the distance makes them touch; nothing nearer separates."""
    rng = np.random.default_rng(4)
    for _ in range(10):
        a, b = (random_shape(kind, rng, 0.3) for kind in kinds)
        found, back = geometry.distance(a, b), geometry.distance(b, a)
        check_points(found)
        assert abs(found.distance - back.distance) < 1e-12
        if abs(found.distance) > 1e-6:
            assert np.abs(found.normal + back.normal).max() < 1e-6
        assert abs(geometry.distance(moved_apart(a, found), b).distance) < 1e-9
        pose = random_pose(rng)
        carried = geometry.distance(a.moved(pose), b.moved(pose))
        assert abs(carried.distance - found.distance) < 1e-10
        assert np.abs(carried.normal - algebra.matrix_from_pose(pose)[:3, :3] @ found.normal).max() < 1e-6
        if found.distance < 0:
            for direction in rng.normal(size=(5, 3)):
                shift = 0.99 * found.distance * direction / np.linalg.norm(direction)
                shifted = a.moved(algebra.pose([1, 0, 0, 0], shift))
                assert geometry.distance(shifted, b).distance < 0


@pytest.mark.parametrize("kinds", [pair for pair in PAIRS if pair <= pair[::-1]], ids="-".join)
def test_rates_against_finite_differences(kinds):
    """Of random motions of both; where five samples disagree about the curvature there is a kink."""
    rng, tried = np.random.default_rng(5), 0
    step = 1e-5
    for _ in range(16):
        a, b = (random_shape(kind, rng) for kind in kinds)
        twist_a, twist_b = rng.normal(size=(2, 6))

        def at(time, a=a, b=b, twists=(twist_a, twist_b)):
            poses = []
            for twist in twists:
                turn = np.linalg.norm(twist[:3])
                rotation = algebra.rotation_from_axis_angle(twist[:3] / turn, turn * time)
                poses.append(algebra.pose(rotation, time * twist[3:]))
            return geometry.distance(a.moved(poses[0]), b.moved(poses[1])).distance

        samples = np.array([at(k * step) for k in (-2, -1, 0, 1, 2)])
        second = np.diff(samples, 2)
        if np.ptp(second) > 0.02 * step**2:
            continue
        tried += 1
        slope = (samples[0] - 8 * samples[1] + 8 * samples[3] - samples[4]) / (12 * step)
        found = geometry.distance(a, b)
        assert abs(geometry.distance_rate(found, twist_a, twist_b) - slope) < 1e-6
    assert tried > 5


@pytest.mark.parametrize("robot", ["panda", "ur5"])
def test_rows_of_links_against_finite_differences(robot):
    arm = dqc.load_robot(robot)
    rng = np.random.default_rng(6)
    ball = geometry.Sphere([0.4, 0.2, 0.5], 0.1)
    lower = arm.up_to(3)
    for _ in range(10):
        q = rng.uniform(-1.5, 1.5, arm.configuration_size)
        link, wrist = random_shape("capsule", rng, 0.1), random_shape("capsule", rng, 0.1)

        def shapes(q, link=link, wrist=wrist):
            return link.moved(lower.fkm(q[:3])), wrist.moved(arm.fkm(q))

        low, high = shapes(q)
        j_low = np.zeros((6, len(q)))
        j_low[:, :3], j_high = lower.twist_jacobian(q[:3]), arm.twist_jacobian(q)
        pairs = [
            (low, high, geometry.distance_jacobian(geometry.distance(low, high), j_low, j_high)),
            (high, ball, geometry.distance_jacobian(geometry.distance(high, ball), j_high)),
            (ball, low, geometry.distance_jacobian(geometry.distance(ball, low), None, j_low)),
        ]
        for number, (_, _, row) in enumerate(pairs):
            numeric = []
            for i in range(len(q)):
                values = []
                for sign in (-1, 1):
                    moved = q.copy()
                    moved[i] += sign * 1e-5
                    low, high = shapes(moved)
                    a, b = ((low, high), (high, ball), (ball, low))[number]
                    values.append(geometry.distance(a, b).distance)
                numeric.append((values[1] - values[0]) / 2e-5)
            assert np.abs(row - numeric).max() < 1e-6


def test_joints_that_move_both_bodies_drop_out():
    arm = dqc.load_robot("panda")
    q = np.array([0.1, 0.2, 0.3, -1.0, 0.2, 1.0, 0.1])
    a = geometry.Sphere([0.1, 0, 0], 0.05).moved(arm.up_to(3).fkm(q[:3]))
    b = geometry.Sphere([0.1, 0, 0], 0.05).moved(arm.fkm(q))
    jacobian = np.zeros((6, 7))
    jacobian[:, :3] = arm.up_to(3).twist_jacobian(q[:3])
    row = geometry.distance_jacobian(geometry.distance(a, b), jacobian, arm.twist_jacobian(q))
    assert np.abs(row[:3]).max() < 1e-15
    assert np.abs(row[3:6]).max() > 1e-3


def brute_force(a, b, n=400):
    """Least distance of the cores of two capsules on a grid, refined three times."""
    least, s0, s1, t0, t1 = np.inf, 0.0, 1.0, 0.0, 1.0
    for _ in range(4):
        s, t = np.meshgrid(np.linspace(s0, s1, n), np.linspace(t0, t1, n), indexing="ij")
        difference = (a.start - b.start) + s[..., None] * (a.end - a.start) - t[..., None] * (b.end - b.start)
        gaps = np.linalg.norm(difference, axis=-1)
        i, j = np.unravel_index(int(gaps.argmin()), gaps.shape)
        least, ds, period = gaps[i, j], (s1 - s0) / n, (t1 - t0) / n
        s0, s1 = max(0, s[i, j] - 2 * ds), min(1, s[i, j] + 2 * ds)
        t0, t1 = max(0, t[i, j] - 2 * period), min(1, t[i, j] + 2 * period)
    return least - a.radius - b.radius


def test_nearly_parallel_capsules_against_brute_force():
    rng = np.random.default_rng(7)
    for angle in (0.0, 1e-14, 1e-10, 1e-7, 1e-5, 1e-3):
        a = geometry.Capsule([0, 0, 0], [1, 0, 0], 0.1)
        start = np.array([rng.uniform(-1.5, 1), 0.3, rng.uniform(-0.2, 0.2)])
        b = geometry.Capsule(start, start + np.array([np.cos(angle), 0, np.sin(angle)]), 0.05)
        found = geometry.distance(a, b)
        check_points(found)
        assert abs(found.distance - brute_force(a, b)) < 1e-9


def test_degenerate_pairs_of_round_shapes():
    origin, x, y = np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    sphere, ball = geometry.Sphere(origin, 0.2), geometry.Sphere(origin, 0.1)
    concentric = geometry.distance(sphere, ball)
    assert concentric.distance == pytest.approx(-0.3, abs=1e-15)
    check_points(concentric)
    touching = geometry.distance(sphere, geometry.Sphere([0.3, 0, 0], 0.1))
    assert touching.distance == pytest.approx(0, abs=1e-15)
    assert touching.normal.tolist() == [-1, 0, 0]
    crossing = geometry.distance(geometry.Capsule(-x, x, 0.1), geometry.Capsule(-y, y, 0.1))
    assert crossing.distance == pytest.approx(-0.2, abs=1e-15)
    assert np.abs(crossing.normal).tolist() == [0, 0, 1]
    along = geometry.distance(geometry.Capsule(-x, x, 0.1), geometry.Capsule(0 * x, 2 * x, 0.1))
    assert along.distance == pytest.approx(-0.2, abs=1e-15)
    assert abs(along.normal[0]) < 1e-12
    zero = geometry.distance(geometry.Capsule(x, x, 0.1), geometry.Capsule(y, y, 0.1))
    assert zero.distance == geometry.distance(geometry.Sphere(x, 0.1), geometry.Sphere(y, 0.1)).distance
    parallel = geometry.distance(geometry.Line(origin, x), geometry.Line(y, -x))
    assert parallel.distance == pytest.approx(1)
    inside = geometry.distance(ball, geometry.Box(algebra.pose([1, 0, 0, 0], origin), [1, 2, 3]))
    assert inside.distance == pytest.approx(-0.6)
    for found in (crossing, along, zero, parallel, inside):
        check_points(found)


def test_primitives_move_as_dual_quaternions():
    """Line: x L x*. Plane: x♯ Π x*, x♯ = P − εD; with x in place of x♯ the offset is wrong."""
    rng = np.random.default_rng(8)
    for _ in range(20):
        x = random_pose(rng)
        sharp = np.concatenate([x[:4], -x[4:]])
        line, plane = random_shape("line", rng), random_shape("plane", rng)
        for shape, left in ((line, x), (plane, sharp)):
            expected = algebra.multiply(
                algebra.multiply(left, np.array(shape.dual_quaternion.vec8)), algebra.conjugate(x)
            )
            assert np.abs(np.array(shape.moved(x).dual_quaternion.vec8) - expected).max() < 1e-12


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: geometry.Sphere([0, 0], 1), "center"),
        (lambda: geometry.Sphere([0, 0, 0], -1), "radius: must be ≥ 0"),
        (lambda: geometry.Capsule([0, 0, 0], [0, 0, np.nan], 1), "end: must be finite"),
        (lambda: geometry.Plane([0, 0, 0], 1), "normal: must not be zero"),
        (lambda: geometry.Box([1, 0, 0, 0, 0, 0, 0, 0], [1, 0, 1]), "size: must be > 0"),
        (lambda: geometry.Box([2, 0, 0, 0, 0, 0, 0, 0], [1, 1, 1]), "pose"),
        (lambda: geometry.distance(geometry.Plane([0, 0, 1], 0), geometry.Plane([0, 0, 1], 1)), "meet"),
        (
            lambda: geometry.distance(geometry.Line([0, 0, 1], [0, 0, 1]), geometry.Plane([0, 0, 1], 0)),
            "meet",
        ),
        (lambda: geometry.distance(geometry.Point([0, 0, 0]), [0, 0, 1]), "b: expected a shape"),
        (lambda: geometry.Point([0, 0, 0]).moved([1, 2, 3]), "pose"),
    ],
)
def test_bad_input_is_named(make, words):
    with pytest.raises(dqc.Error, match=words):
        make()
