"""Bodies of the world over topics: watched ones are where transforms say, and markers show what there is."""

from types import SimpleNamespace as Fields

import numpy as np
import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import TransformStamped

import dqcontrol as dqc
from dqcontrol.algebra import pose, translation
from dqcontrol.constraints import Constraints
from dqcontrol.ros2.messages import RefusedError
from dqcontrol.ros2.world_topics import WorldTopics, body_markers
from dqcontrol.world import Body, Watch, World

ARM = dqc.load_robot("panda")
HOME = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.7, 0.0])
CUBE = Body(box=0.1, position=(0.5, 0.6, 0.3), mass=1.0, watch=Watch())
WORLD = World(bodies={"cube": CUBE, "table": Body(box=[1, 1, 0.04], position=(0, 2, 0))})


def transform(child, at, frame="base_link", turn=(1.0, 0, 0, 0)):
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = frame
    place, rotation = message.transform.translation, message.transform.rotation
    place.x, place.y, place.z = at
    rotation.w, rotation.x, rotation.y, rotation.z = turn
    return message


def topics():
    """Return what hears transforms, and the law that keeps clear of the world."""
    law = dqc.laws.Proportional(
        gain=2.0, constraints=Constraints(world=WORLD, clear_of="all", self_collision=False)
    )
    prepared = law.prepare(ARM, None, 0.01)
    control = Fields(law=prepared, time=0.0)
    made = WorldTopics.__new__(WorldTopics)
    made._control, made._world, made._frame = control, WORLD, "base_link"
    made.seen = {"cube": CUBE.pose}
    return made, prepared


def test_constraints_keep_clear_of_where_a_transform_says_that_a_body_is():
    """The hand goes to its goal as long as the cube is beside it, and stops before the cube when that comes."""
    heard, law = topics()
    goal = dqc.algebra.multiply(pose([1, 0, 0, 0], [0, 0.1, 0]), ARM.fkm(HOME))
    sample = dqc.references.SetPoint(goal).at(0.0)
    state = law.initial_state(HOME)
    free = law.command(HOME, sample, state)
    heard.hear(transform("stranger", (0, 0, 0)))  # somebody else's
    np.testing.assert_array_equal(heard.seen["cube"], CUBE.pose)
    at = np.add(translation(ARM.fkm(HOME)), [0.0, 0.12, 0.0])
    heard.hear(Fields(transforms=[transform("cube", at)]))
    kept = law.command(HOME, sample, law.initial_state(HOME))
    y = ARM.translation_jacobian(HOME)[1]
    assert y @ free > 0.1
    assert y @ kept < 0.5 * (y @ free)
    np.testing.assert_allclose(translation(heard.seen["cube"]), at, atol=1e-12)


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (
            transform("cube", (0, 0, 0), frame="map"),
            "transform of cube: is in frame 'map', expected 'base_link'",
        ),
        (transform("cube", (0, np.nan, 0)), "transform of cube: position: number 2 is not finite"),
        (
            transform("cube", (0, 0, 0), turn=(0.0, 0, 0, 0)),
            "transform of cube: orientation: expected a unit quaternion, got norm 0",
        ),
    ],
)
def test_transforms_that_say_nothing_are_refused(message, words):
    with pytest.raises(RefusedError, match=words):
        topics()[0].hear(message)


def test_markers_are_where_bodies_are():
    messages = pytest.importorskip("visualization_msgs.msg")
    capsule = Body(capsule=(0.1, 0.4), position=(1, 2, 3))
    rod, *ends = body_markers(messages, "rod", capsule, capsule.pose)
    assert (rod.ns, rod.type, rod.scale.x, rod.scale.z) == (
        "rod",
        messages.Marker.CYLINDER,
        0.2,
        pytest.approx(0.4),
    )
    heights = sorted(end.pose.position.z for end in ends)
    assert heights == pytest.approx([2.8, 3.2])
    moved = pose([1, 0, 0, 0], [0, 0, 1])
    (cube,) = body_markers(messages, "cube", CUBE, moved)
    assert (cube.type, cube.pose.position.z, cube.scale.y) == (messages.Marker.CUBE, 1.0, 0.1)


def test_markers_of_meshes_are_their_triangles(tmp_path):
    messages = pytest.importorskip("visualization_msgs.msg")
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box([0.2, 0.4, 0.6]).export(tmp_path / "block.stl")
    block = Body(mesh=str(tmp_path / "block.stl"), position=(1, 2, 3))
    (marker,) = body_markers(messages, "block", block, block.pose)
    assert marker.type == messages.Marker.TRIANGLE_LIST
    assert len(marker.points) == 3 * 12
    corners = np.array([[point.x, point.y, point.z] for point in marker.points])
    place = np.array([getattr(marker.pose.position, axis) for axis in "xyz"])
    assert np.abs(corners).max(axis=0) == pytest.approx([0.1, 0.2, 0.3], abs=1e-6)
    assert place == pytest.approx([1, 2, 3])


def test_a_node_says_its_world(node):
    """Five times a second, watched bodies where a transform put them."""
    messages = pytest.importorskip("visualization_msgs.msg")
    law = dqc.laws.Proportional(
        gain=2.0, constraints=Constraints(world=WORLD, clear_of="all", self_collision=False)
    )
    control = Fields(law=law.prepare(ARM, None, 0.01), time=0.0)
    world = WorldTopics(node, control, WORLD, "base_link", lambda hear: hear)
    got = []
    node.create_subscription(messages.MarkerArray, f"/{node.get_name()}/world", got.append, 1)
    world.hear(transform("cube", (0.4, 0.5, 0.6)))
    assert node.serve(lambda: got)
    cube, table = got[-1].markers
    assert (cube.ns, table.ns) == ("cube", "table")
    assert [cube.pose.position.x, cube.pose.position.y, cube.pose.position.z] == pytest.approx(
        [0.4, 0.5, 0.6]
    )
    assert {cube.header.frame_id, table.header.frame_id} == {"base_link"}
    assert (cube.id, table.id) == (0, 1)
