"""Constraints of a run, as quantities over time."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.controller.controller import Controller
from dqcontrol.loop.signals import Signal
from dqcontrol.world.body import INSTANT

DISTANCE, ROOM = "constraint_distance", "constraint_room"
PRESSURE, SLACK, EFFECT = "constraint_pressure", "constraint_slack", "constraint_effect"

# of `EFFECT`: rows and ends of joints' ranges that pressed, programs solved, share of the command left by scaling,
# excess of a limit of acceleration as a share of it, and speed of the end effector as the law asked and as it left
_PARTS = ("rows", "programs", "scaled", "acceleration_excess", "speed_asked", "speed")
_UNITS = ("", "", "", "", "m/s", "m/s")

_OUT_OF_THE_WAY = 1e5  # m: no distance of what is there
HELD_WINDOW = 0.4  # s: for so long an end effector is held before that counts, as for `Constraints.escape`
_STUCK = 0.1  # share of the speed that the law asks for
_ASKED = 1e-3  # m/s: less is no wish


def is_held(effect: Array) -> NDArray[np.bool_]:
    """Return from reports (…, 6 and more) whether constraints hold the end effector: below a tenth of what is asked."""
    asked, speed = effect[..., 4], effect[..., 5]
    return (asked > _ASKED) & (speed < _STUCK * asked) & (effect[..., 0] > 0)


def constraint_signals(law: Controller, q: Array, times: Array, reports: Array | None) -> dict[str, Signal]:
    """Return distances and the room beyond what was asked by name, how hard rows pressed and gave way, and the effect.

    Parameters
    ----------
    law
        That commanded.
    q, times
        True configurations, shape (N, n), and when they were.
    reports
        Of the constraints, shape (N, size).

    Returns
    -------
    dict
        Empty without constraints. Distances in m, angles' room in rad; both are computed of the true configurations.
    """
    kept = law.constraints
    if kept is None or reports is None or not kept.names:
        return {}
    finite = np.isfinite(q).all(axis=1)
    values = np.full((len(q), len(kept.labels)), np.nan)
    values[finite] = kept.values(q[finite], times[finite])
    values[values > _OUT_OF_THE_WAY] = np.inf  # what is in no hand, or still or already is
    names, count = kept.names, len(kept.names)
    distance, room = np.full((len(q), count), np.inf), np.full((len(q), count), np.inf)
    units = ["m"] * count
    for i, owner in enumerate(kept.owners):
        distance[:, owner] = np.minimum(distance[:, owner], values[:, i])
        room[:, owner] = np.minimum(room[:, owner], values[:, i] - kept.asked[i])
        units[owner] = "rad" if kept.is_angle[i] else "m"
    rates = tuple(f"{unit}/s" for unit in units)
    numbers = kept.report - 3 * count
    pressure, slack = (reports[:, numbers + k * count : numbers + (k + 1) * count] for k in (1, 2))
    return {
        DISTANCE: Signal(DISTANCE, names, tuple(units), distance),
        ROOM: Signal(ROOM, names, tuple(units), room),
        PRESSURE: Signal(PRESSURE, names, ("",) * count, pressure),
        SLACK: Signal(SLACK, names, rates, slack),
        EFFECT: Signal(EFFECT, _PARTS, _UNITS, reports[:, :numbers]),
    }


def held_signals(law: Controller, q: Array, times: Array, known: Collection[str]) -> dict[str, Signal]:
    """Return where bodies were that hands held, as far as physics does not say it: positions and quaternions.

    Parameters
    ----------
    law, q, times
        As of `constraint_signals`.
    known
        Names of what is recorded already.
    """
    found: dict[str, Signal] = {}
    kept = law.constraints
    for name in kept.given.held if kept is not None else ():
        place, turn = f"{name}_position", f"{name}_quaternion"
        if kept is None or place in known:
            continue
        poses = held_poses(kept, name, q, times)
        found[place] = Signal(place, ("x", "y", "z"), ("m",) * 3, algebra.translation(poses))
        found[turn] = Signal(turn, ("w", "x", "y", "z"), ("",) * 4, algebra.rotation(poses))
    return found


def held_poses(kept: PreparedConstraints, name: str, q: Array, times: Array) -> Array:
    """Return where a body is that a hand holds for a part of a run, at configurations (N, n) and times (N,): (N, 8).

    It stays where it is let go if nothing says where it is put.
    """
    assert kept.given.world is not None
    body, held = kept.given.world.bodies[name], kept.given.held[name].held
    frame, hand = kept.hand_that_holds(name)
    carried = algebra.multiply(hand, held.grasp)
    if frame:
        carried = algebra.multiply(kept.robot.frames(q)[:, frame - 1], carried)
    poses = np.array(np.broadcast_to(carried, (len(times), 8)))
    poses[times < held.since - INSTANT] = body.pose
    after = np.flatnonzero(times >= held.ends - INSTANT)
    if len(after):
        poses[after] = poses[after[0]] if body.put_down is None else body.put_down.pose
    return poses
