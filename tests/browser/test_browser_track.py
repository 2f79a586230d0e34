"""What the browser view shows of a run, without a browser."""

import io
import itertools

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.browser import Track
from dqcontrol.browser.run_view_model import (
    ASPECT,
    FIELD,
    extent,
    numbers,
    places,
    step_back,
    viewpoint,
)
from dqcontrol.errors import FileFormatError
from dqcontrol.figures.robot_bodies import (
    DARK,
    mesh_file,
    pose_matrix,
    robot_shapes,
    urdf_shapes,
    wheel_angles,
)
from dqcontrol.loop import Record
from dqcontrol.robots.poses import pose7

URDF = """<robot name="lever">
<material name="red"><color rgba="1 0 0 1"/></material>
<link name="world"/>
<link name="base"><visual><origin xyz="0 0 0.1"/><geometry><box size="0.2 0.3 0.2"/></geometry></visual></link>
<link name="bar"><visual><origin xyz="0.2 0 0" rpy="0 0.3 0"/>
  <geometry><cylinder radius="0.05" length="0.4"/></geometry>
  <material name="blue"><color rgba="0 0 1 1"/></material></visual></link>
<link name="slide"><visual><geometry><sphere radius="0.04"/></geometry></visual>
  <visual><origin xyz="0 0.1 0"/>
  <geometry><mesh filename="package://parts/meshes/wedge.stl" scale="2 1 0.5"/></geometry></visual></link>
<link name="finger"><visual><origin xyz="0.01 0 0"/><geometry><box size="0.1 0.02 0.02"/></geometry></visual></link>
<link name="tip"/>
<joint name="foot" type="fixed"><origin xyz="1 2 0" rpy="0 0 0.5"/><parent link="world"/><child link="base"/></joint>
<joint name="hinge" type="revolute"><origin xyz="0 0 0.2" rpy="0.4 0 0"/><axis xyz="0 1 0"/>
  <limit lower="-2" upper="2" velocity="1" effort="1"/><parent link="base"/><child link="bar"/></joint>
<joint name="rail" type="prismatic"><origin xyz="0.4 0 0" rpy="0 0 0.7"/><axis xyz="1 0 0"/>
  <limit lower="-0.5" upper="0.5" velocity="1" effort="1"/><parent link="bar"/><child link="slide"/></joint>
<joint name="side" type="revolute"><origin xyz="0 0.1 0"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2" velocity="1" effort="1"/><parent link="bar"/><child link="finger"/></joint>
<joint name="end" type="fixed"><origin xyz="0.1 0 0"/><parent link="slide"/><child link="tip"/></joint>
</robot>"""


@pytest.fixture
def urdf(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    folder = tmp_path / "parts"
    (folder / "meshes").mkdir(parents=True)
    (folder / "urdf").mkdir()
    trimesh.creation.box([0.1, 0.2, 0.3]).export(folder / "meshes/wedge.stl")
    path = folder / "urdf" / "lever.urdf"
    path.write_text(URDF)
    return path


def sweep(robot, q, command=None, stopped="duration"):
    q = np.asarray(q, dtype=float)
    finite = np.isfinite(q).all(axis=1)
    pose = np.full((len(q), 8), np.nan)
    pose[finite] = robot.fkm(q[finite])
    desired = np.hstack([np.tile(pose[0], (len(q), 1)), np.zeros((len(q), 13))])
    command = np.zeros((len(q), robot.input_size)) if command is None else command
    time = 0.1 * np.arange(len(q))
    return Record(time, q, q, command, pose, desired, robot.joint_names, robot.input_names, stopped=stopped)


@pytest.mark.parametrize("base_link", [None, "base"])
def test_links_of_a_urdf_are_where_yourdfpy_puts_them(urdf, base_link):
    yourdfpy = pytest.importorskip("yourdfpy")
    arm = dqc.load_robot(urdf, base_link, "tip")
    model = yourdfpy.URDF.load(io.BytesIO(URDF.encode()), load_meshes=False)
    drawn = urdf_shapes(*arm.urdf, arm)
    assert [carrier for carrier, _, _ in drawn] == [-1, 0, 1, 1, 0]
    assert [colour for _, _, colour in drawn][1] == (0, 0, 255)
    rng = np.random.default_rng(3)
    for q in rng.uniform(-0.5, 0.5, (5, 2)):
        model.update_cfg({"hinge": q[0], "rail": q[1], "side": 0.0})
        frames = [np.eye(4), *(pose_matrix(pose7("frame", f)) for f in arm.frames(q))]
        links = ["base", "bar", "slide", "slide", "finger"]
        for link, (carrier, mesh, _) in zip(links, drawn, strict=True):
            visuals = model.link_map[link].visuals
            visual = visuals[1] if len(mesh.faces) == 12 and link == "slide" else visuals[0]
            local = np.eye(4) if visual.origin is None else visual.origin
            expected = model.get_transform(link, base_link or "world") @ local
            found = frames[carrier + 1] @ np.append(mesh.center_mass, 1.0)
            assert found[:3] == pytest.approx(expected[:3, 3], abs=1e-9)
    wedge = drawn[3][1]
    assert wedge.volume == pytest.approx(0.1 * 0.2 * 0.3 * 2 * 1 * 0.5)


def test_a_missing_mesh_leaves_rods_and_a_mesh_of_a_missing_package_names_it(urdf):
    arm = dqc.load_robot(urdf, None, "tip")
    (urdf.parent.parent / "meshes/wedge.stl").unlink()
    assert urdf_shapes(*arm.urdf, arm) == []
    assert {shape.carrier for shape in robot_shapes(arm)} == {-1, 0, 1}
    (rail,) = (shape for shape in robot_shapes(arm) if (shape.carrier, shape.colour) == (0, DARK))
    first, last = (pose7("frame", arm.frames([0.0, q])[1])[4:] for q in (-0.5, 0.5))
    carrier = pose_matrix(pose7("frame", arm.frames([0.0, 0.0])[0]))
    points = rail.vertices @ carrier[:3, :3].T + carrier[:3, 3] - first
    along = points @ (last - first)  # of 1 m
    across = np.linalg.norm(points - np.outer(along, last - first), axis=1)
    assert (along.min(), along.max()) == pytest.approx((-across.max(), 1 + across.max()), abs=1e-3)
    with pytest.raises(FileNotFoundError, match="elsewhere"):
        mesh_file(urdf, "package://elsewhere/a.stl")


def test_packages_are_found_as_ros_does(urdf, tmp_path, monkeypatch):
    there = tmp_path / "ws/share/far/a.stl"
    there.parent.mkdir(parents=True)
    there.write_text("")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path / 'ws'}")
    assert mesh_file(urdf, "package://far/a.stl") == there
    assert mesh_file(urdf, "package://parts/meshes/wedge.stl").is_file()
    assert mesh_file(urdf, "../meshes/wedge.stl").is_file()


def test_damaged_meshes_and_those_with_a_document_type_are_refused(urdf):
    wedge = urdf.parent.parent / "meshes/wedge.dae"
    urdf.write_text(URDF.replace("wedge.stl", "wedge.dae"))
    arm = dqc.load_robot(urdf, None, "tip")
    for text in ("<!DOCTYPE a [<!ENTITY b 'c'>]><a/>", "<nothing/"):
        wedge = wedge.rename(wedge.with_name(f"{len(text)}.dae")) if wedge.exists() else wedge
        wedge.write_text(text)
        urdf.write_text(URDF.replace("wedge.stl", wedge.name))
        with pytest.raises(FileFormatError, match=r"\.dae: "):
            urdf_shapes(*arm.urdf, arm)


def test_rods_reach_from_joint_to_joint():
    arm = dqc.load_robot("ur5")
    q = np.linspace(0.2, 1.0, 6)
    track = Track("one", arm, sweep(arm, [q]))
    frames = track.frames(0)
    assert frames == pytest.approx(np.array([pose7("frame", f) for f in arm.frames(q)]), abs=1e-12)
    points = frames[:, 4:]
    cloud = np.vstack(
        [
            s.vertices
            if s.carrier < 0
            else (pose_matrix(frames[s.carrier]) @ np.c_[s.vertices, np.ones(len(s.vertices))].T).T[:, :3]
            for s in robot_shapes(arm)
        ]
    )
    reach = np.linalg.norm(arm.chain[:, 4:7], axis=1).sum()
    for a, b in itertools.pairwise(points):  # something is drawn near the middle of each link
        assert np.linalg.norm(cloud - (a + b) / 2, axis=1).min() < max(
            0.06 * reach, 0.5 * np.linalg.norm(b - a)
        )
    distance = np.min(np.linalg.norm(cloud[:, None] - points[None], axis=2), axis=1)
    assert distance.max() < reach  # and nothing far away


def test_wheels_roll_as_the_inputs_turn_them():
    seed = 5
    rng = np.random.default_rng(seed)
    drive = dqc.DifferentialDrive(wheel_radius=0.05, half_track=0.2)
    body = dqc.WholeBody([drive, dqc.load_robot("panda")])
    period, inputs = 0.01, np.repeat(rng.uniform(-1, 1, (10, body.input_size)), 30, axis=0)
    q = [np.zeros(body.configuration_size)]
    for u in inputs:
        q.append(body.integrate(q[-1], u, period))
    turned = np.vstack([np.zeros(2), np.cumsum(period * body.wheel_speeds(inputs)[:, :2], axis=0)])
    assert wheel_angles(body, np.array(q)) == pytest.approx(turned, abs=1e-3), f"seed {seed}"
    record = sweep(body, q, np.vstack([inputs, inputs[-1:]]))
    track = Track("drive", body, record)
    frames = track.frames(len(record) - 1)
    assert len(frames) == body.configuration_size + 1 + 2
    right, left = frames[-2:, 4:]
    assert np.linalg.norm(right - left) == pytest.approx(0.4)
    assert (right + left) / 2 == pytest.approx([*q[-1][:2], 0.05], abs=1e-9)
    assert max(shape.carrier for shape in robot_shapes(body)) == len(frames) - 1


def test_numbers_are_those_of_the_sample():
    arm = dqc.load_robot("iiwa7")
    q = np.zeros((3, 7))
    q[2, 3] = arm.limits.upper[3] + 0.1
    command = np.zeros((3, 7))
    command[2, 5] = -2 * arm.limits.velocity[5]
    track = Track("one", arm, sweep(arm, q, command))
    reading = track.reading(2)
    assert (reading.joint, reading.unit) == (arm.joint_names[3], "rad")
    assert reading.margin == pytest.approx(-0.1)
    assert reading.input == arm.input_names[5]
    assert reading.speed == pytest.approx(2.0)
    moved = algebra.translation(arm.fkm(q[2])) - algebra.translation(arm.fkm(q[0]))
    assert reading.position_error == pytest.approx(np.linalg.norm(moved))
    assert reading.orientation_error == pytest.approx(arm.limits.upper[3] + 0.1)
    assert (track.reading(0).stopped, reading.stopped) == ("", "duration")
    assert [track.index(t) for t in (-1.0, 0.0, 0.15, 0.2, 9.0)] == [0, 0, 1, 2, 2]
    text = numbers([("<b>evil</b>", "#0072B2", reading)])
    assert "&lt;b&gt;evil" in text
    assert "-5.7°" in text
    assert "200 %" in text
    assert text.count("#B2182B") == 2  # both limits are crossed


def test_a_run_that_diverged_keeps_its_last_pose():
    arm = dqc.load_robot("iiwa7")
    q = np.zeros((4, 7))
    q[1] = 0.3
    q[2:] = np.nan
    track = Track("lost", arm, sweep(arm, q, stopped="diverged at 0.2 s"))
    assert (track.frames(3) == track.frames(1)).all()
    assert np.isfinite(track.hand_path()).all()
    assert np.isnan(track.reading(3).position_error)
    assert np.isfinite(extent([track]).upper).all()


def test_paths_hold_the_hand_s_way_and_dashes_of_the_desired_one():
    arm = dqc.load_robot("iiwa7")
    q = np.linspace(0, 1, 3000)[:, None] * np.full(7, 0.4)
    record = sweep(arm, q)
    track = Track("long", arm, record)
    path = track.hand_path()
    assert len(path) <= 800
    assert path[0, 0] == pytest.approx(record.position[0])
    assert path[-1, 1] == pytest.approx(record.position[-1])
    assert len(track.desired_path()) == 0  # it rests
    planned = Track("planned", arm, record, record.position).desired_path()
    length = np.linalg.norm(planned[:, 1] - planned[:, 0], axis=1).sum()
    whole = np.linalg.norm(np.diff(record.position, axis=0), axis=1).sum()
    assert 0.5 * whole < length < 0.7 * whole


def test_runs_side_by_side_do_not_touch_and_the_viewer_sees_all():
    arm = dqc.load_robot("iiwa7")
    tracks = [Track(str(i), arm, sweep(arm, [np.full(7, 0.2 * i)] * 2)) for i in range(3)]
    box = extent(tracks)
    position, middle = viewpoint(tracks[0].frames(0)[0, 4:], [track.target for track in tracks], box)
    assert np.linalg.norm(position - middle) > box.size
    assert position[2] > middle[2]
    apart = places(3, box, position - middle)
    assert apart.mean(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    ahead = middle - position
    right = np.cross(ahead, [0, 0, 1.0]) / np.linalg.norm(np.cross(ahead, [0, 0, 1.0]))
    corners = np.array(np.meshgrid(*zip(box.lower, box.upper, strict=True))).reshape(3, -1).T
    assert (np.diff(apart @ right) > np.ptp(corners @ right)).all()
    assert apart @ ahead == pytest.approx(np.zeros(3), abs=1e-12)

    assert step_back(apart, box, 9 * (position - middle)) == 1
    row = places(8, box, position - middle)
    farther = step_back(row, box, position - middle)
    offset = (corners - middle + row[:, None]).reshape(-1, 3)
    depth = farther * np.linalg.norm(ahead) + offset @ ahead / np.linalg.norm(ahead)
    widest = np.abs(offset @ right / depth).max()
    assert widest == pytest.approx(ASPECT * np.tan(FIELD / 2))  # at the edge of the scene


def test_both_hands_of_two_arms_are_shown_and_what_is_relative_where_it_is():
    arms = dqc.load_robot("two-pandas")  # its task: the left hand seen from the right one
    q = np.array([-0.1, -0.5, 0.1, -2.2, 0.1, 1.7, 0.8, 0.3, -0.7, -0.2, -2.1, -0.1, 1.5, 0.7])
    way = q + np.linspace(0, 0.2, 11)[:, None]
    desired = np.hstack([arms.fkm(way), np.zeros((11, 13))])
    record = Record(0.1 * np.arange(11), way, way, 0 * way, arms.fkm(way), desired, arms.joint_names)
    track = Track("both", arms, record)
    left, right = (dqc.algebra.translation(arms.fkm(way, name)) for name in ("left", "right"))
    assert track.hand_path().shape == (20, 2, 3)
    assert np.abs(track.hand_path()[[0, 10], 0] - [left[0], right[0]]).max() < 1e-12
    assert np.abs(track.target - left).max() < 1e-12
    assert np.abs(track.desired(3)[4:] - left[3]).max() < 1e-12
    assert {track.robot.frame_names[row - 14] for row in arms.ends} == {"left", "right"}
