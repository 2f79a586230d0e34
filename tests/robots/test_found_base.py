"""Mobile bases found in URDF and MJCF files: what is read, what is asked for and why."""

import math

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import FileFormatError, UnknownNameError
from dqcontrol.robots import CarLikeBase, DifferentialDrive, MecanumBase, OmniBase, SteeredTricycle

CYLINDER = '<collision><geometry><cylinder radius="0.05" length="0.03"/></geometry></collision>'
MESH = '<collision><geometry><mesh filename="package://nowhere/wheel.stl"/></geometry></collision>'


def joint(name, parent, child, kind="continuous", xyz="0 0 0", axis="0 1 0", extra=""):
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="{xyz}"/><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="{axis}"/>{extra}</joint>'
    )


def wheel(name, x, y, *, z=0.05, shape=CYLINDER, steer="", parent="base", axis="0 1 0"):
    """Return a wheel; ``steer`` is the type of a joint about z above it."""
    speed = '<limit velocity="10" effort="5"/>'
    if not steer:
        return f'<link name="{name}_link">{shape}</link>' + joint(
            name, parent, f"{name}_link", xyz=f"{x} {y} {z}", axis=axis, extra=speed
        )
    limits = '<limit lower="-0.6" upper="0.5" velocity="1" effort="5"/>' if steer == "revolute" else speed
    return (
        f'<link name="{name}_fork"/><link name="{name}_link">{shape}</link>'
        + joint(f"{name}_steer", parent, f"{name}_fork", steer, f"{x} {y} {z}", "0 0 1", limits)
        + joint(name, f"{name}_fork", f"{name}_link", axis=axis, extra=speed)
    )


def arm(count, start="base", prefix="arm"):
    limit = '<limit lower="-2" upper="2" velocity="1" effort="5"/>'
    links, parent = "", start
    for i in range(count):
        child = f"{prefix}{i}_link"
        links += f'<link name="{child}"/>' + joint(
            f"{prefix}{i}", parent, child, "revolute", "0.1 0 0.2", "0 0 1" if i % 2 else "0 1 0", limit
        )
        parent = child
    fingers = "".join(
        f'<link name="{prefix}_{side}"/>'
        + joint(
            f"{prefix}_finger_{side}",
            parent,
            f"{prefix}_{side}",
            "prismatic",
            extra='<limit lower="0" upper="0.05" velocity="1" effort="5"/>',
        )
        for side in ("left", "right")
    )
    return links + fingers


@pytest.fixture
def file(tmp_path):
    def write(*parts, name="robot.urdf"):
        path = tmp_path / name
        path.write_text(f'<robot name="found"><link name="base"/>{"".join(parts)}</robot>')
        return path

    return write


def pair(x=0.0, half=0.2, **others):
    return wheel(f"wheel_left_{x:g}", x, half, **others), wheel(f"wheel_right_{x:g}", x, -half, **others)


def test_two_wheels_make_a_differential_drive_with_its_arm(file):
    caster = wheel("front_caster_wheel", 0.2, 0, steer="continuous")
    body = dqc.load_robot(file(*pair(0.1), caster, arm(4)), drive="found")
    base, place, chain = body.parts
    assert isinstance(base, DifferentialDrive)
    assert (base.wheel_radius, base.half_track, base.rim_speed) == pytest.approx((0.05, 0.2, 0.5))
    np.testing.assert_allclose(dqc.DualQuaternion(place).translation, [-0.1, 0, 0], atol=1e-12)
    assert chain.joint_names == ("arm0", "arm1", "arm2", "arm3")  # the fingers move no hand
    assert chain.links[-1] == "arm3_link"
    hand = dqc.algebra.translation(body.fkm(np.zeros(7)))
    np.testing.assert_allclose(hand, [0.3, 0, 0.8], atol=1e-12)


def test_the_base_drives_forwards_along_the_file_s_x_whichever_way_its_axles_point(file):
    for axis in ("0 1 0", "0 -1 0"):
        body = dqc.load_robot(file(*pair(axis=axis), arm(1)), drive="found")
        moved = dqc.algebra.translation(body.fkm([1.0, 0, 0, 0])) - dqc.algebra.translation(
            body.fkm(np.zeros(4))
        )
        np.testing.assert_allclose(moved, [1, 0, 0], atol=1e-12)
    across = wheel("wheel_a", 0.2, 0, axis="1 0 0") + wheel("wheel_b", -0.2, 0, axis="1 0 0")
    body = dqc.load_robot(file(across, arm(1)), drive="found")
    hand = dqc.algebra.translation(body.fkm(np.zeros(4)))
    np.testing.assert_allclose(hand, [0, -0.1, 0.2], atol=1e-12)  # it drives along the file's y


def test_steered_wheels_make_cars_and_tricycles(file):
    front = [wheel(f"front_wheel_{i}", 0.5, y, steer="revolute") for i, y in enumerate((0.2, -0.2))]
    car = dqc.load_robot(file(*pair(), *front), drive="found").parts[0]
    assert isinstance(car, CarLikeBase)
    assert (car.wheelbase, car.steering_limit, car.half_track) == pytest.approx((0.5, 0.5, 0.2))
    tricycle = dqc.load_robot(
        file(*pair(), wheel("front_wheel", 0.5, 0, steer="revolute")), drive="found"
    ).parts[0]
    assert isinstance(tricycle, SteeredTricycle)
    assert tricycle.wheelbase == pytest.approx(0.5)


def youbot_wheels(steer=""):
    # caster_offset_x, _y of the maker's description; its wheels can be turned, and are not
    return [
        wheel(f"wheel_joint_{x}{y}", x * 0.228, y * 0.158, z=-0.034, steer=steer)
        for x in (1, -1)
        for y in (1, -1)
    ]


def test_four_wheels_are_asked_about(file):
    path = file(*youbot_wheels(), arm(5))
    with pytest.raises(
        FileFormatError, match="four wheels that are not steered: mecanum wheels, or a base that skids"
    ):
        dqc.load_robot(path, drive="found")
    with pytest.raises(FileFormatError, match="are all casters; give drive"):
        dqc.load_robot(file(*youbot_wheels("continuous"), name="casters.urdf"), drive="found")
    for one in (path, file(*youbot_wheels("continuous"), arm(5), name="casters.urdf")):
        body = dqc.load_robot(one, drive="mecanum")
        base = body.parts[0]
        assert isinstance(base, MecanumBase)
        assert (base.half_track, base.half_wheelbase, base.wheel_radius) == pytest.approx(
            (0.158, 0.228, 0.05)
        )
        # the floor is below the wheels, not at the file's origin
        assert dqc.DualQuaternion(body.parts[1]).translation[2] == pytest.approx(0.084)
    rollers = "".join(wheel(f"mecanum_wheel_{x}{y}", x * 0.2, y * 0.1) for x in (1, -1) for y in (1, -1))
    assert isinstance(dqc.load_robot(file(rollers, name="rollers.urdf"), drive="found").parts[0], MecanumBase)


def test_wheels_around_the_middle_are_omni_wheels(file):
    angles = [math.radians(60 + 120 * i) for i in range(3)]
    wheels = [
        wheel(
            f"wheel{i}",
            0.3 * math.cos(a),
            0.3 * math.sin(a),
            axis=f"{math.cos(a):.9f} {math.sin(a):.9f} 0",
        )
        for i, a in enumerate(angles)
    ]
    base = dqc.load_robot(file(*wheels), drive="found").parts[0]
    assert isinstance(base, OmniBase)
    assert (base.wheel_count, base.wheel_distance) == (3, pytest.approx(0.3))


@pytest.mark.parametrize(
    ("parts", "options", "message"),
    [
        ([arm(3)], {}, "has no wheel: a wheel is a joint of type continuous"),
        (pair(shape=MESH), {}, "neither cylinder nor sphere, so its radius is unknown; give wheel_radius"),
        (pair(half=0.0), {}, "a track of 0 turns no base; give track"),
        (pair(), {"drive": "tricycle"}, "needs a wheel that is steered"),
        (pair(), {"drive": "mecanum"}, "on one axle; drive: mecanum needs two"),
        ([wheel("wheel", 0, 0)], {}, "1 wheels that are not steered and 0 that are"),
        (pair(), {"track": 0.0}, "track: must be > 0"),
        (pair(), {"drive": "tank"}, "drive: unknown name 'tank'"),
        (pair(), {"drive": True}, "drive: unknown name 'True'"),
        ([*pair(), arm(3), arm(3, prefix="other")], {}, "tip_link: must be given .*several arms"),
    ],
)
def test_what_cannot_be_told_is_said(file, parts, options, message):
    with pytest.raises((FileFormatError, UnknownNameError, ValueError), match=message):
        dqc.load_robot(file(*parts), **{"drive": "found", **options})


def test_what_the_file_lacks_may_be_given(file):
    base = dqc.load_robot(file(*pair(shape=MESH)), wheel_radius=0.06, track=0.5, drive="found").parts[0]
    assert (base.wheel_radius, base.half_track) == (0.06, 0.25)


def test_tiago_from_its_wheels():
    body = dqc.load_robot("example-robot-data:tiago_description/robots/tiago_no_hand.urdf", drive="found")
    base = body.parts[0]
    assert isinstance(base, DifferentialDrive)
    assert (base.wheel_radius, base.half_track, base.rim_speed) == pytest.approx((0.0985, 0.2022, 1.0))
    assert body.input_names[:4] == ("v", "omega", "torso_lift_joint", "arm_1_joint")
    body = dqc.load_robot("example-robot-data:tiago_description/robots/tiago.urdf", drive="found")
    assert body.parts[-1].links[-1] == "hand_palm_link"


def test_part_of_a_robot_file(file, tmp_path):
    file(*pair(shape=MESH), arm(2))
    path = tmp_path / "mine.yaml"
    path.write_text(
        "name: mine\nangles: degrees\nparts:\n  - {kind: mobile-robot, robot: robot.urdf, wheel_radius: 0.06}\n"
    )
    assert dqc.load_robot(path).input_names == ("v", "omega", "arm0", "arm1")
    path.write_text(path.read_text().replace(", wheel_radius: 0.06", ""))
    with pytest.raises(FileFormatError, match=r"robot\.urdf: mobile base: .*give wheel_radius"):
        dqc.load_robot(path)


MJCF = """<mujoco model="cart"><worldbody><body name="chassis" pos="0 0 0.08"><freejoint/>
  <geom type="box" size="0.2 0.1 0.05"/>
  <body name="left" pos="0 0.15 0"><joint name="left_wheel" axis="0 1 0"/>
    <geom type="cylinder" size="0.08 0.02" euler="90 0 0"/></body>
  <body name="right" pos="0 -0.15 0"><joint name="right_wheel" axis="0 1 0"/>
    <geom type="cylinder" size="0.08 0.02" euler="90 0 0"/></body>
  <body name="link" pos="0.1 0 0.2"><joint name="shoulder" axis="0 1 0" range="-90 90"/>
    <geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0"/></body>
</body></worldbody></mujoco>"""


def test_mjcf(tmp_path):
    pytest.importorskip("mujoco")
    path = tmp_path / "cart.xml"
    path.write_text(MJCF)
    body = dqc.load_robot(path, drive="found")
    assert body.input_names == ("v", "omega", "shoulder")
    assert (body.parts[0].wheel_radius, body.parts[0].half_track) == pytest.approx((0.08, 0.15))
    assert dqc.DualQuaternion(body.fkm(np.zeros(4))).translation[2] == pytest.approx(0.28)


def test_the_command(file, capsys):
    from dqcontrol.cli import app

    path = file(*pair(), wheel("caster_wheel", 0.2, 0, steer="continuous"))
    app(["robots", "wheels", str(path)], result_action="return_value")
    said = capsys.readouterr().out
    assert "found: differential drive, wheel_radius 0.05, half_track 0.2, rim_speed 0.5" in said
    assert "caster" in said
