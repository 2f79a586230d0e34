"""Certified edges against samples, against Coal, and against distances that are known."""

import numpy as np
import pytest
from obstacles import around, sphere
from planning_scenes import ROBOTS, least_sampled, links_of, load, random_constraints, random_edges, things_of
from shape_samples import coal_distance

import dqcontrol as dqc
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.experiments.contacts import Contacts
from dqcontrol.planning import CertifiedEdges
from dqcontrol.planning.standing_world import standing


def check_edges(name, scenes, count, samples):
    robot, rng = load(name), np.random.default_rng([7, len(name)])
    certified = undecided = 0
    for _ in range(scenes):
        edges = CertifiedEdges(robot, random_constraints(rng, robot))
        a, b = random_edges(rng, robot, count)
        found, sampled = edges.clear(a, b), least_sampled(edges, a, b, samples)
        assert sampled[found.certified].min(initial=0.0) >= 0.0
        certified += found.certified.sum()
        undecided += (~found.certified & (sampled >= 0.0)).sum()
    assert certified > 0.05 * scenes * count
    assert undecided <= 2 + 1e-3 * scenes * count  # an edge that comes as near as what is asked


@pytest.mark.parametrize("name", ROBOTS)
def test_no_sample_of_a_certified_edge_is_too_near(name):
    check_edges(name, scenes=4, count=50, samples=200)


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_a_hundred_thousand_edges_sampled_a_thousand_times(name):
    check_edges(name, scenes=100, count=200, samples=1000)


@pytest.mark.parametrize("count", [8, pytest.param(90, marks=pytest.mark.slow)])  # Coal takes 2 s for each
def test_coal_measures_no_less_along_certified_edges(count):
    coal = pytest.importorskip("coal", reason="Coal is the reference")
    robot, rng, measured = load("panda"), np.random.default_rng(3), 0
    while measured < count:
        given = random_constraints(rng, robot, self_collision=False)
        a, b = random_edges(rng, robot, 30)
        certified = CertifiedEdges(robot, given).clear(a, b).certified
        for first, last in zip(a[certified][:count], b[certified][:count], strict=True):
            measured += 1
            distances = [
                coal_distance(coal, link.shape.moved(frames[link.frame - 1]), thing)
                for q in first + np.linspace(0, 1, 7)[:, None] * (last - first)
                for frames in [robot.frames(q)]
                for link in links_of(robot)
                if link.frame > 0
                for name, thing in things_of(given)
                if not (name == "table" and link.frame == 1)  # turns on it
            ]
            assert min(distances) >= given.margin - 1e-6  # Coal's iterations stop there


def test_the_least_room_is_found_to_a_tenth_of_a_millimetre():
    robot, rng = load("panda"), np.random.default_rng(5)
    edges = CertifiedEdges(robot, random_constraints(rng, robot))
    a, b = random_edges(rng, robot, 40)
    sampled = least_sampled(edges, a, b, 2000)
    for k in range(len(a)):
        room = edges.least_room(np.hstack([a[k], 0.5 * (a[k] + b[k]), b[k]])[None]).least
        assert -1e-9 < sampled[k] - room < 2.5e-4  # 1e-4, and what 2000 samples miss of 0.8 rad


def test_of_a_curve_all_of_it_is_proved():
    robot, rng = load("panda"), np.random.default_rng(6)
    edges = CertifiedEdges(robot, random_constraints(rng, robot))
    a, b = random_edges(rng, robot, 200)
    c = 0.5 * (a + b) + rng.normal(scale=0.2, size=a.shape)
    inside = ((c >= robot.limits.lower) & (c <= robot.limits.upper)).all(axis=1)
    found = edges.curves(np.hstack([a, c, b]))
    t = np.linspace(0, 1, 200)[:, None]
    for k in np.flatnonzero(inside):
        q = (1 - t) ** 2 * a[k] + 2 * t * (1 - t) * c[k] + t**2 * b[k]
        least = (edges.kept.values(q, np.zeros(200)) - edges.kept.asked).min()
        assert least >= 0 if found.certified[k] else least < 2e-4
    assert 20 < found.certified.sum() < 180


def test_an_edge_past_a_ball_says_which_pair_and_how_deep():
    """A hand that turns on a circle of 1 m passes a ball 20 mm away, at a quarter of a turn."""
    limits = dqc.robots.Limits([-3.0, -3.0], [3.0, 3.0], [2.0, 2.0], [np.inf, np.inf])
    arm = dqc.SerialArm.from_dh([0, 0], [0, 0], [1.0, 0.0], [0, 0], limits=limits)
    ball = around({"ball": sphere((0, 1.05, 0), 0.03, links=["hand"])})
    close = CertifiedEdges(arm, dqc.constraints.Constraints(**ball, margin=0.0201))
    found = close.clear([0.0, 0.0], [2.0, 0.0])
    assert (found.certified, found.label) == (False, "ball: hand")
    assert found.share == pytest.approx(0.25 * np.pi, abs=0.01)
    assert -1e-4 <= found.room < 0
    wide = CertifiedEdges(arm, dqc.constraints.Constraints(**ball, margin=0.0198))
    assert wide.clear([0.0, 0.0], [2.0, 0.0]).certified
    room = wide.least_room(np.array([[0.0, 0.0, 1.0, 0.0, 2.0, 0.0]]))
    assert room.label == "ball: hand"
    assert 2e-4 - 1.01e-4 < room.least <= 2e-4


def test_ends_beyond_limits_are_not_certified():
    robot = load("panda")
    edges = CertifiedEdges(robot, dqc.constraints.Constraints(self_collision=False))
    q = np.array([0, -0.8, 0, -2.4, 0, 1.6, 0.8])
    beyond = q.copy()
    beyond[5] = 4.0
    found = edges.clear(q, np.array([q, beyond]))
    assert found.certified.tolist() == [True, False]
    assert found.label[1] == "panda_joint6: limit"
    assert found.room[1] == pytest.approx(robot.limits.upper[5] - 4.0)


def test_what_moves_counts_as_what_it_sweeps():
    """The swept shape of each body holds the body at all times of its path."""
    rng = np.random.default_rng(9)
    path = [(0.5 * k, *rng.uniform(-0.5, 0.5, 3)) for k in range(150)]
    things = {
        "ball": sphere((0.5, 0, 0.5), 0.1, path=[(0, 0, 0, 0), (2, 0.3, 0, 0), (3, 0.3, 0.4, 0)]),
        "wild": sphere((0.5, 0, 2.5), 0.1, path=path),
        "car": sphere((2, 0, 0.5), 0.2, velocity=(-0.1, 0.0, 0.0)),
    }
    given = dqc.constraints.Constraints(**around(things))
    still = standing(given)
    for name, kept in still.obstacles.items():
        assert kept.moves.path is kept.moves.velocity is None
        for shift in given.obstacles[name].moves.shifts(np.linspace(0.0, 80.0, 500)):
            start = given.obstacles[name].shapes[0]
            ball = dqc.geometry.Sphere(start.center + shift, 1e-6)
            depth = min(dqc.geometry.distance(ball, each).distance for each in kept.shapes)
            assert depth <= -start.radius + 2e-6
    assert standing(still) is still


def test_bases_that_steer_are_left_to_drive_to():
    edges = CertifiedEdges(load("little-john"), dqc.constraints.Constraints(self_collision=False))
    start = np.array([0.0, 0.0, 0.0, *[0.2] * 5])
    assert edges.clear(start, start + 0.1 * np.eye(8)[3]).certified  # its base stands
    for k in range(3):
        with pytest.raises(ValueRangeError, match=r"base of little-john drives on one.*drive-to"):
            edges.clear(start, start + 0.1 * np.eye(8)[k])


def test_configurations_have_the_robots_size():
    edges = CertifiedEdges(load("panda"), dqc.constraints.Constraints())
    with pytest.raises(ShapeError, match="b: expected shape"):
        edges.clear(np.zeros(7), np.zeros(6))
    with pytest.raises(ValueRangeError, match="finite"):
        edges.clear(np.zeros(7), np.full(7, np.nan))


def test_pairs_are_said_by_links_and_known_by_their_shapes():
    """The Panda's link 6 has two shapes; constraints name it as a whole or one of them."""
    robot = load("panda")
    q = np.array([0, -0.8, 0, -2.4, 0, 1.6, 0.8])
    place = dict(zip(robot.shapes.names, robot.shapes.moved(robot, q), strict=True))["panda_link6.2"]
    for links, known, shape in (
        (["panda_link6"], 2, "panda_link6.1"),  # which lies around the end of the other
        (["panda_link6.2"], 1, "panda_link6.2"),
    ):
        ball = around({"ball": sphere(0.5 * (place.start + place.end), 0.01, links=links)})
        given = dqc.constraints.Constraints(**ball, self_collision=False)
        edges = CertifiedEdges(robot, given)
        assert len(edges.kept.labels) == known
        found = edges.clear(q, q)
        assert (found.certified, found.label) == (False, "ball: panda_link6")
        assert edges.kept.pair(found.row).links[0].name == shape
    with pytest.raises(dqc.errors.UnknownNameError, match=r"links: unknown name 'panda_link9'"):
        CertifiedEdges(
            robot,
            dqc.constraints.Constraints(**around({"ball": sphere((1, 0, 0), 0.1, links=["panda_link9"])})),
        )


def test_a_contact_of_a_link_is_said_once():
    """Both shapes of the Panda's link 6 lie in a box that no law keeps clear of."""
    robot, q = load("panda"), [0, -0.8, 0, -2.4, 0, 1.6, 0.8]
    middle = dqc.algebra.translation(robot.frames(np.array(q))[5]).tolist()
    wall = dqc.world.Body(box=[0.3, 0.3, 0.3], position=middle)
    found = Contacts(robot, None, None, dqc.World(bodies={"wall": wall})).of_run(
        dqc.simulate(
            robot,
            dqc.references.SetPoint(robot.fkm(q)),
            dqc.laws.Proportional(gain=1.0),
            dqc.plants.Integrator(),
            q,
            0.01,
            0.1,
        )
    )
    words = [each.words for each in found]
    assert words.count("in wall: panda_link6") == 1
    assert not [each for each in words if each.endswith((".1", ".2"))]
