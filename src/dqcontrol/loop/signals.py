"""Quantities over time, and the collection of what a plant senses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol.controller.controller import Controller
from dqcontrol.plants.plant import RunningPlant
from dqcontrol.robots.robot import Robot

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
