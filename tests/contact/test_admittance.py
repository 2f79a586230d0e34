"""The admittance stage against matrix exponentials, finite differences, transforms of wrenches and energy."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from dqcontrol import algebra
from dqcontrol.contact import (
    Admittance,
    Compliance,
    DeflectionLimits,
    ForceReference,
    ForceSensor,
    LostContact,
    SilentSensor,
    Tool,
    WantedWrench,
)
from dqcontrol.contact.admittance import exact_step
from dqcontrol.contact.admittance_step import _place
from dqcontrol.contact.contact_layout import contact_parameters
from dqcontrol.errors import Error

FREE = Compliance(damping=100.0)
PUSH = Compliance(damping=200.0, stiffness=["rigid", "rigid", 0.0])
HERE = algebra.pose(algebra.rotation_from_rpy([0.3, -0.5, 1.1]), [0.4, 0.1, 0.3])
NOTHING = np.zeros(6)


def at_rest(pose=HERE):
    return np.concatenate([pose, np.zeros(13)])


def turn_of(pose):
    return Rotation.from_quat(pose[:4], scalar_first=True)


def place_of(pose):
    return algebra.matrix_from_pose(pose[:8])[:3, 3]


@pytest.mark.parametrize(
    ("mass", "damping", "stiffness"), [(2, 30, 400), (2, 30, 0), (0.01, 80, 10), (5, 0, 40)]
)
def test_a_step_is_the_exact_solution(mass, damping, stiffness):
    stage = Admittance(translation=Compliance(mass=mass, damping=damping, stiffness=stiffness)).start(0.01)
    force, y, v = np.array([1.0, -2.0, 3.0]), np.zeros(3), np.zeros(3)
    for k in range(100):
        local = turn_of(HERE).inv().apply(turn_of(HERE).apply(force * np.cos(0.1 * k)))
        stage.step(HERE, at_rest(), np.concatenate([local, np.zeros(3)]))
        step = expm(np.array([[0, 1, 0], [-stiffness / mass, -damping / mass, 1 / mass], [0, 0, 0]]) * 0.01)
        y, v = (row @ [y, v, force * np.cos(0.1 * k)] for row in step[:2])
        assert np.abs(stage.state.y[3:] - y).max() < 1e-12
        assert np.abs(stage.state.v[3:] - v).max() < 1e-12


def test_no_step_grows_by_itself_and_no_mass_is_the_limit_of_small_ones():
    rng = np.random.default_rng(0)
    for _ in range(2000):
        mass, damping, stiffness = rng.uniform(0, 100), 10 ** rng.uniform(-2, 4), 10 ** rng.uniform(-2, 5)
        row = exact_step(mass, damping, stiffness, 10 ** rng.uniform(-4, 0))
        assert np.abs(np.linalg.eigvals(row.reshape(2, 3)[:, :2])).max() <= 1 + 1e-9
    without, with_little = exact_step(0, 80, 500, 0.01), exact_step(1e-7, 80, 500, 0.01)
    assert np.abs(without[:3:2] - with_little[:3:2]).max() < 1e-6


def twist_of(pose, rate):
    """Return ξ of ẋ = ½ ξ x."""
    return 2 * algebra.multiply(rate, algebra.conjugate(pose))[[1, 2, 3, 5, 6, 7]]


@pytest.mark.parametrize("axes", ["reference", "base"])
@pytest.mark.parametrize("size", [1e-3, 0.8])
def test_twist_and_its_rate_are_derivatives_of_the_pose(axes, size):
    """While the reference turns and moves at a changing speed, and the frame leaves it on all axes."""
    given = contact_parameters(Admittance(axes=axes, translation=FREE).parameters(0.01))
    screw, begin, end = np.random.default_rng(1).normal(size=(3, 6))

    def placed(t):
        way, out = np.sin(t), np.zeros(21)
        pose = algebra.multiply(algebra.exp_screw(0.5 * way * screw), HERE)
        sample = np.array([*pose, *np.cos(t) * screw, *-np.sin(t) * screw, t])
        y, v, rate = (
            size * (begin * f + end * g) for f, g in ((np.cos(t), t), (-np.sin(t), 1), (-np.cos(t), 0))
        )
        _place(sample, given, y, v, rate, out)
        return out, sample

    h = 1e-5
    for t in np.linspace(0.1, 1.4, 7):
        (after, desired_after), (before, desired_before) = placed(t + h), placed(t - h)
        for found, ahead, behind in zip(
            placed(t), (after, desired_after), (before, desired_before), strict=True
        ):
            expected = twist_of(found[:8], (ahead[:8] - behind[:8]) / (2 * h))
            assert np.abs(found[8:14] - expected).max() < 1e-8
            assert np.abs(found[14:20] - (ahead[8:14] - behind[8:14]) / (2 * h)).max() < 1e-8


def test_the_pose_is_that_of_the_decoupled_logarithm():
    stage = Admittance(translation=FREE, rotation=Compliance(damping=0.5)).start(0.01)
    for _ in range(40):
        shaped = stage.step(HERE, at_rest(), np.array([10.0, 5, -7, 0.4, -0.6, 0.2]))
    y = stage.state.y.copy()
    shaped = stage.step(HERE, at_rest(), np.zeros(6))
    turned = turn_of(HERE) * Rotation.from_rotvec(y[:3])
    assert np.abs((turned.inv() * turn_of(shaped)).as_rotvec()).max() < 1e-12
    assert np.abs(place_of(shaped) - place_of(HERE) - turn_of(HERE).apply(y[3:])).max() < 1e-14


@pytest.mark.slow
def test_the_spring_makes_no_energy_where_stiffnesses_differ():
    """Its moment is the gradient of ½ φᵀKφ: the work on a closed turn is zero, as K φ itself would make −33 J."""
    stiffness, work, count = np.array([10.0, 40.0, 90.0]), 0.0, 4000
    angles = 2 * np.pi * np.arange(count + 1) / count
    way = 0.6 * np.column_stack(
        [1 + np.cos(angles), 0.5 + 0.8 * np.sin(angles), 0.6 * np.sin(2 * angles + 0.7)]
    )
    plain = 0.0
    for here, there in pairwise(way):
        phi, step = 0.5 * (here + there), Rotation.from_rotvec(there) * Rotation.from_rotvec(here).inv()
        # in balance, Jₗᵀ m = K φ: find m by the stage's own generalised force
        transposed = np.column_stack([_generalised(phi, each) for each in np.eye(3)])
        moment = np.linalg.solve(transposed, stiffness * phi)
        work += moment @ step.as_rotvec()
        plain += stiffness * phi @ step.as_rotvec()
    assert abs(work) < 1e-4
    assert abs(plain) > 0.1


def _generalised(phi, moment):
    """Return what a moment does along φ, by the stage: with D = 1 and K = 0 the rate of φ."""
    stage = Admittance(rotation=Compliance(damping=1.0)).start(1e-9)
    stage.state.y[:3] = phi
    stage.step(HERE, at_rest(), np.concatenate([np.zeros(3), moment]))
    return stage.state.v[:3].copy()


def test_wrenches_go_to_the_hand_and_lose_weight_and_bias():
    tool = Tool(
        mass=0.7, center=(0.01, 0.02, 0.05), force_bias=(0.3, -0.2, 0.1), torque_bias=(0.01, 0.02, -0.03)
    )
    position, rpy = np.array([0.02, -0.01, 0.08]), (0.2, 0.4, -0.9)
    sensor = ForceSensor(position=tuple(position), rpy=rpy, tool=tool)
    force, moment = np.array([1.0, 2.0, -3.0]), np.array([0.1, -0.2, 0.3])  # at the hand, its axes
    turn = Rotation.from_quat(algebra.rotation_from_rpy(rpy)[:4], scalar_first=True)
    weight = (turn_of(HERE) * turn).inv().apply([0, 0, -9.81 * 0.7])
    shown = turn.inv().apply(force) + weight + tool.force_bias
    torque = turn.inv().apply(moment - np.cross(position, force))
    torque = torque + np.cross(tool.center, weight) + tool.torque_bias
    for axes in ("hand", "reference", "base"):
        stage = Admittance(axes=axes, sensor=sensor, translation=FREE).start(0.01)
        target = at_rest(algebra.pose([1, 0, 0, 0], [0.1, 0.2, 0.3]))
        stage.step(HERE, target, np.concatenate([shown, torque]))
        into = Rotation.identity() if axes == "hand" else turn_of(HERE)
        assert np.abs(stage.state.wrench[3:] - into.apply(force)).max() < 1e-13
        assert np.abs(stage.state.wrench[:3] - into.apply(moment)).max() < 1e-13


def test_rigid_axes_pass_and_the_free_hand_moves_at_force_over_damping():
    stage = Admittance(translation=PUSH, force=WantedWrench(z=2.0), ramp=0.0).start(0.004)
    first = stage.step(HERE, at_rest(), np.array([50.0, 60, 0, 1, 2, 3]))
    shaped = [stage.step(HERE, at_rest(), np.array([50.0, 60, 0, 1, 2, 3])) for _ in range(9)][-1]
    assert np.abs(first[:8] - HERE).max() < 1e-15  # no sample is lost, and none jumps
    moved = turn_of(HERE).inv().apply(place_of(shaped) - place_of(HERE))
    assert np.abs(moved - [0, 0, -9 * 0.004 * 0.01]).max() < 1e-15


def test_the_wanted_force_begins_at_what_is_measured_and_follows_its_times():
    wanted = ForceReference(times=[0.0, 1.0], values=[2.0, 6.0])
    stage = Admittance(translation=PUSH, force=WantedWrench(z=wanted), ramp=0.1).start(0.01)
    felt = turn_of(HERE).inv().apply(turn_of(HERE).apply([0, 0, 5.0]))
    speeds = [
        stage.step(HERE, at_rest(), [*felt, 0, 0, 0]) is not None and stage.state.v[5] for _ in range(200)
    ]
    assert abs(speeds[0]) < 1e-15
    for k in (5, 50, 150):
        row = np.interp(0.01 * k, [0, 1], [2.0, 6.0])
        expected = 5.0 + min(k / 10, 1.0) * (row - 5.0)
        assert abs(speeds[k] - (5.0 - expected) / 200) < 1e-12


def test_dead_band_speed_and_depth():
    stage = Admittance(
        translation=FREE, dead_band=3.0, limits=DeflectionLimits(speed=0.05, depth=0.004)
    ).start(0.01)
    stage.step(HERE, at_rest(), np.array([2.0, 1, 1, 0, 0, 0]))
    assert not stage.state.y.any()
    stage.step(HERE, at_rest(), np.array([4.0, 0, 0, 0, 0, 0]))
    assert abs(stage.state.v[3] - 1.0 / 100) < 1e-15
    before = stage.state.y[3]
    stage.step(HERE, at_rest(), np.array([400.0, 0, 0, 0, 0, 0]))
    assert abs(stage.state.y[3] - before - 0.05 * 0.01) < 1e-15
    for _ in range(50):
        stage.step(HERE, at_rest(), np.array([400.0, 0, 0, 0, 0, 0]))
    assert stage.state.y[3] == 0.004
    stage.step(HERE, at_rest(), np.array([-8.0, 0, 0, 0, 0, 0]))
    assert stage.state.y[3] < 0.004  # and comes back at once


def test_contact_is_lost_and_looked_for_at_its_own_speed():
    stage = Admittance(
        translation=PUSH,
        force=WantedWrench(z=2.0),
        ramp=0.0,
        lost=LostContact(below=0.5, after=0.02, speed=0.001),
    ).start(0.004)
    for force, count in ((0.0, 3), (2.0, 5), (0.2, 8)):
        for _ in range(count):
            stage.step(HERE, at_rest(), np.array([0, 0, force, 0, 0, 0]))
    assert stage.state.losses[0] == 1
    assert stage.state.touches[0] == 0
    before = stage.state.y[5]
    stage.step(HERE, at_rest(), NOTHING)
    assert abs(stage.state.y[5] - before + 0.001 * 0.004) < 1e-15


@pytest.mark.parametrize("retreat", [0.005, 0.0])
def test_a_silent_sensor_is_no_free_air(retreat):
    stage = Admittance(
        translation=PUSH,
        force=WantedWrench(z=2.0),
        ramp=0.0,
        silent=SilentSensor(after=0.05, retreat=retreat, speed=0.02),
    ).start(0.01)
    for _ in range(5):
        stage.step(HERE, at_rest(), np.array([0, 0, 1.0, 0, 0, 0]))
    silence, deep = np.full(6, np.nan), []
    for _ in range(60):
        assert np.isfinite(stage.step(HERE, at_rest(), silence)).all()
        deep.append(stage.state.y[5])
    assert deep[3] == deep[2] == deep[4]  # rests once the last value is old
    assert abs(deep[-1] - deep[4] - retreat) < 1e-12
    stage.step(HERE, at_rest(), np.array([0, 0, 1.0, 0, 0, 0]))
    assert stage.state.y[5] < deep[-1]  # hears again, pushes again


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Admittance(translation=Compliance(stiffness=100.0)), "mass and damping are both 0"),
        (lambda: Admittance(translation=Compliance(damping=-1.0)), "damping"),
        (lambda: Admittance(), "all axes are rigid"),
        (
            lambda: Admittance(translation=PUSH, force=WantedWrench(x=2.0)),
            "contact.force.x: is wanted along a rigid",
        ),
        (lambda: Admittance(translation=FREE, ramp=np.nan), "ramp: must be finite"),
        (lambda: ForceReference(times=[0, 0], values=[1, 2]), "which increase"),
        (lambda: Admittance(translation=Compliance(damping=1.0, stiffness=["soft", 0.0, 0.0])), "stiffness"),
    ],
)
def test_what_is_refused(make, text):
    with pytest.raises(Error, match=text):
        make()
