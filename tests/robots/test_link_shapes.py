"""Shapes of links: from robot files and back, from URDF files, on bases, and the pairs that are kept apart."""

import math

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import FileFormatError, ShapeError
from dqcontrol.geometry import Box, Capsule, Point, Sphere, distance
from dqcontrol.robots.collision_shapes import collision_shapes, kept, sampled_pairs
from dqcontrol.robots.files.robot_file import arm_from, plain_arm

CHASSIS = dqc.robots.Chassis(
    mass=3.0, radius=0.2, height=0.1, wheel_mass=0.1, wheel_torque=1.0, caster_distance=0.1
)
URDF = """<robot name="crane">
<link name="base"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
<link name="boom"><collision><origin xyz="0 0 0.5" rpy="0 0 0"/>
<geometry><cylinder radius="0.05" length="1.0"/></geometry></collision>
<collision><origin xyz="0 0 1.0"/><geometry><sphere radius="0.05"/></geometry></collision></link>
<link name="jib"/><link name="hook"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="luff" type="revolute"><parent link="base"/><child link="boom"/><origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>
<limit lower="-1.5" upper="1.5" velocity="1"/></joint>
<joint name="fold" type="revolute"><parent link="boom"/><child link="jib"/><origin xyz="0 0 1.1"/><axis xyz="0 1 0"/>
<limit lower="-3.1" upper="3.1" velocity="1"/></joint>
<joint name="end" type="fixed"><parent link="jib"/><child link="hook"/><origin xyz="0 0 1.1"/></joint></robot>"""


def shapes_of(robot):
    """Return the shapes that a robot must have."""
    assert robot.shapes is not None
    return robot.shapes


@pytest.fixture(scope="module")
def crane(tmp_path_factory):
    path = tmp_path_factory.mktemp("crane") / "crane.urdf"
    path.write_text(URDF)
    return dqc.load_robot(path)


def test_primitives_of_a_urdf_file_stay_where_they_are(crane):
    fitted = collision_shapes(crane)
    assert [(each.shape.name, each.shape.frame, each.made_of) for each in fitted] == [
        ("base", 0, "box"),
        ("boom.1", 1, "cylinder"),  # the ball at its end lies inside of its capsule
        ("hook", 2, "sphere"),
    ]
    crane.shapes = dqc.robots.LinkShapes(tuple(each.shape for each in fitted))
    q = np.array([np.pi / 2, 0.0])
    base, boom, hook = crane.shapes.moved(crane, q)
    assert isinstance(base, Box)
    assert isinstance(boom, Capsule)
    assert isinstance(hook, Sphere)
    assert sorted([boom.start[0], boom.end[0]]) == pytest.approx([0.0, 1.0])
    assert hook.center == pytest.approx([2.2, 0, 0.1])


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("flat.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "flat.obj: spans no volume"),
        ("bad.xyz", "1 2 word\n", "bad.xyz cannot be read"),
        ("empty.stl", "", "empty.stl: spans no volume|empty.stl cannot be read"),
    ],
)
def test_meshes_that_are_none_are_named(tmp_path, name, content, message):
    pytest.importorskip("trimesh")
    (tmp_path / name).write_text(content)
    mesh = f'<mesh filename="file://{tmp_path / name}"/>'
    path = tmp_path / "crane.urdf"
    path.write_text(URDF.replace('<box size="0.2 0.2 0.1"/>', mesh))
    with pytest.raises(FileFormatError, match=message):
        collision_shapes(dqc.load_robot(path))


def test_pairs_are_left_out_for_a_reason(crane):
    shapes = tuple(each.shape for each in collision_shapes(crane))
    pairs = sampled_pairs(crane, shapes, samples=2000)
    reasons = {(shapes[each.a].name, shapes[each.b].name): each.reason for each in pairs}
    assert reasons == {
        ("base", "boom.1"): "neighbours",
        ("base", "hook"): "",
        ("boom.1", "hook"): "neighbours",
    }
    assert list(kept(pairs)) == [(0, 2)]


def test_shapes_come_back_from_a_robot_file(crane):
    shapes = tuple(each.shape for each in collision_shapes(crane))
    crane.shapes = dqc.robots.LinkShapes(shapes, ((0, 2),))
    again = arm_from("crane.yaml", plain_arm(crane))
    q = np.array([0.3, -0.4])
    for a, b in zip(shapes_of(crane).moved(crane, q), shapes_of(again).moved(again, q), strict=True):
        assert a.row == pytest.approx(b.row, abs=1e-12)
    assert shapes_of(again).pairs == ((0, 2),)


def test_wrong_shapes_are_named(crane):
    crane.shapes = None
    plain = plain_arm(crane)
    ball = {"center": [0, 0, 0], "radius": 0.1}
    for shapes, words in (
        ([{"name": "a"}], "give one of sphere, capsule, box"),
        ([{"name": "a", "joint": "luf", "sphere": ball}], "did you mean 'luff'"),
        ([{"name": "a", "sphere": ball}, {"name": "a", "sphere": ball}], "have the name 'a'"),
        ([{"name": "a", "sphere": {"center": [0, 0, 0], "radius": 0}}], "radius"),
    ):
        with pytest.raises(FileFormatError, match=words):
            arm_from("crane.yaml", plain | {"shapes": shapes})
    with pytest.raises(FileFormatError, match="no shapes to keep apart"):
        arm_from("crane.yaml", plain | {"kept_apart": [["a", "b"]]})
    with pytest.raises(ShapeError, match="was not read from a URDF or MJCF file"):
        collision_shapes(dqc.load_robot("iiwa7"))


def test_a_base_carries_its_chassis_and_the_foot_of_its_arm():
    base = dqc.DifferentialDrive(0.04, 0.13, chassis=CHASSIS)
    mount = dqc.DualQuaternion.from_translation([0.1, 0, 0.3])
    robot = dqc.WholeBody([base, mount, dqc.load_robot("panda")])
    q = np.array([1.0, 2.0, np.pi / 2, 0, -0.3, 0, -2.0, 0, 1.8, 0.7])
    shapes = dict(zip(shapes_of(robot).names, shapes_of(robot).moved(robot, q), strict=True))
    assert shapes["chassis"].start[:2] == pytest.approx([1, 2])
    foot = shapes_of(dqc.load_robot("panda")).shapes[0].shape
    assert shapes["panda_link0"].radius == foot.radius
    assert shapes["panda_link0"].start == pytest.approx(
        [1 - foot.start[1], 2.1 + foot.start[0], 0.3 + foot.start[2]]
    )
    pairs = {(shapes_of(robot).names[a], shapes_of(robot).names[b]) for a, b in shapes_of(robot).pairs}
    assert ("chassis", "panda_link5.1") in pairs
    assert ("chassis", "panda_link0") not in pairs


@pytest.mark.parametrize(
    ("name", "arm"), [("little-john", [0, -0.9, 0.9, 0.9, 0]), ("youbot", [0, 0.5, 0.5, 0.5, 0])]
)
def test_no_pair_of_a_mobile_robot_touches_at_rest(name, arm):
    body, q = dqc.load_robot(name), np.array([0.4, -0.2, 1.0, *arm])
    known = shapes_of(body)
    places = known.moved(body, q)
    least = min(distance(places[a], places[b]).distance for a, b in known.pairs)
    assert len(known.pairs) == 9
    assert least > 0.02
    assert known.apart(body, np.array([q, q])) == pytest.approx([least, least], abs=1e-12)


def test_the_box_of_the_youbots_base_drives_with_it():
    body = dqc.load_robot("youbot")
    box = shapes_of(body).moved(body, np.array([1.0, 2.0, np.pi / 2, 0, 0, 0, 0, 0]))[0]
    assert isinstance(box, Box)
    for point, away in (([1.0, 2.29, 0.07], 0.0), ([1.19, 2.0, 0.07], 0.0), ([1.0, 2.0, 0.24], 0.1)):
        assert distance(box, Point(np.array(point))).distance == pytest.approx(away, abs=1e-9)


def test_shapes_of_ax18_are_as_far_apart_as_mujoco_has_them():
    mujoco = pytest.importorskip("mujoco")
    body, rng = dqc.load_robot("ax18"), np.random.default_rng(4)
    known, spec = shapes_of(body), mujoco.MjSpec()
    for each in known.shapes:
        capsule = each.shape
        assert isinstance(capsule, Capsule)
        carried = spec.worldbody.add_body(name=each.name, mocap=True)
        ends, size = [*capsule.start, *capsule.end], [capsule.radius, 0, 0]
        carried.add_geom(name=each.name, type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=ends, size=size)
    model = spec.compile()
    data, number = mujoco.MjData(model), {each.name: model.geom(each.name).id for each in known.shapes}
    drawn = rng.uniform(body.limits.lower, body.limits.upper, (20, 5))
    for q, apart in zip(drawn, known.apart(body, drawn), strict=True):
        least = math.inf
        places, frames = known.moved(body, q), body.frames(q)
        for k, each in enumerate(known.shapes):
            at = dqc.DualQuaternion(frames[each.frame - 1])
            data.mocap_pos[k], data.mocap_quat[k] = at.translation, np.asarray(at.vec8)[:4]
        mujoco.mj_forward(model, data)
        for a, b in known.pairs:
            pair = number[known.names[a]], number[known.names[b]]
            theirs = mujoco.mj_geomDistance(model, data, *pair, 2.0, None)
            assert distance(places[a], places[b]).distance == pytest.approx(theirs, abs=1e-6)
            least = min(least, theirs)
        assert apart == pytest.approx(least, abs=1e-6)


def test_no_pair_of_the_panda_touches_at_home():
    arm = dqc.load_robot("panda")
    places = shapes_of(arm).moved(arm, np.array([0, -0.3, 0, -2.0, 0, 1.8, 0.7]))
    assert min(distance(places[a], places[b]).distance for a, b in shapes_of(arm).pairs) > 0.02


@pytest.mark.parametrize(
    "name", ["ax18", "barrett-wam", "iiwa7", "kuka-lwr4", "meka-a2", "panda", "ur5", "youbot-arm"]
)
def test_shapes_of_presets_hold_the_next_joint(name):
    robot = dqc.load_robot(name)
    known = shapes_of(robot)
    q = 0.5 * (robot.limits.lower + robot.limits.upper)
    moved, joints = known.moved(robot, q), robot.frames(q)
    for k in range(1, robot.configuration_size):
        own = [shape for each, shape in zip(known.shapes, moved, strict=True) if each.frame == k]
        joint = Point(dqc.DualQuaternion(joints[k]).translation)
        beyond = [shape for each, shape in zip(known.shapes, moved, strict=True) if each.frame == k + 1]
        assert min(distance(joint, shape).distance for shape in own + beyond) < 0


def outermost(points, shapes):
    """Return how far points are outside of all of some capsules at most, m."""
    least = np.full(len(points), np.inf)
    for each in shapes:
        along = each.end - each.start
        share = np.clip((points - each.start) @ along / (along @ along), 0.0, 1.0)
        away = np.linalg.norm(points - each.start - share[:, None] * along, axis=1)
        least = np.minimum(least, away - each.radius)
    return least.max()


def test_shapes_of_the_panda_and_its_hand_hold_their_meshes():
    """Links 5 and 6 by two capsules each: corners of the meshes, and points of their faces."""
    trimesh = pytest.importorskip("trimesh")
    from dqcontrol.robots.files.load import installed_file

    urdf = installed_file("example-robot-data:panda_description/urdf/panda.urdf")
    assert urdf is not None
    meshes = urdf.parents[1] / "meshes/collision"
    known = shapes_of(dqc.load_robot("panda-hand")).shapes
    at_flange = dqc.algebra.matrix_from_pose(
        dqc.algebra.pose(dqc.algebra.rotation_from_rpy([0, 0, -np.pi / 4]), [0, 0, 0.107])
    )

    def points(name):
        mesh = trimesh.load(meshes / f"{name}.stl", force="mesh")
        return np.vstack([mesh.vertices, trimesh.sample.sample_surface(mesh, 20_000, seed=0)[0]])

    for k in range(8):
        own = [each.shape for each in known if each.name.startswith(f"panda_link{k}")]
        assert outermost(points(f"link{k}"), own) <= 0.0
        assert len(own) == (2 if k in (5, 6) else 1)
    (hand,), (fingers,) = (
        [each.shape for each in known if each.name == name] for name in ("panda_hand", "panda_fingers")
    )
    assert outermost(points("hand") @ at_flange[:3, :3].T + at_flange[:3, 3], [hand]) <= 0.0
    finger = points("finger")
    for opened in (0.0, 0.04):
        for side in (1.0, -1.0):
            placed = finger * [side, side, 1.0] + [0.0, side * opened, 0.0584]
            assert outermost(placed @ at_flange[:3, :3].T + at_flange[:3, 3], [fingers]) <= 0.0


def test_the_panda_with_its_hand_is_the_panda_with_a_tool():
    arm, hand = dqc.load_robot("panda"), dqc.load_robot("panda-hand")
    q = np.array([0, -0.3, 0, -2.0, 0, 1.8, 0.7])
    tool = dqc.algebra.multiply(
        arm.fkm(q), dqc.algebra.pose(dqc.algebra.rotation_from_rpy([0, 0, -np.pi / 4]), [0, 0, 0.1034])
    )
    assert np.abs(hand.fkm(q) - tool).max() < 1e-12
    places = shapes_of(hand).moved(hand, q)
    assert min(distance(places[a], places[b]).distance for a, b in shapes_of(hand).pairs) > 0.02
    assert np.array_equal(arm.limits.velocity, hand.limits.velocity)


def test_a_tool_needs_an_arm_with_joints(tmp_path):
    path = tmp_path / "held.yaml"
    for robot in ("two-pandas", "missing.urdf"):
        path.write_text(f"name: held\nrobot: {robot}\ntool: {{position: [0, 0, 0.1]}}\n")
        with pytest.raises(
            FileFormatError, match=f"robot: '{robot}' is no robot file with joints, which could have"
        ):
            dqc.load_robot(path)
    path.write_text("name: held\nrobot: panda\ntool: {position: [0, 0, 0.1]}\njoins: []\n")
    with pytest.raises(FileFormatError, match="joins"):
        dqc.load_robot(path)
