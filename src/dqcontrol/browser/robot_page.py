"""A robot alone, to be moved by hand: sliders for its joints, frames, limits, and what it reaches."""

from __future__ import annotations

import math

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.browser.drawn import DrawnRobot
from dqcontrol.browser.run_view_model import Extent, html_table, viewpoint
from dqcontrol.browser.served_page import ServedPage
from dqcontrol.robots import Robot, describe

_CLOSER = 0.75  # than where all that the hand reaches is seen: the robot is what is looked at
_POINTS = 6000  # of the hand in the cloud of what it reaches
_NEAR = 0.05  # share of a joint's range: nearer to a limit than that is red
_CLOUD = (86, 180, 233)
_FREE = {"revolute": math.pi, "prismatic": 1.0}  # rad, m: ends of sliders where there are no limits


class RobotPage(ServedPage):
    """A browser page that shows a robot; ``serve`` keeps it going.

    Parameters
    ----------
    robot
        An arm or a whole body.
    port
        Of this machine; the next free one if it is taken.

    Attributes
    ----------
    q
        The configuration that is shown, shape (n,), rad or m.

    Raises
    ------
    MissingExtraError
        If viser is not installed.
    """

    q: Array

    def __init__(self, robot: Robot, port: int = 8080) -> None:
        super().__init__(port)
        self.server.gui.main_panel.dock_right()
        self.robot = robot
        free = np.array([_FREE[kind] for kind in robot.joint_types])
        self.lower: Array = np.where(np.isfinite(robot.limits.lower), robot.limits.lower, -free)
        self.upper: Array = np.where(np.isfinite(robot.limits.upper), robot.limits.upper, free)
        self._home = inside(self.lower, self.upper)
        self.q = self._home.copy()
        reached = reached_points(robot, self.lower, self.upper)
        self._joints: Array = algebra.translation(robot.frames(self.q))
        cloud = np.vstack([reached, self._joints])
        self._box = Extent(cloud.min(axis=0), cloud.max(axis=0))
        self._set_stage(reached)
        self._drawn = DrawnRobot(self.server, robot, axes=min(0.045 * self._box.size, 0.12))
        self._add_controls()
        self._seen: object = None
        self.tick()

    def tick(self) -> None:
        """Draw what has changed."""
        wanted = (*(slider.value for slider in self._sliders), self._joint_frames.value, self._reach.value)
        if wanted == self._seen:
            return
        self._seen = wanted
        self.q = np.array([slider.value for slider in self._sliders]) * self._scales
        with self.server.atomic():
            self._drawn.show(self.q)
            self._drawn.set_joint_frames(shown=self._joint_frames.value)
            self._cloud.visible = self._reach.value
            self._numbers.content = self._told()

    def set(self, q: Array) -> None:
        """Move the sliders to a configuration, rad or m."""
        for slider, value in zip(self._sliders, q / self._scales, strict=True):
            slider.value = float(np.clip(value, slider.min, slider.max))

    def _set_stage(self, reached: Array) -> None:
        box = self._box
        position, looked_at = viewpoint(self._joints[0], [algebra.translation(self.robot.fkm(self.q))], box)
        nearer = looked_at + _CLOSER * (position - looked_at)
        stands = float(self._joints[:, 2].min())
        self._set_scene(nearer, looked_at, float(np.ceil(2 * box.size)), stands, shadows=0.125)
        self._cloud = self.server.scene.add_point_cloud(
            "/reach",
            points=reached.astype(np.float32),
            colors=_CLOUD,
            point_size=0.0018 * box.size,
            point_shape="circle",
            visible=False,
        )

    def _add_controls(self) -> None:
        gui, about = self.server.gui, describe(self.robot)
        ends = f"{about.ends}, " if about.ends else ""
        gui.add_markdown(f"**{about.name}** — {ends}reach {about.reach:.3g} m")
        turns = np.array(self.robot.joint_types) == "revolute"
        self._scales = np.where(turns, math.pi / 180, 1.0)
        self._sliders = []
        for i, name in enumerate(self.robot.joint_names):
            unit, step = ("°", 0.1) if self.robot.joint_types[i] == "revolute" else ("m", 0.001)
            low, high, first = np.array([self.lower[i], self.upper[i], self._home[i]]) / self._scales[i]
            ends = step * math.ceil(low / step - 1e-6), step * math.floor(high / step + 1e-6)
            low, high = (round(end, 3) for end in ends)  # whole steps, within the limits
            slider = gui.add_slider(f"{name} [{unit}]", low, high, step, float(np.clip(first, low, high)))
            self._sliders.append(slider)
        gui.add_button("Where it began").on_click(lambda _: self.set(self._home))
        gui.add_button("Middle of the limits").on_click(lambda _: self.set((self.lower + self.upper) / 2))
        self._joint_frames = gui.add_checkbox("Frames of all joints", True)
        self._reach = gui.add_checkbox("What the end effector reaches", False)
        self._numbers = gui.add_html("")

    def _told(self) -> str:
        """Return where the hand is, which joints are near their limits, and the start for a spec, as HTML."""
        pose = self.robot.fkm(self.q)
        x, y, z = algebra.translation(pose)
        rpy = np.degrees(algebra.rpy_from_rotation(algebra.rotation(pose)))
        rows = [
            ("End effector [m]", f"{x:.3f}, {y:.3f}, {z:.3f}", False),
            ("Roll, pitch, yaw [°]", ", ".join(f"{angle:.1f}" for angle in rpy), False),
            ("Manipulability", f"{float(self.robot.manipulability(self.q)):.3g}", False),
        ]
        span = self.upper - self.lower
        margins = np.minimum(self.q - self.robot.limits.lower, self.robot.limits.upper - self.q)
        for i in np.flatnonzero(margins < _NEAR * span):
            scale, unit = (180 / math.pi, "°") if self.robot.joint_types[i] == "revolute" else (1e3, " mm")
            name = f"{self.robot.joint_names[i]} to its limit"
            rows.append((name, f"{scale * margins[i]:.1f}{unit}", True))
        start = ", ".join(f"{value:.4g}" for value in self.q + 0.0)
        return (
            f"<div style='margin:8px 12px;font-size:0.85em'>{html_table(rows)}"
            f"<p>For a spec (rad or m):<br><code>start: [{start}]</code></p></div>"
        )


def inside(lower: Array, upper: Array) -> Array:
    """Return a configuration inside limits: zero, or the middle of a joint's range where zero is near its end."""
    zero, margin = np.zeros(len(lower)), _NEAR * (upper - lower)
    well = (lower + margin <= zero) & (zero <= upper - margin)
    return np.where(well, zero, (lower + upper) / 2)


def reached_points(robot: Robot, lower: Array, upper: Array) -> Array:
    """Return positions of the hand at random configurations between limits, shape (N, 3), m; bases rest."""
    q = np.random.default_rng(0).uniform(lower, upper, (_POINTS, len(lower)))
    for first, _ in robot.bases:
        q[:, first : first + 3] = 0.0
    out: Array = algebra.translation(robot.fkm(q))
    return out
