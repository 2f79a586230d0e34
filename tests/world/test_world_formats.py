"""Worlds in MJCF, URDF and MoveIt's scenes: there and back, and as those programs write them."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.algebra import matrix_from_pose
from dqcontrol.cli.log_commands import convert
from dqcontrol.experiments.spec import read_spec
from dqcontrol.experiments.spec.world_file import world_text
from dqcontrol.geometry import FloorMap, Sphere, distance, load_map, save_map
from dqcontrol.world import Body, Hinge, Slide, Solid, World, floor_around

pytest.importorskip("mujoco")

TURN = (0.3, -0.4, 1.1)
TABLE = Body(box=[1.2, 0.8, 0.04], position=(0.6, 0.1, 0.38), rpy=TURN)
STOOL = Body(
    cylinder=(0.2, 0.05), position=(1, 1, 0.5), parts=[Solid(box=0.1, position=(0.1, 0, -0.2), rpy=TURN)]
)
CUBE = Body(box=0.05, position=(0.5, 0.2, 0.6), mass=0.3, friction=0.6)
DOOR = Body(
    box=[0.8, 0.03, 2.0],
    position=(1.5, 0, 1),
    rpy=(0, 0, 0.5),
    hinge=Hinge(axis=(0, 0, 1), at=(-0.4, 0, 0), range=(0, 1.5), damping=2.0),
    mass=8.0,
)
DRAWER = Body(
    box=0.3, position=(0, -1, 0.5), slide=Slide(axis=(0, 1, 0), range=(-0.2, 0.0), damping=5), mass=2.0
)
CAPSULE = Body(capsule=(0.1, 0.4), position=(-1, 0, 0.5), rpy=TURN)
WALL = Body(box=[0.1, 2, 2], position=(3, 0, 1), stiffness=2e4, damping=100)
BALL = Body(sphere=0.06, position=(0.8, 0.1, 0.9))
FLOOR = Body(plane=(0, 0, 1))
PROBES = [Sphere(point, 0.0) for point in np.random.default_rng(41).uniform(-2, 3, (40, 3))]


def distances(world):
    """Return how far points are from each body."""
    return {
        name: [min(distance(probe, shape).distance for shape in body.shapes) for probe in PROBES]
        for name, body in world.bodies.items()
    }


@pytest.mark.parametrize(
    ("suffix", "bodies"),
    [
        (
            ".xml",
            {"table": TABLE, "stool": STOOL, "cube": CUBE, "door": DOOR, "drawer": DRAWER, "wall": WALL},
        ),
        (".xml", {"floor": FLOOR, "capsule": CAPSULE, "ball": BALL}),
        (
            ".urdf",
            {"table": TABLE, "stool": STOOL, "cube": CUBE, "door": DOOR, "drawer": DRAWER, "ball": BALL},
        ),
        (".scene", {"table": TABLE, "stool": STOOL, "ball": BALL}),
    ],
)
def test_there_and_back(tmp_path, suffix, bodies):
    world = World(bodies=bodies)
    (tmp_path / f"shelf{suffix}").write_text(world_text(world, suffix))
    back = dqc.load_world(tmp_path / f"shelf{suffix}")
    assert set(back.bodies) == set(bodies)
    for name, found in distances(back).items():
        np.testing.assert_allclose(found, distances(world)[name], atol=1e-6)
    for name, body in bodies.items():
        found = back.bodies[name]
        assert found.role == body.role
        if body.mass is not None:
            assert found.mass == pytest.approx(body.mass)
        if body.hinge is not None:
            assert found.hinge.range == pytest.approx(body.hinge.range)
            assert found.hinge.damping == pytest.approx(body.hinge.damping)
            for one, other in ((found, body), (body, found)):
                turn = matrix_from_pose(one.pose)
                at = turn[:3, 3] + turn[:3, :3] @ one.hinge.at
                turn = matrix_from_pose(other.pose)
                assert (turn[:3, 3] + turn[:3, :3] @ other.hinge.at)[:2] == pytest.approx(at[:2], abs=1e-6)
        if body.stiffness is not None:
            assert (found.stiffness, found.damping) == pytest.approx((body.stiffness, body.damping))


def test_a_capsule_is_three_shapes_in_urdf(tmp_path):
    (tmp_path / "a.urdf").write_text(world_text(World(bodies={"capsule": CAPSULE}), ".urdf"))
    back = dqc.load_world(tmp_path / "a.urdf")
    np.testing.assert_allclose(
        np.maximum(distances(back)["capsule"], 0),
        np.maximum(distances(World(bodies={"capsule": CAPSULE}))["capsule"], 0),
        atol=1e-6,
    )


OLD_SCENE = """(noname)+++
* pole
1
cylinder
0.1 1.5
0.3 0.2 0.75
0 0 0 1
0 0 0 0
.
"""


def test_a_scene_without_object_poses_and_a_spec_that_names_it(tmp_path):
    (tmp_path / "lab.scene").write_text(OLD_SCENE)
    spec = {
        "name": "lab",
        "robot": "panda",
        "start": [0, -0.3, 0, -2.0, 0, 1.8, 0.7],
        "period": 0.01,
        "reference": {"kind": "set-point", "duration": 0.1},
        "law": {"kind": "proportional", "gain": 2},
        "plant": {"kind": "integrator"},
        "world": str(tmp_path / "lab.scene"),
    }
    world = read_spec(spec)[0].surroundings
    assert world.bodies["pole"].cylinder == (0.1, 1.5)
    assert world.bodies["pole"].position == (0.3, 0.2, 0.75)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        (
            "a.scene",
            "x\n* cone\n1\ncone\n1 2\n0 0 0\n0 0 0 1\n0 0 0 0\n.\n",
            "cone: has a cone; boxes, spheres",
        ),
        ("a.scene", "x\n* box\n1\nbox\n1 2\n", "is no scene of MoveIt's"),
        (
            "a.xml",
            "<mujoco><worldbody><geom type='ellipsoid' size='1 2 3'/></worldbody></mujoco>",
            "no box, sphere",
        ),
        ("a.xml", "<mujoco><worldbody>", "a.xml: "),
        (
            "a.xml",
            "<mujoco><worldbody><body name='arm'><joint/><geom size='1'/><body name='hand'><joint/><geom size='1'/>"
            "</body></body></worldbody></mujoco>",
            "hand: hangs on a body that moves",
        ),
    ],
)
def test_what_cannot_be_read_is_said_in_a_line(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    with pytest.raises(dqc.Error, match=words) as caught:
        dqc.load_world(tmp_path / name)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("suffix", "body", "words"),
    [
        (".scene", FLOOR, r"world.a: this format has no plane"),
        (".urdf", WALL, r"world.a: URDF has no word for"),
        (".txt", BALL, r"a world is written as .yaml, .xml, .urdf, .scene, got '.txt'"),
    ],
)
def test_what_cannot_be_written_is_said(suffix, body, words):
    with pytest.raises(dqc.Error, match=words):
        world_text(World(bodies={"a": body}), suffix)


def test_the_command_writes_worlds(tmp_path, capsys):
    (tmp_path / "shelf.yaml").write_text("table: {box: [1.2, 0.8, 40 mm], position: [0.6, 0, 0.38]}\n")
    for there, back in (
        ("shelf.yaml", "a.scene"),
        ("a.scene", "a.xml"),
        ("a.xml", "a.urdf"),
        ("a.urdf", "b.yaml"),
    ):
        convert(tmp_path / there, tmp_path / back)
    assert "results:" in capsys.readouterr().out
    table = dqc.load_world(tmp_path / "b.yaml").bodies["table"]
    assert table.size == pytest.approx([1.2, 0.8, 0.04])
    assert table.position == pytest.approx((0.6, 0, 0.38))
    with pytest.raises(dqc.Error, match=r"b\.yaml: exists already"):
        convert(tmp_path / "a.xml", tmp_path / "b.yaml")


@pytest.mark.parametrize("suffix", [".pgm", ".png"])
def test_what_stands_on_the_floor_is_written_as_a_map_and_read_again(tmp_path, suffix):
    """Boxes on cells come back exactly; round and turned things as the cells that they are in."""
    world = World(
        bodies={
            "floor": Body(plane=(0, 0, 1)),
            "wall": Body(box=[2.0, 0.1, 1.5], position=(0.5, 0.55, 0.75)),
            "column": Body(cylinder=(0.2, 1.0), position=(1.5, -0.4, 0.5)),
            "chest": Body(box=[0.5, 0.3, 0.4], position=(-0.8, -0.5, 0.2), rpy=(0, 0, 0.5)),
            "cube": Body(box=0.1, position=(0, 0, 0.05), mass=0.1),
        }
    )
    (tmp_path / "room.yaml").write_text(world_text(world, ".yaml"))
    convert(tmp_path / "room.yaml", tmp_path / f"map{suffix}")
    with pytest.raises(dqc.Error, match=r"would be .*room\.yaml itself"):
        convert(tmp_path / "room.yaml", tmp_path / f"room{suffix}", force=True)
    again = load_map(tmp_path / "map.yaml")
    assert again.height == pytest.approx(1.5)
    floor = floor_around(world, "all", "world")
    points = np.random.default_rng(0).uniform([-1.5, -1.2], [2.2, 1.0], (4000, 2))
    room, back = floor.clearance(points), again.clearance(points)
    assert back[room <= 0].max() <= 1e-9  # nothing is lost
    assert (room - back).max() < 0.05 * np.sqrt(2) + 1e-9  # and no cell is taken that nothing is in
    wall = np.array([[x, y] for x in np.linspace(-0.5, 1.5, 41) for y in (0.49, 0.61)])
    assert again.clearance(wall) == pytest.approx(floor.clearance(wall), abs=1e-9)
    world_again = World(bodies={"room": Body(map=str(tmp_path / "map.yaml"))})
    save_map(floor_around(world_again, "all", "world"), tmp_path / f"again{suffix}")
    assert (tmp_path / f"again{suffix}").read_bytes() == (tmp_path / f"map{suffix}").read_bytes()


def test_maps_that_cannot_be_written_are_refused(tmp_path):
    column = FloorMap((np.array([[0, 0], [1, 0], [1, 1]]),))
    save_map(column, tmp_path / "a.pgm")
    for make, words in (
        (lambda: save_map(column, tmp_path / "a.jpg"), "a map's image is a .pgm or .png"),
        (lambda: save_map(column, tmp_path / "a.pgm"), "a.pgm: exists already"),
        (lambda: save_map(column, tmp_path / "b.pgm", 1e-5), "resolution: 1e-05 m makes"),
        (lambda: save_map(FloorMap(()), tmp_path / "b.pgm"), "nothing stands on it"),
    ):
        with pytest.raises(dqc.Error, match=words):
            make()
