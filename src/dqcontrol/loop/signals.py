"""Quantities over time, and the collection of what a plant senses."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.controller.controller import Controller
from dqcontrol.plants.plant import RunningPlant
from dqcontrol.robots.robot import Robot
from dqcontrol.world.body import INSTANT

ACTUATORS = "actuator_command"
TASK = "task."  # before the names of further tasks


class Signal(NamedTuple):
    """One quantity over time.

    Attributes
    ----------
    name
        Of the quantity.
    parts
        Names of its columns; empty for a single number.
    units
        One for each column; empty where there is none.
    values
        Shape (N, number of columns).
    """

    name: str
    parts: tuple[str, ...]
    units: tuple[str, ...]
    values: NDArray[np.float64]

    def headings(self) -> list[str]:
        """Return the columns' names with their units."""
        prefix = "" if self.name == "q" else f"{self.name}."
        names = [prefix + part for part in self.parts] or [self.name]
        return [f"{name} [{unit}]" if unit else name for name, unit in zip(names, self.units, strict=True)]


class Readings:
    """Collects what a plant senses, if it does, at each of a number of samples."""

    def __init__(self, plant: RunningPlant, count: int) -> None:
        self._plant = plant
        self.rows: NDArray[np.float64] = np.empty((count, len(plant.readings)))

    def take(self, k: int) -> None:
        """Keep the present values as those of sample k."""
        self.rows[k] = self._plant.readings

    def signals(self, count: int) -> dict[str, Signal]:
        """Return the first samples of all quantities by name."""
        found = [(channel, _first(values, count)) for channel, values in self._plant.foreseen]
        first = 0
        for channel in self._plant.channels:
            found.append((channel, self.rows[:count, first : first + channel.size]))
            first += channel.size
        return {
            each.name: Signal(each.name, each.parts, (each.unit,) * each.size, rows) for each, rows in found
        }


def _first(values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return the first rows; beyond them the last one is repeated."""
    return values[np.minimum(np.arange(count), len(values) - 1)] if count > len(values) else values[:count]


def actuator_command(robot: Robot, q: NDArray[np.float64], command: NDArray[np.float64]) -> dict[str, Signal]:
    """Return u_f by its name, if the robot has differential drives: its command as wheel and joint speeds. [S17 4.27]

    Parameters
    ----------
    robot
        Of whom the command is.
    q, command
        Configurations and inputs, shapes (N, n) and (N, m); u_f is NaN where one is not finite.
    """
    if not len(robot.drives):
        return {}
    from dqcontrol.robots.whole_body import WholeBody  # what has drives has imported it

    if not isinstance(robot, WholeBody):
        return {}
    driven = robot.in_form("constrained")
    finite = np.isfinite(q).all(axis=1) & np.isfinite(command).all(axis=1)
    values = np.full((len(q), driven.input_size), np.nan)
    inputs = command[finite]
    if robot.form == "unconstrained":
        inputs = robot.feasible_inputs(q[finite], inputs)
    values[finite] = driven.wheel_speeds(inputs)
    parts = list(driven.input_names)
    units = ["m/s" if kind == "prismatic" else "rad/s" for kind in driven.input_types]
    for k, (first, *_) in enumerate(driven.drives):
        j = int(first) - k
        prefix = parts[j].removesuffix("v")
        parts[j], parts[j + 1] = f"{prefix}right_wheel", f"{prefix}left_wheel"
        units[j] = units[j + 1] = "rad/s"
    return {ACTUATORS: Signal(ACTUATORS, tuple(parts), tuple(units), values)}


def task_errors(law: Controller, q: NDArray[np.float64]) -> dict[str, Signal]:
    """Return how far the robot is from each further task at configurations (N, n), by its name; NaN where q is."""
    if law.tasks is None:
        return {}
    finite = np.asarray(np.isfinite(q).all(axis=1))
    found = law.tasks.errors(np.where(finite[:, None], q, 0.0))
    signals = {}
    for label, values in found.items():
        values[~finite] = np.nan
        name = TASK + label.replace(" ", "_")
        signals[name] = Signal(name, ("position_error", "orientation_error"), ("m", "rad"), values)
    return signals


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
