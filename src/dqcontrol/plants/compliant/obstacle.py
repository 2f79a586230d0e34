"""Padded balls in the way of the hand: a person, a cushion, a wall seen from near."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np
from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import inline
from dqcontrol.errors import ValueRangeError
from dqcontrol.named_fields import NamedFields
from dqcontrol.plants.compliant.elastic_model import MOST_STEPS, TICK
from dqcontrol.plants.compliant.loads_and_faults import Seconds, span
from dqcontrol.plants.mujoco.mujoco_model import import_mujoco
from dqcontrol.robots.kinematics.kinematics_kernels import compose_fixed, half_sine_cosine, move_joint, z_axis

Metres = Annotated[float, Meta(ge=-1e3, le=1e3, description="m, base frame")]
Speed = Annotated[float, Meta(ge=-100, le=100, description="m/s, base frame")]

# A row of the table: when it is there, its size, pad, the body that it pushes, its centre (3) and velocity (3).
FROM, UNTIL, RADIUS, STIFFNESS, DAMPING, BODY, CENTER, VELOCITY = 0, 1, 2, 3, 4, 5, 6, 9
COLUMNS = 12


class Obstacle(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A padded ball that stands or moves in the hand's way for a while; nothing moves it.

    While the tool's point is deeper than 0 in the ball, the pad pushes it out along the line from the ball's centre,
    without friction: F = max(0, k δ + d δ̇), δ the depth.

    Parameters
    ----------
    position
        Of its centre when it appears, m, base frame.
    radius
        Of ball and hand together, m.
    stiffness, damping
        k in N/m and d in N·s/m of the pad. ISO/TS 15066 has 10 kN/m for a belly, 30 kN/m for an upper arm, 75 kN/m for
        a hand.
    velocity
        m/s, base frame.
    begin, until
        s; in a file, ``from`` and ``until``. For ever if ``until`` is omitted.
    """

    spec_key: ClassVar[str] = "plant.obstacles"
    position: tuple[Metres, Metres, Metres]
    radius: Annotated[float, Meta(gt=0, le=100, description="m")]
    stiffness: Annotated[float, Meta(gt=0, le=1e7, description="N/m")]
    damping: Annotated[float, Meta(ge=0, le=1e6, description="N·s/m")] = 0.0
    velocity: tuple[Speed, Speed, Speed] = (0.0, 0.0, 0.0)
    begin: Seconds = msgspec.field(default=0.0, name="from")
    until: Seconds | None = None

    def centers(self, times: Array) -> Array:
        """Return its centre at times (N,), s: shape (N, 3), m, base frame; NaN while it is not there."""
        there = (times >= self.begin) & (times < (math.inf if self.until is None else self.until))
        moved = np.array(self.position) + (times - self.begin)[:, None] * np.array(self.velocity)
        return np.where(there[:, None], moved, np.nan)


def obstacle_table(obstacles: list[Obstacle], body: int) -> Array:
    """Return a row an obstacle, shape (N, COLUMNS), for the body that they push; or name what does not fit."""
    rows = np.zeros((len(obstacles), COLUMNS))
    for row, obstacle in zip(rows, obstacles, strict=True):
        row[FROM], row[UNTIL] = span("plant.obstacles", obstacle.begin, obstacle.until)
        row[RADIUS] = obstacle.radius
        row[STIFFNESS] = obstacle.stiffness
        row[DAMPING] = obstacle.damping
        row[BODY] = body
        row[CENTER : CENTER + 3] = obstacle.position
        row[VELOCITY : VELOCITY + 3] = obstacle.velocity
    return rows


def steps_per_touch(obstacles: list[Obstacle], model: Any, data: Any, joints: int) -> int:
    """Return how many time steps a tick of 1 ms needs for the pads, whose forces are held over a step h.

    A mass m in a pad is stable where h² k / m + 2 h d / m < 4; a quarter of it is allowed, for the hand's mass in its
    lightest direction.

    Parameters
    ----------
    model, data
        MuJoCo's, of `elastic_model`, at the start configuration.
    joints
        How many the arm has.

    Raises
    ------
    ValueRangeError
        If a pad is too hard for what it hits.
    """
    if not obstacles:
        return 1
    mujoco = import_mujoco()
    jacobian, solved = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jacBody(model, data, jacobian, None, model.body("contact").id)
    mujoco.mj_solveM(model, data, solved, jacobian)
    mass = 1 / float(np.linalg.eigvalsh(jacobian[:, :joints] @ solved[:, :joints].T)[-1])
    most = 1
    for obstacle in obstacles:
        damping, stiffness = obstacle.damping / mass, obstacle.stiffness / mass
        steps = math.ceil(
            TICK * (damping + math.sqrt(damping**2 + stiffness))
        )  # the root of h² k + 2 h d = m
        if steps > MOST_STEPS:
            raise ValueRangeError(
                f"plant.obstacles: {obstacle.stiffness:g} N/m with a damping of {obstacle.damping:g} N·s/m is too hard "
                f"for what it hits, {mass:.2g} kg in its lightest direction: it would need {steps} steps a "
                f"millisecond, {MOST_STEPS} at most are made"
            )
        most = max(most, steps)
    return most


@inline
def hand_motion(chain, q, velocity):
    """Return position and velocity of the tool's point (3 + 3); joints may be more than the chain has."""
    w, x, y, z, px, py, pz = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    ox, oy, oz, vx, vy, vz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0  # twist of what has passed, about the base's origin
    n = chain.shape[0] - 1
    for i in range(n):
        w, x, y, z, px, py, pz = compose_fixed(w, x, y, z, px, py, pz, chain[i])
        zx, zy, zz = z_axis(w, x, y, z)
        ox, oy, oz = ox + velocity[i] * zx, oy + velocity[i] * zy, oz + velocity[i] * zz
        vx += velocity[i] * (py * zz - pz * zy)
        vy += velocity[i] * (pz * zx - px * zz)
        vz += velocity[i] * (px * zy - py * zx)
        sine, cosine = half_sine_cosine(q[i])
        w, x, y, z, px, py, pz = move_joint(
            w, x, y, z, px, py, pz, zx, zy, zz, chain[i, 7], q[i], sine, cosine
        )
    w, x, y, z, px, py, pz = compose_fixed(w, x, y, z, px, py, pz, chain[n])
    return px, py, pz, vx + oy * pz - oz * py, vy + oz * px - ox * pz, vz + ox * py - oy * px


@inline
def touch(obstacles, time, chain, q, velocity, forces, largest):
    """Set the force of the pads on the hand at a time; keep the largest yet, its norm last, in ``largest`` (4)."""
    px, py, pz, vx, vy, vz = hand_motion(chain, q, velocity)
    fx, fy, fz = 0.0, 0.0, 0.0
    for k in range(obstacles.shape[0]):
        row = obstacles[k]
        if row[FROM] <= time < row[UNTIL]:
            passed = time - row[FROM]
            nx = px - row[CENTER] - passed * row[VELOCITY]
            ny = py - row[CENTER + 1] - passed * row[VELOCITY + 1]
            nz = pz - row[CENTER + 2] - passed * row[VELOCITY + 2]
            distance = math.sqrt(nx * nx + ny * ny + nz * nz)
            if 0.0 < distance < row[RADIUS]:
                nx, ny, nz = nx / distance, ny / distance, nz / distance
                leaving = (
                    nx * (vx - row[VELOCITY]) + ny * (vy - row[VELOCITY + 1]) + nz * (vz - row[VELOCITY + 2])
                )
                force = max(0.0, row[STIFFNESS] * (row[RADIUS] - distance) - row[DAMPING] * leaving)
                fx, fy, fz = fx + force * nx, fy + force * ny, fz + force * nz
    body = int(obstacles[0, BODY])
    forces[body, 0], forces[body, 1], forces[body, 2] = fx, fy, fz
    norm = math.sqrt(fx * fx + fy * fy + fz * fz)
    if norm > largest[3]:
        largest[0], largest[1], largest[2], largest[3] = fx, fy, fz, norm
