"""What messages mean, and why some are refused. Stand-ins have the fields of the real ones: no ROS is needed."""

from types import SimpleNamespace as Fields

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.plants.compliant import joint_columns as column
from dqcontrol.ros2.messages import (
    RefusedError,
    Stamps,
    by_name,
    deviation_of,
    humanoid_command,
    numbers,
    planar_pose_of,
    planar_twist_of,
    pose_of,
    trajectory_point,
    twist_of,
)

MEKA = [0, 0.6283185, 0, 1.5707963, 0, 0.6283185, 0]


def test_joints_are_found_by_name_in_any_order_among_others():
    assert by_name("joints", ["grip", "b", "a"], [0.3, 2.0, 1.0], ["a", "b"]).tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("names", "values", "why"),
    [
        (["a", "x"], [1.0, 2.0], "has no joint 'b'"),
        (["a", "b"], [1.0], "2 names, but 1 positions"),
        (["a", "b", "a"], [1.0, 2.0, 3.0], "'a' is there twice"),
        (["a", "b"], [1.0, np.nan], "number 2 is not finite"),
        ([], [], "has no joint 'a'"),
    ],
)
def test_joints_that_do_not_fit_are_refused(names, values, why):
    with pytest.raises(RefusedError, match=why):
        by_name("joints", names, values, ["a", "b"])


def test_numbers_of_a_wrong_count_are_refused():
    with pytest.raises(RefusedError, match="velocity: expected 2 numbers, got 3"):
        numbers("velocity", [1.0, 2.0, 3.0], 2)


def test_stamps_must_increase():
    stamps = Stamps("joint states")
    assert stamps.check(10) == 10
    for early in (10, 9):
        with pytest.raises(RefusedError, match="stamp"):
            stamps.check(early)
    assert stamps.check(11) == 11


def humanoid(frame="THETA_GC", positions=(1.0, 2.0), effort=(0.5, 1.0), velocities=(), accelerations=()):
    point = Fields(positions=positions, effort=effort, velocities=velocities, accelerations=accelerations)
    return Fields(header=Fields(frame_id=frame), joint_names=["b", "a"], points=[point])


def test_a_humanoid_command_tells_mode_stiffness_and_slew_rate_beside_the_angles():
    position, told = humanoid_command(humanoid(), ["a", "b"])
    assert (position.tolist(), told.mode) == ([2.0, 1.0], "THETA_GC")
    np.testing.assert_array_equal(told.stiffness, [1.0, 0.5])
    assert told.slew_rate is None  # as it was
    _, told = humanoid_command(humanoid("", effort=(), velocities=(3.0, 4.0)), ["a"])
    np.testing.assert_array_equal(told.slew_rate, [4.0])


@pytest.mark.parametrize("mode", column.MODES)
def test_a_command_takes_a_meka_to_each_of_its_eight_modes(mode):
    """Torques come out of the torque loop as asked, duties as the voltage's share, after the second that it takes."""
    arm = dqc.load_robot("meka-a2")
    plant = dqc.plants.CompliantPlant(mode="THETA_GC").start(arm, MEKA, 0.008, 400, 0)
    asked = {"PWM": 0.02, "TORQUE": 0.3, "TORQUE_GC": 0.2}.get(mode)
    message = Fields(
        header=Fields(frame_id=mode),
        joint_names=list(arm.joint_names),
        points=[
            Fields(
                positions=MEKA, effort=(), velocities=(), accelerations=[] if asked is None else [asked] * 7
            )
        ],
    )
    _, told = humanoid_command(message, arm.joint_names)
    plant.set_joint_control(told)
    for _ in range(150):
        plant.step(np.zeros(7))
    assert plant.mode == mode
    assert plant.readings[-1] == column.MODES[mode]
    state = plant.memory.state
    if mode == "PWM":
        np.testing.assert_allclose(state[:, column.DUTY], asked, atol=1e-9)
    if mode == "TORQUE":
        np.testing.assert_allclose(state[:, column.DESIRED_TORQUE], asked, atol=1e-9)
    if mode == "TORQUE_GC":
        held = state[:, column.GRAVITY] + asked
        np.testing.assert_allclose(state[:, column.DESIRED_TORQUE], held, atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"frame": "TETA_GC"}, r"mode: unknown name 'TETA_GC'; did you mean 'THETA_GC'"),
        ({"accelerations": (1.0, 2.0)}, "must be one of PWM, TORQUE, TORQUE_GC, got 'THETA_GC'"),
        ({"frame": "PWM", "accelerations": (0.5, 1.5)}, "duty: must lie in -1 … 1, got 0.5 … 1.5"),
        ({"frame": "TORQUE", "accelerations": (0.5,)}, "2 names, but 1 torque"),
        (
            {"effort": (0.5, 1.5)},
            r"stiffness: must lie in 0 … 1, got 1.5|stiffness: must lie in 0 … 1, got 0.5 … 1.5",
        ),
        ({"effort": (0.5,)}, "2 names, but 1 stiffness"),
        ({"velocities": (-1.0, 2.0)}, "slew rate: must lie in 0 … 100"),
        ({"velocities": (np.nan, 2.0)}, "number 2 is not finite"),
    ],
)
def test_humanoid_commands_that_cannot_be_are_refused(changes, why):
    with pytest.raises(RefusedError, match=why):
        humanoid_command(humanoid(**changes), ["a", "b"])


def pose(frame="base_link", place=(0.1, 0.2, 0.3), turn=(1.0, 0.0, 0.0, 0.0)):
    return Fields(
        header=Fields(frame_id=frame),
        pose=Fields(
            position=Fields(**dict(zip("xyz", place, strict=True))),
            orientation=Fields(**dict(zip("wxyz", turn, strict=True))),
        ),
    )


def test_a_pose_is_a_unit_dual_quaternion():
    r = algebra.rotation_from_axis_angle([1.0, 2.0, 3.0], 0.7)
    x = pose_of(pose(turn=r * 1.001), "base_link")
    np.testing.assert_allclose(algebra.rotation(x), r, atol=1e-15)
    np.testing.assert_allclose(algebra.translation(x), [0.1, 0.2, 0.3], atol=1e-15)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"turn": (0.0, 0.0, 0.0, 0.0)}, "unit quaternion, got norm 0"),
        ({"frame": "camera"}, r"unknown frame 'camera' \(allowed: base_link\)"),
        ({"frame": ""}, "unknown frame ''"),
        ({"place": (0.0, np.inf, 0.0)}, "pose.position: number 2"),
    ],
)
def test_a_pose_that_is_none_is_refused(changes, why):
    with pytest.raises(RefusedError, match=why):
        pose_of(pose(**changes), "base_link")


def test_a_twist_in_an_unknown_frame_is_refused():
    zero = Fields(x=0.0, y=0.0, z=0.0)
    message = Fields(header=Fields(frame_id="map"), twist=Fields(linear=zero, angular=zero))
    with pytest.raises(RefusedError, match="unknown frame 'map'"):
        twist_of(message, ("base_link", "tool0"))


def test_a_trajectory_has_one_point():
    point = Fields(positions=[1.0, 2.0])
    message = Fields(joint_names=["b", "a"], points=[point])
    assert trajectory_point(message, ["a", "b"]).tolist() == [2.0, 1.0]
    with pytest.raises(RefusedError, match="expected 1 point, got 2"):
        trajectory_point(Fields(joint_names=["b", "a"], points=[point, point]), ["a", "b"])


def odometry(covariance=np.zeros(36), w=1.0, x=0.0, y=0.0, z=0.0, frame="odom"):  # noqa: B008
    pose = Fields(position=Fields(x=1.0, y=2.0, z=0.1), orientation=Fields(w=w, x=x, y=y, z=z))
    return Fields(header=Fields(frame_id=frame), pose=Fields(pose=pose, covariance=covariance))


def test_odometry_is_a_place_in_the_plane_and_its_worst_deviation():
    turned = odometry(w=np.cos(-1.2), z=np.sin(-1.2))
    np.testing.assert_allclose(planar_pose_of(turned, "odom"), [1.0, 2.0, -2.4])
    tilted = odometry(w=np.cos(0.17) * np.cos(0.4), x=np.sin(0.17), z=np.cos(0.17) * np.sin(0.4))
    assert planar_pose_of(tilted, "odom")[2] == pytest.approx(0.8)
    covariance = np.zeros((6, 6))
    covariance[:2, :2] = [[0.05, 0.04], [0.04, 0.05]]  # 0.3 m along the diagonal, 0.1 m across
    assert deviation_of(odometry(covariance.ravel())) == pytest.approx(0.3)
    covariance[0, 0] = -1.0
    assert deviation_of(odometry(covariance.ravel())) == 0.0
    for entry, why in (((0, 1), "negative eigenvalues"), ((5, 5), "negative eigenvalues")):
        wrong = np.eye(6)
        wrong[entry] = wrong[entry[::-1]] = -2.0
        with pytest.raises(RefusedError, match=why):
            deviation_of(odometry(wrong.ravel()))
    with pytest.raises(RefusedError, match="odometry: covariance: number 8 is not finite"):
        deviation_of(odometry(np.where(np.arange(36) == 7, np.nan, 0.0)))


def test_velocities_that_a_base_cannot_have_are_refused():
    def twist(v, w):
        return Fields(linear=Fields(x=v[0], y=v[1], z=v[2]), angular=Fields(x=w[0], y=w[1], z=w[2]))

    assert planar_twist_of(twist((0.3, 0, 0), (0, 0, 0.5)), sideways=False) == (0.3, 0.0, 0.5)
    assert planar_twist_of(twist((0, 0.2, 0), (0, 0, 0)), sideways=True) == (0.0, 0.2, 0.0)
    for v, w, why in (
        ((0, 0.2, 0), (0, 0, 0), "linear.y: the base cannot move so; expected 0, got 0.2"),
        ((0, 0, 0.1), (0, 0, 0), "linear.z: the base cannot move so"),
        ((0, 0, 0), (0.1, 0, 0), "angular.x: the base cannot move so"),
        ((np.inf, 0, 0), (0, 0, 0), "linear: number 1 is not finite"),
    ):
        with pytest.raises(RefusedError, match=why):
            planar_twist_of(twist(v, w), sideways=False)
