"""A robot in a browser's scene, at any configuration."""

from __future__ import annotations

from typing import Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.browser.run_view_model import wheel_angles, with_wheels
from dqcontrol.figures.robot_bodies import Colour, robot_shapes, tinted
from dqcontrol.robots import Robot
from dqcontrol.robots.poses import pose7


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
