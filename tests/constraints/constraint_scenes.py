"""Random scenes for constrained laws: a Panda among things in its way, and what shows that none was touched."""

import numpy as np
from obstacles import around, box, capsule, plane, sphere, towards

import dqcontrol as dqc
from dqcontrol.constraints.prepared_constraints import PreparedConstraints

HOME = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.7])
SUBSAMPLES = 20
# The first two links cannot get out of the way of what comes.
MOVED = [f"panda_link{k}" for k in (3, 4, "5.1", "5.2", "6.1", "6.2", 7)]


def random_constraints(rng, arm, q, **options):
    """Return constraints with a ball, a bar, a table and a box that the robot does not touch yet."""
    while True:
        middle = dqc.DualQuaternion(arm.fkm(q)).translation

        def near(low, high, middle=middle):
            direction = rng.normal(size=3)
            return tuple(middle + rng.uniform(low, high) * direction / np.linalg.norm(direction))

        start = np.array(near(0.2, 0.6))
        obstacles = {
            "ball": sphere(center=near(0.15, 0.5), radius=rng.uniform(0.02, 0.1)),
            "bar": capsule(start=tuple(start), end=tuple(start + rng.normal(scale=0.3, size=3)), radius=0.03),
            "table": plane(normal=(0.0, 0.0, 1.0), offset=-0.05),
            "box": box(position=near(0.3, 0.7), size=(0.2, 0.1, 0.15), rpy=(0.3, 0.2, 0.5)),
            "mover": sphere(
                center=near(0.5, 0.8),
                radius=0.05,
                velocity=tuple(rng.uniform(-0.05, 0.05, 3)),
                links=MOVED,
            ),
        }
        found = dqc.constraints.Constraints(margin=0.01, **around(obstacles), **options)
        kept = PreparedConstraints(found, arm, 0.01, "measured")
        if kept.values(q[None], [0.0])[0].min() > 0.025:
            return found


def random_goal(rng, arm):
    """Return a reference at a pose that some configuration has, often blocked."""
    low, high = np.maximum(arm.limits.lower, -2), np.minimum(arm.limits.upper, 2.5)
    return dqc.references.SetPoint(arm.fkm(rng.uniform(low, high)))


def least_room(law, record, period):
    """Return the least room beyond what is asked at samples and between them, m or rad."""
    q, command = record.q[:-1], record.command[:-1]
    least = np.inf
    for share in np.arange(1, SUBSAMPLES + 1) / SUBSAMPLES:
        between = law.robot.integrate(q, command, share * period)
        values = law.constraints.values(between, record.time[:-1] + share * period)
        least = min(least, float((values - law.constraints.asked).min()))
    return least


def least_room_of_servos(law, record, period, servo):
    """Return the least room beyond what is asked of joints that follow their targets by a first-order lag."""
    tau, delay = servo.time_constant, servo.delay
    targets = record.q[0] + period * np.vstack(
        [np.zeros(record.command.shape[1]), record.command[:-1].cumsum(axis=0)]
    )
    q, between, steps = record.q[0].copy(), [], SUBSAMPLES
    sub = period / steps
    for k in range(steps * (len(targets) - 1)):
        at = (
            int(np.floor((k * sub - delay) / period + 1e-9)) + 1
        )  # the target of the period that has begun, late
        goal = targets[max(at, 0)]
        q = goal + (q - goal) * np.exp(-sub / tau)
        between.append(q)
    joints = np.array(between)
    assert np.abs(joints[steps - 1 :: steps] - record.q[1:]).max() < 1e-9  # the plant did so
    values = law.constraints.values(joints, sub * np.arange(1, len(joints) + 1))
    return float((values - law.constraints.asked).min())


def random_turn(rng):
    """Return a random unit vector."""
    direction = rng.normal(size=3)
    return tuple(direction / np.linalg.norm(direction))


def random_kinds(rng, robot, q, **options):
    """Return zones, angles and sights, of all kinds, that hold at a configuration, some of them barely."""
    while True:
        pose = dqc.DualQuaternion(robot.fkm(q))
        middle, axis = pose.translation, pose.matrix()[:3, 2]
        near = tuple(middle + rng.uniform(0.0, 0.06) * np.array(random_turn(rng)))
        zones = {
            "room": dqc.constraints.Zone(
                position=near, box=tuple(rng.uniform(0.15, 0.5, 3)), rpy=tuple(rng.uniform(-1, 1, 3))
            ),
            "globe": dqc.constraints.Zone(position=near, sphere=rng.uniform(0.08, 0.3), radius_of_hand=0.01),
            "tube": dqc.constraints.Zone(
                position=near, rpy=towards(random_turn(rng)), cylinder=(rng.uniform(0.08, 0.3), 0.5)
            ),
            "floor": dqc.constraints.Zone(plane=(0, 0, 1), position=(0, 0, middle[2] - 0.1), margin=0.02),
        }
        away = np.cross(axis, random_turn(rng))
        away /= np.linalg.norm(away)
        angles = {
            "cone": dqc.constraints.Angle(direction=tuple(axis + 0.2 * away), at_most=rng.uniform(0.25, 1.0)),
            "out of": dqc.constraints.Angle(
                direction=tuple(axis + 0.5 * away), at_least=rng.uniform(0.05, 0.4)
            ),
            "lines": dqc.constraints.Angle(direction=tuple(away), apart=rng.uniform(0.2, 1.0)),
        }
        place = tuple(middle + axis * rng.uniform(0.3, 0.8))
        lamp = sphere(center=place, radius=0.02, links=["hand"], velocity=tuple(rng.uniform(-0.05, 0.05, 3)))
        sights = {
            "at place": dqc.constraints.LineOfSight(place=place, at_most=0.5),
            "at lamp": dqc.constraints.LineOfSight(target="lamp", at_most=0.6, camera=(0.0, 0.05, 0.0)),
        }
        parts = {"zones": zones, "angles": angles, "sights": sights}
        chosen = {
            kind: {name: each for name, each in given.items() if rng.random() < 0.5}
            for kind, given in parts.items()
        }
        found = dqc.constraints.Constraints(**around({"lamp": lamp}), **chosen, **options)  # pyright: ignore
        kept = PreparedConstraints(found, robot, 0.01, "measured")
        if (kept.values(q[None], [0.0])[0] - kept.asked).min() > 0.005:
            return found


def plain_rooms(given, robot, q, time):
    """Return what zones, angles and sights leave beyond what is asked at a configuration, by plain formulas."""
    matrix = dqc.DualQuaternion(robot.fkm(q)).matrix()
    hand, turn = matrix[:3, 3], matrix[:3, :3]
    rooms = {}
    for name, zone in given.zones.items():
        local = dqc.DualQuaternion(zone.pose).matrix()
        place = local[:3, :3].T @ (hand - local[:3, 3])
        if zone.kind == "box":
            rooms[name] = (0.5 * zone.size - abs(place)).min()
        elif zone.kind == "sphere":
            rooms[name] = zone.sphere - np.linalg.norm(place)
        elif zone.kind == "cylinder":
            radius, length = zone.cylinder
            rooms[name] = min(radius - np.linalg.norm(place[:2]), 0.5 * length - abs(place[2]))
        else:
            rooms[name] = place @ zone.plane
        rooms[name] -= zone.margin + zone.radius_of_hand
    for name, angle in given.angles.items():
        opening = opening_of(turn @ angle.axis, angle.direction)
        limits = [(angle.at_most, 1), (angle.at_least, -1), (angle.apart, -1)]
        rooms[name] = min(sign * (limit - opening) for limit, sign in limits if limit is not None)
        if angle.apart is not None:
            rooms[name] = min(rooms[name], np.pi - angle.apart - opening)
    for name, sight in given.sights.items():
        place = sight.place
        if place is None:
            lamp = given.obstacles[sight.target]
            place = lamp.shapes[0].center + time * np.array(lamp.moves.velocity)
        rooms[name] = sight.at_most - opening_of(turn @ sight.axis, place - hand - turn @ sight.camera)
    return rooms


def opening_of(a, b):
    """Return the angle between two vectors."""
    return np.arctan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b))
