import math
from typing import Any

import msgspec
import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import DivergedError, FileFormatError, ShapeError, ValueRangeError
from dqcontrol.files.yaml_file import convert
from dqcontrol.plants import CompliantPlant, RunningPlant
from dqcontrol.plants.compliant.controller_file import gravity_bodies, load_controllers
from dqcontrol.plants.compliant.joint_columns import SERVO_P
from dqcontrol.robots.files.load import load_robot

mujoco: Any = pytest.importorskip("mujoco")

SEED = 20260903
MEKA, IIWA = load_robot("meka-a2"), load_robot("iiwa7")
Q0 = np.array([0, np.pi / 5, 0, np.pi / 2, 0, np.pi / 5, 0])
QI = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
T = 0.008


def rest(live, seconds, command=None):
    command = np.zeros(7) if command is None else command
    for _ in range(round(seconds / T)):
        live.step(command)


def mean_angles(live, seconds):
    rows = []
    for _ in range(round(seconds / T)):
        live.step(np.zeros(7))
        rows.append(live.q.copy())
    return np.mean(rows, axis=0)


@pytest.mark.parametrize("mode", ["THETA", "THETA_MJ", "THETA_GC", "THETA_GC_MJ"])
@pytest.mark.parametrize("hand", [False, "H2R3", "ma17"])
def test_arm_starts_in_balance(mode, hand):
    live = CompliantPlant(mode=mode, hand=hand, gravity_factor=0.9).start(MEKA, Q0, T, 100, 0)
    assert isinstance(live, RunningPlant)
    rest(live, 1.0)
    assert live.time == pytest.approx(1.0)
    assert np.abs(live.q - Q0).max() < 2e-3  # the encoders' steps move it a little
    assert not live.fault


def test_spring_carries_gravity():
    live = CompliantPlant().start(MEKA, Q0, T, 100, 0)
    stiffness = load_controllers(MEKA).stiffness("default")
    load = MEKA.gravity_forces(Q0, (0, 0, -9.809))
    np.testing.assert_allclose(live.data.qpos[7:] - Q0, load / stiffness, atol=1e-12)


@pytest.mark.parametrize(("hand", "mass"), [(True, 0.838), ("H2R3", 0.838), ("ma17", 0.9)])
def test_controllers_know_the_weight_of_the_hand(hand, mass):
    file = load_controllers(MEKA)
    live = CompliantPlant(hand=hand).start(MEKA, Q0, T, 100, 0)
    bodies = gravity_bodies(MEKA, file.hand(hand))
    assert bodies[:, 0].sum() == pytest.approx(6.92 + mass)
    held = (live.data.qpos[7:] - Q0) * file.stiffness("default")
    assert MEKA.inertia is not None
    inertia = dqc.robots.Inertia(bodies[:, 0], bodies[:, 1:], MEKA.inertia.tensor)
    other = dqc.SerialArm(MEKA.chain[:, :7], MEKA.joint_types, inertia=inertia, joint_names=MEKA.joint_names)
    np.testing.assert_allclose(held, other.gravity_forces(Q0, (0, 0, -9.809)), atol=1e-11)


def torque_loop_gain(file):
    """Return τ_spring / τ_desired at rest without integral: g k_p / (1 + g k_p), g the torque a current makes."""
    gain = file.column("motor", "torque_constant") * file.column("torque_loop", "k_p")
    return gain / (1 + gain)


@pytest.mark.parametrize("springs", ["default", [None] * 7])
def test_static_sag_of_theta_gc_is_that_of_its_equation(springs):
    """g(q) = ρ (s (k_p (r − q) + I) + γ g(q)), ρ = 1 where the torque loop has an integral, I at its limit."""
    file = load_controllers(MEKA)
    stiffness, factor = 0.8, 0.7
    plant = CompliantPlant(
        stiffness=stiffness, gravity_factor=factor, encoder_resolution=0.0, springs=springs
    )
    live = plant.start(MEKA, Q0, T, 0, 0)
    rest(live, 1.0, 0.1 * np.array([1, 1, 1, -1, 1, -1, 1]))
    rest(live, 3.0)
    q = mean_angles(live, 1.0)
    load = MEKA.gravity_forces(q, (0, 0, -9.809))
    ratio = np.where(file.column("torque_loop", "k_i") > 0, 1.0, torque_loop_gain(file))
    integral = np.array([1.0, 0, 0, 0.35, 0, 0, 0])  # N·m; joint 5's is slow and has not settled
    sag = ((load / ratio - factor * load) / stiffness - integral) / file.column("position_loop", "k_p")
    settled = [0, 1, 2, 3, 5, 6]
    assert np.abs(sag).max() > 0.09
    np.testing.assert_allclose((live.reference - q)[settled], sag[settled], rtol=0.02, atol=1e-4)


def test_static_sag_of_theta_is_that_of_its_equation():
    """r − q = g(q) (1/k_s + 1/k_p): the servo's give and the spring's."""
    live = CompliantPlant(mode="THETA").start(MEKA, Q0, T, 0, 0)
    rest(live, 1.0, 0.2 * np.array([1, 1, 1, -1, 1, -1, 1]))
    rest(live, 2.0)
    load = MEKA.gravity_forces(live.q, (0, 0, -9.809))
    sag = load / load_controllers(MEKA).stiffness("default") + load / live.memory.constants[:, SERVO_P]
    assert np.abs(sag).max() > 0.02
    np.testing.assert_allclose(live.reference - live.q, sag, rtol=0.02, atol=1e-5)


@pytest.mark.parametrize("springs", ["default", "elastic"])
def test_iiwa_carries_itself_with_exact_gravity_and_sags_with_a_wrong_one(springs):
    k = load_controllers(IIWA).column("position_loop", "k_p")
    for factor in (1.0, 0.8):
        live = CompliantPlant(gravity_factor=factor, springs=springs).start(IIWA, QI, T, 0, 0)
        rest(live, 1.0, np.full(7, 0.1))
        rest(live, 1.0)
        load = IIWA.gravity_forces(live.q, (0, 0, -9.809))
        np.testing.assert_allclose(live.reference - live.q, (1 - factor) * load / k, rtol=0.02, atol=3e-5)


def test_commands_move_the_target_from_where_it_was_or_from_the_measured_angle():
    u = np.full(7, 0.1)
    for mode in ("integrated", "measured"):
        live = CompliantPlant(mode="THETA", command_mode=mode).start(IIWA, QI, T, 0, 0)
        before, measured = live.reference.copy(), live.measured.copy()
        live.step(u)
        start = before if mode == "integrated" else measured
        np.testing.assert_allclose(live.target, start + T * u, atol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize("accurate", [False, True])
def test_same_seed_gives_the_same_bits(accurate):
    plant = CompliantPlant(hand=True, encoder_noise=1e-4, accurate=accurate)

    def rows(seed):
        live = plant.start(MEKA, Q0, T, 60, seed)
        out = []
        for k in range(60):
            live.step(0.2 * np.sin(0.1 * k + np.arange(7)))
            out.append(np.concatenate([live.q, live.measured]))
        return np.array(out)

    first = rows(SEED)
    assert (first == rows(SEED)).all()
    assert (first != rows(SEED + 1)).any()


def test_encoders_have_their_steps():
    live = CompliantPlant(encoder_resolution=0.01).start(MEKA, Q0, T, 0, 0)
    rest(live, 0.2)
    ticks = live.encoders / 0.01
    np.testing.assert_allclose(ticks, np.round(ticks), atol=1e-9)


def test_stops_hold_the_links():
    live = CompliantPlant(mode="TORQUE", torque=[0, 0, 0, 0, 0, 4.0, -4.0]).start(MEKA, Q0, T, 0, 0)
    rest(live, 3.0)
    ends = [MEKA.limits.upper[5], MEKA.limits.lower[6]]
    np.testing.assert_allclose(live.q[5:], ends, atol=0.01)


def test_targets_stay_in_the_joints_range():
    file = load_controllers(MEKA)
    live = CompliantPlant(mode="THETA").start(MEKA, Q0, T, 0, 0)
    rest(live, 2.0, np.full(7, 0.8))
    upper = np.minimum(file.column("range", "upper"), MEKA.limits.upper)
    assert live.target[5] == upper[5]
    live.step(np.full(7, -0.8))
    assert live.target[5] == pytest.approx(upper[5] - 0.8 * T)


def test_a_spec_drives_the_arm(tmp_path):
    spec = {
        "name": "soft",
        "robot": "meka-a2",
        "start": Q0.tolist(),
        "period": T,
        "reference": {"kind": "circle", "radius": 0.02, "duration": 3, "plane": "xy"},
        "law": {"kind": "proportional", "gain": 3},
        "plant": {"kind": "compliant", "mode": "THETA_GC", "hand": True, "springs": "default"},
    }
    run = dqc.run(spec)
    assert run.record.stopped == "duration"
    assert 1 < run.metrics.position.mean < 20  # mm
    assert (dqc.run(spec).q == run.q).all()


def with_file(tmp_path, edit):
    """Write the Meka's controllers with something changed, and return the file's path."""
    data = msgspec.to_builtins(load_controllers(MEKA))
    edit(data)
    path = tmp_path / "mine.yaml"
    path.write_bytes(msgspec.yaml.encode(data))
    return str(path)


def test_controllers_come_from_a_file(tmp_path):
    path = with_file(tmp_path, lambda data: data["joints"][0]["motor"].update(friction=2.5))
    live = CompliantPlant(controllers=path).start(MEKA, Q0, T, 0, 0)
    assert live.model.dof_damping[7] == 2.5


def test_a_controller_file_lies_beside_its_spec(tmp_path):
    with_file(tmp_path, lambda data: None)
    path = tmp_path / "spec.yaml"
    path.write_text(
        f"{{name: x, robot: meka-a2, start: {Q0.tolist()}, period: 0.008, duration: 0.1,"
        " reference: {kind: set-point}, law: {kind: proportional, gain: 3},"
        " plant: {kind: compliant, controllers: mine.yaml}}"
    )
    run = dqc.run(path)
    assert str(tmp_path / "mine.yaml") in run.spec


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (
            lambda data: data["joints"][2]["motor"].update(resistance=0),
            r"mine.yaml: joints\[2\].motor.resistance: expected a number > 0.0",
        ),
        (
            lambda data: data["joints"][0]["range"].update(torq=1),
            r"joints\[0\].range: unknown key 'torq'; did you mean 'torque'",
        ),
        (lambda data: data["joints"].pop(), "joints: must be those of meka-a2"),
        (
            lambda data: data["joints"][1]["range"].update(lower=3),
            r"right_arm_j1.range: lower 3 must be below",
        ),
        (lambda data: data["springs"].update(default=[1.0]), "springs.default: expected 7 numbers, got 1"),
        (lambda data: data.pop("safety"), "missing key 'safety'"),
    ],
)
def test_bad_controller_files_are_named(tmp_path, edit, words):
    with pytest.raises((FileFormatError, ShapeError), match=words):
        CompliantPlant(controllers=with_file(tmp_path, edit)).start(MEKA, Q0, T, 0, 0)


@pytest.mark.parametrize(
    ("parameters", "error", "words"),
    [
        ({"mode": "THETA_CG"}, KeyError, "plant.mode: unknown name 'THETA_CG'; did you mean 'THETA_GC'"),
        ({"command_mode": "mesured"}, KeyError, "plant.command_mode: .* did you mean 'measured'"),
        ({"stiffness": 1.2}, ValueRangeError, r"plant.stiffness: must be ≤ 1, got 1\.2"),
        ({"stiffness": [0.5, -1]}, ValueRangeError, r"plant.stiffness\[1\]: must be ≥ 0, got -1"),
        ({"gravity_factor": math.nan}, ValueRangeError, "plant.gravity_factor: must be finite"),
        ({"springs": [0.0] * 7}, ValueRangeError, r"plant.springs\[0\]: must be ≥ 0\.01, got 0"),
        ({"duty": 2.0}, ValueRangeError, "plant.duty: must be ≤ 1, got 2"),
        ({"hand": 3}, ShapeError, "plant.hand: expected true or false or text, got 3"),
        ({"pushes": {"time": 1}}, ShapeError, "plant.pushes: expected a list, got a mapping"),
        ({"payload": 0.9}, ShapeError, "plant.payload: expected Payload or a list or nothing, got 0.9"),
        (
            {"wrist_fault": True},
            ShapeError,
            "plant.wrist_fault: expected WristFault or nothing, got true",
        ),
        ({"gravity": (0, 0)}, ShapeError, "plant.gravity"),
        ({"encoder_noise": -1e-3}, ValueRangeError, r"plant.encoder_noise: must be ≥ 0, got -0\.001"),
    ],
)
def test_bad_parameters_are_named(parameters, error, words):
    with pytest.raises(error, match=words):
        CompliantPlant(**parameters)


@pytest.mark.parametrize(
    ("robot", "parameters", "q0", "period", "error", "words"),
    [
        (MEKA, {"springs": "stif"}, Q0, T, KeyError, "plant.springs: unknown name 'stif'.*lower-bound"),
        (MEKA, {"hand": "h2r3"}, Q0, T, KeyError, "plant.hand: unknown name 'h2r3'; did you mean 'H2R3'"),
        (MEKA, {"springs": [100.0]}, Q0, T, ShapeError, "plant.springs: expected 7 numbers, got 1"),
        (MEKA, {"stiffness": [0.5, 0.5]}, Q0, T, ShapeError, "plant.stiffness: expected one number or 7"),
        (
            IIWA,
            {"hand": True},
            QI,
            T,
            ValueRangeError,
            "plant.hand: the controllers of iiwa7 describe no hand",
        ),
        (MEKA, {}, Q0, 0.0015, ValueRangeError, r"period: must be a multiple of .* 0\.001 s, got 0\.0015"),
        (MEKA, {}, Q0[:6], T, ShapeError, "start: expected shape"),
        (MEKA, {}, Q0 + 3, T, ValueRangeError, r"start: joint 2 'right_arm_j1' is at 3\.6.*; must lie in"),
        (
            load_robot("panda"),
            {},
            np.zeros(7),
            T,
            ValueRangeError,
            "plant.controllers: no controllers are known for 'panda'; they are for iiwa7, meka-a2; give",
        ),
    ],
)
def test_bad_starts_are_named(robot, parameters, q0, period, error, words):
    with pytest.raises(error, match=words):
        CompliantPlant(**parameters).start(robot, q0, period, 0, 0)


def test_spec_errors_name_the_field():
    with pytest.raises(FileFormatError, match=r"plant.stiffness: "):
        convert("spec", {"plant": {"kind": "compliant", "stiffness": 3.0}}, dict[str, CompliantPlant])


@pytest.mark.parametrize(
    ("command", "error", "words"),
    [
        (np.full(7, np.nan), ValueRangeError, "command: must be finite"),
        (np.zeros(6), ShapeError, r"command: expected shape \(7,\), got \(6,\)"),
    ],
)
def test_bad_commands_are_named_and_move_nothing(command, error, words):
    live = CompliantPlant().start(MEKA, Q0, T, 0, 0)
    with pytest.raises(error, match=words):
        live.step(command)
    assert live.time == 0


def test_divergence_is_an_error():
    live = CompliantPlant(mode="THETA").start(MEKA, Q0, T, 0, 0)
    live.data.qvel[:] = 1e5
    with pytest.raises(DivergedError, match="the arm diverged before"):
        rest(live, 0.1)
