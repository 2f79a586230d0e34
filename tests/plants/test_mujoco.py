import math
import sys
from typing import Any

import numpy as np
import pytest

from dqcontrol.errors import DivergedError, MissingExtraError, ShapeError, ValueRangeError
from dqcontrol.plants.mujoco import MujocoPlant
from dqcontrol.plants.mujoco.mujoco_model import add_inertias, compiled, skeleton
from dqcontrol.plants.plant import RunningPlant
from dqcontrol.robots.files.load import load_robot, package_files
from dqcontrol.robots.limits import Inertia, Limits
from dqcontrol.robots.serial_arm import SerialArm

mujoco: Any = pytest.importorskip("mujoco")

SEED = 20260711
G = 9.81


def iiwa(effort=np.inf):
    """Return an arm with the geometry of an iiwa 7 and inertias of its order of magnitude."""
    rng = np.random.default_rng(SEED)
    mass = np.array([4.9, 3.4, 4.0, 3.4, 4.0, 1.5, 2.6])
    tensor = []
    for m in mass:
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        tensor.append(axes @ np.diag(m * np.array([0.004, 0.005, 0.006])) @ axes.T)
    inertia = Inertia(mass, rng.uniform(-0.1, 0.1, (7, 3)), np.array(tensor))
    bound = np.radians([170, 120, 170, 120, 170, 120, 175])
    limits = Limits(-bound, bound, np.full(7, 2.0), np.full(7, effort))
    return SerialArm.from_dh(
        theta=np.zeros(7),
        d=[0.34, 0, 0.4, 0, 0.4, 0, 0.126],
        a=np.zeros(7),
        alpha=np.radians([-90, 90, 90, -90, -90, 90, 0]),
        limits=limits,
        inertia=inertia,
        name="test iiwa",
    )


def crane():
    """Return an arm with a lift, a sliding boom, modified DH and a tool."""
    inertia = Inertia(
        np.array([3.0, 2.0, 1.0]), np.full((3, 3), 0.05), np.tile(np.diag([0.02, 0.03, 0.04]), (3, 1, 1))
    )
    return SerialArm.from_dh(
        theta=[0.3, -0.2, 0.5],
        d=[0.2, 0.1, 0.3],
        a=[0.1, 0.4, -0.2],
        alpha=[0.4, -1.1, 0.7],
        joint_types=["prismatic", "revolute", "prismatic"],
        convention="modified",
        tool=[math.cos(0.2), 0, math.sin(0.2), 0, 0, 0.05, 0, 0.1],
        inertia=inertia,
    )


def pendulum(mass=2.0, length=0.5, moment=0.1, effort=np.inf):
    """Return one joint about a horizontal axis, its bar along the first frame's x axis at q = 0."""
    inertia = Inertia(np.array([mass]), np.array([[length, 0, 0]]), np.diag([0.06, moment, moment])[None])
    horizontal = [math.sqrt(0.5), math.sqrt(0.5), 0, 0, 0, 0, 0]
    limits = Limits(np.full(1, -np.inf), np.full(1, np.inf), np.full(1, np.inf), np.array([effort]))
    return SerialArm([horizontal, [1, 0, 0, 0, 1, 0, 0]], ["revolute"], inertia=inertia, limits=limits)


def pose_of_hand(model, data):
    """Return the hand's pose (8,)."""
    r = np.empty(4)
    mujoco.mju_mat2Quat(r, data.site("hand").xmat)
    p = data.site("hand").xpos
    dual = 0.5 * np.concatenate([[-p @ r[1:]], r[0] * p + np.cross(p, r[1:])])
    return np.concatenate([r, dual])


def run(live, command, periods):
    for _ in range(periods):
        live.step(command)


def plain_model(robot, **option):
    spec = skeleton(robot)
    add_inertias(spec, robot)
    for name, value in option.items():
        setattr(spec.option, name, value)
    return compiled(spec)


@pytest.mark.parametrize("robot", [iiwa(), crane(), pendulum()], ids=["iiwa", "crane", "pendulum"])
def test_forward_kinematics_is_the_robots_own(robot):
    model = plain_model(robot)
    data = mujoco.MjData(model)
    for q in np.random.default_rng(SEED).uniform(-3, 3, (50, robot.configuration_size)):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        ours, theirs = robot.fkm(q), pose_of_hand(model, data)
        theirs *= np.sign(theirs[:4] @ ours[:4])
        assert np.abs(ours - theirs).max() < 1e-12


def test_gravity_torque_is_the_slope_of_the_potential_energy():
    robot = iiwa()
    model = plain_model(robot)
    data = mujoco.MjData(model)
    inertia = robot.inertia
    assert inertia is not None

    def potential(q):
        total = 0.0
        for mass, center, x in zip(inertia.mass, inertia.center, robot.frames(q)[:-1], strict=True):
            w, v, dw, dv = x[0], x[1:4], x[4], x[5:]
            p = 2 * (w * dv - dw * v - np.cross(dv, v))
            total += mass * G * (p + center + 2 * np.cross(v, w * center + np.cross(v, center)))[2]
        return total

    for q in np.random.default_rng(SEED).uniform(-2, 2, (5, 7)):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        slope = [(potential(q + h) - potential(q - h)) / 2e-5 for h in 1e-5 * np.eye(7)]
        np.testing.assert_allclose(data.qfrc_bias, slope, atol=1e-7)


@pytest.mark.parametrize("name", ["iiwa7", "meka-a2"])
def test_own_models_move_and_weigh_what_the_robot_says(name):
    robot = load_robot(name)
    model = plain_model(robot)
    data = mujoco.MjData(model)
    for q in np.random.default_rng(SEED).uniform(-1, 1, (5, robot.configuration_size)):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qfrc_bias, robot.gravity_forces(q), atol=1e-11)
    live = MujocoPlant().start(robot, np.full(robot.configuration_size, 0.2), 0.01, 100, 0)
    run(live, np.full(robot.configuration_size, 0.1), 100)
    np.testing.assert_allclose(live.q, 0.3 - 0.1 * live.damping / live.stiffness, atol=2e-4)


@pytest.mark.parametrize(
    ("file", "tip"),
    [
        ("panda_description/urdf/panda.urdf", "panda_hand_tcp"),
        ("ur_description/urdf/ur5_robot.urdf", "tool0"),
    ],
)
def test_urdf_arms_have_pinocchios_kinematics_and_dynamics(file, tip):
    pinocchio: Any = pytest.importorskip("pinocchio")
    try:
        path = package_files("example-robot-data")[file]
    except MissingExtraError as error:
        pytest.skip(str(error))
    robot = load_robot(path, tip_link=tip)
    model = plain_model(robot)
    data = mujoco.MjData(model)
    whole = pinocchio.buildModelFromUrdf(str(path))
    others = [whole.getJointId(name) for name in whole.names[1:] if name not in robot.joint_names]
    other = pinocchio.buildReducedModel(whole, others, pinocchio.neutral(whole))
    state = other.createData()
    n = robot.configuration_size
    rng = np.random.default_rng(SEED)
    for _ in range(5):
        q, qdot, qddot = rng.uniform(-1, 1, (3, n))
        data.qpos[:], data.qvel[:] = q, qdot
        mujoco.mj_forward(model, data)
        torque = np.empty(n)
        mujoco.mj_mulM(model, data, torque, qddot)
        torque += data.qfrc_bias
        np.testing.assert_allclose(torque, pinocchio.rnea(other, state, q, qdot, qddot), atol=1e-11)
        pinocchio.framesForwardKinematics(other, state, q)
        frame = state.oMf[other.getFrameId(tip)]
        np.testing.assert_allclose(data.site("hand").xpos, frame.translation, atol=1e-12)
        np.testing.assert_allclose(data.site("hand").xmat.reshape(3, 3), frame.rotation, atol=1e-12)


def test_free_motion_keeps_its_energy():
    robot = iiwa()
    model = plain_model(
        robot,
        timestep=1e-4,
        integrator=mujoco.mjtIntegrator.mjINT_RK4,
        enableflags=int(mujoco.mjtEnableBit.mjENBL_ENERGY),
    )
    data = mujoco.MjData(model)
    data.qpos[:] = 0.3
    mujoco.mj_forward(model, data)
    before = data.energy.sum()
    mujoco.mj_step(model, data, 2000)
    mujoco.mj_forward(model, data)
    assert data.energy[1] > 1.0  # it has fallen
    assert abs(data.energy.sum() - before) < 1e-6 * data.energy[1]


def test_arm_starts_in_balance_with_and_without_compensation():
    robot = iiwa()
    q0 = np.array([0.1, 0.5, 0.2, -1.2, 0.3, 0.9, 0.4])
    for share in (0.0, 0.5, 1.0):
        live = MujocoPlant(gravity_compensation=share).start(robot, q0, 0.01, 100, 0)
        assert isinstance(live, RunningPlant)
        run(live, np.zeros(7), 100)
        assert live.time == pytest.approx(1.0)
        assert np.abs(live.q - q0).max() < 1e-9
        assert np.abs(live.torque).max() > 5.0
        assert (live.measured == live.q).all()


def test_servo_follows_a_ramp_as_the_second_order_closed_form():
    mass, length, moment, armature = 2.0, 0.5, 0.1, 0.05
    plant = MujocoPlant(
        bandwidth=3.0, damping_ratio=0.5, gravity=(0, 0, 0), armature=armature, timestep=1e-4, stiffness=None
    )
    live = plant.start(pendulum(mass, length, moment), np.zeros(1), 0.01, 100, 0)
    whole = mass * length**2 + moment + armature
    omega, zeta, u = 2 * math.pi * 3.0, 0.5, 1.5
    assert live.stiffness[0] == pytest.approx(whole * omega**2, rel=1e-12)
    assert live.damping[0] == pytest.approx(2 * zeta * whole * omega, rel=1e-12)
    damped = omega * math.sqrt(1 - zeta**2)
    for k in range(1, 101):
        live.step(np.array([u]))
        t = 0.01 * k
        # q̈ + 2ζω q̇ + ω² q = ω² u t from rest
        decay = math.exp(-zeta * omega * t)
        lag = 2 * zeta / omega
        swing = lag * math.cos(damped * t) + (lag * zeta * omega - 1) / damped * math.sin(damped * t)
        assert live.q[0] == pytest.approx(u * (t - lag + decay * swing), abs=2e-4)


def test_uncompensated_gravity_sags_by_torque_over_stiffness():
    robot, u, T = pendulum(), 0.5, 0.01
    live = MujocoPlant(gravity_compensation=0.0, stiffness=2000.0).start(robot, np.array([0.4]), T, 500, 0)
    run(live, np.array([u]), 200)
    run(live, np.zeros(1), 300)
    load = 2.0 * G * 0.5 * np.cos([0.4, live.q[0]])
    assert live.target[0] == pytest.approx(0.4 + load[0] / 2000 + u * 2.0, abs=1e-12)
    assert live.target[0] - live.q[0] == pytest.approx(load[1] / 2000, rel=0.02)
    assert live.torque[0] == pytest.approx(load[1], rel=1e-6)


@pytest.mark.parametrize("period", [0.001, 0.01])
def test_measured_mode_settles_at_its_share_of_the_velocity(period):
    plant = MujocoPlant(command_mode="measured", gravity=(0, 0, 0))
    live = plant.start(pendulum(), np.zeros(1), period, 0, 0)
    run(live, np.array([0.3]), round(1.0 / period))
    gain = live.stiffness[0] * period
    assert live.velocity[0] == pytest.approx(0.3 * gain / (gain + live.damping[0]), rel=1e-3)


def test_torque_stays_within_the_effort_limit():
    robot = pendulum(effort=12.0)
    live = MujocoPlant(bandwidth=20.0).start(robot, np.array([0.3]), 0.01, 0, 0)
    largest = 0.0
    for _ in range(50):
        live.step(np.array([5.0]))
        largest = max(largest, abs(live.torque[0]))
    assert largest == pytest.approx(12.0, abs=1e-9)


def test_position_limits_stop_the_joint():
    robot = iiwa()
    live = MujocoPlant(position_limit=False).start(robot, np.zeros(7), 0.01, 0, 0)
    run(live, np.array([0, 1.0, 0, 0, 0, 0, 0]), 300)
    assert live.target[1] == pytest.approx(3.0, abs=0.1)
    assert live.q[1] < robot.limits.upper[1] + 0.002


@pytest.mark.parametrize("mode", ["integrated", "measured"])
def test_targets_do_not_leave_the_position_limits(mode):
    robot = iiwa()
    live = MujocoPlant(command_mode=mode).start(robot, np.zeros(7), 0.01, 0, 0)
    for u in (4.0, -4.0):
        for _ in range(600):
            live.step(np.array([0, u, 0, 0, 0, 0, 0]))
            assert robot.limits.lower[1] <= live.target[1] <= robot.limits.upper[1]
        assert live.target[1] == pytest.approx(np.sign(u) * robot.limits.upper[1], abs=1e-2)


def test_same_seed_gives_the_same_bits():
    robot = iiwa(effort=300.0)
    plant = MujocoPlant(command_mode="measured", encoder_noise=1e-4, encoder_resolution=[1e-5] * 7)

    def record(seed):
        live = plant.start(robot, np.full(7, 0.2), 0.004, 100, seed)
        rows = []
        for k in range(100):
            live.step(0.3 * np.sin(0.1 * k + np.arange(7)))
            rows.append(np.concatenate([live.q, live.measured, live.torque]))
        return np.array(rows)

    first = record(5)
    assert (first == record(5)).all()
    assert (first != record(6)).any()


def test_encoders_have_their_resolution_and_noise():
    live = MujocoPlant(encoder_noise=1e-3, encoder_resolution=2e-4).start(iiwa(), np.zeros(7), 0.001, 0, SEED)
    errors = []
    for _ in range(1000):
        live.step(np.zeros(7))
        ticks = live.measured / 2e-4
        assert np.abs(ticks - np.round(ticks)).max() < 1e-9
        errors.append(live.measured - live.q)
    assert np.std(errors) == pytest.approx(math.hypot(1e-3, 2e-4 / math.sqrt(12)), rel=0.03)


def test_friction_brakes():
    frictions: list[dict[str, Any]] = [{}, {"viscous_friction": 0.5}, {"dry_friction": 0.2}]
    free, viscous, dry = (
        MujocoPlant(stiffness=1e-9, damping=0.0, gravity=(0, 0, 0), **friction).start(
            pendulum(), np.zeros(1), 0.01, 0, 0
        )
        for friction in frictions
    )
    inertia = 2.0 * 0.25 + 0.1 + 0.1
    for live in (free, viscous, dry):
        live.data.qvel[:] = 1.0
        run(live, np.zeros(1), 50)
    assert free.velocity[0] == pytest.approx(1.0, abs=1e-6)
    assert viscous.velocity[0] == pytest.approx(math.exp(-0.5 * 0.5 / inertia), rel=1e-3)
    assert dry.velocity[0] == pytest.approx(1.0 - 0.2 * 0.5 / inertia, rel=0.02)


def with_inertia(mass=1.0, tensor=(0.1, 0.1, 0.1), off=0.0):
    matrix = np.diag(np.array(tensor, dtype=float))
    matrix[0, 1] = off
    return SerialArm(
        [[1, 0, 0, 0, 0, 0, 0]] * 2,
        ["revolute"],
        inertia=Inertia(np.array([mass]), np.zeros((1, 3)), matrix[None]),
        joint_names=["shoulder"],
        name="odd",
    )


@pytest.mark.parametrize(
    ("robot", "words"),
    [
        (SerialArm([[1, 0, 0, 0, 0, 0, 0]] * 2, ["revolute"], name="odd"), "inertia: odd has none"),
        (
            with_inertia(mass=0.0),
            "joint 1 'shoulder' of odd has mass 0 kg; inertias do not allow physics.*> 0",
        ),
        (
            with_inertia(tensor=(0.1, 0.1, 0.25)),
            r"moments 0\.1, 0\.1, 0\.25.*do not allow physics.*sum of the others, 0\.2$",
        ),
        (with_inertia(tensor=(0.1, 0.1, -0.1)), "moments -0.1, .*each must be > 0"),
        (with_inertia(tensor=(0.0, 0.0, 0.0)), "moments 0, 0, 0 .*each must be > 0"),
        (with_inertia(off=0.05), "must be symmetric"),
    ],
)
def test_impossible_inertias_are_named(robot, words):
    with pytest.raises(ValueRangeError, match=words):
        MujocoPlant().start(robot, np.zeros(1), 0.01, 0, 0)


def test_a_flat_plate_is_allowed():
    MujocoPlant().start(with_inertia(tensor=(0.1, 0.2, 0.3)), np.zeros(1), 0.01, 0, 0)


@pytest.mark.parametrize(
    ("parameters", "error", "words"),
    [
        (
            {"command_mode": "mesured"},
            KeyError,
            "plant.command_mode: unknown name 'mesured'; did you mean 'measured'",
        ),
        ({"bandwidth": 0}, ValueRangeError, "plant.bandwidth: must be > 0, got 0"),
        ({"timestep": -1e-3}, ValueRangeError, "plant.timestep: must be > 0"),
        (
            {"gravity_compensation": 1.2},
            ValueRangeError,
            r"plant.gravity_compensation: must be ≤ 1, got 1\.2",
        ),
        ({"gravity": (0, 0)}, ShapeError, "plant.gravity"),
        ({"stiffness": [1.0, 0.0]}, ValueRangeError, r"plant.stiffness\[1\]: must be > 0"),
        ({"armature": -0.1}, ValueRangeError, "plant.armature: must be ≥ 0, got -0.1"),
        ({"encoder_noise": math.nan}, ValueRangeError, "plant.encoder_noise: must be finite"),
    ],
)
def test_bad_parameters_are_named(parameters, error, words):
    with pytest.raises(error, match=words):
        MujocoPlant(**parameters)


@pytest.mark.parametrize(
    ("parameters", "q0", "period", "error", "words"),
    [
        (
            {},
            np.zeros(7),
            0.0015,
            ValueRangeError,
            r"control period 0\.0015 s must be an integer multiple.*0\.00075 would do",
        ),
        ({}, np.zeros(7), 0.0005, ValueRangeError, r"plant\.timestep.*0\.0005 would do"),
        ({}, np.zeros(7), math.nan, ValueRangeError, "period: must be finite"),
        ({}, np.zeros(6), 0.01, ShapeError, "start: expected shape"),
        ({}, np.zeros((2, 7)), 0.01, ShapeError, r"start: expected shape \(7,\), got \(2, 7\)"),
        (
            {},
            np.full(7, 2.5),
            0.01,
            ValueRangeError,
            r"start: joint 2 'joint_2' is at 2\.5; must lie in -2\.094",
        ),
        (
            {"armature": [0.1, 0.2]},
            np.zeros(7),
            0.01,
            ShapeError,
            r"plant.armature: expected one number or 7, got shape \(2,\)",
        ),
    ],
)
def test_bad_starts_are_named(parameters, q0, period, error, words):
    with pytest.raises(error, match=words):
        MujocoPlant(**parameters).start(iiwa(), q0, period, 0, 0)


def test_an_arm_too_weak_for_its_weight_is_refused():
    with pytest.raises(
        ValueRangeError, match=r"start: joint 1 .* needs 9\.81 N·m to hold gravity; its effort limit is 5"
    ):
        MujocoPlant().start(pendulum(effort=5.0), np.zeros(1), 0.01, 0, 0)


@pytest.mark.parametrize(
    ("command", "error", "words"),
    [
        (np.full(7, np.nan), ValueRangeError, "command: must be finite"),
        (np.array([np.inf, -np.inf, 0, 0, 0, 0, 0]), ValueRangeError, "command: must be finite"),
        (np.zeros(6), ShapeError, r"command: expected shape \(7,\), got \(6,\)"),
        (["fast"] * 7, ShapeError, "command: expected real numbers"),
        (
            [0, 2e11, 0, 0, 0, 0, 0],
            DivergedError,
            r"a command of 2e\+11 rad/s; MuJoCo takes less than 1e\+10",
        ),
        (np.full(7, -1e200), DivergedError, r"a command of 1e\+200 rad/s"),
    ],
)
def test_bad_commands_are_named_and_move_nothing(command, error, words):
    live = MujocoPlant().start(iiwa(), np.zeros(7), 0.01, 0, 0)
    with pytest.raises(error, match=words):
        live.step(command)
    assert live.time == 0
    live.step([0] * 7)
    assert live.time == pytest.approx(0.01)


def test_divergence_is_an_error(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    live = MujocoPlant(stiffness=1e12, damping=0.0).start(iiwa(), np.zeros(7), 0.01, 0, 0)
    with pytest.raises(DivergedError, match=r"the arm diverged before .* smaller timestep"):
        run(live, np.ones(7), 200)
    assert not list(tmp_path.iterdir())  # MuJoCo would write a log file here


def test_missing_mujoco_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'dqcontrol\[physics\]'"):
        MujocoPlant().start(iiwa(), np.zeros(7), 0.01, 0, 0)
