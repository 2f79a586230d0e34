"""One joint's controller, tick by tick, against the modes' equations."""

import math

import numpy as np
import pytest

from dqcontrol.plants.compliant import joint_columns as column
from dqcontrol.plants.compliant.compliant_step import arm_memory
from dqcontrol.plants.compliant.elastic_model import TICK
from dqcontrol.plants.compliant.joint_columns import butterworth
from dqcontrol.plants.compliant.joint_controller import control, drive, integrated, sense, step_reference


def joint(**values):
    """Return constants of a joint that clamps nothing, with some of them set."""
    row = np.zeros(column.CONSTANTS)
    row[column.LOWER], row[column.UPPER], row[column.SLEW], row[column.SPEED] = -10, 10, 1e9, 1.0
    for greatest in (column.MAX_TORQUE, column.MAX_CURRENT, column.NOMINAL_CURRENT, column.OVERLOAD_TICKS):
        row[greatest] = 1e9
    row[
        [
            column.TORQUE_CONSTANT,
            column.RESISTANCE,
            column.VOLTAGE,
            column.MAX_DUTY,
            column.STIFFNESS,
            column.SPRING,
        ]
    ] = 1.0
    for first in (column.ANGLE_FILTER, column.VELOCITY_FILTER, column.TORQUE_RATE_FILTER):
        row[first : first + 5] = butterworth(100.0, TICK)
    for name, value in values.items():
        row[getattr(column, name)] = value
    return row


def at(**values):
    row = np.zeros(column.STATE)
    for name, value in values.items():
        row[getattr(column, name)] = value
    return row


def current(mode, constants, state, ramp=1.0, rotor=0.0, rotor_velocity=0.0):
    drive(constants, state, column.MODES[mode], ramp, rotor, rotor_velocity)
    return state[column.CURRENT]


def test_off_gives_no_current():
    assert current("OFF", joint(), at(CURRENT=3.0, TARGET=1.0)) == 0


def test_pwm_drives_current_through_the_winding_against_the_motors_voltage():
    constants = joint(DUTY_ASKED=0.5, VOLTAGE=24.0, RESISTANCE=2.0, TORQUE_CONSTANT=3.0, MAX_DUTY=0.4)
    state = at()
    assert current("PWM", constants, state, rotor_velocity=0.7) == pytest.approx((0.4 * 24 - 3 * 0.7) / 2)
    assert state[column.MOTOR_TORQUE] == pytest.approx(3 * state[column.CURRENT])
    assert state[column.DUTY] == pytest.approx(0.4)


def test_pwm_ramps_from_the_duty_at_the_switch():
    constants = joint(DUTY_ASKED=0.5, VOLTAGE=10.0)
    assert current("PWM", constants, at(DUTY_AT_SWITCH=0.1), ramp=0.25) == pytest.approx(
        10 * (0.25 * 0.5 + 0.75 * 0.1)
    )


@pytest.mark.parametrize(("mode", "gravity"), [("TORQUE", 0.0), ("TORQUE_GC", 2.5)])
def test_torque_modes_ramp_and_clamp_the_desired_torque(mode, gravity):
    constants = joint(TORQUE_ASKED=4.0, FEEDFORWARD=1.0, MAX_TORQUE=6.0)
    state = at(GRAVITY=2.5, TORQUE_AT_SWITCH=1.0)
    for ramp in (0.0, 0.3, 1.0):
        current(mode, constants, state, ramp)
        assert state[column.DESIRED_TORQUE] == pytest.approx(
            min(6.0, ramp * (4 + gravity) + (1 - ramp) * 1.0)
        )


@pytest.mark.parametrize("mode", ["THETA_GC", "THETA_GC_MJ"])
def test_theta_gc_is_stiffness_times_pid_and_gravity(mode):
    constants = joint(
        STIFFNESS=0.6, POSITION_P=50.0, POSITION_I=2.0, POSITION_D=3.0, POSITION_LIMIT=9.0, POSITION_RANGE=1.0
    )
    state = at(
        TARGET=0.3, REFERENCE=0.3, GOAL=0.3, ANGLE=0.1, VELOCITY=0.4, GRAVITY=7.0, POSITION_INTEGRAL=1.0
    )
    current(mode, constants, state)
    pid = 50 * 0.2 + (1 + 2 * 0.2) - 3 * 0.4
    assert state[column.DESIRED_TORQUE] == pytest.approx(0.6 * pid + 7.0)
    assert state[column.POSITION_INTEGRAL] == pytest.approx(1.4)


@pytest.mark.parametrize("mode", ["THETA", "THETA_MJ"])
def test_theta_is_a_servo_on_the_motors_angle(mode):
    constants = joint(SERVO_P=200.0, SERVO_D=8.0, TORQUE_CONSTANT=4.0)
    state = at(TARGET=0.3, REFERENCE=0.3, GOAL=0.3, ANGLE=9.0, TORQUE_AT_SWITCH=5.0, GRAVITY=7.0)
    servo = 200 * (0.3 - 0.25) - 8 * 0.5
    assert current(mode, constants, state, rotor=0.25, rotor_velocity=0.5) == pytest.approx(servo / 4)
    state[column.ANGLE_AT_SWITCH] = 0.3
    ramped = (0.2 * servo + 0.8 * 5) / 4
    assert current(mode, constants, state, ramp=0.2, rotor=0.25, rotor_velocity=0.5) == pytest.approx(ramped)


def test_torque_loop_is_a_pid_with_feedforward_and_clamped_current():
    constants = joint(
        TORQUE_ASKED=3.0,
        TORQUE_P=0.5,
        TORQUE_I=0.1,
        TORQUE_D=0.02,
        TORQUE_LIMIT=1.0,
        TORQUE_RANGE=10.0,
        FEEDFORWARD=0.25,
    )
    state = at(SENSED=1.0, TORQUE_RATE=5.0, TORQUE_INTEGRAL=0.3)
    assert current("TORQUE", constants, state) == pytest.approx(0.5 * 2 + (0.3 + 0.2) - 0.02 * 5 + 0.25 * 3)
    constants[column.MAX_CURRENT] = 0.4
    assert current("TORQUE", constants, state) == 0.4
    constants[column.TORQUE_ASKED] = -30
    assert current("TORQUE", constants, state) == -0.4


def test_a_rigid_joints_torque_is_the_one_at_which_its_loop_would_end():
    """τ = k_τ (k_p (τ_d − τ) + f τ_d), whatever was sensed."""
    constants = joint(SPRING=0.0, TORQUE_ASKED=3.0, TORQUE_P=1.2, TORQUE_D=0.02, TORQUE_CONSTANT=3.6)
    for forward in (0.0, 0.1):
        constants[column.FEEDFORWARD] = forward
        state = at(SENSED=-40.0, TORQUE_RATE=5.0)
        torque = 3.6 * current("TORQUE", constants, state)
        assert torque == pytest.approx(3.6 * (1.2 * (3.0 - torque) + forward * 3.0))


def test_integrals_grow_within_reach_only_but_always_shrink_and_stay_in_their_limit():
    assert integrated(0.5, (0.0, 0.1, 0.0, 1.0, 3.0), 2.0) == pytest.approx(0.7)
    assert integrated(0.5, (0.0, 0.1, 0.0, 1.0, 1.0), 2.0) == 0.5  # the error is out of reach
    assert integrated(0.5, (0.0, 0.1, 0.0, 1.0, 1.0), -2.0) == pytest.approx(0.3)
    assert integrated(0.95, (0.0, 0.1, 0.0, 1.0, 3.0), 2.0) == 1.0
    assert integrated(0.5, (0.0, 0.0, 0.0, 1.0, 3.0), 2.0) == 0.0  # no gain, no integral


def test_reference_is_ramped_kept_in_range_and_limited_in_rate():
    constants = joint(LOWER=-0.5, UPPER=0.5, SLEW=0.01)
    state = at(TARGET=2.0, REFERENCE=0.1, ANGLE_AT_SWITCH=0.0)
    step_reference(constants, state, 1.0, False)
    assert state[column.REFERENCE] == pytest.approx(0.11)
    for _ in range(100):
        step_reference(constants, state, 1.0, False)
    assert state[column.REFERENCE] == pytest.approx(0.5)
    step_reference(joint(), state, 0.1, False)
    assert state[column.REFERENCE] == pytest.approx(0.2)  # ramp · target + (1 − ramp) · angle at the switch


def test_minimum_jerk_reference_is_the_quintic():
    """From rest at 0 to rest at 1 in a second: 10 s³ − 15 s⁴ + 6 s⁵."""
    constants, state = joint(SPEED=1.0), at(TARGET=1.0)
    for k in range(1, 1200):
        step_reference(constants, state, 1.0, True)
        s = min(k * TICK, 1.0)
        assert state[column.REFERENCE] == pytest.approx(10 * s**3 - 15 * s**4 + 6 * s**5, abs=1e-12)


def test_minimum_jerk_reference_is_planned_anew_without_a_jump():
    constants, state = joint(SPEED=0.5), at(TARGET=1.0)
    rows = []
    for k in range(4000):
        if k == 700:
            state[column.TARGET] = -0.4
        step_reference(constants, state, 1.0, True)
        rows.append(state[[column.REFERENCE, column.REFERENCE_VELOCITY, column.REFERENCE_ACCELERATION]])
    x, v, a = np.array(rows).T
    np.testing.assert_allclose(np.diff(x)[:-1], (TICK * v)[1:-1], atol=5e-6)
    assert np.abs(np.diff(v)).max() < 2e-2
    assert np.abs(np.diff(a)[600:1000]).max() < 0.2  # the acceleration is continuous where the goal changes
    assert x[-1] == -0.4
    assert v[-1] == a[-1] == 0


def test_a_switch_starts_at_what_is_measured_and_takes_a_second():
    sizes = 7, 0, 0, 0
    arm = arm_memory(np.zeros(arm_memory.size(*sizes)), *sizes)
    arm.constants[:] = joint(TORQUE_ASKED=2.0, FEEDFORWARD=1.0)
    arm.state[:] = at(SENSED=0.5, ANGLE=0.2, TORQUE_INTEGRAL=3.0, REFERENCE=0.9)
    state, shared = arm.state, arm.shared
    shared[column.MODE], shared[column.ASKED_MODE] = column.MODES["THETA"], column.MODES["TORQUE"]
    shared[column.RAMP], shared[column.RAMP_STEP] = 1.0, 1e-3
    shared[column.MOST_AGE], shared[column.MOST_LOST] = 1e9, 1e9
    for k in range(1, 1500):
        control(arm)
        s = min(1.0, k * 1e-3)
        np.testing.assert_allclose(state[:, column.DESIRED_TORQUE], s * 2 + (1 - s) * 0.5, atol=1e-12)
    assert (state[:, column.REFERENCE] == 0.2).all()
    assert (state[:, column.TORQUE_INTEGRAL] == 0).all()


def test_sensors_have_their_steps_and_filters():
    step = 2 * math.pi / 16383
    constants = joint(ANGLE_RESOLUTION=step, TORQUE_RESOLUTION=0.0114)
    state = at()
    for k in range(400):
        sense(constants, state, 0.5 * k * TICK, 3.0, False)
    assert state[column.ENCODER] / step == pytest.approx(round(0.5 * 399 * TICK / step), abs=1e-9)
    assert state[column.SENSED] == pytest.approx(round(3.0 / 0.0114) * 0.0114)
    assert state[column.VELOCITY] == pytest.approx(0.5, rel=0.2)  # the encoder's steps show through
    assert state[column.ANGLE] == pytest.approx(0.5 * 399 * TICK, abs=3e-3)


def test_heat_follows_the_square_of_the_current():
    constants = joint(TORQUE_ASKED=2.0, FEEDFORWARD=1.0, NOMINAL_CURRENT=1.0, HEATING=1e-3)
    state = at()
    for _ in range(1000):
        current("TORQUE", constants, state)
    assert state[column.HEAT] == pytest.approx(4 * (1 - 0.999**1000))
    assert state[column.HOT_TICKS] == sum(4 * (1 - 0.999**k) > 1 for k in range(1, 1001))
