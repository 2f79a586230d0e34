"""What is between a control loop and a compliant arm, and beneath it: exchange, dry friction, a base that shakes."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import Error, SafetyWarning, UnknownNameError
from dqcontrol.plants import CompliantPlant, EncoderLoss, Servo
from dqcontrol.plants.compliant import joint_columns as column
from dqcontrol.plants.plant import ControllerSettings, running_plant

pytest.importorskip("mujoco")
START = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
COMMAND = np.full(7, 0.05)


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("meka-a2")


def steps(arm, period, count, **plant):
    live = CompliantPlant(hand=True, **plant).start(arm, START, period=period, steps=count, seed=0)
    out = []
    for _ in range(count):
        live.step(COMMAND)
        out.append((live.measured.copy(), live.target, live.q.copy()))
    return [np.array(each) for each in zip(*out, strict=True)]


def test_states_and_commands_pass_at_the_rate_of_the_node(arm):
    measured, target, _ = steps(arm, 0.002, 20, exchange_period=0.01)
    new = np.flatnonzero(np.abs(np.diff(measured, axis=0)).max(axis=1) > 0) + 1
    assert {15, 20} <= set(new + 1) <= {5, 10, 15, 20}  # after k steps of 2 ms
    sent = np.flatnonzero(np.abs(np.diff(target, axis=0)).max(axis=1) > 0)
    assert (sent + 1).tolist() == [5, 10, 15]  # a command waits until the next exchange begins
    np.testing.assert_allclose(target[-1] - target[0], 0.002 * 15 * COMMAND, rtol=1e-9)


@pytest.mark.parametrize("mode", ["integrated", "measured"])
def test_an_exchange_at_every_tick_is_none(arm, mode):
    every = steps(arm, 0.008, 10, command_mode=mode, exchange_period=0.001)
    for ours, plain in zip(every, steps(arm, 0.008, 10, command_mode=mode), strict=True):
        np.testing.assert_array_equal(ours, plain)


def test_dry_friction_holds_a_motor_against_less_than_it_and_not_against_more(arm):
    moved = {}
    for force in (2.0, 40.0):
        push = {"force": [0, force, 0], "time": 0.0, "duration": 0.4}
        plant = CompliantPlant(
            mode="OFF",
            gravity=(0, 0, 0),
            dry_friction=[5, 5, 5, 5, 2, 2, 2],
            pushes=[dqc.plants.Push(**push)],
        )
        live = plant.start(arm, START, period=0.02, steps=20, seed=0)
        for _ in range(20):
            live.step(np.zeros(7))
        moved[force] = float(np.abs(live.data.qpos[7:] - START).max())
    assert moved[2.0] < 2e-3
    assert moved[40.0] > 0.1


def test_a_base_shakes_as_much_whatever_the_period_and_the_controllers_do_not_know(arm):
    for period in (0.002, 0.01):
        live = CompliantPlant(hand=True, base_shaking=0.03).start(
            arm, START, period=period, steps=300, seed=3
        )
        drawn = []
        for _ in range(300):
            live.step(np.zeros(7))
            drawn.append(live.model.opt.gravity.copy())
        drawn = np.array(drawn) - [0, 0, -9.809]
        assert np.std(drawn) * np.sqrt(period) == pytest.approx(0.03, rel=0.1)
        assert live.memory.gravity == pytest.approx([0, 0, -9.809])
    still, shaken = (steps(arm, 0.01, 100, base_shaking=each)[2] for each in (0.0, 0.03))
    assert 1e-5 < np.std(shaken - still) < 1e-2


@pytest.mark.parametrize(
    ("plant", "message"),
    [
        (
            {"exchange_period": 0.0015},
            r"^plant.exchange_period: must be a multiple of .* 0.001 s, got 0.0015",
        ),
        ({"dry_friction": [1, 2]}, r"^plant.dry_friction: expected one number or 7"),
        ({"dry_friction": -1}, r"^plant.dry_friction: must be ≥ 0, got -1"),
        ({"base_shaking": -0.1}, r"^plant.base_shaking: must be ≥ 0, got -0.1"),
    ],
)
def test_bad_input(arm, plant, message):
    with pytest.raises(Error, match=message):
        CompliantPlant(**plant).start(arm, START, period=0.008, steps=1, seed=0)


def test_a_linear_model_knows_the_delay_of_exchanges_that_begin_each_period(arm):
    def model(exchange_period, period):
        return CompliantPlant(command_mode="measured", exchange_period=exchange_period).linear_model(
            arm, START, period
        )

    assert model(0.01, 0.008) is None
    late, prompt = (model(each, 0.02) for each in (0.02, None))
    assert late is not None
    assert prompt is not None
    late, prompt = (np.abs(each.poles(80.0)).max() for each in (late, prompt))
    assert late == pytest.approx(prompt, abs=1e-6)  # an exchange a period is what a period is


def test_joint_controllers_take_mode_stiffness_and_slew_rate_while_they_run(arm):
    live = CompliantPlant(gravity_factor=0.8).start(arm, START, 0.008, 100, 0)
    own = live.memory.constants[:, column.SLEW].copy()
    for _ in range(50):
        live.step(np.zeros(7))
    stiff = np.abs(live.q - live.target).max()
    live.set_joint_control(ControllerSettings("", np.full(7, 0.5), np.full(7, 0.2)))
    assert live.mode == "THETA_GC"
    for _ in range(200):
        live.step(np.zeros(7))
    assert 1.6 < np.abs(live.q - live.target).max() / stiff < 2.4  # half the stiffness, twice the sag
    before = live.reference
    live.step(np.full(7, 50.0))
    assert np.abs(live.reference - before).max() == pytest.approx(0.2 * 0.008)
    live.set_joint_control(ControllerSettings("THETA_MJ", None, np.full(7, 99.0)))
    assert (live.memory.constants[:, column.SLEW] == np.minimum(own, 0.099)).all()  # never above the file's
    live.step(np.zeros(7))
    assert live.mode == "THETA_MJ"
    with pytest.raises(UnknownNameError, match="did you mean 'THETA'"):
        live.set_joint_control(ControllerSettings("THETTA"))


def test_after_a_fault_no_command_switches_the_motors_on_again(arm):
    losses = [EncoderLoss(joint=4, time=0.0, duration=1.0)]
    live = CompliantPlant(encoder_losses=losses).start(arm, START, 0.008, 100, 0)

    def drive():
        for _ in range(60):
            live.step(np.zeros(7))
            live.set_joint_control(ControllerSettings("THETA_GC"))

    with pytest.warns(SafetyWarning, match="encoder lost"):
        drive()
    assert live.mode == "OFF"


def test_plants_without_joint_controllers_take_no_notice(arm):
    assert Servo().joint_control(7) == ControllerSettings()
    running_plant(Servo().start(arm, START, 0.008, 1, 0)).set_joint_control(ControllerSettings("OFF"))
    told = CompliantPlant(stiffness=0.7, slew_rate=2.0).joint_control(7)
    assert told.stiffness is not None
    assert told.slew_rate is not None
    assert (told.mode, told.stiffness.tolist(), told.slew_rate.tolist()) == ("THETA_GC", [0.7] * 7, [2.0] * 7)
