"""The supervisor of trees: as that of the same chain, and both hands of two arms in the box and below the speed."""

import numpy as np
import pytest

import dqcontrol as dqc

FILE = "examples/robots/six-axis.urdf"
START = np.array([-0.1, -0.5, 0.1, -2.2, 0.1, 1.7, 0.8, 0.3, -0.7, -0.2, -2.1, -0.1, 1.5, 0.7])
TWO = dqc.load_robot("two-pandas")


def walk(prepared, q, wanted):
    """Return the commands for inputs that a law wants, as a robot on ideal joints would get them."""
    state, out = prepared.start(q), []
    for each in wanted:
        out.append(prepared.command(q, each, state))
        q = q + prepared.period * out[-1]
    return np.array(out)


def test_a_chain_and_the_tree_of_it_are_guarded_alike():
    chain, tree = (
        dqc.load_robot(FILE, "base", "tool"),
        dqc.load_robot(FILE, "base", tips=["tool"]).with_task("tool"),
    )
    q = np.array([0, 0.418, 1.716, 0, 1.007, 0])
    hand = dqc.DualQuaternion(chain.fkm(q)).translation
    box = dqc.supervisor.WorkspaceBox(lower=tuple(hand - 0.1), upper=tuple(hand + 0.15))
    given = dqc.supervisor.Supervisor(
        velocity=2.0, workspace=box, hand_speed=0.3, hand_acceleration=3.0, ramp=0.1
    )
    rng = np.random.default_rng(0)
    wanted = np.repeat(rng.uniform(-3, 3, (10, 6)), 20, axis=0)
    one, other = (walk(given.prepare(robot, 0.01), q, wanted) for robot in (chain, tree))
    assert np.abs(one - other).max() < 1e-9
    assert np.abs(one).max() > 0.1


@pytest.mark.parametrize("task", ["relative", "absolute", "left"])
def test_all_hands_of_the_task_are_guarded(task):
    arms = TWO.with_task(task)
    hands = ["left"] if task == "left" else ["left", "right"]
    places = np.array([dqc.DualQuaternion(arms.fkm(START, name)).translation for name in hands])
    box = dqc.supervisor.WorkspaceBox(
        lower=tuple(places.min(axis=0) - 0.05), upper=tuple(places.max(axis=0) + 0.05)
    )
    given = dqc.supervisor.Supervisor(workspace=box, hand_speed=0.2, acceleration=20.0, ramp=0.0)
    prepared, rng = given.prepare(arms, 0.01), np.random.default_rng(1)
    wanted = np.repeat(rng.uniform(-1, 1, (8, 14)), 25, axis=0)
    u = walk(prepared, START, wanted)
    q = START + 0.01 * np.vstack([np.zeros(14), np.cumsum(u, axis=0)])
    for name in hands:
        at = dqc.algebra.translation(arms.fkm(q, name))
        assert (at >= np.array(box.lower) - 1e-9).all()
        assert (at <= np.array(box.upper) + 1e-9).all()
        assert np.linalg.norm(np.diff(at, axis=0), axis=1).max() < 0.2 * 0.01 * 1.101
    assert np.abs(u).max() > 0.05


def test_a_run_of_two_arms_under_the_supervisor_is_the_same_interpreted():
    arms = TWO.with_task("absolute")
    circle = dqc.references.Circle(arms.fkm(START), radius=0.08, duration=2.0)
    law = dqc.laws.ProportionalFeedforward(gain=5.0)
    runs = [
        dqc.simulate(
            arms,
            circle,
            law,
            dqc.plants.Servo(),
            START,
            0.01,
            supervisor=dqc.supervisor.Supervisor(),
            interpreted=each,
        )
        for each in (True, False)
    ]
    assert np.array_equal(runs[0].q, runs[1].q)
    assert dqc.measures.evaluate(runs[0]).position.peak < 60


def test_what_is_refused_of_several_hands():
    with pytest.raises(dqc.Error, match="contact_force: is of one end effector"):
        dqc.supervisor.Supervisor(contact_force=10.0).prepare(TWO, 0.01)
    box = dqc.supervisor.WorkspaceBox(lower=(0, 0, 0), upper=(1, 1, 1))
    with pytest.raises(dqc.Error, match=r"the end effector starts at \[.*\] and \[.*-0.40"):
        dqc.supervisor.Supervisor(workspace=box).prepare(TWO, 0.01).start(START)
