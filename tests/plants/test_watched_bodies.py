"""Bodies that physics moves and something measures: late, seldom, with noise; kept clear of, and followed."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.algebra import pose, translation
from dqcontrol.plants import Gripper, GripperEvent, MujocoPlant
from dqcontrol.references import Follow, SetPoint
from dqcontrol.world import Body, Slide, Watch

pytest.importorskip("mujoco")

T = 0.01
PANDA = dqc.load_robot("panda")
HOME = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.7, 0.0])
ONE = [1.0, 0, 0, 0]


def falling(watch):
    """Return true and measured heights of a ball that falls, at each sample."""
    ball = Body(sphere=0.05, position=(0.0, 1.0, 3.0), mass=1.0, watch=watch)
    live = MujocoPlant(world=dqc.World(bodies={"ball": ball})).start(PANDA, HOME, T, 50, 3)
    true, seen = [], []
    for _ in range(50):
        true.append(live.data.body("world: ball").xpos.copy())
        seen.append(translation(live.seen["ball"]))
        live.step(np.zeros(7))
    names = [channel.name for channel in live.channels]
    assert names[-2:] == ["ball_seen_position", "ball_seen_quaternion"]
    return np.array(true), np.array(seen)


def test_frames_come_at_their_rate_and_as_late_as_said():
    true, seen = falling(Watch(rate=25.0, delay=0.03))
    for k in range(50):
        shown = max((k - 3) // 4 * 4, 0) if k >= 3 else 0  # every fourth sample, three late
        np.testing.assert_allclose(seen[k], true[shown], atol=1e-12)


def test_noise_has_its_size_and_differs_by_the_seed():
    true, seen = falling(Watch(rate=100.0, position_noise=0.01))
    error = (seen - true)[1:]
    assert error.std() == pytest.approx(0.01, rel=0.2)
    assert abs(error.mean()) < 3 * 0.01 / np.sqrt(error.size)


def test_a_hand_keeps_clear_of_a_box_by_where_it_is_measured():
    """A drawer slides into the hand's way: with `clear_of` the hand gives way, and only then."""
    hand = translation(PANDA.fkm(HOME))
    kinds = {}
    for kept in (True, False):
        drawer = Body(
            box=0.1,
            position=(hand[0] + 0.2, hand[1], hand[2]),
            slide=Slide(axis=(1, 0, 0), damping=80.0),
            mass=1.0,
            watch=Watch(rate=100.0),
        )
        world = dqc.World(bodies={"drawer": drawer})
        constraints = dqc.constraints.Constraints(world=world, clear_of="all", self_collision=False)
        law = dqc.laws.Proportional(gain=2.0, constraints=constraints if kept else None)
        target = pose(PANDA.fkm(HOME)[:4], hand)
        plant = MujocoPlant(world=world, gravity=(-2.0, 0.0, 0.0), gravity_compensation=1.0)
        record = dqc.simulate(PANDA, SetPoint(target), law, plant, HOME, period=T, duration=5.0)
        kinds[kept] = record.readings["contact_force"].values.max(), record.position[-1, 0] - hand[0]
    assert kinds[False][0] > 1.0  # it was pushed
    assert kinds[True][0] == 0.0
    assert kinds[True][1] < -0.01


LONG = dqc.SerialArm.join([PANDA, pose(ONE, [0, 0, 0.16])], "panda")


@pytest.mark.parametrize("follows", [True, False])
def test_a_pick_works_where_the_cube_is(follows):
    """The pick is programmed for a cube that stands 30 mm away from there."""
    start = LONG.fkm(HOME)
    hand, up = translation(start), pose(ONE, [0, 0, 0.08])
    top, away = hand[2] - 0.1, np.array([0.03, 0.02, 0.0])
    taught = pose(ONE, [hand[0], hand[1], top + 0.02])
    low = dqc.algebra.multiply(dqc.algebra.conjugate(up), start)
    pick = dqc.references.ViaPoints([0.0, 1.0, 2.0, 3.0, 4.0, 5.0], [start, start, low, low, start, start])
    reference = Follow(pick, "cube", taught, until=2.5) if follows else pick
    bodies = {
        "table": Body(box=[0.6, 0.6, 0.1], position=(hand[0], hand[1], top - 0.05)),
        "cube": Body(box=0.04, position=tuple(translation(taught) + away), mass=0.1, watch=Watch(delay=0.02)),
    }
    closes = [GripperEvent(time=2.5, closed=True)]
    gripper = Gripper(points="z", closes="y", length=0.09, force=20.0, speed=0.1, schedule=closes)
    plant = MujocoPlant(gripper=gripper, world=dqc.World(bodies=bodies))
    record = dqc.simulate(LONG, reference, dqc.laws.Proportional(gain=4.0), plant, HOME, period=T)
    lifted = record.readings["cube_position"].values[-1, 2] - top
    assert (lifted > 0.08) == follows
    if follows:
        shift = translation(record.desired_pose[-1]) - hand
        np.testing.assert_allclose(shift, away, atol=1e-3)


SPEC = {
    "name": "follow",
    "robot": "panda",
    "start": HOME.tolist(),
    "period": T,
    "law": {"kind": "proportional", "gain": 3},
    "plant": {"kind": "mujoco"},
    "world": {
        "floor": True,
        "cube": {"box": 0.1, "position": [0.3, 0.6, 0.05], "mass": 1, "watch": {"rate": 50}},
        "stone": {"box": 0.1, "position": [0.3, -0.6, 0.05], "mass": 1},
    },
}
STAYS = {"kind": "follow", "body": "cube", "duration": 2.0, "taught": [0.25, 0.6, 0.05]}


def test_a_spec_follows_a_body():
    run = dqc.run(SPEC | {"reference": STAYS})
    shift = run.record.position[-1] - run.record.position[0]
    np.testing.assert_allclose(shift, [0.05, 0, 0], atol=2e-3)
    assert run.verdict.words.startswith("reached")


@pytest.mark.parametrize(
    ("reference", "plant", "words"),
    [
        ({"body": "cub"}, "mujoco", r"reference.body: unknown name 'cub'; did you mean 'cube'"),
        ({"body": "stone"}, "mujoco", r"reference.body: nothing measures where 'stone' is; give it 'watch'"),
        (
            {"duration": 1.0, "ramp": 0.5},
            "mujoco",
            r"what changes a motion belongs to that inside of 'follow'",
        ),
        ({"duration": None}, "mujoco", r"give either 'reference', the motion for the body, or 'duration'"),
        ({}, "integrator", r"nothing measures 'cube' here; its 'watch' needs a plant that moves it"),
    ],
)
def test_what_cannot_be_followed_is_said(reference, plant, words):
    with pytest.raises(dqc.Error, match=words):
        dqc.run(SPEC | {"reference": STAYS | reference, "plant": {"kind": plant}})


def test_what_stands_is_not_watched():
    with pytest.raises(dqc.Error, match=r"world.table: watch: measures where physics moves a body, .* fixed"):
        dqc.World(bodies={"table": Body(box=1.0, watch=Watch())})
