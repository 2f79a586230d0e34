"""Laws against disturbances: fixed points and responses in closed form, both loops, records."""

import math
from typing import Any

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import Error, FileFormatError, ShapeError
from dqcontrol.laws import OpenLoop, Proportional
from dqcontrol.loop import close_loop
from dqcontrol.plants import (
    BandLimitedTwist,
    ConstantTwist,
    Disturbance,
    Integrator,
    MujocoPlant,
    OwnPlant,
    Servo,
    SinusoidalTwist,
    WorstCase,
)
from dqcontrol.recording import load_record, save_record
from dqcontrol.recording.export import signals
from dqcontrol.references import Circle, SetPoint

T = 0.01
Q0 = np.array([0.2, 0.6, 0.1, 1.6, -0.3, 0.9, 0.4])
K = Proportional(gain=5.0)
PUSH = Disturbance(twist=ConstantTwist(value=(0, 0, 0, 0.02, 0, -0.01)))
BOTH = Disturbance(
    twist=BandLimitedTwist(rms=(0.01, 0.02, 0.01, 0.02, 0.02, 0.02), bandwidth=5.0),
    pose=SinusoidalTwist(amplitude=(0.1, 0, 0.05, 0, 0.02, 0), frequency=2.0),
)


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def run(arm, disturbance, duration, law: Any = K, plant=None, period=T, reference=None, **options) -> Any:
    reference = reference or SetPoint(arm.fkm(Q0))
    plant = plant or Integrator()
    return dqc.simulate(arm, reference, law, plant, Q0, period, duration, disturbance=disturbance, **options)


def test_a_constant_translation_holds_the_hand_off_by_its_speed_over_the_gain(arm):
    """u = −J_h⁺v there, so k (p_d − p) = −v exactly; |1 − x*x_d| is half that distance."""
    speed = math.hypot(0.02, 0.01)
    for period in (T, 0.1):
        record = run(arm, PUSH, 6.0, period=period)
        assert record.position[-1] - record.desired_position[-1] == pytest.approx(
            [0.02 / 5, 0, -0.01 / 5], abs=1e-11
        )
        assert record.error[-1] == pytest.approx(speed / (2 * 5), rel=1e-9)
        assert record.orientation_error[-1] < 1e-9
        assert record.disturbance[-1] == pytest.approx([0, 0, 0, 0.02, 0, -0.01], abs=1e-12)


def test_a_constant_rotation_turns_the_hand_by_what_the_law_cannot_hold(arm):
    """A pure rotation θ feeds back with 2k sin(θ/2), so it rests where that equals ω; the hand's point stays."""
    record = run(arm, Disturbance(pose=ConstantTwist(value=(0, 0, 1.5, 0, 0, 0))), 8.0)
    assert record.orientation_error[-1] == pytest.approx(2 * math.asin(1.5 / (2 * 5)), rel=1e-8)
    assert record.position_error[-1] < 1e-9
    assert record.rotation_error[-1] == pytest.approx([0, 0, -record.orientation_error[-1]], abs=1e-8)


def test_worst_case_reaches_the_guaranteed_error(arm):
    case = WorstCase(level=0.02, direction=(1, 2, -1), gammas=(0.4, 0.3))
    gain = math.sqrt(0.4**-2 + 0.3**-2)
    record = run(arm, Disturbance(worst_case=case), 5.0, law=Proportional(gain=gain))
    assert record.position_error[-1] == pytest.approx(case.bound(), rel=1e-9)
    assert record.position_error.max() <= case.bound() * (1 + 1e-9)


def sine_response(record, frequency, axis):
    """Return amplitude and phase (of a sine) of the hand's displacement once the start is forgotten."""
    late = record.time > 4.0
    angle = 2 * math.pi * frequency * record.time[late]
    motion = (record.position - record.desired_position)[late, axis]
    a, b = np.linalg.lstsq(np.stack([np.sin(angle), np.cos(angle)], axis=1), motion, rcond=None)[0]
    return math.hypot(a, b), math.atan2(b, a)


@pytest.mark.parametrize("frequency", [0.5, 2.0, 10.0])
def test_a_sinusoid_comes_through_as_a_first_order_loop_lets_it(arm, frequency):
    """e(k+1) = (1 − kT) e(k) + T v(k): the transfer function is T / (z − 1 + kT)."""
    source = SinusoidalTwist(amplitude=(0, 0, 0, 0, 1e-3, 0), frequency=frequency, phase=0.3)
    record = run(arm, Disturbance(twist=source), 8.0)
    response = T / (np.exp(2j * math.pi * frequency * T) - 1 + 5 * T)
    amplitude, phase = sine_response(record, frequency, axis=1)
    assert amplitude == pytest.approx(1e-3 * abs(response), rel=2e-3)
    assert phase == pytest.approx(0.3 + np.angle(response), abs=2e-3)


@pytest.mark.parametrize("command", [0.0, 0.2], ids=["at rest", "moving"])
def test_a_pose_disturbance_is_the_real_hand_off_by_c(arm, command):
    """x(t) = x_E(t) c(t) with ẋ_E = ½(J_w q̇) x_E and ċ = ½ c w, integrated apart; the gap is of the order of T."""
    w = np.array([0.4, -0.3, 0.2, 0.05, 0.1, -0.08])
    gaps = []
    for period in (2e-3, 1e-3):
        steps = round(0.5 / period)
        q, realised = Q0.copy(), np.zeros(6)
        live = Disturbance(pose=ConstantTwist(value=tuple(w))).start(arm, period, steps, 0)
        hand, wander = arm.fkm(Q0), np.eye(8)[0]
        half = 0.5 * period * w
        for k in range(steps):
            u = command * np.cos(np.arange(7))
            moved = 0.5 * period * (arm.twist_jacobian(q) @ u)
            hand = algebra.multiply(algebra.exp_screw(moved), hand)
            wander = algebra.multiply(wander, algebra.exp_screw(half))
            live.step(arm, k, q, realised)
            q += period * u
        gaps.append(np.linalg.norm(arm.fkm(q) - algebra.multiply(hand, wander)))
    assert gaps[0] < 2e-3
    assert gaps[0] / gaps[1] == pytest.approx(2, rel=0.05)


def test_without_a_command_the_hand_follows_the_inertial_twist(arm):
    twist = np.array([0.2, 0.1, -0.3, 0.05, -0.1, 0.02])
    gaps = []
    for period in (4e-3, 2e-3):
        record = run(
            arm, Disturbance(twist=ConstantTwist(value=tuple(twist))), 0.5, law=OpenLoop(), period=period
        )
        assert np.abs(record.command).max() < 1e-12
        whole = algebra.exp_screw(0.5 * record.duration * twist)
        gaps.append(np.linalg.norm(algebra.multiply(whole, record.pose[0]) - record.pose[-1]))
    assert gaps[0] < 1e-3
    assert gaps[0] / gaps[1] == pytest.approx(2, rel=0.05)


def test_a_servo_gives_way_by_its_time_constant_times_the_push(arm):
    """q(k+1) = target + (q(k) + T v − target) e^{−T/τ}, so the joint rests T v / (e^{T/τ} − 1) off."""
    record = run(arm, PUSH, 3.0, law=OpenLoop(), plant=Servo(time_constant=0.05))
    off = record.position[-1] - record.position[0]
    assert off == pytest.approx(T / math.expm1(T / 0.05) * np.array([0.02, 0, -0.01]), abs=3e-6)
    following = run(arm, PUSH, 1.0, law=OpenLoop(), plant=Servo(time_constant=0.05, command_mode="measured"))
    drift = (following.position[-1] - following.position[0]) / following.duration
    assert drift == pytest.approx(math.exp(-T / 0.05) * np.array([0.02, 0, -0.01]), abs=1e-4)
    coarse = run(arm, PUSH, 1.0, plant=Servo(encoder_resolution=1e-3))
    assert coarse.measured[1:] / 1e-3 == pytest.approx(np.round(coarse.measured[1:] / 1e-3), abs=1e-9)


def sticky(command, parameters, noise, state, q, measured):
    for i in range(q.shape[0]):
        q[i] += parameters[0] * command[i]
        measured[i] = q[i]


PLANTS = [
    Integrator(),
    Servo(delay=2 * T, encoder_noise=1e-3, encoder_resolution=1e-4),
    OwnPlant(function=sticky),
]


@pytest.mark.parametrize("plant", PLANTS, ids=["integrator", "servo", "own"])
@pytest.mark.parametrize("disturbance", [PUSH, BOTH], ids=["push", "both"])
def test_compiled_and_interpreted_are_equal_to_the_last_bit(arm, plant, disturbance):
    circle = Circle(arm.fkm(Q0), radius=0.05, duration=2.0)
    fast, slow = (
        run(arm, disturbance, None, plant=plant, reference=circle, seed=4, interpreted=way)
        for way in (False, True)
    )
    for name in ("q", "measured", "command", "disturbance"):
        assert np.array_equal(getattr(fast, name), getattr(slow, name)), name
    assert np.isfinite(fast.q).all()
    calm = run(arm, None, None, plant=plant, reference=circle, seed=4)
    assert calm.disturbance is None
    assert np.abs(calm.q - fast.q).max() > 1e-4
    other = run(arm, disturbance, None, plant=plant, reference=circle, seed=5)
    assert np.array_equal(other.disturbance, fast.disturbance) == (
        disturbance is PUSH and not isinstance(plant, Servo)
    )


def test_the_record_holds_what_acted_at_each_sample(arm):
    record = run(arm, BOTH, 1.0, seed=7)
    rows = BOTH.samples(record.time, seed=7)
    for k in (0, 33, 99):
        pure = np.insert(rows[k, 6:], [0, 3], 0.0)
        x = record.pose[k]
        body = np.delete(algebra.multiply(algebra.multiply(x, pure), algebra.conjugate(x)), [0, 4])
        assert record.disturbance[k] == pytest.approx(rows[k, :6] + body, abs=1e-12)
    stopped = run(arm, PUSH, 5.0, stop=dqc.loop.Stop(error=1.0, samples=3))
    assert stopped.disturbance.shape == (3, 6)


def test_a_recording_and_an_export_keep_the_disturbance(arm, tmp_path):
    record = run(arm, BOTH, 0.5)
    again: Any = load_record(save_record(record, tmp_path / "record.mcap"))
    assert again.disturbance.tobytes() == record.disturbance.tobytes()
    calm = run(arm, None, 0.5)
    assert load_record(save_record(calm, tmp_path / "calm.mcap")).disturbance is None
    named = {signal.name: signal for signal in signals(record)}
    assert named["disturbance"].headings()[0] == "disturbance.wx [rad/s]"
    assert named["disturbance"].headings()[5] == "disturbance.vz [m/s]"
    assert np.array_equal(named["disturbance"].values, record.disturbance)
    assert "disturbance" not in {signal.name for signal in signals(calm)}


def test_a_record_refuses_a_disturbance_of_another_length(arm):
    record = run(arm, PUSH, 0.1)
    arrays = (record.time, record.q, record.measured, record.command, record.pose, record.desired)
    with pytest.raises(ShapeError, match=r"^disturbance: expected shape \(11, 6\), got \(10, 6\)$"):
        dqc.loop.Record(*arrays, record.joint_names, disturbance=record.disturbance[1:])
    assert not record.disturbance.flags.writeable


def test_what_does_not_fit_is_refused(arm):
    samples = SetPoint(arm.fkm(Q0)).samples(T * np.arange(20))
    law, plant = K.prepare(arm, None, T), Integrator().start(arm, Q0, T, 20, 0)
    with pytest.raises(ShapeError, match=r"^disturbance: was started for 19 periods, got 20 samples$"):
        close_loop(law, plant, samples, disturbance=PUSH.start(arm, T, 19, 0))

    class Users:
        q, measured = Q0.copy(), Q0.copy()

        def step(self, command):
            raise AssertionError("never reached")

    with pytest.raises(
        Error, match=r"^disturbance: cannot move the joints of Users, whose physics moves them; use "
    ):
        close_loop(law, Users(), samples, disturbance=PUSH.start(arm, T, 20, 0))


def spec(**changes):
    base = {
        "name": "pushed",
        "robot": "iiwa7",
        "start": Q0.tolist(),
        "period": T,
        "duration": 0.5,
        "reference": {"kind": "set-point"},
        "law": {"kind": "proportional", "gain": 5},
        "plant": {"kind": "integrator"},
        "disturbance": {"twist": {"kind": "constant", "value": [0, 0, 0, 0.02, 0, -0.01]}},
    }
    return base | changes


@pytest.mark.slow
def test_a_spec_with_a_disturbance_runs_saves_and_repeats(arm, tmp_path):
    result = dqc.run(spec())
    assert result.q == pytest.approx(run(arm, PUSH, 0.5).q, abs=1e-13)
    folder = result.save(tmp_path / "pushed")
    assert "twist that the disturbance gave the end effector" in (folder / "report.html").read_text().lower()
    again = dqc.run(folder / "spec.yaml")
    assert again.q.tobytes() == result.q.tobytes()


SIX = [0, 0, 0, 0.1, 0, 0]
UNFIT = [
    ({"twist": {"kind": "constant", "value": SIX[:5]}}, r"disturbance.twist.value: .*length 6, got"),
    ({"twist": {"kind": "constnat", "value": SIX}},
     r"disturbance.twist.kind: unknown name 'constnat'; did you mean 'constant'\?"),
    ({"twist": {"kind": "sinusoidal", "amplitude": SIX, "frequency": -2}}, r"disturbance.twist.frequency: .* > 0"),
    ({"pose": {"kind": "sinusoidal", "amplitude": SIX, "frequency": 60}}, r"disturbance.pose.frequency: must be below"),
    ({"pose": {"kind": "band-limited", "rms": SIX, "bandwith": 1}},
     r"disturbance.pose: unknown key 'bandwith'; did you mean 'bandwidth'\?"),
    ({"worst_case": {"level": 1, "direction": [0, 0, 0], "gammas": [1, 1]}}, r"direction: must not be zero"),
    ({"twits": {"kind": "constant", "value": SIX}}, r"disturbance: unknown key 'twits'; did you mean 'twist'\?"),
    ({}, r"disturbance: give twist, pose or worst_case"),
]  # fmt: skip


@pytest.mark.parametrize(("disturbance", "text"), UNFIT)
def test_a_spec_with_an_unfit_disturbance_is_refused(disturbance, text):
    with pytest.raises((FileFormatError, Error), match=text):
        dqc.run(spec(disturbance=disturbance))


def test_physics_refuses_disturbances_before_anything_moves(arm):
    pytest.importorskip("mujoco")
    with pytest.raises(Error, match="disturbance: cannot move the joints of RunningMujoco"):
        dqc.run(spec(plant={"kind": "mujoco"}))
    with pytest.raises(Error, match="disturbance: cannot move the joints of RunningMujoco"):
        run(arm, PUSH, 0.1, plant=MujocoPlant())
