"""Sag fed forward and the disturbance observer: what they take away, when they are stable, and what they refuse."""

import numpy as np
import pytest

import dqcontrol as dqc
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
        ({"compensation": {"compliance": -1}}, "compliance"),
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
