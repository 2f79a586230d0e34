"""What a world says, from Python, YAML and files, and what of it is refused."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra, geometry
from dqcontrol.experiments.spec import read_spec
from dqcontrol.world import Body, Hinge, Motion, Slide, Solid, World, floor_around, mesh

SPEC = {
    "name": "world",
    "robot": "panda",
    "start": [0, -0.3, 0, -2.0, 0, 1.8, 0.7],
    "period": 0.01,
    "reference": {"kind": "set-point", "duration": 0.1},
    "law": {"kind": "proportional", "gain": 2},
    "plant": {"kind": "integrator"},
}


def test_yaml_says_the_same_as_python(tmp_path):
    text = """
floor: true
table: {box: [1.2, 0.8, 40 mm], position: [0.6, 0, 0.38]}
ball: {sphere: 60 mm, position: [0.8, 0.1, 0.5], moves: {path: [[0, 0, 0, 0], [1.2, -0.27, 0, 0]]}}
cube: {box: 50 mm, position: [0.5, 0.2, 0.425], mass: 0.1, friction: 0.8}
door: {box: [0.8, 30 mm, 2], position: [1.5, 0, 1], hinge: {axis: [0, 0, 1], at: [-0.4, 0, 0], range: [0, 90 deg]}}
wall: {box: [0.1, 2, 2], position: [0.9, 0, 1.1], stiffness: 20 kN/m, damping: 100}
"""
    (tmp_path / "room.yaml").write_text(text)
    found = read_spec(SPEC | {"world": str(tmp_path / "room.yaml")})[0].surroundings
    assert found is not None
    assert found == dqc.load_world(tmp_path / "room.yaml")
    assert found.bodies == {
        "floor": Body(plane=(0, 0, 1)),
        "table": Body(box=[1.2, 0.8, 0.04], position=(0.6, 0, 0.38)),
        "ball": Body(
            sphere=0.06, position=(0.8, 0.1, 0.5), moves=Motion(path=[(0, 0, 0, 0), (1.2, -0.27, 0, 0)])
        ),
        "cube": Body(box=0.05, position=(0.5, 0.2, 0.425), mass=0.1, friction=0.8),
        "door": Body(
            box=[0.8, 0.03, 2],
            position=(1.5, 0, 1),
            hinge=Hinge(axis=(0, 0, 1), at=(-0.4, 0, 0), range=(0, np.pi / 2)),
        ),
        "wall": Body(box=[0.1, 2, 2], position=(0.9, 0, 1.1), stiffness=2e4, damping=100.0),
    }
    roles = [body.role for body in found.bodies.values()]
    assert roles == ["fixed", "fixed", "moving", "free", "hinge", "springy"]


def test_shapes_are_where_poses_take_them():
    turned = {"position": (1.0, 2.0, 3.0), "rpy": (0.0, np.pi / 2, 0.0)}  # z becomes x
    (can,) = Body(cylinder=(0.1, 0.4), **turned).shapes
    assert can.start == pytest.approx([0.8, 2, 3])
    assert can.end == pytest.approx([1.2, 2, 3])
    (plane,) = Body(plane=(0, 0, 2), **turned).shapes
    assert plane.normal == pytest.approx([1, 0, 0])
    assert plane.offset == pytest.approx(1.0)
    lamp = Body(box=0.2, parts=[Solid(sphere=0.1, position=(0, 0, 0.5))], **turned)
    assert lamp.shapes[1].center == pytest.approx([1.5, 2, 3])


def test_a_container_is_hollow_and_knows_what_it_holds():
    basket = Body(container=(0.2, 0.2, 0.1), position=(1.0, 2.0, 0.5), rpy=(0, 0, np.pi / 2))
    points = [[1.0, 2.0, 0.52], [1.05, 1.95, 0.59], [1.2, 2.0, 0.52], [1.0, 2.0, 0.7]]
    assert basket.holds(points).tolist() == [True, True, False, False]
    assert basket.away(points) == pytest.approx([0, 0, 0.1, 0.1])
    assert len(basket.shapes) == 5
    gaps = [geometry.distance(geometry.Point([1.0, 2.0, 0.55]), wall).distance for wall in basket.shapes]
    assert gaps == pytest.approx([0.1, 0.1, 0.1, 0.1, 0.047])


def test_a_round_container_lets_its_circle_through_and_nothing_more():
    socket = Body(container=(0.0202, 0.03), chamfer=1e-3, position=(1.0, 2.0, 0.5), rpy=(0.3, -0.2, 0.0))
    matrix = algebra.matrix_from_pose(socket.pose)

    def away(radius, angle, height):
        """Return the distance of a point in cylindrical coordinates of the socket from all that it consists of."""
        point = matrix[:3, :3] @ [radius * np.cos(angle), radius * np.sin(angle), height] + matrix[:3, 3]
        return min(geometry.distance(geometry.Point(point), each).distance for each in socket.shapes)

    for angle in np.linspace(0, 2 * np.pi, 37):
        assert away(0.0, angle, 0.015) >= 0.0101 - 1e-12  # on the axis, half way
        assert away(0.0100, angle, 0.015) > 9e-5
    for angle in 2 * np.pi / 16 * np.arange(16):  # in the middle of a stave
        assert away(0.0101, angle, 0.015) == pytest.approx(0.0, abs=1e-12)
        assert away(0.0101 + 5e-4, angle, 0.0295) == pytest.approx(0.0, abs=1e-12)  # on the slope
        assert away(0.0101 + 5e-4, angle, 0.0297) == pytest.approx(2e-4 / np.sqrt(2), abs=1e-12)
    inside = matrix[:3, :3] @ [0.0, 0.0100, 0.02] + matrix[:3, 3]
    assert socket.holds(inside)
    assert socket.away(matrix[:3, :3] @ [0.0201, 0, 0.034] + matrix[:3, 3]) == pytest.approx(
        np.hypot(0.01, 4e-3)
    )


def test_constraints_keep_clear_of_all_but_what_physics_moves():
    world = {
        "floor": True,
        "ball": {"sphere": 0.1, "position": [2, 0, 1]},
        "cube": {"box": 0.1, "position": [1, 0, 1], "mass": 1},
    }
    spec = read_spec(SPEC | {"world": world, "constraints": {"clear_of": "all"}})[0]
    kept = spec.variants[0].law.constraints
    assert kept is not None
    assert list(kept.obstacles) == ["floor", "ball"]


def test_nothing_of_a_spec_changes_without_constraints():
    spec = read_spec(SPEC | {"world": {"floor": True}})[0]
    assert spec.variants[0].law == read_spec(SPEC)[0].variants[0].law


def test_files_of_bodies_that_are_written_anew_are_read_anew(tmp_path):
    """Also the image of a map whose own file stays."""
    trimesh = pytest.importorskip("trimesh")
    room, grid, mesh = tmp_path / "room.yaml", tmp_path / "grid.yaml", tmp_path / "block.stl"
    grid.write_text("image: grid.pgm\nresolution: 1.0\n")
    for x in (1.0, 2.0):
        room.write_text(f"polygons: [[[{x}, 0], [{x + 1}, 0], [{x + 1}, 1], [{x}, 1]]]\n")
        cells = bytes(0 if column == x else 254 for column in range(4))
        (tmp_path / "grid.pgm").write_bytes(b"P5\n4 1\n255\n" + cells)
        trimesh.creation.box([2 * x, 0.2, 0.1]).export(mesh)
        for body in (Body(map=str(room)), Body(map=str(grid))):
            (box,) = body.shapes
            np.testing.assert_allclose(dqc.algebra.translation(box.pose)[0], x + 0.5)
        (hull,) = Body(mesh=str(mesh)).shapes
        assert np.abs(np.asarray(hull.points)[:, 0]).max() == pytest.approx(x)


def test_a_mesh_is_taken_apart(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("scipy")
    block = trimesh.creation.box([0.4, 0.2, 0.1])
    block.export(tmp_path / "block.stl")
    (hull,) = Body(mesh=str(tmp_path / "block.stl"), position=(1, 0, 0)).shapes
    assert np.ptp(hull.corners, axis=0) == pytest.approx([0.4, 0.2, 0.1], abs=1e-6)
    assert geometry.distance(geometry.Point([1, 0, 0.25]), hull).distance == pytest.approx(0.2, abs=1e-6)
    ball = trimesh.creation.icosphere(radius=0.1)
    ball.export(tmp_path / "ball.stl")
    (part,) = Body(mesh=str(tmp_path / "ball.stl")).shapes
    assert geometry.distance(geometry.Point([1, 0, 0]), part).distance == pytest.approx(0.9, abs=2e-4)
    block.faces = block.faces[:-1]
    block.export(tmp_path / "open.stl")
    with pytest.raises(dqc.Error, match=r"mesh: .*open.stl is open"):
        dqc.World(bodies={"it": Body(mesh=str(tmp_path / "open.stl"))})


def test_a_bracket_is_made_of_convex_parts_of_which_number_and_error_are_said(tmp_path, monkeypatch, capfd):
    trimesh, shapely = pytest.importorskip("trimesh"), pytest.importorskip("shapely")
    coacd = pytest.importorskip("coacd")
    monkeypatch.setattr(mesh, "module_folder", lambda module: tmp_path)
    corner = shapely.Polygon([(0, 0), (0.4, 0), (0.4, 0.05), (0.05, 0.05), (0.05, 0.3), (0, 0.3)])
    trimesh.creation.extrude_polygon(corner, 0.2).export(tmp_path / "bracket.stl")
    with pytest.warns(
        dqc.errors.NoteWarning, match=r"bracket.stl: 2 convex parts .*, up to 0.011 mm outside and 0"
    ):
        parts = Body(mesh=str(tmp_path / "bracket.stl"), position=(1, 0, 0)).shapes
    assert "taking bracket.stl apart" in capfd.readouterr().err
    inside_of_the_angle = geometry.Point([1.2, 0.2, 0.1])  # 150 mm from both arms of it, and within its hull
    least = min(geometry.distance(inside_of_the_angle, part).distance for part in parts)
    assert least == pytest.approx(0.15, abs=1e-4)

    mesh._convex_parts.cache_clear()
    monkeypatch.setattr(coacd, "run_coacd", None)  # what is kept is not made again
    with pytest.warns(dqc.errors.NoteWarning):
        assert len(mesh.convex_parts(str(tmp_path / "bracket.stl"))) == 2
    assert capfd.readouterr().err == ""


def test_a_huge_mesh_is_refused(tmp_path, monkeypatch):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.icosphere(subdivisions=2).export(tmp_path / "ball.stl")
    monkeypatch.setattr(mesh, "_MOST_FACES", 319)  # it has 320
    with pytest.raises(dqc.Error, match=r"mesh: .*ball.stl has 320 faces, at most 319; simplify it"):
        dqc.World(bodies={"it": Body(mesh=str(tmp_path / "ball.stl"))})


@pytest.mark.parametrize(
    ("world", "words"),
    [
        ({"a": {}}, r"world.a: give one shape of box, sphere, .*, got none"),
        ({"a": {"box": 1, "sphere": 1}}, r"world.a: give one shape of .*, got box and sphere"),
        ({"a": {"bx": 1}}, r"world.a.*'bx'.*box"),
        ({"a": {"sphere": 0}}, r"world.a.sphere"),
        (
            {"a": {"container": [1, 1, 1], "chamfer": 0.001}},
            r"world.a: chamfer: is that of a round container",
        ),
        ({"a": {"container": [0.02, 0.03], "chamfer": 0.01}}, r"world.a: chamfer: must be less than 6 mm"),
        ({"a": {"container": [1]}}, r"world.a.container"),
        ({"a": {"box": 1, "mass": 1, "moves": {"velocity": [1, 0, 0]}}}, r"world.a: .* got moves and mass"),
        ({"a": {"plane": [0, 0, 1], "mass": 1}}, r"world.a: plane: stands still"),
        ({"a": {"box": 1, "hinge": {"axis": [0, 0, 0]}}}, r"hinge.axis: must not be zero"),
        ({"a": {"box": 1, "hinge": {"axis": [0, 0, 1], "range": [1, 2]}}}, r"hinge.range: must hold 0"),
        (
            {"a": {"box": 1, "moves": {"path": [[0, 0, 0, 0], [0.01, 1, 0, 0]]}}},
            r"has a jump: from 0 s to 0.01 s",
        ),
        ({"a": {"box": 1, "moves": {"path": [[1, 0, 0, 0], [0, 1, 0, 0]]}}}, r"times must increase"),
        ({"a": {"mesh": "no.stl"}}, r"mesh: .*no.stl cannot be read"),
        ({"floor": True, "a": {"box": 1, "mass": 1}}, r"world.a: starts 500 mm deep in floor"),
        ("no.yaml", r"no.yaml: no such file"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(world, words):
    with pytest.raises(dqc.Error, match=words) as caught:
        _ = read_spec(SPEC | {"world": world})[0].surroundings
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("constraints", "words"),
    [
        ({"clear_of": ["cub"]}, r"constraints.clear_of: unknown name 'cub'; did you mean 'cube'"),
        ({"clear_of": ["cube"]}, r"'cube' is moved by what touches it"),
    ],
)
def test_what_cannot_be_kept_clear_of_is_refused(constraints, words):
    world = {"cube": {"box": 0.1, "position": [1, 0, 1], "mass": 1}}
    kept = read_spec(SPEC | {"world": world, "constraints": constraints})[0].variants[0].law.constraints
    assert kept is not None
    with pytest.raises(dqc.Error, match=words):
        _ = kept.names
    with pytest.raises(dqc.Error, match="there is none; give 'world'"):
        _ = dqc.constraints.Constraints(clear_of="all").names


def test_a_name_twice_is_refused(tmp_path):
    (tmp_path / "room.yaml").write_text("a: {box: 1}\na: {sphere: 1}\n")
    with pytest.raises(dqc.Error, match="key 'a' appears twice"):
        dqc.load_world(tmp_path / "room.yaml")


def test_a_slide_moves_along_something():
    with pytest.raises(dqc.Error, match="nothing to move along"):
        Slide(axis=(0, 0, 0))


def test_footprints_are_shadows():
    points = np.random.default_rng(3).uniform(-1, 1, (500, 2))
    column = dqc.world.footprint(Body(cylinder=(0.2, 1.0), position=(0.3, 0.1, 0.5)))
    assert column.clearance(points) == pytest.approx(np.linalg.norm(points - [0.3, 0.1], axis=1) - 0.2)
    turn = 0.4
    block = dqc.world.footprint(Body(box=[0.6, 0.2, 1], position=(0.1, -0.2, 0.5), rpy=(0, 0, turn)))
    matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    apart = np.abs((points - [0.1, -0.2]) @ matrix) - [0.3, 0.1]
    outside = np.linalg.norm(np.maximum(apart, 0), axis=1)
    found = block.clearance(points)
    assert found[outside > 0] == pytest.approx(outside[outside > 0])
    assert (found[outside == 0] <= 0).all()
    assert len(dqc.world.footprint(Body(plane=(0, 0, 1))).floor.polygons) == 0


def test_plans_keep_clear_of_what_stands_on_the_floor():
    """Of a column a polygon a little outside of its disc; as high as the highest."""
    world = World(
        bodies={
            "floor": Body(plane=(0, 0, 1)),
            "column": Body(cylinder=(0.2, 1.0), position=(1.0, 0.0, 0.5)),
            "table": Body(box=[1.0, 0.5, 0.8], position=(3.0, 0.0, 0.4)),
            "cube": Body(box=0.1, position=(0.0, 2.0, 0.05), mass=1.0),
        }
    )
    floor = floor_around(world, "all", "reference.clear_of")
    assert len(floor.polygons) == 2
    assert floor.height == pytest.approx(1.0)
    assert floor.clearance([[0.0, 0.0], [3.0, 1.0]]) == pytest.approx([0.8, 0.75], abs=2e-3)
    assert floor_around(world, ["table"], "x").height == pytest.approx(0.8)
    with pytest.raises(dqc.Error, match=r"reference.clear_of: 'cube' does not stand still"):
        floor_around(world, ["cube"], "reference.clear_of")
    with pytest.raises(dqc.Error, match=r"reference.clear_of: there is nothing in the world"):
        floor_around(None, "all", "reference.clear_of")


def test_shapes_of_bodies_are_made_a_few_times_however_many_bodies_there_are(monkeypatch):
    made, own = [], Body._convex
    monkeypatch.setattr(Body, "_convex", lambda body: (made.append(body), own(body))[1])
    balls = {f"ball {k}": {"sphere": 0.02, "position": [1.5, 0.1 * k, 0.5]} for k in range(40)}
    spec = {
        "name": "balls",
        "robot": "panda",
        "start": [0, -0.3, 0, -2.0, 0, 1.8, 0.7],
        "period": 0.01,
        "duration": 0.02,
        "reference": {"kind": "circle", "radius": 0.05, "duration": 4},
        "law": {"kind": "proportional", "gain": 5},
        "plant": {"kind": "integrator"},
        "world": balls,
        "constraints": {"clear_of": "all"},
    }
    dqc.run(spec)
    assert len(made) <= 4 * len(balls)
