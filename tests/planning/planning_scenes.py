"""Random scenes to plan in, edges in them, and an independent judge."""

import numpy as np
from obstacles import around, box, capsule, column, plane, sphere

import dqcontrol as dqc

ROBOTS = ("panda", "ur5", "iiwa7", "two-pandas", "youbot")


def load(name):
    return dqc.load_robot(name)


def links_of(robot):
    assert robot.shapes is not None
    return robot.shapes.shapes


def random_things(rng, reach):
    """Return a ball, a bar, a box, a column and a table around a robot."""

    def near():
        direction = rng.normal(size=3)
        direction[2] = abs(direction[2])
        return tuple(rng.uniform(0.4, 0.9) * reach * direction / np.linalg.norm(direction))

    start = np.array(near())
    return {
        "ball": sphere(center=near(), radius=rng.uniform(0.02, 0.12)),
        "bar": capsule(start=tuple(start), end=tuple(start + rng.normal(scale=0.3, size=3)), radius=0.03),
        "box": box(position=near(), size=(0.3, 0.2, 0.15), rpy=tuple(rng.uniform(-1, 1, 3))),
        "column": column(point=near(), radius=0.05),
        "table": plane(normal=(0.0, 0.0, 1.0), offset=-0.1),
    }


def random_constraints(rng, robot, **options):
    return dqc.constraints.Constraints(**around(random_things(rng, min(robot.reach, 1.0))), **options)


def random_configurations(rng, robot, count):
    lower = np.where(np.isfinite(robot.limits.lower), np.maximum(robot.limits.lower, -2.5), -1.0)
    upper = np.where(np.isfinite(robot.limits.upper), np.minimum(robot.limits.upper, 2.5), 1.0)
    return rng.uniform(lower, upper, (count, len(lower)))


def random_edges(rng, robot, count, length=0.8):
    """Return ends of edges within the limits, shape (count, n) each."""
    a = random_configurations(rng, robot, count)
    away = rng.normal(size=a.shape)
    b = a + length * away / np.linalg.norm(away, axis=1)[:, None]
    return a, np.clip(b, robot.limits.lower, robot.limits.upper)


def least_sampled(edges, a, b, samples):
    """Return the least room beyond what is asked at samples of each edge, shape (N,)."""
    steps = np.linspace(0.0, 1.0, samples)
    q = a[:, None] + steps[:, None] * (b - a)[:, None]
    values = edges.kept.values(q.reshape(-1, q.shape[2]), np.zeros(q.shape[0] * samples))
    return (values - edges.kept.asked).min(axis=1).reshape(len(a), samples).min(axis=1)
