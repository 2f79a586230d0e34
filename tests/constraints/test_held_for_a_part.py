"""A body that a hand holds for a part of a run: it stands, is carried, and stands elsewhere."""

import msgspec
import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.constraints import Constraints
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.geometry import distance
from dqcontrol.planning import CertifiedEdges
from dqcontrol.planning.standing_world import standing
from dqcontrol.world import Body, Held, SetDown

ARM = dqc.load_robot("panda-hand")
Q = np.array([0.3, -0.2, 0, -2.2, 0, 2.0, 0.8])
HELD = Held(
    since=1.0, until=2.0, position=(0, 0, 0.1), rpy=(0.2, 0, 0), put=SetDown(position=(0.2, -0.6, 0.3))
)
ROD = Body(box=(0.03, 0.05, 0.2), position=(0.5, 0.4, 0.5), held=HELD)
POST = Body(sphere=0.05, position=(0.2, 0.1, 0.9))
CARRY = """
name: carry
robot: panda-hand
start: {position: [0.45, -0.3, 0.39], quaternion: [0, 1, 0, 0]}
period: 10 ms
world:
  table: {box: [0.7, 1.2, 40 mm], position: [0.55, 0, 0.18]}
  wall: {box: [0.3, 20 mm, 0.2], position: [0.45, 0, 0.3]}
  rod:
    cylinder: [20 mm, 120 mm]
    position: [0.45, -0.3, 0.26]
    held: {since: 2.5 s, until: 11 s, position: [0, 0, 30 mm], put: {position: [0.45, 0.3, 0.26]}}
constraints:
  margin: 5 mm
  acceleration: 10
  clear_of: {wall: {}, rod: {}, table: {links: [panda_link5, panda_link6, panda_link7, panda_hand]}}
reference:
  kind: sequence
  references:
    - {kind: straight, way: [0, 0, -0.1], duration: 2}
    - {kind: set-point, duration: 1}
    - {kind: straight, way: [0, 0, 0.22], duration: 2}
    - {kind: straight, way: [0, 0.6, 0], duration: 4}
    - {kind: straight, way: [0, 0, -0.22], duration: 2}
    - {kind: set-point, duration: 0.5}
    - {kind: straight, way: [0, 0, 0.1], duration: 2}
law: {kind: proportional-feedforward, gain: 5}
plant: {kind: integrator}
outcome:
  - {clear_of: [wall], by: 5 mm}
"""


def keeping(rod=ROD):
    return Constraints(world=dqc.World(bodies={"post": POST, "rod": rod}), clear_of="all", margin=0.005)


def where(time):
    """Return the rod's shape at a time, with the arm at Q."""
    (own,) = msgspec.structs.replace(ROD, position=(0, 0, 0), held=None).shapes
    if 1.0 <= time < 2.0:
        grasp = algebra.pose(algebra.rotation_from_rpy(HELD.rpy), HELD.position)
        return own.moved(algebra.multiply(ARM.fkm(Q), grasp))
    return own.moved(algebra.pose([1, 0, 0, 0], ROD.position if time < 1.0 else HELD.put.position))


@pytest.mark.parametrize("time", [0.0, 0.99, 1.0, 1.5, 1.99, 2.0, 5.0])
def test_distances_are_those_of_where_it_is(time):
    kept = PreparedConstraints(keeping(), ARM, 0.01, "measured")
    every = kept.values(Q[None], [time])[0]
    values = dict(zip(kept.labels, every, strict=True))
    here = where(time)
    (post,) = POST.shapes
    if 1.0 <= time < 2.0:
        assert values["post: rod"] == pytest.approx(distance(here, post).distance, abs=1e-9)
        assert min(value for label, value in values.items() if label.startswith("rod")) > 1e5
        return
    assert values["post: rod"] > 1e5
    frames = ARM.frames(Q)
    part = f"rod {1 if time < 1 else 2}"
    links = [each for each in ARM.shapes.shapes if each.link == "panda_link5"]
    for each in links:
        truth = distance(each.shape.moved(frames[each.frame - 1]), here).distance
        found = [
            value for label, value in zip(kept.labels, every, strict=True) if label == f"{part}: panda_link5"
        ]
        assert np.abs(np.array(found) - truth).min() < 1e-9
    assert not [
        label for label in values if label.startswith("rod") and "hand" in label
    ]  # which is to grip it


@pytest.mark.parametrize(
    ("time", "label"), [(0.0, "rod: panda_link5"), (1.5, "post: rod"), (3.0, "rod: panda_link5")]
)
def test_plans_take_it_where_it_is_when_they_are_made(time, label):
    still = standing(keeping(), time)
    edges = CertifiedEdges(ARM, still)
    assert label in edges.kept.labels
    (post,) = POST.shapes
    values = dict(zip(edges.kept.labels, edges.kept.values(Q[None], [0.0])[0], strict=True))
    there = where(time)
    if time == 1.5:
        assert values["post: rod"] == pytest.approx(distance(there, post).distance, abs=1e-9)
    else:
        assert values["post: rod"] > 1e5
        assert still.world.bodies["rod"].shapes[0].row == pytest.approx(there.row)


def test_where_nobody_knows_that_it_was_put_plans_do_without_it():
    gone = msgspec.structs.replace(ROD, held=msgspec.structs.replace(HELD, put=None))
    assert "rod" not in standing(keeping(gone), 3.0).world.bodies
    assert set(standing(keeping(gone), 0.5).world.bodies) == {"post", "rod"}


def spec(**changes):
    given = msgspec.yaml.decode(CARRY)
    given["world"]["rod"] |= changes
    return given


def test_it_is_picked_carried_over_a_wall_and_placed():
    run = dqc.run(spec())
    assert "reached" in run.verdict.words
    assert not run.verdict.failure
    record = run.record
    places = record.readings["rod_position"].values
    np.testing.assert_allclose(places[0], [0.45, -0.3, 0.26])
    np.testing.assert_allclose(places[-1], [0.45, 0.3, 0.26])
    grasp = algebra.pose([1, 0, 0, 0], [0, 0, 0.03])
    k = int(np.searchsorted(record.time, 6.0))
    np.testing.assert_allclose(
        places[k], algebra.translation(algebra.multiply(record.pose[k], grasp)), atol=1e-9
    )
    (wall,) = Body(box=(0.3, 0.02, 0.2), position=(0.45, 0, 0.3)).shapes
    (own,) = Body(cylinder=(0.02, 0.12)).shapes
    turns = record.readings["rod_quaternion"].values
    least = min(
        distance(own.moved(algebra.pose(turn, place)), wall).distance
        for turn, place in zip(turns[::10], places[::10], strict=True)
    )
    assert least >= 0.005
    jumps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert jumps.max() < 0.01  # it is gripped where it stands, and put where it is let go


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"position": [0.45, -0.26, 0.26]},
            "gripped nothing: rod is 40 mm from where the hand closes on it at 2.5 s",
        ),
        (
            {
                "held": {
                    "since": 2.5,
                    "until": 11,
                    "position": [0, 0, 0.03],
                    "put": {"position": [0.45, 0.33, 0.26]},
                }
            },
            "put elsewhere: rod is 30 mm from where it is to be at 11 s",
        ),
    ],
)
def test_a_verdict_says_that_a_hand_grips_air_or_puts_it_elsewhere(changes, words):
    verdict = dqc.run(spec(**changes)).verdict
    assert verdict.failure == "grip"
    assert words in verdict.words
