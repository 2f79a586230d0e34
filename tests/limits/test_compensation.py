"""Sag fed forward and the disturbance observer: what they take away, when they are stable, and what they refuse."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import Error
from dqcontrol.experiments import check

START = [0, 0.6, 0, 1.6, 0, 0.6, 0]
SPEC = {
    "name": "left",
    "robot": "iiwa7",
    "start": START,
    "period": 0.01,
    "reference": {
        "kind": "circle",
        "radius": 0.06,
        "duration": 4,
        "ramp": 0.5,
        "preview": {"delay": 0.025, "lag": 0.05, "step": 0.01},
    },
    "law": {"kind": "proportional-feedforward", "gain": 5},
    "plant": {"kind": "servo", "time_constant": 0.05, "delay": 0.02, "sag": 1},
    "skip_initial": 0.5,
}
SAG = {"compliance": 1 / 500}
OBSERVER = {"observer": 0.05, "lag": 0.05, "delay": 0.02}


def rms(**changes):
    return dqc.run(SPEC | changes).metrics.position.settled_rms


def compensated(**given):
    return {"limits": {"compensation": given}}


def test_lag_sag_and_observer_each_take_their_part_away():
    whole = {key: value for key, value in SPEC["reference"].items() if key != "preview"}
    plain, lag = rms(reference=whole, law=SPEC["law"] | {"feedforward": "printed"}), rms()
    assert rms(reference=whole) == pytest.approx(lag)  # the preview that the plant's numbers make
    sag, observed = rms(**compensated(**SAG)), rms(**compensated(**OBSERVER))
    both = rms(**compensated(**SAG, **OBSERVER))
    assert plain == pytest.approx(3.06, abs=0.1)
    assert lag < 0.6 * plain
    assert sag < 0.12 * lag, "with gravity a tenth wrong 0.14"
    assert observed < 0.2 * plain
    assert both < 0.15 * plain
    wrong = [rms(**compensated(compliance=factor / 500)) for factor in (0.7, 1.3)]
    assert max(wrong) < 0.5 * lag


def test_sag_of_two_arms_is_taken_away():
    """What is left is the lag: with all of the sag fed forward the error is that of stiff servos."""
    start = [-0.1, -0.5, 0.1, -2.2, 0.1, 1.7, 0.8, 0.3, -0.7, -0.2, -2.1, -0.1, 1.5, 0.7]
    two = {"robot": {"source": "two-pandas", "task": "absolute"}, "start": start, "duration": 2}
    stiff = rms(**two, plant=SPEC["plant"] | {"sag": 0})
    assert rms(**two) > 1.5 * stiff
    assert rms(**two, **compensated(**SAG)) == pytest.approx(stiff, rel=0.1)


def gravity_torque(arm, q):
    """Return the slope of the potential energy."""

    def potential(q):
        return sum(
            9.81
            * mass
            * (algebra.translation(x) + algebra.matrix_from_rotation(algebra.rotation(x)) @ center)[2]
            for mass, center, x in zip(arm.inertia.mass, arm.inertia.center, arm.frames(q)[:-1], strict=True)
        )

    return np.array([(potential(q + h) - potential(q - h)) / 2e-4 for h in 1e-4 * np.eye(len(q))])


def test_what_joints_give_way_more_or_less_in_the_period_is_added_to_their_rates():
    """u + c (g(q + T u) − g(q))/T at each sample, wherever it was before."""
    arm, rng, compliance = dqc.load_robot("iiwa7"), np.random.default_rng(4), np.linspace(1, 4, 7) / 500
    law, period = dqc.laws.Proportional(gain=5.0), 0.01
    given = dqc.limits.Compensation(compliance=compliance.tolist())
    free = law.prepare(arm, None, period)
    compensated = law.prepare(arm, None, period, dqc.limits.CommandLimits(compensation=given))
    states = [each.initial_state(np.array(START)) for each in (free, compensated)]
    for _ in range(5):
        q = np.array(START) + rng.uniform(-0.4, 0.4, 7)
        sample = dqc.Sample(arm.fkm(q + rng.uniform(-0.2, 0.2, 7)))
        u, found = (
            each.command(q, sample, state) for each, state in zip((free, compensated), states, strict=True)
        )
        change = gravity_torque(arm, q + period * u) - gravity_torque(arm, q)
        assert found == pytest.approx(u + compliance * change / period, abs=1e-6)
        assert np.abs(found - u).max() > 1e-3


def test_an_observer_sees_nothing_in_an_arm_that_sags_as_it_is_told():
    """The first command: it is at rest where its targets and its weight have it."""
    arm, law = dqc.load_robot("iiwa7"), dqc.laws.Proportional(gain=5.0)
    commands = []
    for more in ({}, OBSERVER):
        given = dqc.limits.Compensation(**SAG, **more)
        prepared = law.prepare(arm, None, 0.01, dqc.limits.CommandLimits(compensation=given), "integrated")
        q = np.array(START)
        commands.append(prepared.command(q, dqc.Sample(arm.fkm(q + 0.1)), prepared.initial_state(q)))
    np.testing.assert_allclose(*commands, atol=1e-12)


def test_delays_of_whole_periods_are_whole_whatever_their_division_leaves():
    for k in range(400):
        begun, oldest, _ = dqc.limits.Compensation._answer(k * 0.01, 0.0, 0.01)
        assert (begun, oldest) == (k, 1.0)
        begun, oldest, _ = dqc.limits.Compensation._answer((k + 0.25) * 0.01, 0.0, 0.01)
        assert begun == k + 1


def test_only_what_sags_needs_inertia():
    bare = dqc.SerialArm.from_dh([0, 0], [0, 0], [0.3, 0.3], [0, 0], name="bare")
    law = dqc.laws.Proportional(gain=5.0)
    observer = dqc.limits.CommandLimits(compensation=dqc.limits.Compensation(observer=0.1))
    assert law.prepare(bare, None, 0.01, observer)
    sag = dqc.limits.CommandLimits(compensation=dqc.limits.Compensation(compliance=0.001))
    with pytest.raises(Error, match="compliance: bare has no inertia to sag under"):
        law.prepare(bare, None, 0.01, sag)


def test_it_is_the_same_compiled_and_interpreted():
    spec = SPEC | compensated(**SAG, **OBSERVER) | {"duration": 0.6}
    runs = [dqc.run(spec, interpreted=how) for how in (False, True)]
    assert np.array_equal(runs[0].q, runs[1].q)
    assert np.array_equal(runs[0].command, runs[1].command)


def test_an_observer_takes_a_constant_push_off_which_a_law_without_integral_keeps():
    rest = {"kind": "set-point", "duration": 3}
    loaded = SPEC["plant"] | {"sag": 2}  # twice the sag that is fed forward
    kept = rms(reference=rest, plant=loaded, law={"kind": "proportional", "gain": 2})
    assert kept == pytest.approx(0, abs=1e-6)  # the arm starts in balance
    offset = {"kind": "set-point", "duration": 3, "offset": {"translation": [0, 0, 0.1]}}
    # Until 1 s it is the way there that counts, which the law alone decides.
    plain, observed = (
        rms(reference=offset, plant=loaded, skip_initial=1.0, **more)
        for more in ({}, compensated(**OBSERVER))
    )
    assert observed < plain


@pytest.mark.parametrize("delay", [0.0, 0.004, 0.02, 0.027])
def test_an_observer_with_the_true_model_sees_nothing(delay):
    """Whole periods of delay and parts of them: without a disturbance the commands stay as they were."""
    plant = SPEC["plant"] | {"delay": delay, "sag": 0, "rate_limit": False}
    spec = SPEC | {"plant": plant, "duration": 1.0}
    plain, observed = (dqc.run(spec | more) for more in ({}, compensated(**OBSERVER | {"delay": delay})))
    np.testing.assert_allclose(observed.command, plain.command, atol=1e-9)


@pytest.mark.parametrize(("tau", "stable"), [(0.2, True), (0.05, False)])
def test_check_knows_when_a_wrong_model_makes_it_unstable(tau, stable):
    """100 ms more delay than the model has."""
    plant = SPEC["plant"] | {"delay": 0.12, "sag": 0, "rate_limit": False}
    law = {"kind": "proportional-feedforward", "gain": 1.5}
    spec = SPEC | {"plant": plant, "law": law} | compensated(**(OBSERVER | {"observer": tau}))
    spec["limits"]["velocity"] = False
    (row,) = check(spec)
    assert (row.verdict != "unstable") is stable
    assert ("unstable: so is the plant with its observer, with any gain; give" in row.remark) is not stable
    peak = dqc.run(spec).metrics.position.peak
    assert (peak < 10) is stable


@pytest.mark.parametrize("delay", [0.0, 0.004, 0.02, 0.027])
def test_the_linear_model_of_an_observer_with_the_true_model_is_that_of_the_plant(delay):
    """Random commands move x as they do without an observer, which has nothing to take off."""
    arm, rng = dqc.load_robot("iiwa7"), np.random.default_rng(20261128)
    model = dqc.plants.Servo(time_constant=0.05, delay=delay).linear_model(arm, np.array(START), 0.01)
    compensation = dqc.limits.Compensation(**OBSERVER | {"delay": delay})
    transition, inputs = compensation.behind(model.transition, model.inputs, 7, 0.01)
    size, m = model.inputs.shape
    x, state = np.zeros(size), np.zeros(len(transition))
    for _ in range(30):
        command = rng.standard_normal(m)
        x, state = model.transition @ x + model.inputs @ command, transition @ state + inputs @ command
        np.testing.assert_allclose(state[:size], x, atol=1e-12)


def test_a_true_model_leaves_the_loop_its_margin():
    (plain,) = check(SPEC)
    (observed,) = check(SPEC | compensated(**OBSERVER))
    assert observed.worst.margin == pytest.approx(plain.worst.margin, rel=0.02)


@pytest.mark.parametrize(
    ("limits", "text"),
    [
        (
            {"compensation": SAG, "position": {"kind": "modified-clamping"}},
            "'position' and 'compensation' do not go",
        ),
        ({"compensation": {"compliance": -1e-9}}, "compliance"),
        ({"compensation": {"compliance": [0, 0, 0, -1e-9, 0, 0, 0]}}, "compliance[3]"),
        ({"compensation": {"observer": 0}}, "observer"),
        ({"compensation": {"delay": [0.1, 0.2]}}, "limits.compensation.delay: expected one number or 7"),
        (
            {"compensation": {"delay": "20.01 s", "observer": 1}},
            "limits.compensation.delay: must be ≤ 2000 periods",
        ),
    ],
)
def test_a_mistake_is_one_clear_line(limits, text):
    with pytest.raises(Error, match=None) as caught:
        dqc.run(SPEC | {"limits": limits})
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)
