"""Ways of mobile robots whose own file, or whose physics, says how wide they are: through no narrower door."""

import numpy as np
import pytest
import yaml

import dqcontrol as dqc
from dqcontrol.cli import app
from dqcontrol.errors import NoteWarning, ShapeError, UnreachableGoalError
from dqcontrol.geometry import FloorMap
from dqcontrol.references import DriveTo
from dqcontrol.references.ways_around import across

WIDTH, DOOR = 0.8, 0.62  # m
BOX = f'<collision><origin xyz="0 0 0.2"/><geometry><box size="0.5 {WIDTH} 0.3"/></geometry></collision>'
MESH = '<collision><geometry><mesh filename="package://nowhere/base.stl"/></geometry></collision>'
TYRE = '<collision><geometry><cylinder radius="0.1" length="0.04"/></geometry></collision>'
HOME = [0, 0, 0, 0.2, -0.8, 1.2, -0.4]


def robot_file(folder, body):
    """Write a robot on two wheels 0.4 m apart, with an arm of four joints, and a file that it is a part of."""
    wheels = "".join(
        f'<link name="{side}_wheel">{TYRE}</link><joint name="{side}" type="continuous">'
        f'<origin xyz="0 {y} 0.1" rpy="-1.5708 0 0"/><axis xyz="0 0 1"/><parent link="base"/>'
        f'<child link="{side}_wheel"/><limit velocity="10" effort="5"/></joint>'
        for side, y in (("left", 0.2), ("right", -0.2))
    )
    arm, parent = "", "base"
    for k, (axis, height) in enumerate((("0 0 1", 0.4), ("0 1 0", 0.1), ("0 1 0", 0.2), ("0 1 0", 0.2))):
        arm += (
            f'<link name="link{k}"><collision><geometry><sphere radius="0.04"/></geometry></collision></link>'
            f'<joint name="arm{k}" type="revolute"><origin xyz="0 0 {height}"/><axis xyz="{axis}"/>'
            f'<parent link="{parent}"/><child link="link{k}"/>'
            '<limit lower="-2.5" upper="2.5" velocity="1" effort="9"/></joint>'
        )
        parent = f"link{k}"
    (folder / "wide.urdf").write_text(
        f'<robot name="wide"><link name="base">{body}</link>{wheels}{arm}</robot>'
    )
    path = folder / "wide.yaml"
    path.write_text("name: wide\nangles: degrees\nparts: [{kind: mobile-robot, robot: wide.urdf}]\n")
    return path


def wall(door):
    """Return the corners of what stands left and right of a door (m) in a wall at x = 1.2, 4 m long."""
    half = door / 2
    return [
        [[1.2, half], [1.3, half], [1.3, 2], [1.2, 2]],
        [[1.2, -2], [1.3, -2], [1.3, -half], [1.2, -half]],
    ]


def base_through_door(way, door):
    """Return whether the middle of the base goes through the door."""
    x, y = way.configurations(np.linspace(0, way.duration, 2000))[:, :2].T
    return bool(((x > 1.2) & (x < 1.3) & (abs(y) < door / 2)).any())


@pytest.fixture
def wide(tmp_path):
    return dqc.load_robot(robot_file(tmp_path, BOX))


@pytest.mark.slow
def test_a_robot_0_8_m_wide_never_goes_through_a_door_of_0_62_m(wide):
    """Its wheels are 0.4 m apart, and what its file says of its body is 0.8 m wide."""
    assert across(wide, np.array(HOME, dtype=float)) >= np.hypot(WIDTH, 0.5) / 2
    goal = wide.fkm([3.0, 0, *HOME[2:]])
    try:
        way = DriveTo.pose(wide, HOME, goal, floor=FloorMap(wall(DOOR)))
    except UnreachableGoalError:
        pass
    else:
        assert not base_through_door(way, DOOR)
    assert base_through_door(DriveTo.pose(wide, HOME, goal, floor=FloorMap(wall(1.3))), 1.3)


def test_boxes_are_covered_and_hardly_more(wide):
    """Every corner of the base's box counts, and nothing 25 mm beyond it."""
    from dqcontrol.references.ways_around import body_points

    body = body_points(wide, np.array(HOME, dtype=float))
    own = ~body.carried
    corners = np.array([[x, y, z] for x in (-0.25, 0.25) for y in (-0.4, 0.4) for z in (0.05, 0.35)])
    gap = np.linalg.norm(corners[:, None] - body.points[own], axis=-1) - body.radius[own]
    assert gap.min(axis=1).max() < 1e-9
    assert (abs(body.points[own, 1]) + body.radius[own]).max() < 0.4 + 0.025


def test_the_command_lists_shapes_of_base_and_arm(tmp_path, capsys):
    app(["robots", "shapes", str(robot_file(tmp_path, BOX))], result_action="return_value")
    said = capsys.readouterr().out
    assert "wide: 7 shapes" in said
    assert "500.0 × 800.0 × 300.0" in said


def test_without_a_body_it_is_refused_and_said_what_to_give(tmp_path):
    bare = dqc.load_robot(robot_file(tmp_path, MESH))
    goal = bare.fkm([3.0, 0, *HOME[2:]])
    with (
        pytest.warns(NoteWarning, match="base.stl"),
        pytest.raises(
            ShapeError, match=r"clear_of: nothing says how wide .*plant\.base of its physics a radius"
        ),
    ):
        DriveTo.pose(bare, HOME, goal, floor=FloorMap(wall(DOOR)))


BASE = {
    "mass": 20,
    "height": 0.2,  # a higher one reaches into the arm
    "wheel_mass": 1,
    "wheel_torque": 8,
    "caster_distance": 0.2,
}


@pytest.mark.slow
@pytest.mark.parametrize(("radius", "passes"), [(0.6, False), (0.21, True)])
def test_the_base_that_physics_gives_a_robot_counts(tmp_path, radius, passes):
    """The chassis of little-john is narrower than a door of 1 m; plant.base may make it wider."""
    pytest.importorskip("mujoco")
    from dqcontrol.experiments.prepared_experiment import prepare

    (tmp_path / "room.yaml").write_text(yaml.safe_dump({"polygons": wall(1.0)}))
    spec = {
        "name": "door",
        "robot": "little-john",
        "start": [0, 0, 0, 0, -0.9, 0.9, 0.9, 0],
        "reference": {
            "kind": "drive-to",
            "offset": {"translation": [2.4, 0, 0]},
            "clear_of": "all",
        },
        "world": {"room": {"map": str(tmp_path / "room.yaml")}},
        "period": 0.05,
        "law": {"kind": "guided-proportional", "gain": 1.0},
        "plant": {"kind": "mobile", "base": BASE | {"radius": radius}},
    }
    try:
        way = prepare(spec).scene.reference
    except UnreachableGoalError:
        assert not passes
    else:
        assert base_through_door(way, 1.0) == passes
