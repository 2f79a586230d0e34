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
            "room": dqc.laws.BoxZone(
                position=near, size=tuple(rng.uniform(0.15, 0.5, 3)), rpy=tuple(rng.uniform(-1, 1, 3))
            ),
            "globe": dqc.laws.SphereZone(center=near, radius=rng.uniform(0.08, 0.3), radius_of_hand=0.01),
            "tube": dqc.laws.CylinderZone(
                point=near, direction=random_turn(rng), radius=rng.uniform(0.08, 0.3)
            ),
            "floor": dqc.laws.PlaneZone(normal=(0, 0, 1), offset=middle[2] - 0.1, margin=0.02),
        }
        away = np.cross(axis, random_turn(rng))
        away /= np.linalg.norm(away)
        angles = {
            "cone": dqc.laws.Angle(direction=tuple(axis + 0.2 * away), at_most=rng.uniform(0.25, 1.0)),
            "out of": dqc.laws.Angle(direction=tuple(axis + 0.5 * away), at_least=rng.uniform(0.05, 0.4)),
            "lines": dqc.laws.Angle(direction=tuple(away), apart=rng.uniform(0.2, 1.0)),
        }
        place = tuple(middle + axis * rng.uniform(0.3, 0.8))
        lamp = dqc.laws.SphereObstacle(
            center=place, radius=0.02, links=["hand"], velocity=tuple(rng.uniform(-0.05, 0.05, 3))
        )
        sights = {
            "at place": dqc.laws.LineOfSight(place=place, at_most=0.5),
            "at lamp": dqc.laws.LineOfSight(target="lamp", at_most=0.6, camera=(0.0, 0.05, 0.0)),
        }
        parts = {"zones": zones, "angles": angles, "sights": sights}
        chosen = {
            kind: {name: each for name, each in given.items() if rng.random() < 0.5}
            for kind, given in parts.items()
        }
        found = dqc.laws.Constraints(obstacles={"lamp": lamp}, **chosen, **options)  # pyright: ignore
        kept = PreparedConstraints(found, robot, 0.01, "measured")
        if (kept.values(q[None], [0.0])[0] - kept.asked).min() > 0.005:
            return found


def plain_rooms(given, robot, q, time):
    """Return what zones, angles and sights leave beyond what is asked at a configuration, by plain formulas."""
    matrix = dqc.DualQuaternion(robot.fkm(q)).matrix()
    hand, turn = matrix[:3, 3], matrix[:3, :3]
    rooms = {}
    for name, zone in given.zones.items():
        if isinstance(zone, dqc.laws.BoxZone):
            box = dqc.DualQuaternion(zone_box(zone)).matrix()
            rooms[name] = (0.5 * np.array(zone.size) - abs(box[:3, :3].T @ (hand - box[:3, 3]))).min()
        elif isinstance(zone, dqc.laws.SphereZone):
            rooms[name] = zone.radius - np.linalg.norm(hand - zone.center)
        elif isinstance(zone, dqc.laws.CylinderZone):
            rooms[name] = zone.radius - np.linalg.norm(np.cross(hand - zone.point, zone.direction))
        else:
            rooms[name] = hand @ zone.normal - zone.offset
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
            place = np.array(lamp.center) + time * np.array(lamp.velocity)
        rooms[name] = sight.at_most - opening_of(turn @ sight.axis, place - hand - turn @ sight.camera)
    return rooms


def zone_box(zone):
    """Return the pose of a box zone."""
    return dqc.DualQuaternion.from_translation(zone.position) * dqc.DualQuaternion.from_rpy(zone.rpy)


def opening_of(a, b):
    """Return the angle between two vectors."""
    return np.arctan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b))
