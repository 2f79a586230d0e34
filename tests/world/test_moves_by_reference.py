"""Bodies that move by references: as these say, in constraints, in physics and where pictures have them."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.algebra import translation
from dqcontrol.experiments.spec import read_spec
from dqcontrol.loop.signals import DISTANCE
from dqcontrol.world.body import poses_of

PLACE = [0.8, 0.5, 0.5]
HOME = [0, -0.3, 0, -2.0, 0, 1.8, 0.7]
SPEC = {
    "name": "moves",
    "robot": "panda",
    "start": HOME,
    "period": 0.01,
    "reference": {"kind": "set-point", "duration": 2.0},
    "law": {"kind": "proportional", "gain": 2},
    "plant": {"kind": "integrator"},
}
SQUARE = {"kind": "square", "side": "100 mm", "duration": 2, "corner_stops": 0.2}
CIRCLE = {"kind": "circle", "radius": "100 mm", "duration": "2 s"}


def ball(reference, **more):
    return {"ball": {"sphere": "60 mm", "position": PLACE, "moves": {"reference": reference, **more}}}


def world_of(reference, **more):
    found = read_spec(SPEC | {"world": ball(reference, **more)})[0].surroundings
    assert found is not None
    return found


@pytest.mark.parametrize(
    "reference",
    [CIRCLE, SQUARE, {"kind": "sequence", "references": [SQUARE, CIRCLE], "repeat": 2, "ramp": 0.3}],
)
def test_a_body_is_where_its_reference_is(reference):
    body = world_of(reference, speed=0.1).bodies["ball"]
    assert body.moves is not None
    assert body.moves.speed == 0.1
    spec = read_spec(SPEC | {"reference": reference})[0].reference
    start = dqc.algebra.pose([1, 0, 0, 0], PLACE)
    made = spec.build(start, None)  # type: ignore[arg-type]
    times = np.linspace(0, made.duration + 1, 1000)
    wanted = translation(made.samples(times)[:, :8])
    there = translation(poses_of("ball", body, times, {}))
    assert np.abs(there - wanted).max() < 1.1e-4


def test_points_of_a_file_beside_the_worlds(tmp_path):
    (tmp_path / "way.csv").write_text("time,x,y,z\n0,0.8,0.5,0.5\n1,0.9,0.5,0.5\n2,0.9,0.6,0.6\n")
    (tmp_path / "room.yaml").write_text(
        "ball: {sphere: 0.06, position: [0.8, 0.5, 0.5], moves: {reference: {kind: points, file: way.csv}}}"
    )
    moves = dqc.load_world(tmp_path / "room.yaml").bodies["ball"].moves
    assert moves is not None
    assert moves.shifts(np.array([0.5, 1.5])) == pytest.approx(np.array([[0.05, 0, 0], [0.1, 0.05, 0.05]]))


def test_constraints_and_physics_have_it_there():
    pytest.importorskip("mujoco")
    spec = SPEC | {
        "world": ball(CIRCLE),
        "plant": {"kind": "mujoco"},
        "constraints": {"clear_of": "all"},
    }
    run = dqc.run(spec)
    world = world_of(CIRCLE)
    body, arm = world.bodies["ball"], dqc.load_robot("panda")
    shapes = arm.shapes
    assert shapes is not None
    k = 77
    at = body.shapes[0].moved(dqc.algebra.pose([1, 0, 0, 0], body.moves.shifts(run.record.time[[k]])[0]))  # type: ignore[union-attr]
    placed = shapes.moved(arm, run.record.q[k])
    least = min(
        dqc.geometry.distance(shape, at).distance
        for shape, each in zip(placed, shapes.shapes, strict=True)
        if each.frame > 1
    )
    kept = run.record.readings[DISTANCE]
    of_ball = [i for i, part in enumerate(kept.parts) if "ball" in part]
    assert kept.values[k, of_ball].min() == pytest.approx(least, abs=2e-4)
    live = dqc.plants.MujocoPlant(world=world).start(arm, np.array(HOME), 0.01, 100, 0)
    for _ in range(77):
        live.step(np.zeros(7))
    there = live.data.body("world: ball").xpos - PLACE
    assert there == pytest.approx(body.moves.shifts(np.array([0.77]))[0], abs=2e-4)  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("reference", "words"),
    [
        ({"kind": "set-point"}, r"world.ball.moves.reference: it never ends; give its duration"),
        ({"kind": "circl"}, r"moves.reference: kind: unknown name 'circl'; did you mean 'circle'"),
        ({"kind": "follow", "body": "ball", "duration": 1}, r"follow is made for a robot"),
        (CIRCLE | {"offset": {"translation": [0, 0, 0.1]}}, r"begins 100 mm from where the body is"),
        (
            {"kind": "via-points", "points": [{"translation": [0, 0, 0]}]},
            r"world.ball.moves.reference",
        ),
    ],
)
def test_what_no_body_moves_by_is_refused(reference, words):
    with pytest.raises(dqc.Error, match=words):
        world_of(reference)


def test_a_reference_that_turns_is_refused(tmp_path):
    (tmp_path / "way.csv").write_text(
        "time,x,y,z,qw,qx,qy,qz\n0,0.8,0.5,0.5,1,0,0,0\n1,0.9,0.5,0.5,0,0,0,1\n"
    )
    with pytest.raises(dqc.Error, match="it turns, and bodies that move by themselves keep"):
        world_of({"kind": "points", "file": str(tmp_path / "way.csv")})


def test_two_ways_to_move_are_refused():
    with pytest.raises(dqc.Error, match="it has a path or velocity already"):
        world_of(CIRCLE, velocity=[0, 0, 1])
