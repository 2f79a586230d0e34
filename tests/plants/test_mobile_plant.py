"""Mobile manipulators in physics: against their kinematics, the unicycle, Coulomb's law and energy."""

import math
from typing import Any

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import DivergedError, ShapeError, UnknownNameError, ValueRangeError
from dqcontrol.plants import (
    Camera,
    FiducialLoss,
    Gripper,
    GripperEvent,
    MobilePlant,
    MujocoPlant,
    WheeledBase,
)

mujoco: Any = pytest.importorskip("mujoco")

SEED = 20261208
T = 0.02
G = 9.81
Q0 = np.array([0.4, -0.3, 0.5, 0, -0.504, 1.397, 0, 0])
FREE = WheeledBase(rolling_resistance=0, caster_friction=0)
DRIVE = dqc.load_robot("little-john").parts[0]
CHASSIS = DRIVE.chassis


@pytest.fixture(scope="module")
def body():
    return dqc.load_robot("little-john")


@pytest.fixture(scope="module")
def cart():
    """Return a drive with neither arm nor anything else on it."""
    return dqc.WholeBody([DRIVE])


def drive(plant, robot, q0, command, seconds, seed=0):
    """Return the live plant after a constant command, and its configurations and readings after each period."""
    steps = round(seconds / T)
    live = plant.start(robot, q0, T, steps, seed)
    rows = []
    for _ in range(steps):
        live.step(np.array(command, dtype=float))
        rows.append(np.concatenate([live.q, live.readings]))
    return live, np.array(rows)[:, : len(q0)], np.array(rows)[:, len(q0) :]


def reading(live, name, rows):
    first = 0
    for channel in live.channels:
        if channel.name == name:
            return rows[..., first : first + channel.size]
        first += channel.size
    raise KeyError(name)


@pytest.mark.parametrize("name", ["little-john", "little-john-wrist"])
def test_forward_kinematics_is_the_robots_own(name):
    robot = dqc.load_robot(name)
    live = MobilePlant(gripper=Gripper()).start(robot, Q0, T, 1, 0)
    for q in np.random.default_rng(SEED).uniform(-2.5, 2.5, (30, 8)):
        live.place(q)
        mujoco.mj_kinematics(live.model, live.data)
        ours, site = robot.fkm(q), live.data.site("hand")
        rotation = np.empty(4)
        mujoco.mju_mat2Quat(rotation, site.xmat)
        assert abs(rotation @ ours[:4]) == pytest.approx(1, abs=1e-12)
        assert np.abs(dqc.algebra.translation(ours) - site.xpos).max() < 1e-12


def test_masses_are_those_assumed(body):
    base = WheeledBase(mass=5, wheel_mass=0.25)
    plant = MobilePlant(base=base, link_mass=[0.1, 0.4, 0.2, 0.1, 0.2], gripper=Gripper(mass=0.06))
    model = plant.start(body, Q0, T, 1, 0).model
    assert model.body_subtreemass[model.body("base").id] == pytest.approx(5 + 0.5 + 1.0 + 0.06)
    assert model.body("link_2").mass == pytest.approx(0.4)
    wheel = model.body("wheel_left")
    assert np.abs(wheel.ipos).max() == 0
    assert wheel.inertia[1] == pytest.approx(0.5 * 0.25 * 0.065**2)


def test_an_arm_with_inertias_keeps_them():
    arm = dqc.load_robot("iiwa7")
    base = dqc.DifferentialDrive(wheel_radius=0.1, half_track=0.3, rim_speed=1.0)
    robot = dqc.WholeBody([base, dqc.DualQuaternion.from_translation([0, 0, 0.4]), arm])
    heavy = WheeledBase(
        mass=60, radius=0.35, height=0.075, wheel_mass=0.1, wheel_torque=20, caster_distance=0.3
    )
    start = np.array([0, 0, 0, 0, 0.6, 0, 1.6, 0, 0.6, 0])
    live, q, _ = drive(MobilePlant(base=heavy), robot, start, [0.2, 0.3, *np.zeros(7)], 2)
    assert arm.inertia is not None
    assert live.model.body("link_3").mass == pytest.approx(arm.inertia.mass[2])
    assert np.abs(q[-1, 3:] - start[3:]).max() < 5e-3
    wanted = robot.integrate(start, [0.2, 0.3, *np.zeros(7)], 2.0)
    assert q[-1, :3] == pytest.approx(wanted[:3], abs=0.03)


@pytest.mark.parametrize("command", [(0.3, 0), (-0.2, 0), (0, 0.8), (0, -0.05), (0.2, 0.6)])
def test_the_free_base_moves_as_a_unicycle(cart, command):
    """Once it has its speed, along the arc of the solved ODE, with hardly any slip."""
    live, q, rows = drive(MobilePlant(base=FREE), cart, Q0[:3], command, 3)
    moved = cart.integrate(q[49], np.array(command), 2.0)
    assert q[-1, :2] == pytest.approx(moved[:2], abs=2e-3)
    assert q[-1, 2] == pytest.approx(moved[2], abs=0.01)
    assert np.abs(reading(live, "wheel_slip", rows)[50:]).max() < 1e-3
    assert np.abs(reading(live, "tilt", rows)).max() < 4e-3
    assert live.odometry == pytest.approx(q[-1], abs=0.01)


def test_at_rest_it_stays(body):
    live, q, _ = drive(MobilePlant(base=FREE), body, Q0, np.zeros(7), 2)
    assert np.abs(q - Q0).max() < 2e-4
    assert np.abs(live.data.qvel).max() < 1e-4


def test_wheels_slip_where_friction_ends(cart):
    """Sliding wheels accelerate the robot by μ (N_r + N_l)/m, no more, and odometry does not see it."""
    base = WheeledBase(friction=0.05, caster_friction=0, rolling_resistance=0)
    live, q, rows = drive(MobilePlant(base=base), cart, np.zeros(3), [0.5, 0], 0.4)
    share = 1 - CHASSIS.centre_ahead / CHASSIS.caster_distance
    load = CHASSIS.mass * G * share + 2 * CHASSIS.wheel_mass * G
    wanted = base.friction * load / (CHASSIS.mass + 2 * CHASSIS.wheel_mass)
    speed = np.diff(q[:, 0])[5:15] / T
    assert np.mean(np.diff(speed)) / T == pytest.approx(wanted, rel=0.04)
    assert reading(live, "wheel_slip", rows)[:, :2].min() < -0.3
    assert live.odometry[0] > q[-1, 0] + 0.05


def test_the_motors_do_the_work(cart):
    """What the motors put in is the kinetic energy and a little heat, and nothing comes from nowhere."""
    plant = MobilePlant(base=FREE)
    live = plant.start(cart, np.zeros(3), plant.timestep, 1, 0)
    live.model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    mujoco.mj_forward(live.model, live.data)
    before, work, wheels = (
        live.data.energy.sum(),
        0.0,
        [live.model.joint(f"wheel_{s}") for s in ("right", "left")],
    )
    dofs = [int(wheel.dofadr[0]) for wheel in wheels]
    for _ in range(600):
        torque, speed = None, live.data.qvel[dofs].copy()
        live.step([0.3, 0.5])
        torque = live.data.qfrc_actuator[dofs]
        work += plant.timestep * torque @ (speed + live.data.qvel[dofs]) / 2
    gained = live.data.energy.sum() - before
    mass = CHASSIS.mass + 2 * CHASSIS.wheel_mass
    assert gained > 0.5 * mass * 0.29**2
    assert 0.9 * work < gained < 1.01 * work


def test_the_rims_keep_their_limit_and_the_arc(cart):
    live, _, rows = drive(MobilePlant(base=FREE), cart, np.zeros(3), [2.0, 4.0], 2)
    speeds = np.diff(reading(live, "wheel_angle", rows)[50:], axis=0) / T
    assert np.abs(speeds).max() == pytest.approx(0.5 / 0.065, rel=0.01)
    assert speeds[-1, 1] / speeds[-1, 0] == pytest.approx((2 - 0.52) / (2 + 0.52), abs=0.01)


def test_both_forms_of_inputs_move_alike(body):
    rates = np.array([0.1, 0.15, 0.1, 0.1, 0, 0.1, 0, 0])
    _, q, _ = drive(MobilePlant(), body.in_form("unconstrained"), Q0, rates, T)
    _, same, _ = drive(MobilePlant(), body, Q0, body.feasible_inputs(Q0, rates), T)
    assert np.array_equal(q, same)


@pytest.mark.parametrize("mode", ["integrated", "measured"])
def test_joints_follow_while_the_base_drives(body, mode):
    command = np.array([0.2, 0.3, 0.1, -0.1, 0.1, 0.2, 0.1])
    plant = MobilePlant(command_mode=mode, gravity_compensation=1.0, location="odometry")
    live, q, _ = drive(plant, body, Q0, command, 1.0)
    moved = q[-1, 3:] - q[-26, 3:]
    share = 1.0 if mode == "integrated" else 2 * math.pi * 10 * T / (2 * math.pi * 10 * T + 2)
    assert moved == pytest.approx(0.5 * share * command[2:], abs=0.006)
    assert np.array_equal(live.measured[:3], live.odometry)
    assert np.array_equal(live.measured[3:], live.q[3:])


@pytest.mark.parametrize("mode", ["integrated", "measured"])
def test_the_camera_measures_and_its_loss_stops_the_robot(body, mode):
    camera = Camera(
        rate=25, delay=T, timeout=0.3, stopping_time=0.2, losses=[FiducialLoss(time=0.5, duration=10)]
    )
    live, q, rows = drive(
        MobilePlant(location="camera", camera=camera, command_mode=mode),
        body,
        Q0,
        [0.3, 0, 0.2, 0, 0, 0, 0],
        1.6,
    )
    speed = np.hypot(*np.diff(q[:, :2], axis=0).T) / T
    assert speed[20] > 0.28
    assert speed[60:].max() < 2e-3  # 0.5 s after the last frame and a moment later
    turned = np.diff(q[:, 3:], axis=0) / T
    assert turned[20, 0] > 0.05
    assert np.abs(turned[60:]).max() < 0.01, "nor does the arm sink"
    assert reading(live, "command_share", rows)[-1] == 0
    assert np.hypot(*(live.measured[:2] - q[-1, :2])) > 0.05  # what it saw last


def test_equal_seeds_give_equal_runs(body):
    plant = MobilePlant(location="camera", camera=Camera(position_noise=0.01, rate=50), encoder_noise=1e-3)
    runs = [drive(plant, body, Q0, [0.2, 0.1, 0, 0, 0, 0, 0], 0.2, seed)[0].measured for seed in (1, 1, 2)]
    assert np.array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])


def test_the_gripper_holds_a_cube_by_friction(body):
    """It closes on the cube, lifts it, and drops it; a cube without friction stays where it is."""
    hand = dqc.algebra.translation(body.fkm(np.array([0, 0, 0, 0, 0.317, 0.949, 0, 0])))
    lifted = dqc.algebra.translation(body.fkm(np.array([0, 0, 0, 0, 0.067, 0.949, 0, 0])))[2] - hand[2]
    schedule = [GripperEvent(time=0.2, closed=True), GripperEvent(time=2.4, closed=False)]
    for friction, height in ((0.8, lifted), (0.0, 0.0)):
        cube = dqc.world.Body(box=0.03, position=(hand[0], 0.0, 0.015), mass=0.02, friction=friction)
        world = dqc.World(bodies={"floor": dqc.world.Body(plane=(0, 0, 1)), "cube": cube})
        plant = MobilePlant(gripper=Gripper(closes="y", schedule=schedule), world=world)
        live = plant.start(body, np.array([0, 0, 0, 0, 0.317, 0.949, 0, 0]), T, 200, 0)
        heights = []
        for k in range(180):
            live.step(np.array([0, 0, 0, -0.25 if 50 < k <= 100 else 0, 0, 0, 0.0]))
            heights.append(reading(live, "cube_position", live.readings)[2])
        assert heights[118] == pytest.approx(0.015 + height, abs=0.006)
        assert heights[-1] == pytest.approx(0.015, abs=2e-3)
        closed = reading(live, "gripper_opening", live.readings)[0]
        assert closed == pytest.approx(0.06, abs=1e-3)


@pytest.mark.parametrize(
    ("make", "error", "text"),
    [
        (lambda: WheeledBase(mass=-1), ValueRangeError, r"plant.base.mass: must be > 0, got -1"),
        (lambda: WheeledBase(friction=-0.1), ValueRangeError, r"plant.base.friction: must be ≥ 0, got -0.1"),
        (lambda: WheeledBase(wheel_torque=0), ValueRangeError, r"plant.base.wheel_torque: must be > 0"),
        (lambda: MobilePlant(link_mass=[0.1, -1]), ValueRangeError, r"plant.link_mass\[1\]: must be > 0"),
        (lambda: MobilePlant(location="gps"), UnknownNameError, "plant.location"),
        (lambda: Gripper(force=0), ValueRangeError, "plant.gripper.force: must be > 0"),
        (lambda: Gripper(points="x", closes="x"), ValueRangeError, "plant.gripper.closes: must be another"),
        (
            lambda: Gripper(schedule=[GripperEvent(time=2, closed=True), GripperEvent(time=1, closed=False)]),
            ValueRangeError,
            "plant.gripper.schedule: times must increase",
        ),
    ],
)
def test_bad_parameters(make, error, text):
    with pytest.raises(error, match=text):
        make()


def test_bad_starts(body, cart):
    heavy, youbot = WheeledBase(mass=60), dqc.load_robot("youbot")
    for robot, plant, q0, error, text in (
        (
            youbot,
            MobilePlant(),
            np.zeros(8),
            ValueRangeError,
            "DifferentialDrive.*no physics has such a base.*'servo' or 'integrator'",
        ),
        (
            youbot,
            MujocoPlant(),
            np.zeros(8),
            ValueRangeError,
            "mobile base; no physics.*'servo' or 'integrator'",
        ),
        (
            dqc.load_robot("ax18"),
            MobilePlant(),
            np.zeros(5),
            ValueRangeError,
            "DifferentialDrive.*kind 'mujoco'",
        ),
        (body, MobilePlant(), np.zeros(7), ShapeError, r"start: expected shape \(…, 8\)"),
        (body, MobilePlant(), np.full(8, 2.7), ValueRangeError, "start: joint 4 'joint_1' is at 2.7"),
        (body, MobilePlant(link_mass=[1, 2]), Q0, ShapeError, "plant.link_mass"),
        (body, MobilePlant(link_mass=5), Q0, ValueRangeError, "little-john would fall over"),
        (body, MobilePlant(link_mass=5, base=heavy), Q0, ValueRangeError, "N·m to hold gravity"),
        (
            body,
            MujocoPlant(),
            np.zeros(8),
            ValueRangeError,
            "mujoco moves arms.*'mobile', or without physics 'servo'",
        ),
    ):
        with pytest.raises(error, match=text):
            plant.start(robot, q0, T, 1, 0)
    live = MobilePlant().start(cart, np.zeros(3), T, 1, 0)
    with pytest.raises(ShapeError, match=r"command: expected shape \(2,\)"):
        live.step(np.zeros(3))
    with pytest.raises(ValueRangeError, match="finite"):
        live.step([np.nan, 0])
    live = MobilePlant().start(body, Q0, T, 1, 0)
    with pytest.raises(DivergedError, match=r"a command of 1e\+30 rad/s"):
        live.step(np.eye(7)[4] * 1e30)


def two_arms_on_wheels():
    chassis = dqc.Chassis(
        mass=150, radius=0.4, height=0.3, wheel_mass=2, wheel_torque=60, caster_distance=0.38
    )
    base = dqc.DifferentialDrive(0.1, 0.3, rim_speed=1.0, chassis=chassis)
    stand, arm = dqc.DualQuaternion.from_translation, dqc.load_robot("panda")
    sides = [dqc.SerialArm.join([stand([0, y, 0]), arm]) for y in (0.3, -0.3)]
    return dqc.TwoArms(*sides, base=dqc.WholeBody([base, stand([0, 0, 0.5])]))


def test_two_arms_stand_on_a_drive_and_drive_with_it():
    robot, arm = two_arms_on_wheels(), [0, -0.5, 0, -2.2, 0, 1.7, 0.8]
    q0, command = np.array([0, 0, 0, *arm, *arm]), np.zeros(16)
    command[:2] = 0.3, 0.2
    plant = MobilePlant(gravity_compensation=1.0)
    live, q, _ = drive(plant, robot, q0, command, 1.0)
    inertia = dqc.load_robot("panda").inertia
    assert inertia is not None
    carried = 2 * inertia.mass.sum()
    assert live.model.body_mass.sum() == pytest.approx(154 + carried)
    assert np.abs(q[-1, :3] - robot.integrate(q0, command, 1.0)[:3]).max() < 0.03  # it takes a moment
    assert np.abs(q[-1, 3:] - q0[3:]).max() < 0.01
    for site, hand in (("hand", "left"), ("hand_2", "right")):
        place = dqc.algebra.translation(robot.fkm(live.q, hand))
        assert np.abs(live.data.site(site).xpos - place).max() < 2e-3  # the chassis tilts a little
    bent = np.tile([0.1, 0, 0, 0, 0, 0, 0], 2)
    live, q, _ = drive(plant, robot, q0, [0, 0, *bent], 1.0)
    assert np.abs(q[-1, 3:] - q0[3:] - bent).max() < 0.01


def test_two_arms_on_a_drive_that_are_refused():
    robot = two_arms_on_wheels()
    with pytest.raises(
        ValueRangeError, match=r"plant\.gripper: is at the end effector of one arm, and .* has two"
    ):
        MobilePlant(gripper=Gripper()).start(robot, np.zeros(17), T, 1, 0)
    with pytest.raises(ValueRangeError, match=r"two arms by v and ω, and .* is unconstrained"):
        MobilePlant().start(robot.in_form("unconstrained"), np.zeros(17), T, 1, 0)
    with pytest.raises(ValueRangeError, match=r"plant\.base: .* would fall over: with its arm at"):
        MobilePlant(base=WheeledBase(mass=5)).start(robot, np.zeros(17), T, 1, 0)
