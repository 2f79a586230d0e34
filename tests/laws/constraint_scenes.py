"""Random scenes for constrained laws: a Panda among things in its way, and what shows that none was touched."""

import numpy as np

import dqcontrol as dqc
from dqcontrol.laws.constrained.prepared_constraints import PreparedConstraints

HOME = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.7])
SUBSAMPLES = 20
MOVED = [f"panda_link{k}" for k in range(3, 8)]  # the first two cannot get out of the way of what comes


def random_constraints(rng, arm, q, **options):
    """Return constraints with a ball, a bar, a table and a box that the robot does not touch yet."""
    while True:
        middle = dqc.DualQuaternion(arm.fkm(q)).translation

        def near(low, high, middle=middle):
            direction = rng.normal(size=3)
            return tuple(middle + rng.uniform(low, high) * direction / np.linalg.norm(direction))

        start = np.array(near(0.2, 0.6))
        obstacles = {
            "ball": dqc.laws.SphereObstacle(center=near(0.15, 0.5), radius=rng.uniform(0.02, 0.1)),
            "bar": dqc.laws.CapsuleObstacle(
                start=tuple(start), end=tuple(start + rng.normal(scale=0.3, size=3)), radius=0.03
            ),
            "table": dqc.laws.PlaneObstacle(normal=(0.0, 0.0, 1.0), offset=-0.05),
            "box": dqc.laws.BoxObstacle(position=near(0.3, 0.7), size=(0.2, 0.1, 0.15), rpy=(0.3, 0.2, 0.5)),
            "mover": dqc.laws.SphereObstacle(
                center=near(0.5, 0.8),
                radius=0.05,
                velocity=tuple(rng.uniform(-0.05, 0.05, 3)),
                links=MOVED,
            ),
        }
        found = dqc.laws.Constraints(margin=0.01, obstacles=obstacles, **options)
        kept = PreparedConstraints(found, arm, 0.01, "measured")
        if kept.values(q[None], [0.0])[0].min() > 0.025:
            return found


def random_goal(rng, arm):
    """Return a reference at a pose that some configuration has, often blocked."""
    low, high = np.maximum(arm.limits.lower, -2), np.minimum(arm.limits.upper, 2.5)
    return dqc.references.SetPoint(arm.fkm(rng.uniform(low, high)))


def least_room(law, record, period):
    """Return the least room beyond what is asked at samples and between them, m."""
    q, command = record.q[:-1], record.command[:-1]
    least = np.inf
    for share in np.arange(1, SUBSAMPLES + 1) / SUBSAMPLES:
        values = law.constraints.values(q + share * period * command, record.time[:-1] + share * period)
        least = min(least, float((values - law.constraints.asked).min()))
    return least
