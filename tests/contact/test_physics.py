"""Force in physics: the sensor of a wrist with its tool, and pressing on what MuJoCo moves."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
import yaml

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.contact import Admittance, Compliance, ForceSensor, Tool, WantedWrench, contact_limits
from dqcontrol.plants import MujocoPlant, Servo, Wrist

pytest.importorskip("mujoco")

ARM = dqc.SerialArm.join([dqc.load_robot("iiwa7"), algebra.pose([1, 0, 0, 0], [0, 0, 0.1])])
START = np.array([0, 0.6, 0, -1.6, 0, 0.9, 0])
HAND = ARM.fkm(START)
PLACE = algebra.translation(HAND)
LOAD = {
    "mass": 0.5,
    "center": (0.01, 0.0, -0.05),
    "force_bias": (0.3, -0.1, 0.0),
    "torque_bias": (0.0, 0.02, 0.0),
}
PEN = {"length": 0.1, "radius": 0.004}
T = 0.004


def benchmark(name):
    file = Path(__file__).parents[2] / "benchmarks" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


peg, crank = benchmark("peg"), benchmark("crank")


def plant(**more):
    return MujocoPlant(bandwidth=10, timestep=5e-4, wrist=Wrist(**{"filter": 0.005, **LOAD, **PEN, **more}))


def board(stiffness, tilt=0.0, friction=0.2):
    body = dqc.world.Body(
        box=(0.4, 0.4, 0.04),
        position=(PLACE[0], PLACE[1], PLACE[2] - 0.025),
        rpy=(np.radians(tilt), 0, 0),
        stiffness=stiffness,
        friction=friction,
    )
    return dqc.World(bodies={"board": body})


def press(damping, **more):
    translation = Compliance(damping=damping, stiffness=["rigid", "rigid", 0.0])
    sensor = ForceSensor(tool=Tool(**LOAD))
    return Admittance(axes="base", translation=translation, force=WantedWrench(z=2.0), sensor=sensor, **more)


@pytest.mark.parametrize("seed", [0, 1])
def test_the_sensor_shows_weight_and_bias_at_rest(seed):
    q = np.random.default_rng(seed).uniform(-0.4, 0.4, 7) + START
    live = plant().start(ARM, q, T, 50, 0)
    for _ in range(50):
        live.step(np.zeros(7))
    weight = 0.5 * algebra.matrix_from_pose(ARM.fkm(live.q))[:3, :3].T @ [0.0, 0.0, -9.81]
    wanted = [*(weight + LOAD["force_bias"]), *(np.cross(LOAD["center"], weight) + LOAD["torque_bias"])]
    np.testing.assert_allclose(live.wrench, wanted, atol=2e-3)


def test_filter_and_noise_of_the_sensor():
    live = plant(filter=0.02, force_noise=0.1, torque_noise=0.01).start(ARM, START, T, 500, 3)
    shown = []
    for _ in range(500):
        live.step(np.zeros(7))
        shown.append(live.wrench.copy())
    spread = np.std(shown[100:], axis=0)
    np.testing.assert_allclose(spread, [0.1] * 3 + [0.01] * 3, rtol=0.15)


def test_pressing_on_a_springy_board():
    """Within 1 % of the wanted force, in MuJoCo's contacts and in the board's spring."""
    law = dqc.laws.ProportionalFeedforward(gain=1.0, contact=press(300.0))
    record = dqc.simulate(
        ARM, dqc.references.SetPoint(HAND), law, plant().in_world(board(5e3)), START, T, 5.0
    )
    touch = record.readings["touch_force"].values[:, 2]
    assert touch[-1] == pytest.approx(2.0, rel=0.01)
    assert touch.max() < 3 * 2.0
    assert -5e3 * record.readings["board_displacement"].values[-1, 2] == pytest.approx(2.0, rel=0.01)


def test_a_circle_pressed_on_a_tilted_board():
    contact = press(150.0)
    law = dqc.laws.ProportionalFeedforward(gain=1.0, contact=contact)
    circle = dqc.references.Circle(HAND, radius=0.03, duration=6.0, plane="xy")
    record = dqc.simulate(ARM, circle, law, plant().in_world(board(2e3, tilt=3.0, friction=0.0)), START, T)
    force = record.readings["touch_force"].values[record.time > 2.0, 2]
    assert np.mean(np.abs(force - 2.0) <= 0.5) >= 0.98


def test_how_fast_to_approach_counts_the_lag_of_servos_with_masses():
    """Critically damped at 10 Hz they are 2/ω = 32 ms late, as servos with such a lag are."""
    law = dqc.laws.ProportionalFeedforward(gain=1.0).prepare(ARM, None, T)
    contact = press(300.0)
    physics = contact_limits(contact, law, plant(), START, 5e3).approach_speed
    servos = contact_limits(contact, law, Servo(time_constant=2 / (20 * np.pi)), START, 5e3).approach_speed
    assert physics == pytest.approx(servos, rel=0.1)


def test_a_flat_tool_is_as_wide_as_it_says():
    """The hull of its corners: a prism whose sides lie within 0.1 % of its radius, and which ends at the hand."""
    live = plant(radius=0.01, flat=True).in_world(board(5e3)).start(ARM, START, T, 1, 0)
    corners = live.model.mesh_vert + live.model.mesh_pos[0]
    assert np.hypot(*corners[:, :2].T) == pytest.approx(0.01, rel=1e-3)
    assert corners[:, 2].max() == pytest.approx(0.0, abs=1e-6)
    assert corners[:, 2].min() == pytest.approx(-0.1, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 4])
def test_a_peg_finds_its_hole(seed):
    """2 mm and 2° off in other directions, on 100 kN/m: more than 20 mm deep in the end, at most 25 N on the peg."""
    record = dqc.run(peg.displaced(yaml.safe_load(peg.EXAMPLE.read_text()), seed)).record
    socket = peg.displaced(yaml.safe_load(peg.EXAMPLE.read_text()), seed)["world"]["socket"]
    body = dqc.world.Body(**socket)
    assert body.holds(record.position[-1])
    matrix = algebra.matrix_from_pose(body.pose)
    assert (matrix[:3, :3].T @ (record.position[-1] - matrix[:3, 3]))[2] < 0.010
    assert np.linalg.norm(record.readings["touch_force"].values, axis=1).max() <= peg.MOST


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_a_crank_of_unknown_radius_is_turned(seed):
    trial, axis, asked = crank.crank(yaml.safe_load(crank.EXAMPLE.read_text()), seed)
    record = dqc.run(trial).record
    assert np.abs(record.readings["crank_angle"].values).max() >= abs(asked)
    radial = record.position[:, :2] - axis
    radial /= np.linalg.norm(radial, axis=1, keepdims=True)
    assert np.abs(np.sum(record.readings["touch_force"].values[:, :2] * radial, axis=1)).max() <= crank.MOST


@pytest.mark.slow
def test_a_drum_is_wiped_by_its_force():
    record = dqc.run(crank.EXAMPLE.with_name("wiping.yaml")).record
    force = record.readings["touch_force"].values[record.time > 2.5, 2]
    assert np.mean(np.abs(force - 5.0) <= 1.0) >= 0.98
