"""Meshes kept clear of: by their convex parts, as exact as `geometry.distance`, standing, moving and measured."""

import re

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.algebra import pose
from dqcontrol.constraints import Constraints
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.experiments.contacts import Contacts
from dqcontrol.geometry import distance
from dqcontrol.world import Body, Motion, Watch, World, footprint

trimesh = pytest.importorskip("trimesh")

PANDA = dqc.load_robot("panda")
HOME = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.7])
T = 0.01


@pytest.fixture(scope="module")
def wedge(tmp_path_factory):
    """Return the file of a wedge, whose box is twice its volume."""
    file = tmp_path_factory.mktemp("meshes") / "wedge.stl"
    points = [[0, 0, 0], [0.4, 0, 0], [0, 0.3, 0], [0, 0, 0.3], [0.4, 0, 0.3], [0.05, 0.05, 0.35]]
    trimesh.convex.convex_hull(np.array(points)).export(file)
    return str(file)


def among(mesh, **keys):
    return World(bodies={"wedge": Body(mesh=mesh, position=(0.45, 0.1, 0.1), rpy=(0.3, 0.2, 0.1), **keys)})


def prepared(world):
    kept = Constraints(world=world, clear_of="all", margin=0.02, self_collision=False)
    return PreparedConstraints(kept, PANDA, T, "measured")


def expected(q, hull):
    assert PANDA.shapes is not None
    moved = PANDA.shapes.moved(PANDA, q)
    return [distance(shape, hull).distance for shape in moved]


@pytest.mark.parametrize("shift", [None, (0.1, -0.2, 0.05)])
def test_distances_are_those_of_the_hull(wedge, shift):
    moves = None if shift is None else Motion(velocity=shift)
    world = among(wedge, moves=moves)
    rows = prepared(world)
    (hull,) = world.bodies["wedge"].shapes
    rng, times = np.random.default_rng(2), np.arange(20) * T
    q = HOME + rng.uniform(-0.5, 0.5, (20, 7))
    values = rows.values(q, times)
    for k in range(20):
        moved = hull if shift is None else hull.moved(pose([1, 0, 0, 0], times[k] * np.array(shift)))
        all_links = np.array(expected(q[k], moved))
        assert all(np.abs(all_links - value).min() < 1e-9 for value in values[k])
        assert values[k].min() == pytest.approx(all_links[-values.shape[1] :].min(), abs=1e-9)


def test_a_measured_mesh_is_where_it_is_seen(wedge):
    world = among(wedge, mass=0.2, watch=Watch(rate=100))
    rows = prepared(world)
    body = world.bodies["wedge"]
    there = pose(dqc.algebra.rotation_from_rpy([0.5, -0.4, 1.0]), [0.5, -0.2, 0.2])
    rows.place(rows.parameters, "wedge", there)
    (hull,) = body.shapes
    seen = hull.moved(dqc.algebra.multiply(there, dqc.algebra.conjugate(body.pose)))
    value = rows.values(HOME[None], np.zeros(1)).min()
    assert value == pytest.approx(
        min(expected(HOME, seen)[-rows.values(HOME[None], np.zeros(1)).size :]), abs=1e-9
    )


def test_a_law_keeps_clear_of_a_mesh_where_its_box_would_stop_it(wedge):
    """The hand goes past the slope of the wedge, inside of the box around it."""
    spec = {
        "name": "mesh",
        "robot": "panda",
        "start": HOME.tolist(),
        "period": T,
        "reference": {"kind": "set-point", "offset": {"translation": [0, 0, -0.2]}, "duration": 4},
        "law": {"kind": "proportional", "gain": 2},
        "plant": {"kind": "integrator"},
        "world": {"wedge": {"mesh": wedge, "position": [0.45, -0.1, 0.05]}},
        "constraints": {"clear_of": "all", "margin": 0.02},
    }
    run = dqc.run(spec)
    (hull,) = Body(mesh=wedge, position=(0.45, -0.1, 0.05)).shapes
    least = min(min(expected(q, hull)[2:]) for q in run.record.q[::5])
    assert 0.019 < least < 0.03
    assert (
        Contacts(PANDA, None, None, World(bodies={"wedge": Body(mesh=wedge)})).of_run(run.record) is not None
    )


def test_a_run_that_goes_through_a_mesh_says_so(wedge):
    spec = {
        "name": "through",
        "robot": "panda",
        "start": HOME.tolist(),
        "period": T,
        "reference": {"kind": "set-point", "offset": {"translation": [0, 0, -0.2]}, "duration": 2},
        "law": {"kind": "proportional", "gain": 2},
        "plant": {"kind": "integrator"},
        "world": {"wedge": {"mesh": wedge, "position": [0.45, -0.1, 0.05]}},
    }
    with pytest.warns(dqc.errors.CollisionWarning):
        run = dqc.run(spec)
    (hull,) = Body(mesh=wedge, position=(0.45, -0.1, 0.05)).shapes
    deepest = max(-min(expected(q, hull)[1:]) for q in run.record.q)
    assert f"−{1e3 * deepest:.3g} mm" in run.verdict.words, run.verdict.words


def test_the_floor_under_a_mesh_is_its_shadow(wedge):
    place = footprint(Body(mesh=wedge))
    inside, outside = place.clearance(np.array([[0.1, 0.1], [0.35, 0.25]]))
    assert inside < 0 < outside


def test_check_says_what_many_parts_cost(wedge):
    spec = {
        "name": "parts",
        "robot": "panda",
        "start": HOME.tolist(),
        "period": T,
        "reference": {"kind": "set-point", "duration": 1},
        "law": {"kind": "proportional", "gain": 2},
        "plant": {"kind": "integrator"},
        "world": {
            "shelf": {
                "mesh": wedge,
                "position": [0.8, 0.5, 0.05],
                "parts": [{"mesh": wedge, "position": [0, 0.1 * k, 0]} for k in range(1, 4)],
            }
        },
        "constraints": {"clear_of": "all", "margin": 0.02},
    }
    (said,) = [words for words in dqc.experiments.check(spec).tasks if "shelf" in words]
    found = re.fullmatch(
        r"constraints.clear_of.shelf: 4 convex parts with (\d+) corners; all their distances from 10 links take "
        r"([\d.e+]+) µs here, each time that a step looks at them; far ones are left out",
        said,
    )
    assert found, said
    assert int(found[1]) == 4 * len(Body(mesh=wedge).shapes[0].points)
    assert float(found[2]) > 0
    del spec["world"]["shelf"]["parts"]
    assert not any("shelf" in words for words in dqc.experiments.check(spec).tasks)
