"""Peers of the constrained law on the same robot, shapes and pairs: Mink, and NEO with signs that are right."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.geometry import Box, Capsule, Plane, Shape, Sphere, distance_kernels as geometry
from dqcontrol.plants.mujoco.mujoco_model import skeleton

PERIOD = 0.01  # s
GAIN, RATE = 2.0, 10.0  # 1/s: of the hand's error, and of distances
KEPT, SEEN = 0.01, 0.3  # m: distance to keep, and from where rows are made
BALL = 0.06  # m
AS_SHIPPED = 0.85  # gain of Mink's collision limit

Step = Callable[[np.ndarray], np.ndarray]


def correct(period: float) -> float:
    """Return the gain of Mink's collision limit that bounds the speed of approach by RATE times what is left."""
    return RATE * period**2


def by_mink(
    arm: dqc.Robot,
    given: dqc.constraints.Constraints,
    goal: np.ndarray,
    approach: float,
    gain: float = GAIN,
    period: float = PERIOD,
) -> Step:
    """Return what gives Mink's joint speeds towards a pose, among the same shapes and pairs, obstacles standing still.

    Mink leaves out pairs of what stands still and of the first link, whose body is a child of the world's.
    """
    import mink

    assert arm.shapes is not None
    spec = skeleton(arm)
    for each in arm.shapes.shapes:
        body = spec.body(f"link_{each.frame}") if each.frame else spec.worldbody
        add_geom(body, each.name, each.shape)
    for name, obstacle in given.obstacles.items():
        add_geom(spec.worldbody, name, obstacle.shapes[0])
    model = spec.compile()
    names = arm.shapes.names
    pairs = [([names[a]], [names[b]]) for a, b in arm.shapes.pairs]
    links = [each.name for each in arm.shapes.shapes if each.frame > 1]
    kept_from: dict[tuple[str, ...], list[str]] = {}
    for name, obstacle in given.obstacles.items():
        kept_from.setdefault(tuple(obstacle.clear.links or links), []).append(name)
    pairs += [(list(chosen), obstacles) for chosen, obstacles in kept_from.items()]
    configuration = mink.Configuration(model)
    task = mink.FrameTask("hand", "site", position_cost=1.0, orientation_cost=1.0, gain=gain * period)
    task.set_target(mink.SE3.from_matrix(np.asarray(dqc.DualQuaternion(goal).matrix())))
    speeds = dict(zip(arm.joint_names, arm.limits.velocity, strict=True))
    limits = [
        mink.ConfigurationLimit(model),
        mink.VelocityLimit(model, speeds),
        mink.CollisionAvoidanceLimit(
            model,
            pairs,
            gain=approach,
            minimum_distance_from_collisions=given.margin,
            collision_detection_distance=SEEN,
        ),
    ]

    def step(q: np.ndarray) -> np.ndarray:
        configuration.update(q)
        try:
            return mink.solve_ik(configuration, [task], period, solver="daqp", damping=1e-6, limits=limits)
        except mink.NoSolutionFound:
            return np.zeros(len(q))

    return step


def add_geom(body: Any, name: str, shape: Shape) -> None:
    """Give a body of MuJoCo a shape."""
    import mujoco

    kinds = mujoco.mjtGeom
    match shape:
        case Capsule():
            geom = body.add_geom(name=name, type=kinds.mjGEOM_CAPSULE, size=[shape.radius, 0, 0])
            geom.fromto = [*shape.start, *shape.end]
        case Sphere():
            body.add_geom(name=name, type=kinds.mjGEOM_SPHERE, size=[shape.radius, 0, 0], pos=shape.center)
        case Box():
            place = dqc.DualQuaternion(shape.pose)
            geom = body.add_geom(name=name, type=kinds.mjGEOM_BOX, size=0.5 * shape.size)
            geom.pos, geom.quat = place.translation, algebra.rotation(shape.pose)
        case Plane():
            geom = body.add_geom(name=name, type=kinds.mjGEOM_PLANE, size=[0, 0, 0.01])
            geom.pos, geom.alt.zaxis = shape.offset * shape.normal, shape.normal
        case _:
            raise TypeError(f"{name}: {type(shape).__name__} is no shape that Mink is compared with")


def driven(step: Step, start: np.ndarray, period: float, periods: int) -> np.ndarray:
    """Return the configurations that speeds drive through, shape (N + 1, n), rad."""
    path = np.empty((periods + 1, len(start)))
    path[0] = start
    for k in range(periods):
        path[k + 1] = path[k] + period * step(path[k])
    return path


class Neo:
    """NEO's quadratic program among balls: speeds and slack of the hand, limits of joints and distances as dampers."""

    def __init__(self, arm: dqc.Robot, balls: np.ndarray, goal: np.ndarray) -> None:
        assert arm.shapes is not None
        self._arm, self._goal = arm, np.asarray(dqc.DualQuaternion(goal).matrix())
        shapes = arm.shapes.shapes
        self._rows = np.array([each.shape.row for each in shapes])
        self._frames = np.array([each.frame for each in shapes])
        self._solids = np.array([Sphere(ball, BALL).row for ball in balls])
        links = [i for i, each in enumerate(shapes) if each.frame > 1]
        pairs = [(i, len(shapes) + k) for i in links for k in range(len(balls))] + list(arm.shapes.pairs)
        self._first, self._second = np.array(pairs).T
        joints = np.arange(1, arm.configuration_size + 1)
        carriers = np.concatenate([self._frames, np.zeros(len(balls), int)])
        moves = (joints <= carriers[:, None]).astype(float)
        self._moves = moves[self._first] - moves[self._second]  # which joints move one of a pair
        self._found = np.empty((len(pairs), geometry.FOUND))

    def rows(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return all distances, shape (m,), and their derivatives by the joints, shape (m, n)."""
        frames = self._arm.frames(q)
        places = np.concatenate([np.eye(4)[None], algebra.matrix_from_pose(frames[:-1])])
        carriers = places[self._frames]
        moved = self._rows.copy()
        moved[:, 2:5] = np.einsum("mij,mj->mi", carriers[:, :3, :3], self._rows[:, 2:5]) + carriers[:, :3, 3]
        moved[:, 5:8] = np.einsum("mij,mj->mi", carriers[:, :3, :3], self._rows[:, 5:8])
        everything = np.vstack([moved, self._solids])
        first, second = everything[self._first], everything[self._second]
        geometry.distances(first, second, self._found)
        axes, origins = places[1:, :3, 2], places[1:, :3, 3]
        normal = self._found[:, geometry.DIRECTION : geometry.DIRECTION + 3]
        at = self._found[:, geometry.ON_A : geometry.ON_A + 3]
        lever = np.cross(axes[None], at[:, None] - origins[None])
        rate = np.einsum("mnk,mk->mn", lever, normal)
        return self._found[:, geometry.DISTANCE].copy(), rate * self._moves

    def step(self, q: np.ndarray) -> np.ndarray:
        """Return the joints' speeds."""
        import daqp

        arm, n = self._arm, len(q)
        frames = arm.frames(q)
        places = algebra.matrix_from_pose(frames)
        hand, axes, origins = places[-1], places[:-1, :3, 2], places[:-1, :3, 3]
        jacobian = np.vstack([np.cross(axes, hand[:3, 3] - origins).T, axes.T])
        error = np.concatenate(
            [self._goal[:3, 3] - hand[:3, 3], rotation_vector(self._goal[:3, :3] @ hand[:3, :3].T)]
        )
        away = max(float(np.abs(error).sum()), 1e-3)
        hessian = np.diag(np.concatenate([np.full(n, 0.01), np.full(6, 1.0 / away)]))
        gradient = np.concatenate([-manipulability_gradient(axes, origins, jacobian), np.zeros(6)])
        distances, rates = self.rows(q)
        near = distances < SEEN
        lower, upper = arm.limits.lower, arm.limits.upper
        most = np.minimum(arm.limits.velocity, np.maximum(upper - q - 0.05, 0) / (0.9 - 0.05) * RATE)
        least = np.maximum(-arm.limits.velocity, np.minimum(lower - q + 0.05, 0) / (0.9 - 0.05) * RATE)
        task = np.hstack([jacobian, np.eye(6)])
        kept = np.hstack([-rates[near], np.zeros((int(near.sum()), 6))])
        bound = RATE * (distances[near] - KEPT)
        high = np.concatenate([most, np.full(6, 1e2), GAIN * error, bound])
        low = np.concatenate([least, np.full(6, -1e2), GAIN * error, np.full(len(bound), -1e30)])
        sense = np.zeros(len(high), np.int32)
        sense[n + 6 : n + 12] = 5  # equalities
        x, _, flag, _ = daqp.solve(
            hessian, gradient, np.ascontiguousarray(np.vstack([task, kept])), high, low, sense
        )
        return x[:n] if flag > 0 else np.zeros(n)


def rotation_vector(turn: np.ndarray) -> np.ndarray:
    """Return axis times angle of a rotation matrix, by its quaternion."""
    r = algebra.rotation_from_matrix(turn)
    r = r if r[0] >= 0 else -r
    sine = float(np.linalg.norm(r[1:4]))
    return r[1:4] * (2 * np.arctan2(sine, r[0]) / sine if sine > 1e-12 else 2.0)


def manipulability_gradient(axes: np.ndarray, origins: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """Return the derivative of √det(J Jᵀ) by the joints, from that of J: m tr(J⁺ ∂J/∂q)."""
    n = len(axes)
    square = jacobian @ jacobian.T
    size = float(np.sqrt(max(np.linalg.det(square), 0.0)))
    inverse = jacobian.T @ np.linalg.inv(square + 1e-12 * np.eye(6))
    joints = np.arange(n)
    first, last = np.minimum.outer(joints, joints), np.maximum.outer(joints, joints)
    change = np.zeros((n, 6, n))  # of the Jacobian by joint k
    change[:, :3] = np.cross(axes[first], jacobian[:3].T[last]).transpose(0, 2, 1)
    after = (joints[:, None] < joints)[..., None]
    change[:, 3:] = (after * np.cross(axes[:, None], axes[None])).transpose(0, 2, 1)
    return size * np.einsum("ji,kij->k", inverse, change)


def check_neo(arm: dqc.Robot) -> None:
    """Compare the rows with finite differences, that nobody says NEO lost by a wrong sign."""
    rng = np.random.default_rng(8)
    worst = 0.0
    for _ in range(20):
        balls = rng.uniform([-0.1, -0.7, 0.2], [0.8, 0.7, 1.0], (3, 3))
        neo, q = Neo(arm, balls, arm.fkm(np.zeros(7))), rng.uniform(-1.5, 1.5, 7)
        _, rates = neo.rows(q)
        for k in range(7):
            move = np.eye(7)[k] * 1e-6
            change = (neo.rows(q + move)[0] - neo.rows(q - move)[0]) / 2e-6
            worst = max(worst, float(np.median(np.abs(change - rates[:, k]))))
    if worst > 1e-6:
        raise SystemExit(f"NEO: its rows differ from finite differences by {worst:.2g}")
