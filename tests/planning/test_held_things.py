"""What a hand holds is kept clear of as links are, with Coal as the judge."""

import msgspec
import numpy as np
import pytest
from shape_samples import coal_distance

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.constraints import Constraints
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.planning import CertifiedEdges, plan
from dqcontrol.world import Held, SetDown

Body = dqc.world.Body
ARM = dqc.load_robot("panda-hand")
START = np.array([0.9, -0.2, 0, -2.2, 0, 2.0, 0.8])
GOAL = np.array([-0.9, -0.2, 0, -2.2, 0, 2.0, 0.8])
BELOW = dqc.DualQuaternion(ARM.fkm(0.5 * (START + GOAL))).translation - [0, 0, 0.3]
POST = Body(
    box=(0.1, 0.1, 0.4), position=tuple(BELOW.tolist())
)  # the hand passes 0.1 m above it, the straight way
THINGS = {
    "box": Body(box=(0.04, 0.04, 0.3), mass=0.2),
    "cylinder": Body(cylinder=(0.02, 0.3), mass=0.2),
    "two balls": Body(sphere=0.03, parts=[dqc.world.Solid(sphere=0.03, position=(0, 0, 0.12))], mass=0.2),
    "elsewhere": Body(capsule=(0.02, 0.25), position=(1.0, 2.0, 3.0), rpy=(0.3, 0.2, 0.1)),
}


def keeping(thing, held=None, **options):
    world = dqc.World(bodies={"post": POST, "thing": msgspec.structs.replace(thing, held=held)})
    return Constraints(world=world, clear_of="all", **options)


def least_by_coal(coal, robot, thing, held, configurations):
    """Return the least distance of what is held from the post."""
    place = algebra.pose(algebra.rotation_from_rpy(held.rpy), held.position)
    (post,) = POST.shapes
    own = [each.moved(algebra.conjugate(thing.pose)) for each in thing.shapes]
    return min(
        coal_distance(coal, shape.moved(algebra.multiply(robot.fkm(q), place)), post)
        for q in configurations
        for shape in own
    )


@pytest.mark.parametrize("name", THINGS)
def test_a_plan_keeps_what_is_held_clear(name):
    coal = pytest.importorskip("coal", reason="Coal is the reference")
    thing, held = THINGS[name], Held(position=(0.0, 0.0, 0.1), rpy=(0.1, 0.2, 0.0))
    empty, full = keeping(thing), keeping(thing, held)
    if name == "elsewhere":
        empty = Constraints(world=dqc.World(bodies={"post": POST}), clear_of="all")
    straight = np.linspace(START, GOAL, 60)
    assert plan(ARM, empty, START, GOAL).configurations.shape == (2, 7)
    assert least_by_coal(coal, ARM, thing, held, straight) < 0
    check = CertifiedEdges(ARM, full).clear(START, GOAL)
    assert (check.certified, check.label) == (False, "post: thing")
    way = plan(ARM, full, START, GOAL)
    assert len(way.configurations) > 2
    gone = way.way.at(np.linspace(0, way.length, 200))[0]
    assert least_by_coal(coal, ARM, thing, held, gone) >= full.margin - 1e-6


def test_a_law_keeps_what_is_held_clear():
    thing, held = THINGS["box"], Held(position=(0, 0, 0.1))
    keep = keeping(thing, held, acceleration=10.0)
    law = dqc.laws.GuidedProportional(gain=2.0, pull=5.0, constraints=keep)
    way = dqc.planning.PlanTo(plan(ARM, keep, START, GOAL))
    record = dqc.simulate(ARM, way, law, dqc.plants.Integrator(), START, 0.01, way.duration + 1.0)
    assert np.abs(record.q[-1] - GOAL).max() < 1e-6
    assert record.readings["constraint_room"].values.min() >= 0


def test_it_is_kept_away_from_the_robot_itself():
    """A rod so long that it would go through the upper arm."""
    long = keeping(Body(box=(0.02, 1.2, 0.02), mass=0.2), Held())
    labels = CertifiedEdges(ARM, long).kept.labels
    assert {"panda_link0, thing", "panda_link1, thing", "panda_link2, thing", "panda_link5, thing"} <= set(
        labels
    )
    assert not {"panda_hand, thing", "panda_link7, thing"} & set(labels)


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"held": Held(frame="left")}, ShapeError, r"world.thing.held.frame: .* has one hand"),
        (
            {"held": Held(), "hinge": dqc.world.Hinge(axis=(0, 0, 1))},
            ShapeError,
            "held: no hand holds a box that is hin",
        ),
        (
            {"held": Held(), "watch": dqc.world.Watch(), "mass": 1.0},
            ShapeError,
            "held: says where the body is",
        ),
    ],
)
def test_what_no_hand_holds_is_said(given, error, message):
    with pytest.raises(error, match=message):
        CertifiedEdges(
            ARM, Constraints(world=dqc.World(bodies={"thing": Body(box=0.1, **given)}), clear_of="all")
        )


def test_what_is_let_go_before_it_is_gripped_is_said():
    with pytest.raises(ValueRangeError, match=r"held.until: must be after since, 2 s, got 1 s"):
        Held(since=2, until=1)
    with pytest.raises(ShapeError, match=r"held.put: it is held to the end"):
        Held(put=SetDown(position=(0, 0, 0)))


def test_in_a_spec_for_two_arms():
    """What the left hand holds keeps away from a post, and from what the file keeps the left hand away from."""
    spec = {
        "name": "held",
        "robot": "two-pandas",
        "period": "10 ms",
        "start": [0, -0.8, 0, -2.4, 0, 1.6, 0.8] * 2,
        "world": {
            "post": {"box": [0.1, 0.1, 0.4], "position": [1.5, 0, 0.2]},
            "rod": {
                "box": [0.04, 0.04, 0.3],
                "mass": 0.2,
                "held": {"position": [0, 0, 0.1], "frame": "left"},
            },
        },
        "constraints": {"clear_of": "all"},
        "reference": {"kind": "set-point", "duration": 0.1},
        "law": {"kind": "proportional", "gain": 2},
        "plant": {"kind": "integrator"},
    }
    from dqcontrol.experiments.prepared_experiment import prepare

    setting = prepare(spec)
    (case,) = setting.cases
    labels = case.prepare_law(setting.spec).constraints.labels
    assert "post: rod" in labels
    assert any(each.startswith("right/") and each.endswith(", rod") for each in labels)
