"""What happens to a compliant arm from outside: pushes, payloads, faults, modes that change; and what it senses."""

from typing import Any

import msgspec
import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.contact import Tool
from dqcontrol.errors import FileFormatError, SafetyWarning, ShapeError, ValueRangeError
from dqcontrol.files.yaml_file import convert
from dqcontrol.plants import CompliantPlant, EncoderLoss, Payload, Push
from dqcontrol.plants.compliant.controller_file import load_controllers
from dqcontrol.robots.files.load import load_robot
from dqcontrol.supervisor import Supervisor

mujoco: Any = pytest.importorskip("mujoco")

SEED = 20260904
MEKA, IIWA = load_robot("meka-a2"), load_robot("iiwa7")
Q0 = np.array([0, np.pi / 5, 0, np.pi / 2, 0, np.pi / 5, 0])
QI = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
T = 0.008
G = np.array([0, 0, -9.809])


def rest(live, seconds):
    for _ in range(round(seconds / T)):
        live.step(np.zeros(7))


def reading(live, name):
    first = 0
    for channel in live.channels:
        if channel.name == name:
            return live.readings[first : first + channel.size].copy()
        first += channel.size
    raise KeyError(name)


def hand_jacobian(robot, q):
    """Return how the hand's point moves, shape (3, n), by finite differences."""

    def point(q):
        return dqc.DualQuaternion(robot.fkm(q)).translation

    return np.array([(point(q + h) - point(q - h)) / 2e-6 for h in 1e-6 * np.eye(len(q))]).T


@pytest.mark.parametrize("point", ["hand", "link 7"])
def test_a_push_bends_the_arm_by_its_torques_over_the_gains(point):
    force = (6.0, -9.0, 12.0)
    live = CompliantPlant(pushes=[Push(time=0.5, duration=3.0, force=force, point=point)]).start(
        IIWA, QI, T, 0, 0
    )
    rest(live, 0.496)
    assert np.abs(live.q - QI).max() < 1e-5
    assert (reading(live, "push") == 0).all()
    rest(live, 2.0)
    jacobian = hand_jacobian(IIWA, live.q)
    if point == "link 7":
        body, other = np.empty((3, 7)), np.empty((3, 7))
        mujoco.mj_jacBodyCom(live.model, live.data, body, other, live.model.body("link_7").id)
        jacobian = body
    give = jacobian.T @ force / load_controllers(IIWA).column("position_loop", "k_p")
    np.testing.assert_allclose(live.q - live.reference, give, rtol=0.02, atol=2e-5)
    np.testing.assert_allclose(reading(live, "push"), force)
    rest(live, 3.0)
    assert np.abs(live.q - QI).max() < 1e-4
    assert (reading(live, "push") == 0).all()


def test_an_unknown_payload_hangs_on_the_hand_for_a_while():
    mass = 1.5
    live = CompliantPlant(payload=Payload(mass=mass, begin=0.5, until=3.5)).start(IIWA, QI, T, 0, 0)
    whole = live.model.body_mass.sum()
    rest(live, 2.4)
    assert live.model.body_mass.sum() == pytest.approx(whole + mass)
    assert live.model.body_subtreemass[0] == pytest.approx(whole + mass)
    assert reading(live, "payload") == mass
    give = hand_jacobian(IIWA, live.q).T @ (mass * G) / load_controllers(IIWA).column("position_loop", "k_p")
    np.testing.assert_allclose(live.q - live.reference, give, rtol=0.02, atol=2e-5)
    rest(live, 3.0)
    assert live.model.body_mass.sum() == pytest.approx(whole)
    assert np.abs(live.q - QI).max() < 1e-4


def test_payloads_come_and_go_one_by_one():
    plant = CompliantPlant(payload=[Payload(mass=0.3, until=0.4), Payload(mass=0.5, begin=0.2, until=0.8)])
    live = plant.start(IIWA, QI, T, 0, 0)
    whole, carried = live.model.body_mass.sum(), []
    for _ in range(5):
        rest(live, 0.2)
        carried.append(reading(live, "payload")[0])
        assert live.model.body_mass.sum() == pytest.approx(whole + carried[-1])
    assert carried == pytest.approx([0.3, 0.8, 0.5, 0.5, 0.0])


def test_the_wrist_feels_the_hand_the_payload_and_the_push():
    plant = CompliantPlant(
        mode="THETA",
        hand=True,
        payload=Payload(mass=0.5, begin=0.0),
        pushes=[Push(time=0.0, duration=10.0, force=(3.0, 0, 0))],
    )
    live = plant.start(MEKA, Q0, T, 0, SEED)
    rest(live, 2.0)
    rows = []
    for _ in range(400):
        live.step(np.zeros(7))
        rows.append(np.concatenate([reading(live, "wrist_force"), reading(live, "wrist_torque")]))
    r = live.data.site("hand").xmat.reshape(3, 3)
    center = np.array([-0.00286004, 0.00206754, 0.06242752])
    weight, other = r.T @ (0.838 * G), r.T @ (0.5 * G + np.array([3.0, 0, 0]))
    expected = np.concatenate([weight + other, np.cross(center, weight)])
    np.testing.assert_allclose(np.mean(rows, axis=0), expected, atol=0.03)
    spread = np.std(rows, axis=0)
    np.testing.assert_allclose(spread[:3], 0.1, rtol=0.12)
    np.testing.assert_allclose(spread[3:], 0.005, rtol=0.12)


def test_a_wrist_that_holds_still_feels_the_declared_payload_alone():
    """Its sign and its frame are those that the supervisor takes the weight off in."""
    body = load_controllers(MEKA).hand(True)
    assert body is not None
    payload = Tool(mass=body.mass, center=tuple(body.center))
    live = CompliantPlant(mode="THETA", hand=True).start(MEKA, Q0, T, 0, SEED)
    rest(live, 2.0)
    for carried, told in ((payload, ""), (None, "stop category 1: contact")):
        bounds = Supervisor(contact_force=1.0, contact_torque=0.05, payload=carried)
        supervisor = bounds.prepare(MEKA, T)
        state = supervisor.start(live.measured)
        supervisor.command(live.measured, np.zeros(7), state, wrench=live.wrench)
        assert supervisor.describe_stop(state) == told


def test_a_command_too_old_switches_the_motors_off():
    live = CompliantPlant().start(MEKA, Q0, T, 0, 0)
    live.step(np.zeros(7))
    live.wait(0.19)
    assert not live.fault
    with pytest.warns(SafetyWarning, match="no command: the motors are off"):
        live.wait(0.02)
    assert (live.mode, live.fault) == ("OFF", "no command")
    rest(live, 1.0)
    assert (reading(live, "motor_current") == 0).all()
    assert np.abs(live.q - Q0).max() > 0.2  # the arm falls


def test_a_period_longer_than_the_timeout_is_too_long():
    live = CompliantPlant().start(MEKA, Q0, 0.3, 0, 0)
    with pytest.warns(SafetyWarning, match="no command"):
        live.step(np.zeros(7))


def test_a_lost_encoder_switches_the_motors_off():
    live = CompliantPlant(encoder_losses=[EncoderLoss(time=0.2, duration=0.5, joint=4)]).start(
        MEKA, Q0, T, 0, 0
    )
    rest(live, 0.288)
    assert not live.fault
    with pytest.warns(SafetyWarning, match="right_arm_j3: encoder lost"):
        rest(live, 0.1)
    assert live.mode == "OFF"


def test_a_short_loss_does_no_harm():
    live = CompliantPlant(encoder_losses=[EncoderLoss(time=0.2, duration=0.09, joint=4)]).start(
        MEKA, Q0, T, 0, 0
    )
    rest(live, 1.0)
    assert not live.fault


def test_a_motor_too_hot_switches_the_motors_off(tmp_path):
    """With the current i the heat passes 1 after −τ ln(1 − (i_n / i)²), and the overload time later it ends."""
    data = msgspec.to_builtins(load_controllers(MEKA))
    data["joints"][1]["motor"].update(nominal_current=1.5, thermal_time=2.0, overload_time=0.5)
    path = tmp_path / "weak.yaml"
    path.write_bytes(msgspec.yaml.encode(data))
    live = CompliantPlant(controllers=str(path)).start(MEKA, Q0, T, 0, 0)
    rest(live, 0.4)
    currents = []
    for _ in range(100):
        live.step(np.zeros(7))
        currents.append(reading(live, "motor_current")[1])
    end = 0.5 - 2.0 * np.log(1 - 1.5**2 / np.mean(np.square(currents)))
    assert 1.5 < end < 5
    rest(live, end - live.time - 0.1)
    assert not live.fault
    with pytest.warns(SafetyWarning, match="right_arm_j1: motor too hot"):
        rest(live, 0.2)
    assert live.mode == "OFF"


def test_modes_change_smoothly_and_a_fault_can_be_cleared():
    live = CompliantPlant().start(IIWA, QI, T, 0, 0)
    for mode in ("TORQUE_GC", "THETA_GC_MJ", "TORQUE_GC", "THETA_GC"):
        live.switch(mode)
        rest(live, 1.5)
        assert live.mode == mode
        assert np.abs(live.q - QI).max() < 0.1
    live.wait(0.1)
    with pytest.warns(SafetyWarning):
        live.wait(0.2)
    live.switch("THETA_GC")
    live.step(np.zeros(7))
    assert (live.mode, live.fault) == ("THETA_GC", "")


def test_without_integral_the_torque_loop_lets_a_floating_arm_sink():
    live = CompliantPlant(mode="TORQUE_GC").start(MEKA, Q0, T, 0, 0)
    rest(live, 2.0)
    hand = (
        dqc.DualQuaternion(MEKA.fkm(live.q)).translation[2] - dqc.DualQuaternion(MEKA.fkm(Q0)).translation[2]
    )
    assert hand < -0.1


def test_unknown_modes_are_named():
    live = CompliantPlant().start(MEKA, Q0, T, 0, 0)
    with pytest.raises(KeyError, match="mode: unknown name 'TETA'; did you mean 'THETA'"):
        live.switch("TETA")


def record(tmp_path=None, **plant):
    circle = dqc.references.Circle(MEKA.fkm(Q0), radius=0.02, duration=0.4, plane="xy")
    return dqc.simulate(MEKA, circle, dqc.laws.Proportional(gain=3.0), CompliantPlant(**plant), Q0, period=T)


def test_what_the_arm_senses_is_recorded_and_saved(tmp_path):
    from dqcontrol.recording import export_record, load_record, save_record

    run = record(pushes=[Push(time=0.2, duration=1.0, force=(0, 0, 5.0))])
    assert set(run.readings) == {
        "motor_angle",
        "reference",
        "desired_torque",
        "spring_torque",
        "motor_current",
        "wrist_force",
        "wrist_torque",
        "push",
        "payload",
        "mode",
    }
    push = run.readings["push"]
    assert (push.parts, push.units) == (("x", "y", "z"), ("N", "N", "N"))
    np.testing.assert_array_equal(push.values[:, 2], np.where(run.time > 0.2, 5.0, 0.0))
    stiffness = load_controllers(MEKA).stiffness("default")
    spring = stiffness * (run.readings["motor_angle"].values - run.q)
    np.testing.assert_allclose(
        run.readings["spring_torque"].values, spring, atol=0.1
    )  # the damping is missing here
    back = load_record(save_record(run, tmp_path / "run.mcap"))
    assert list(back.readings) == list(run.readings)
    for name, signal in run.readings.items():
        assert back.readings[name][:3] == signal[:3]
        assert (back.readings[name].values == signal.values).all()
    header = export_record(run, tmp_path / "run.csv").read_text().splitlines()[0].split(",")
    assert "wrist_force.z [N]" in header
    assert "motor_current.right_arm_j2 [A]" in header


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (
            {"pushes": [{"time": -1, "duration": 1, "force": [0, 0, 1]}]},
            r"pushes\[0\].time: expected .* >= 0",
        ),
        ({"pushes": [{"time": 0, "duration": 1, "force": [0, 1]}]}, r"pushes\[0\].force"),
        ({"pushes": [{"time": 0, "duration": 1, "force": [0, 0, 1], "point": "elbow"}]}, "hand, or link"),
        ({"payload": {"mass": 0}}, "payload.mass: expected .* > 0"),
        ({"payload": {"mass": 1, "begin": 0}}, "payload: unknown key 'begin'"),
        ({"payload": [{"mass": 1}, {"mass": 0}]}, r"payload\[1\].mass: expected .* > 0"),
        ({"encoder_losses": [{"time": 0, "duration": 1, "joint": 0}]}, "joint: expected .* >= 1"),
    ],
)
def test_bad_loads_in_a_spec_are_named(fields, words):
    with pytest.raises(FileFormatError, match=words):
        convert("spec", {"kind": "compliant", **fields}, CompliantPlant)


@pytest.mark.parametrize(
    ("fields", "error", "words"),
    [
        (
            {"pushes": [Push(time=0, duration=1, force=(0, 0, 1), point="link 9")]},
            KeyError,
            "plant.pushes.point: unknown name 'link 9'",
        ),
        (
            {"payload": Payload(mass=1, begin=2, until=1)},
            ValueRangeError,
            "plant.payload.until: must be after",
        ),
        (
            {"encoder_losses": [EncoderLoss(time=0, duration=1, joint=8)]},
            ValueRangeError,
            "plant.encoder_losses.joint: must lie in 1 … 7, got 8",
        ),
    ],
)
def test_bad_loads_are_named(fields, error, words):
    with pytest.raises(error, match=words):
        CompliantPlant(**fields).start(MEKA, Q0, T, 0, 0)


def test_bad_loads_are_refused_as_they_are_made():
    with pytest.raises(ValueRangeError, match=r"plant.pushes.duration: must be > 0, got 0"):
        Push(time=0, duration=0, force=(0, 0, 1))
    with pytest.raises(ShapeError, match=r"plant.pushes.force: expected a list of length 3"):
        Push(time=0, duration=1, force=(0, 1))  # pyright: ignore[reportArgumentType]
