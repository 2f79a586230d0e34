"""A robot in a browser's scene at any configuration, and the constraints around it with the nearest pair in red."""

from __future__ import annotations

from typing import Any

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.browser.run_view_model import Track, with_wheels
from dqcontrol.constraints.constraint_view import NEAR
from dqcontrol.figures.robot_bodies import Colour, Surface, ball, box, robot_shapes, rod, tinted, wheel_angles
from dqcontrol.geometry import Box, Capsule, Cylinder, Hull, InfiniteCylinder, Plane, Shape, Sphere
from dqcontrol.robots import Robot
from dqcontrol.robots.poses import pose7
from dqcontrol.world.body import poses_of


class DrawnRobot:
    """The nodes of a robot in a scene of viser.

    Parameters
    ----------
    server
        A ``viser.ViserServer``.
    robot
        An arm or a whole body.
    name
        Of its node in the scene.
    tint
        Mixed into its own colours, 0 … 255, to tell it from others; none if omitted.
    opacity
        Below 1 what is behind shows through.
    axes
        Length of the frames' axes, m.

    Attributes
    ----------
    bodies
        Its meshes, each with the row of `Robot.frames` that it moves with, −1 for what stands still.

    Examples
    --------
    >>> server = viser.ViserServer()  # doctest: +SKIP
    >>> drawn = dqc.browser.DrawnRobot(server, arm)  # doctest: +SKIP
    >>> drawn.show(q)  # doctest: +SKIP
    """

    robot: Robot
    bodies: list[tuple[int, Any]]

    def __init__(
        self,
        server: Any,
        robot: Robot,
        name: str = "/robot",
        *,
        tint: Colour | None = None,
        opacity: float = 1.0,
        axes: float = 0.1,
    ) -> None:
        self.robot, self._server = robot, server
        scene = server.scene
        self._root = scene.add_frame(name, show_axes=False)
        self._q = np.zeros(robot.configuration_size)
        self._wheels = np.zeros(2 * len(robot.drives))
        rows = len(robot.frames(self._q)) + len(self._wheels)
        sizes = {"axes_length": axes, "axes_radius": 0.03 * axes, "origin_radius": 0.0}
        self._frames = [scene.add_frame(f"{name}/frame{j}", show_axes=False, **sizes) for j in range(rows)]
        self._hands, self._joints = robot.ends, len(robot.row_coordinates)
        for hand in self._hands:
            self._frames[hand].show_axes = True
        self._opacity = 1.0
        self.bodies = []
        for j, (carrier, vertices, faces, colour) in enumerate(robot_shapes(robot)):
            parent = name if carrier < 0 else f"{name}/frame{carrier}"
            shown = tinted(colour, tint) if tint else colour
            mesh = scene.add_mesh_simple(f"{parent}/shape{j}", vertices, faces, color=shown)
            self.bodies.append((carrier, mesh))
        self.set_opacity(opacity)

    def show(self, q: Array) -> None:
        """Show a configuration, shape (n,), rad or m; wheels roll there from the last one."""
        q = np.array(q, dtype=np.float64)
        if len(self._wheels):
            self._wheels += wheel_angles(self.robot, np.stack([self._q, q]))[1]
        self._q = q
        frames = [pose7("frame", frame) for frame in self.robot.frames(q)]
        with self._server.atomic():
            self.place(with_wheels(self.robot, frames, self._wheels))

    def place(self, frames: Array) -> None:
        """Show all frames at poses [quaternion, position], shape (rows, 7): those of the robot, then its wheels'."""
        for node, pose in zip(self._frames, frames, strict=True):
            node.wxyz, node.position = pose[:4], pose[4:]

    def remove(self) -> None:
        """Take all of it out of the scene."""
        self._root.remove()

    def set_place(self, position: Array, *, visible: bool = True) -> None:
        """Show all of it displaced, (3,), m; or hide it."""
        self._root.position, self._root.visible = position, visible

    def set_joint_frames(self, *, shown: bool) -> None:
        """Show the frames of all joints, or of the hands alone."""
        for j, node in enumerate(self._frames):
            node.show_axes = j in self._hands or (shown and j < self._joints)

    def set_opacity(self, opacity: float) -> None:
        """Let what is behind show through, if below 1."""
        if opacity != self._opacity:
            for _, mesh in self.bodies:
                mesh.opacity = None if opacity == 1.0 else opacity
            self._opacity = opacity


_SOLID, _CLOSE, _ZONE, _WOOD = (140, 90, 165), (230, 64, 26), (64, 140, 90), (194, 153, 107)
_OPACITY, _ZONE_OPACITY, _LINK_OPACITY = 0.6, 0.15, 0.4
_THIN = 0.002  # m
_WALL = 0.4  # of the scene's size, for walls of zones: the robot is what is looked at


class DrawnThings:
    """The nodes of what is around one run's robot."""

    def __init__(self, scene: Any, name: str, track: Track, size: float) -> None:
        self._scene, self._name, self._track, self._size = scene, name, track, size
        self._frames: list[Any] = []
        self._meshes: list[Any] = []
        self._pair: list[Any] = []
        self._carried: list[tuple[Any, Array]] = []  # what physics or a hand moves, and its poses
        if track.around is None:
            return
        for i, thing in enumerate(track.around.things):
            node = f"{name}/around{i}"
            self._frames.append(scene.add_frame(node, show_axes=False))
            is_wide = thing.is_zone or isinstance(thing.shape, Plane)
            opacity = _ZONE_OPACITY if is_wide else _OPACITY
            wide = _WALL * size if thing.is_zone else size
            self._meshes.append(self._add(f"{node}/shape", thing.shape, self._colour(i), opacity, wide))
        record = track.record
        readings = {signal: each.values for signal, each in record.readings.items()}
        for body_name, body in track.around.free.items():
            node = f"{name}/{body_name}"
            frame = scene.add_frame(node, show_axes=False)
            self._carried.append((frame, poses_of(body_name, body, record.time, readings)))
            for number, shape in enumerate(body.own_shapes):
                self._add(f"{node}/shape{number}", shape, _WOOD, 1.0)

    def show(self, k: int) -> None:
        """Show a sample."""
        track = self._track
        if track.around is None:
            return
        nearest = track.nearest(k)
        near = nearest if nearest is not None and nearest.room < NEAR else None
        shifts = track.around.shifts(track.record.time[k : k + 1])[:, 0]
        for frame, poses in self._carried:
            frame.position, frame.wxyz = algebra.translation(poses[k]), algebra.rotation(poses[k])
        for i, (frame, mesh) in enumerate(zip(self._frames, self._meshes, strict=True)):
            frame.position = shifts[i]
            colour = _CLOSE if near is not None and near.thing == i else self._colour(i)
            if mesh is not None and tuple(mesh.color) != colour:
                mesh.color = colour
        for node in self._pair:
            node.remove()
        self._pair = []
        if near is None or not len(near.on_a):
            return
        node, ends = f"{self._name}/nearest", np.array([[near.on_a, near.on_b]])
        self._pair = [self._scene.add_line_segments(f"{node}/line", ends, _CLOSE, thickness=0.004)]
        if near.link is not None and (link := self._add(f"{node}/link", near.link, _CLOSE, _LINK_OPACITY)):
            self._pair.append(link)

    def _colour(self, i: int) -> Colour:
        assert self._track.around is not None
        return _ZONE if self._track.around.things[i].is_zone else _SOLID

    def _add(self, name: str, shape: Shape, colour: Colour, opacity: float, size: float | None = None) -> Any:
        """Add a shape's mesh; None of one that cannot be drawn, as a ball without size."""
        mesh = shape_mesh(shape, size or self._size)
        if mesh is None:
            return None
        return self._scene.add_mesh_simple(name, mesh.vertices, mesh.faces, color=colour, opacity=opacity)


def shape_mesh(shape: Shape, size: float) -> Surface | None:
    """Return the mesh of a shape; of one without end as much as a scene of this size, m, shows."""
    if isinstance(shape, Sphere):
        return ball(shape.center, shape.radius) if shape.radius else None
    if isinstance(shape, Capsule):
        return rod(shape.start, shape.end, shape.radius, round_ends=True)
    if isinstance(shape, Cylinder):
        return rod(shape.start, shape.end, shape.radius)
    if isinstance(shape, InfiniteCylinder):
        along = size * shape.direction
        return rod(shape.point - along, shape.point + along, shape.radius)
    if isinstance(shape, Hull):
        return Surface(shape.corners[shape.faces].reshape(-1, 3), np.arange(shape.faces.size).reshape(-1, 3))
    if isinstance(shape, Box):
        return box(shape.size, shape.row[4:7], shape.row[7:].reshape(3, 3))
    if isinstance(shape, Plane):
        return box([2 * size, 2 * size, _THIN], (shape.offset - 0.5 * _THIN) * shape.normal, shape.axes)
    return None
