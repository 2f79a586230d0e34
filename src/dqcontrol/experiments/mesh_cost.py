"""What meshes cost constraints: the time of their distances, measured where it is asked."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from dqcontrol.constraints.constraints import Constraints
from dqcontrol.experiments.prepared_experiment import PreparedExperiment
from dqcontrol.geometry import Hull, distance_kernels as kernels
from dqcontrol.robots import Robot

_REPEATS = 20


def mesh_remarks(setting: PreparedExperiment) -> Iterator[str]:
    """Give in one line for each body made of several convex parts that constraints keep clear of what these cost."""
    told: set[str] = set()
    for case in setting.cases:
        kept = case.variant.law.constraints
        if kept is None:
            continue
        for name in kept.obstacles:
            if name not in told and (words := mesh_cost(case.scene.robot, kept, name)):
                told.add(name)
                yield words


def mesh_cost(robot: Robot, constraints: Constraints, name: str) -> str:
    """Return what the convex parts of a body cost a step, where it has several; empty otherwise.

    Parameters
    ----------
    robot
        Whose links are kept clear of it, where they are at rest in all coordinates 0.
    constraints
        That keep them.
    name
        Of the body.
    """
    hulls = [shape for shape in constraints.obstacles[name].shapes if isinstance(shape, Hull)]
    if robot.shapes is None or len(hulls) < 2:
        return ""
    links = [shape.row for shape in robot.shapes.moved(robot, np.zeros(robot.configuration_size))]
    rows = np.zeros((len(links), kernels.SHAPE))
    for row, link in zip(rows, links, strict=True):
        row[:] = link
    found, spent = np.empty((len(links), kernels.FOUND)), 0.0
    for hull in hulls:
        parts = np.tile(hull.row, (len(links), 1))
        kernels.distances(rows, parts, found)
        begin = time.process_time()
        for _ in range(_REPEATS):
            kernels.distances(rows, parts, found)
        spent += (time.process_time() - begin) / _REPEATS
    corners = sum(len(hull.points) for hull in hulls)
    return (
        f"constraints.clear_of.{name}: {len(hulls)} convex parts with {corners} corners; all their distances from "
        f"{len(links)} links take {1e6 * spent:.2g} µs here, each time that a step looks at them; far ones are left out"
    )
