"""A robot that follows what it is told now: it gets there, changes its law on the way, and no input shakes it."""

import math
from contextlib import suppress

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.controller import FurtherTask, PreparedTasks
from dqcontrol.errors import Error, ShapeError, ValueRangeError
from dqcontrol.loop import Live
from dqcontrol.loop.live import Pace
from dqcontrol.loop.targets import Speeds

T, Q0 = 0.01, np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
ACCELERATION = 8.0
LAW = dqc.laws.ProportionalFeedforward(gain=5.0)


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def live_arm(arm, plant=None, **options):
    plant = plant or dqc.plants.Servo()
    guard = dqc.supervisor.Supervisor(acceleration=ACCELERATION)
    return Live(arm, LAW, plant, T, start=Q0, supervisor=guard, **options)


def moved(pose, shift):
    return algebra.multiply(algebra.pose([1, 0, 0, 0], shift), pose)


def steps(live, count):
    for _ in range(count):
        live.step()


def test_it_goes_where_it_is_told_and_says_what_is_missing(arm):
    live = live_arm(arm)
    assert live.target is None
    assert math.isnan(live.state.missing)
    goal = moved(live.state.pose, [0.0, 0.1, 0.05])
    live.target = goal
    np.testing.assert_array_equal(live.target, goal)
    assert live.state.missing == pytest.approx(math.hypot(0.1, 0.05))
    steps(live, 400)
    state = live.state
    assert state.missing < 1e-4
    assert state.position_error < 1e-4
    assert state.orientation_error < 1e-4
    assert state.time == pytest.approx(3.99, abs=1e-12)
    assert 0 <= state.share < 0.01


def test_out_of_reach_it_is_calm_and_says_how_far(arm):
    live = live_arm(arm)
    live.target = moved(live.state.pose, [2.0, 0.0, 0.0])
    steps(live, 1500)
    commands = []
    for _ in range(300):
        live.step()
        commands.append(live.control.command.copy())
    signs = np.sign(np.where(np.abs(commands) < 1e-3, 0.0, commands))
    assert not (signs[1:] * signs[:-1] < 0).any()  # no joint turns back
    shoulder = algebra.translation(arm.frames(Q0)[1])
    beyond = np.linalg.norm(algebra.translation(live.target) - shoulder) - 0.926
    apart = algebra.translation(live.target) - algebra.translation(arm.fkm(live.state.q))
    assert live.state.missing == pytest.approx(np.linalg.norm(apart))
    assert (
        beyond - 1e-3 < live.state.missing < beyond + 0.3
    )  # the hand keeps its orientation: it reaches less far
    assert live.condition.startswith("active")


def test_it_comes_back_from_a_singularity_before_which_it_was_held():
    """Its target waited ahead of it, where no joint leads: it has to come back for the hand."""
    arm, start = dqc.load_robot("ur5"), [0, -1.2, 1.5, -1.8, -1.5, 0]
    live = Live(arm, LAW, dqc.plants.Servo(), T, start=start)
    home = live.state.pose.copy()
    live.target = moved(home, [3.0, 0.0, 0.2])
    steps(live, 1500)
    assert live.condition == "active: held near a singularity"
    live.target = home
    steps(live, 1500)
    assert live.state.missing < 1e-4
    assert live.condition == "active"


def test_it_holds_when_told_so_and_follows_twists_and_references(arm):
    live = live_arm(arm)
    start = live.state.pose
    live.target = moved(start, [0.0, 0.2, 0.0])
    steps(live, 60)
    live.hold()
    assert live.target is None
    there = live.state.pose
    steps(live, 200)
    assert np.linalg.norm(algebra.translation(live.state.pose) - algebra.translation(there)) < 0.06
    assert np.linalg.norm(algebra.translation(live.state.pose) - algebra.translation(start)) < 0.19
    before = algebra.translation(live.state.pose)
    for _ in range(100):
        live.move(np.array([0.05, 0.0, 0.0]), np.zeros(3))
        live.step()
    steps(live, 150)  # no more: it rests
    way = algebra.translation(live.state.pose) - before
    assert way == pytest.approx([0.057, 0, 0], abs=0.006)  # a second, and what the last one lasts
    still = live.plant.q.copy()
    circle = dqc.references.Circle(live.state.desired, radius=0.05, duration=3.0)
    live.follow(circle)
    errors = []
    for _ in range(320):
        live.step()
        errors.append(live.state.position_error)
    assert max(errors) < 0.01
    assert max(errors[150:290]) < 0.001
    assert np.linalg.norm(live.plant.q - still) < 0.2  # the circle is closed
    steps(live, 200)
    assert not live.control.command.any() or np.abs(live.control.command).max() < 1e-4
    live.follow(dqc.references.SetPoint(start))
    np.testing.assert_allclose(live.target, start, atol=1e-15)


def test_a_reference_is_followed_as_in_a_run_to_the_last_bit(arm):
    """Joints are late: twists lead by that, as where the whole motion is known."""
    plant = dqc.plants.Servo(delay=0.02, time_constant=0.05)
    circle = dqc.references.Circle(arm.fkm(Q0), radius=0.08, duration=4.0)
    live = live_arm(arm, plant)
    live.follow(circle)
    spec = {
        "name": "run",
        "robot": arm,
        "start": Q0,
        "period": T,
        "reference": circle,
        "law": LAW,
        "plant": plant,
        "supervisor": {"acceleration": ACCELERATION},
    }
    run = dqc.run(spec)
    for k in range(400):
        live.step()
        np.testing.assert_array_equal(live.state.q, run.record.q[k])
        np.testing.assert_array_equal(live.control.command, run.record.command[k])
        assert live.state.position_error == pytest.approx(run.record.position_error[k], abs=1e-12)


def test_another_law_takes_over_on_the_way_within_the_limits(arm):
    live = live_arm(arm)
    live.target = moved(live.state.pose, [0.0, 0.15, 0.0])
    steps(live, 40)
    before = live.control.command.copy()
    live.set_law(dqc.laws.DecoupledProportional(gain=9.0))
    live.step()
    assert np.abs(live.control.command - before).max() <= ACCELERATION * T * (1 + 1e-9)
    with pytest.raises(ShapeError, match=r"law: expected a Law, got 'fast'"):
        live.set_law("fast")
    steps(live, 300)
    assert live.state.missing < 1e-4
    assert isinstance(live.law, dqc.laws.DecoupledProportional)


def test_a_gain_beyond_stability_shakes_within_limits_and_a_reset_brings_it_back(arm):
    live = live_arm(arm, dqc.plants.Servo(delay=0.05, time_constant=0.05))
    live.set_law(dqc.laws.Proportional(gain=60.0))
    live.target = moved(live.state.pose, [0.0, 0.05, 0.0])
    steps(live, 300)
    assert np.ptp([live.step() or live.control.command[0] for _ in range(100)]) > 0.1
    live.stop()
    steps(live, 200)
    assert live.is_stopped
    assert live.condition.startswith("stopped: ")
    live.set_law(LAW)
    live.resume()
    with pytest.raises(Error, match="not stopped"):
        live.resume()
    live.target = moved(live.state.pose, [0.0, 0.05, 0.0])
    steps(live, 500)
    assert live.state.missing < 1e-3


def test_what_is_no_pose_changes_nothing_and_says_why(arm):
    live = live_arm(arm)
    live.target = goal = moved(live.state.pose, [0.0, 0.05, 0.0])
    for wrong, error in (
        (np.zeros(8), ValueRangeError),
        (2 * goal, ValueRangeError),
        (goal[:7], ShapeError),
        (np.tile(goal, (2, 1)), ShapeError),
        ("x", ShapeError),
    ):
        with pytest.raises(error, match="target"):
            live.target = wrong
        np.testing.assert_array_equal(live.target, goal)


def unit(quaternion):
    return quaternion / np.linalg.norm(quaternion)


def hostile(rng, live, start):
    """Say something that nobody should say."""
    kind = rng.integers(8)
    far = algebra.pose(unit(rng.normal(size=4)), rng.uniform(-1, 1, 3) * 10.0 ** rng.integers(-2, 7))
    if kind == 0:
        live.target = np.where(rng.random(8) < 0.3, rng.choice([np.nan, np.inf, -np.inf]), far)
    elif kind == 1:
        live.target = far  # a jump
    elif kind == 2:
        live.target = -moved(start, rng.normal(size=3) * 0.1)  # the other sign
    elif kind == 3:
        live.move(rng.normal(size=3) * 1e6, np.full(3, np.nan), of_hand=bool(rng.integers(2)))
    elif kind == 4:
        live.move(rng.normal(size=3) * 1e9, rng.normal(size=3) * 1e9, of_hand=bool(rng.integers(2)))
    elif kind == 5:
        live.set_law(dqc.laws.ProportionalFeedforward(gain=float(rng.uniform(0.1, 500.0))))
    elif kind == 6:
        live.hold()
    else:
        live.target = rng.normal(size=8)  # no unit dual quaternion


@pytest.mark.parametrize("count", [3000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_no_input_moves_a_joint_beyond_its_limits(arm, count):
    seed = 7
    rng = np.random.default_rng(seed)
    live, speed = live_arm(arm, dqc.plants.Integrator(), speeds=Speeds(2.0, 6.0, 20.0)), arm.limits.velocity
    start, before, rate, jumps, stops = live.state.pose, Q0.copy(), np.zeros(7), 0, 0
    for _ in range(count):
        with suppress(ValueRangeError):
            hostile(rng, live, start)
        for _ in range(int(rng.integers(1, 3))):  # gaps: nothing comes for a while
            live.step()
            q, u = live.plant.q, live.control.command
            jumps += (np.abs(q - before) > speed * T * (1 + 1e-9)).any()
            jumps += (np.abs(u - rate) > ACCELERATION * T * (1 + 1e-6)).any()
            jumps += not (
                np.isfinite(q).all()
                and (arm.limits.lower - 1e-9 <= q).all()
                and (q <= arm.limits.upper + 1e-9).all()
            )
            before, rate = q.copy(), u.copy()
        if live.is_stopped:
            stops += 1
            live.resume()
    assert jumps == 0, f"seed {seed}"
    live.set_law(LAW)
    live.hold()
    steps(live, 300)
    assert np.abs(live.control.command).max() < 1e-3


def test_late_periods_are_counted_and_none_is_caught_up():
    now = [0.0]
    pace = Pace(0.01, lambda: now[0])
    waits = []
    for work in (0.004, 0.006, 0.043, 0.001):
        now[0] += work
        waits.append(pace.done())
        now[0] += waits[-1]
    assert waits == pytest.approx([0.006, 0.004, 0.0, 0.009])
    assert pace.missed == 3


def test_further_tasks_go_where_they_are_told_and_hold():
    robot = dqc.load_robot("two-pandas").with_task("left")
    q = np.tile([0, -0.3, 0, -2.0, 0, 1.8, 0.7], 2)
    further = [FurtherTask("right", gain=5.0, level=1), FurtherTask("posture", gain=0.5)]
    tasks = PreparedTasks(robot, further, q, np.zeros(1))
    live = Live(robot, LAW, dqc.plants.Servo(), T, start=q, tasks=tasks)
    goal = moved(robot.fkm(q, "right"), [0, 0.05, 0.05])
    live.aim(0, goal)
    live.step()
    assert 0.06 < live.state.missing < 0.08
    steps(live, 200)
    live.set_law(LAW.scaled(1.5))  # what was told stays
    steps(live, 300)
    assert live.state.missing < 1e-3
    np.testing.assert_allclose(robot.fkm(live.plant.q, "right"), goal, atol=1e-3)
    np.testing.assert_allclose(robot.fkm(live.plant.q, "left"), robot.fkm(q, "left"), atol=1e-3)
    live.aim(0, moved(goal, [0, 0, 0.3]))
    steps(live, 60)
    live.hold()
    steps(live, 200)
    assert np.abs(live.control.command).max() < 1e-3
    away = algebra.translation(robot.fkm(live.plant.q, "right")) - algebra.translation(goal)
    assert 0.01 < np.linalg.norm(away) < 0.2
    for number, pose, said in ((2, goal, "no task 2"), (1, goal, "no pose"), (0, 2 * goal, "pose")):
        with pytest.raises(Error, match=said):
            live.aim(number, pose)
