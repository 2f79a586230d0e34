"""Laws of unknown loop gains: the turning point of finite differences against closed loops at both sides."""

from pathlib import Path

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.experiments import check
from dqcontrol.experiments.run import run
from dqcontrol.laws import OwnLaw, Proportional
from dqcontrol.measures.stability import NumericLoop, gain_limits, linearise_law
from dqcontrol.plants import Integrator, MujocoPlant, OwnPlant, Servo
from dqcontrol.references import SetPoint
from dqcontrol_theses.variants import Cascade

DAMPED_TRANSPOSE = f"{Path(__file__).parents[2] / 'examples/my_motion.py'}:damped_transpose"
T = 0.01
Q0 = np.array([0.2, 0.6, 0.1, 1.6, -0.3, 0.9, 0.4])
FREE = dqc.limits.CommandLimits(velocity=False)
PLANTS = {
    "ideal": Integrator(),
    "servo": Servo(time_constant=0.05, delay=0.02),
    "measured": Servo(command_mode="measured", time_constant=0.05, delay=0.013),
}


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def jump(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """A command of one size, towards the target."""
    for i in range(out.shape[0]):
        out[i] = 0.0
        for k in range(8):
            out[i] += pose_jacobian[k, i] * (sample[k] - pose[k])
        out[i] = parameters[0] * np.sign(out[i])


def idle(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """No command."""
    for i in range(out.shape[0]):
        out[i] = 0.0


def k_in_python(gain):
    """Return law K as an own law: Jᵀ(J Jᵀ)⁻¹ of the body error, by NumPy."""

    def own_k(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
        relative = dqc.algebra.multiply(dqc.algebra.conjugate(sample[:8].copy()), pose)
        twist = -parameters[0] * 2 * dqc.algebra.log_body(dqc.algebra.short(relative))
        inertial = dqc.algebra.adjoint_twist(pose, twist)
        out[:] = np.linalg.pinv(twist_jacobian) @ inertial

    return OwnLaw(function=own_k, parameters=[gain])


def errors_at_both_ends(robot, law, plant, start, steps, factor=1.0):
    """Return the first error and the largest of the last tenth, with the law's command multiplied by a factor."""
    prepared = law.prepare(robot, None, T, FREE)
    state, live = prepared.initial_state(start), plant.start(robot, start, T, steps, 0)
    goal = dqc.Sample(robot.fkm(robot.integrate(start, np.full(robot.input_size, 1e-5), 1.0)))
    errors = []
    for _ in range(steps):
        live.step(factor * prepared.command(live.measured, goal, state))
        error = dqc.algebra.short(dqc.algebra.multiply(dqc.algebra.conjugate(robot.fkm(live.q)), goal.pose))
        errors.append(np.linalg.norm(error - [1, 0, 0, 0, 0, 0, 0, 0]))
        if errors[-1] > 0.1:
            return errors[0], np.inf
    return errors[0], max(errors[-steps // 10 :])


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("smoothing", [1.0, 0.2])
def test_an_own_law_turns_unstable_where_it_is_said_to(arm, plant, smoothing):
    def law(gain):
        return OwnLaw(function=DAMPED_TRANSPOSE, parameters=[gain, smoothing], memory=7)

    model = PLANTS[plant].linear_model(arm, Q0, T)
    loop = NumericLoop(linearise_law(law(10.0).prepare(arm, None, T), Q0), model)
    for share, stable in ((0.95, True), (1.05, False)):
        gain = 10.0 * share * loop.margin
        goal = SetPoint(arm.fkm(Q0 + 1e-6))
        record = dqc.simulate(arm, goal, law(gain), PLANTS[plant], Q0, T, 20.0, limits=FREE)
        first, last = record.error[0], record.error[-200:].max()
        assert last < first if stable else last > 20 * first, (share, first, last)
        judged = NumericLoop(linearise_law(law(gain).prepare(arm, None, T), Q0), model)
        assert judged.is_stable == stable
        assert judged.margin * share == pytest.approx(1, rel=1e-4)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::dqcontrol.errors.InterpretedWarning")
@pytest.mark.parametrize("plant", [*PLANTS, "physics"])
def test_k_given_as_an_own_law_is_judged_as_k_is(arm, plant):
    if plant == "physics":
        pytest.importorskip("mujoco")
    model = (MujocoPlant() if plant == "physics" else PLANTS[plant]).linear_model(arm, Q0, T)
    limit = gain_limits(model, T).stable / T
    for gain in (0.9 * limit, 1.2 * limit):
        own, k = (
            NumericLoop(linearise_law(law.prepare(arm, None, T), Q0), model)
            for law in (k_in_python(gain), Proportional(gain=gain))
        )
        assert own.margin == pytest.approx(k.margin, rel=1e-5)
        assert own.margin * gain == pytest.approx(limit, rel=0.01 if plant == "physics" else 1e-5)
        assert own.is_stable == (gain < limit)


@pytest.mark.slow
def test_a_cascade_turns_unstable_where_it_is_said_to():
    body, start = dqc.load_robot("little-john"), np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
    law = Cascade(stiffness=16.0, damping=4.0)
    loop = NumericLoop(
        linearise_law(law.prepare(body, None, T), start), Integrator().linear_model(body, start, T)
    )
    for share, stable in ((0.95, True), (1.05, False)):
        first, last = errors_at_both_ends(body, law, Integrator(), start, 2000, share * loop.margin)
        assert last < first if stable else last > 20 * first, (share, first, last)


def spec(**changed):
    return {
        "name": "own",
        "robot": "iiwa7",
        "start": Q0.tolist(),
        "period": T,
        "reference": {"kind": "set-point", "duration": 1},
        "plant": {"kind": "servo", "delay": 0.02},
        **changed,
    }


def test_a_check_judges_an_own_law_and_a_run_warns():
    laws = {
        name: {"kind": "own", "function": DAMPED_TRANSPOSE, "parameters": [gain, 0.5], "memory": 7}
        for name, gain in (("slow", 2.0), ("fast", 500.0))
    }
    checks = check(spec(laws=laws))
    slow, fast = checks
    assert (slow.verdict, fast.verdict) == ("stable", "unstable")
    assert slow.numeric
    assert fast.numeric
    assert slow.numeric.margin * 2 == pytest.approx(fast.numeric.margin * 500, rel=1e-4)
    assert "by numeric linearisation at the start only" in slow.remark
    assert checks.unstable
    assert checks.table().with_columns(["verdict"]).texts()[0][-1] == "stable"
    with pytest.warns(
        dqc.errors.StabilityWarning, match="unstable by numeric linearisation at the start only"
    ):
        run(spec(law=laws["fast"]))


@pytest.mark.parametrize(
    ("function", "verdict", "remark"),
    [
        ("jump", "cannot be decided", "its command jumps or bends at the start"),
        ("idle", "drifts", "nothing corrects its errors"),
    ],
)
def test_what_has_no_linearisation(function, verdict, remark):
    law = {"kind": "own", "function": f"{__file__}:{function}", "parameters": [0.1]}
    (row,) = check(spec(law=law))
    assert row.verdict == verdict
    assert row.remark.endswith(remark)


def lagging(command, parameters, noise, state, q, measured):
    """Joints that follow targets with a lag, measured a period late, with noise."""
    for i in range(q.shape[0]):
        measured[i] = q[i] + 1e-3 * noise[i]
        state[i] += parameters[0] * command[i]
        q[i] += parameters[1] * (state[i] - q[i])


def sticky(command, parameters, noise, state, q, measured):
    """Joints that do not move below a speed."""
    for i in range(q.shape[0]):
        if abs(command[i]) > 0.01:
            q[i] += parameters[0] * command[i]
        measured[i] = q[i]


def test_an_own_plant_is_judged_as_the_same_of_the_library(arm):
    """A lag of share 1 − exp(−T/τ) of the way to the target, and of one period of delay."""
    own = OwnPlant(function=lagging, parameters=[1 - np.exp(-T / 0.05)], state=Q0.tolist(), noise=7)
    found = gain_limits(own.linear_model(arm, Q0, T), T)
    known = gain_limits(Servo(time_constant=0.05, delay=T).linear_model(arm, None, T), T)
    assert [found.stable, found.recommended] == pytest.approx([known.stable, known.recommended], rel=1e-4)


def test_a_dead_zone_has_no_linear_model(arm):
    assert OwnPlant(function=sticky).linear_model(arm, Q0, T) is None
