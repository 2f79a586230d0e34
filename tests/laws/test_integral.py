"""The integral of the error in the task-space laws: what it removes, its bound, its limits of sampling."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import ValueRangeError
from dqcontrol.experiments.check import check
from dqcontrol.laws import DecoupledProportional, Proportional, ProportionalFeedforward
from dqcontrol.limits import CommandLimits, ModifiedClamping
from dqcontrol.measures.stability import gain_limits
from dqcontrol.plants import Integrator, Servo
from dqcontrol.references import SetPoint
from dqcontrol.supervisor import Supervisor
from dqcontrol_theses.variants import ClassicProportional

T = 0.01
Q0 = np.array([0.2, 0.6, 0.1, 1.6, -0.3, 0.9, 0.4])
LAWS = [Proportional, ProportionalFeedforward, ClassicProportional, DecoupledProportional]
ARM = dqc.load_robot("iiwa7")
FREE = {"integral_position_limit": 1e6, "integral_orientation_limit": 1e6}


def settled(law, plant, arm=ARM, q=Q0, duration=6.0, **options):
    target = SetPoint(arm.fkm(q))
    return dqc.simulate(arm, target, law, plant, q, period=T, duration=duration, **options)


@pytest.mark.parametrize("law", LAWS)
def test_steady_error_under_a_constant_drift_is_j_b_over_k_and_vanishes(law):
    """Joints that drift by b (rad/s) are held by u = −b: without integral the hand rests |J_p b|/k away."""
    hand = np.vstack([ARM.twist_jacobian(Q0)[:3], ARM.translation_jacobian(Q0)])
    bias = np.linalg.pinv(hand) @ [0, 0, 0, 0.01, -0.02, 0.02]  # moves no joint in vain
    plant, k = Integrator(bias=bias.tolist()), 5.0
    without = settled(law(gain=k), plant)
    assert without.position_error[-1] == pytest.approx(0.03 / k, rel=0.02)
    kept = settled(law(gain=k, integral_gain=6.0), plant, duration=15.0)
    assert kept.position_error[-1] < 1e-9
    assert kept.orientation_error[-1] < 1e-9


def test_sag_of_servos_with_measured_commands_is_carried_by_the_integral():
    """Gravity takes s(q) off every measured position; at rest T u = s(q), by K e or by the integral."""
    arm, q = dqc.load_robot("ur5"), np.array([0.3, -1.2, 1.4, -1.6, -1.5, 0.2])
    plant, k = Servo(command_mode="measured", sag=1.0, stiffness=2e4, time_constant=0.05), 10.0
    runs = [settled(Proportional(gain=k, integral_gain=i, **FREE), plant, arm, q, 12.0) for i in (0.0, 20.0)]
    for run in runs:
        sag = arm.gravity_forces(run.q[-1]) / 2e4
        np.testing.assert_allclose(run.command[-1], sag / T, rtol=1e-4, atol=1e-7)
    sag = arm.gravity_forces(q) / 2e4
    expected = np.linalg.norm(arm.translation_jacobian(q) @ sag) / (k * T)
    assert expected > 5e-3
    assert runs[0].position_error[-1] == pytest.approx(expected, rel=0.03)
    assert runs[1].position_error[-1] < 1e-6


@pytest.mark.parametrize("law", [Proportional, DecoupledProportional])
def test_integral_is_the_clamped_sum_of_the_error(law):
    """A target that stays 2 cm away asks for k e + min(k_I T e n, limit) at sample n, in the hand's axes."""
    k, gain, limit, way = 2.0, 3.0, 8e-4, np.array([0.0, 0.02, 0.0])
    target = dqc.DualQuaternion.from_translation(way) * dqc.DualQuaternion(ARM.fkm(Q0))
    prepared = law(gain=k, integral_gain=gain, integral_position_limit=limit).prepare(ARM, None, T)
    state, jacobian = prepared.initial_state(Q0), ARM.translation_jacobian(Q0)
    frame = dqc.DualQuaternion(ARM.fkm(Q0)).matrix()[:3, :3]
    error = frame.T @ way
    for n in range(1, 6):
        velocity = jacobian @ prepared.command(Q0, dqc.Sample(target), state)
        summed = np.clip(gain * T * n * error, -limit, limit)
        np.testing.assert_allclose(velocity, frame @ (k * error + summed), atol=1e-12)


@pytest.mark.usefixtures("without_growth")  # the target is nearly half a turn away
def test_a_flip_of_the_sign_of_the_target_turns_what_is_summed_and_keeps_the_sum():
    prepared = Proportional(gain=1.0, integral_gain=1.0).prepare(ARM, None, T)
    state, pose = prepared.initial_state(Q0), dqc.DualQuaternion(ARM.fkm(Q0))

    def turned(angle):
        return dqc.Sample(pose * dqc.DualQuaternion.from_axis_angle([0, 0, 1], angle))

    for _ in range(50):
        prepared.command(Q0, turned(3.0), state)
    assert state[3] == pytest.approx(T * 50 * 2 * np.sin(1.5))
    prepared.command(Q0, turned(4.0), state)  # the short way is the other way round now
    assert state[3] == pytest.approx(T * 2 * (50 * np.sin(1.5) - np.sin(2.0)))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("how", ["velocity limits", "supervisor", "interpreted"])
def test_a_step_under_limits_does_not_wind_it_up(law, how):
    """40 cm with joints at their limits: less overshoot than the 55 mm of the linear loop (without mend 109 to 136)."""
    arm = dqc.load_robot("panda")
    q = np.array([0.0, -0.4, 0, -2.0, 0, 1.6, 0.8])
    target = dqc.DualQuaternion.from_translation([0.0, 0.4, 0.0]) * dqc.DualQuaternion(arm.fkm(q))
    is_supervised = how == "supervisor"
    options = {"supervisor": Supervisor()} if is_supervised else {"limits": CommandLimits(velocity=True)}
    run = dqc.simulate(
        arm, SetPoint(target), law(gain=10.0, integral_gain=25.0), Integrator(), q, T, 4.0,
        interpreted=how == "interpreted", **options,
    )  # fmt: skip
    past = algebra.translation(run.pose)[:, 1] - algebra.translation(run.desired_pose)[:, 1]
    assert past.max() < 25e-3
    assert run.position_error[-1] < 1e-5


def test_a_blocked_joint_does_not_wind_it_up():
    """The target lies 4 s beyond a joint's limit, then within: the hand comes back at once, not 0.8 s later."""
    q = Q0.copy()
    q[3] = 1.9
    beyond, within = (ARM.fkm(q + np.eye(7)[3] * step) for step in (0.6, 0.0))
    passes = []
    for gain in (0.0, 25.0):
        prepared = Proportional(gain=10.0, integral_gain=gain).prepare(
            ARM, None, T, CommandLimits(position=ModifiedClamping())
        )
        now, state, errors = q.copy(), prepared.initial_state(q), []
        for n in range(800):
            target = dqc.Sample(beyond if n < 400 else within)
            now = now + T * prepared.command(now, target, state)
            errors.append(np.linalg.norm(algebra.translation(ARM.fkm(now)) - algebra.translation(within)))
        passes.append(np.array(errors[399:]))
    assert passes[1][0] == pytest.approx(passes[0][0], abs=1e-4)  # rests where it does without integral
    assert (passes[1] - passes[0]).max() < 0.15 * passes[0][0]  # the linear loop's own overshoot
    assert passes[1][80] < 12e-3  # without mend 66 mm


def test_compiled_and_interpreted_loops_are_equal():
    circle = dqc.references.Circle(ARM.fkm(Q0), radius=0.1, duration=1.0, plane="xz")
    law = Proportional(gain=5.0, integral_gain=4.0)
    first, second = (
        dqc.simulate(ARM, circle, law, Servo(sag=0.2), Q0, T, interpreted=way) for way in (False, True)
    )
    assert (first.q == second.q).all()


def test_position_limits_ask_twice_and_it_sums_once():
    q = Q0.copy()
    q[3] = ARM.limits.upper[3]
    target = dqc.Sample(ARM.fkm(q + 0.05 * np.eye(7)[3]))
    states, commands = [], []
    for limits in (CommandLimits(), CommandLimits(position=ModifiedClamping())):
        prepared = Proportional(gain=1.0, integral_gain=1.0).prepare(ARM, None, T, limits)
        states.append(prepared.initial_state(q))
        commands.append(prepared.command(q, target, states[-1])[3])
    assert commands[0] > 0.01
    assert commands[1] == 0
    np.testing.assert_array_equal(states[0][:7], states[1][:7])


@pytest.mark.parametrize("share", [0.1, 0.5, 2.0])
def test_limit_of_ideal_joints_is_its_closed_form(share):
    """z² − (2 − x (1 + κ x)) z + 1 − x = 0 with x = kT, κ = k_I/k²: the first root leaves at −1, x (2 + κ x) = 4."""
    model = Integrator().linear_model(ARM, Q0, T)
    assert model is not None
    expected = (np.sqrt(1 + 4 * share) - 1) / share
    assert gain_limits(model, T, 1.0, share).stable == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    "plant",
    [Integrator(), Servo(command_mode="measured", time_constant=0.05), Servo(delay=2 * T)],
    ids=["ideal", "measured", "late"],
)
def test_loops_settle_below_the_limit_and_not_above(law, plant):
    share = 0.4
    model = plant.linear_model(ARM, Q0, T)
    limit = gain_limits(model, T, 1.0, share).stable
    target = SetPoint(ARM.fkm(Q0 + 1e-6))
    for factor, stable in ((0.95, True), (1.05, False)):
        k = factor * limit / T
        run = dqc.simulate(
            ARM, target, law(gain=k, integral_gain=share * k**2, **FREE), plant, Q0, period=T, duration=4.0,
            limits=CommandLimits(),
        )  # fmt: skip
        assert (run.error[-20:].max() < run.error[0]) == stable


def spec(**law):
    return {
        "name": "sum", "robot": "iiwa7", "start": Q0.tolist(), "period": T,
        "reference": {"kind": "set-point", "duration": 0.1},
        "law": {"kind": "proportional", "gain": 10, **law}, "plant": {"kind": "servo", "delay": 2 * T},
    }  # fmt: skip


def test_check_knows_the_integral():
    without, mild, strong, wild = (check(spec(integral_gain=gain))[0] for gain in (0, 20, 80, 4000))
    assert without.worst.limits.stable > mild.worst.limits.stable > wild.worst.limits.stable
    assert mild.time_constant > without.time_constant
    assert "choose k_I ≤ k²/2 = 50 1/s²" in strong.remark
    assert wild.verdict == "unstable"
    assert check(spec(integral_gain=4000)).unstable


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"integral_gain": -1.0}, "integral_gain: must be"),
        ({"integral_gain": np.nan}, "integral_gain: must be"),
        ({"integral_gain": 1.0, "integral_position_limit": 0.0}, "integral_position_limit: must be > 0"),
        (
            {"integral_gain": 1.0, "integral_orientation_limit": -1.0},
            "integral_orientation_limit: must be > 0",
        ),
    ],
)
def test_bad_numbers_are_named(fields, words):
    with pytest.raises(ValueRangeError, match=words):
        Proportional(gain=1.0, **fields).prepare(ARM, None, T)
