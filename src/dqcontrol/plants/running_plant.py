"""A plant at work: what the loop, jogging, ROS 2 and recordings ask of it, and what stands for what it lacks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.plants.channels import Channel

if TYPE_CHECKING:
    from dqcontrol.plants.plant import CompiledPlant

_NOTHING: Array = np.zeros(0)
_NOTHING.flags.writeable = False


class ControllerSettings(NamedTuple):
    """What joint controllers are told beside their targets, as each command of a Meka tells them.

    Attributes
    ----------
    mode
        As in `CompliantPlant`; empty: stays as it is.
    stiffness
        0 … 1, shape (n,); None: stays as it is.
    slew_rate
        Of the reference, mean speed of minimum-jerk motions, rad/s, shape (n,); None: stays as it is.
    asked
        What modes without a position loop take, shape (n,): torques, N·m, or in PWM duties, −1 … 1; None: they stay.
    """

    mode: str = ""
    stiffness: Array | None = None
    slew_rate: Array | None = None
    asked: Array | None = None


class PlantProtocol(Protocol):
    """The least that a plant at work has; ``running_plant`` adds the defaults of `RunningPlant`.

    Attributes
    ----------
    q, measured
        True and measured configuration, shape (n,), rad or m; `step` changes them.
    """

    q: Array
    measured: Array

    def step(self, command: Array) -> None:
        """Apply the inputs, shape (m,), for one period; update ``q`` and ``measured``."""
        ...


class RunningPlant:
    """A plant at work, at one configuration: `q`, ``measured`` and `step`, and as much of the rest as it has.

    Attributes
    ----------
    q, measured
        True and measured configuration, shape (n,), rad or m, updated in place.
    fault
        Why it switched its motors off; empty while all is well. The run then brakes, if it has a supervisor.
    age
        Of the present measurement, s. Report it for a robot on a network, whose measurements come when they come: the
        supervisor stops at old ones. Left at 0, a robot that falls silent is noticed only where its numbers stay the
        same.
    effort
        Measured effort of each input, shape (m,), N·m or N; empty if it measures none.
    wrench
        Measured force and torque that payload and environment exert on the end effector, its axes and about its origin,
        shape (6,), N and N·m; empty if it measures none.
    channels, readings
        What it senses beside these, recorded at every sample: the quantities, and their present values one after the
        other, shape (sum of sizes,), updated in place.
    foreseen
        What it senses and is known before the run: quantities, and their values at each sample.
    periods
        For how many steps its noise was drawn.
    seen
        Where bodies of the world are measured, by name unit dual quaternions (8,), inertial frame, updated in place.
    can_be_pushed
        Whether `push` moves it.

    Examples
    --------
    >>> class Robot(RunningPlant):
    ...     def __init__(self, driver):
    ...         self.driver, self.q, self.measured = driver, driver.joints(), driver.joints()
    ...
    ...     def step(self, command):
    ...         self.driver.send(command)
    ...         self.measured[:] = self.q[:] = self.driver.joints()
    ...         self.age = self.driver.seconds_since_last_message()
    """

    q: Array
    measured: Array
    fault: str = ""
    age: float = 0.0
    effort: Array = _NOTHING
    wrench: Array = _NOTHING
    channels: tuple[Channel, ...] = ()
    readings: Array = _NOTHING
    foreseen: tuple[tuple[Channel, Array], ...] = ()
    periods: float = math.inf
    seen: Mapping[str, Array] = MappingProxyType({})
    can_be_pushed: bool = False

    def step(self, command: Array) -> None:
        """Move for one control period; what it measures is updated in place.

        Parameters
        ----------
        command
            The inputs u, shape (m,): velocities of joints, and v and ω of drives, rad/s or m/s.

        Raises
        ------
        ShapeError, ValueRangeError
            If the command has the wrong shape or is not finite, or the plant was started for fewer periods.
        DivergedError
            If the plant's state became NaN or infinite, or the command larger than its simulator takes.
        FallenError
            If the robot has fallen over.
        """
        raise NotImplementedError

    def rewind(self) -> None:
        """Use the drawn noise again from its start, for a plant that runs longer than it was started for."""

    def set_joint_control(self, control: ControllerSettings) -> None:
        """Tell joint controllers their mode, stiffness and slew rate; a plant without such takes no notice."""

    def push(self, row: int, point: Array, force: Array) -> None:
        """Push a link from the next step on, until told otherwise; a plant without physics takes no notice.

        Parameters
        ----------
        row
            Of `Robot.frames`: what the link moves with.
        point, force
            Where and how, shape (3,) each, inertial frame, m and N.
        """

    def compiled(self) -> CompiledPlant | None:
        """Return it as the compiled loop takes it; None if its step is not one compiled function."""
        return None


def _of_plant(name: str) -> Any:
    """Return a property: the plant's own attribute, or the default of `RunningPlant`."""
    default = getattr(RunningPlant, name, None)
    return property(lambda self: getattr(self._plant, name, default))


class _CompletedPlant(RunningPlant):
    """A user's plant with the defaults for what it has not; what it has may also come later."""

    q, measured = _of_plant("q"), _of_plant("measured")
    fault, age, effort, wrench = (_of_plant(name) for name in ("fault", "age", "effort", "wrench"))
    channels, readings, foreseen = (_of_plant(name) for name in ("channels", "readings", "foreseen"))
    seen = _of_plant("seen")

    def __init__(self, plant: PlantProtocol) -> None:
        self._plant = plant

    def step(self, command: Array) -> None:
        """Step the plant."""
        self._plant.step(command)


def running_plant(plant: PlantProtocol) -> RunningPlant:
    """Return a plant with defaults for what it has not; one derived from `RunningPlant` as it is.

    Examples
    --------
    >>> class Robot:
    ...     q = measured = np.zeros(7)
    ...     def step(self, command): ...
    >>> running_plant(Robot()).fault, running_plant(Robot()).age
    ('', 0.0)
    """
    return plant if isinstance(plant, RunningPlant) else _CompletedPlant(plant)
