"""A user's own plant."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import NOT_FINITE, OK, RAISED, InterpretedKernel, Kernel, compile_own
from dqcontrol.errors import DivergedError, as_array, as_count, as_positive
from dqcontrol.extensions.user_code import function_at, numbers_in
from dqcontrol.plants.linear_model import LinearModel, smooth_slopes
from dqcontrol.plants.plant import PLANT, CompiledPlant, Plant, start_configuration
from dqcontrol.robots.robot import Robot

_PERIODS = 200  # in which a plant without a command comes to rest
_HORIZON = 10.0  # s in which what matters of its state is seen


def _checked(function: Callable[..., Any]) -> Callable[..., int]:
    def own_plant(command, parameters, noise, state, q, measured):
        function(command, parameters, noise, state, q, measured)
        for i in range(q.shape[0]):
            if not math.isfinite(q[i]) or not math.isfinite(measured[i]):
                return NOT_FINITE
        return OK

    return own_plant


def _guarded(checked: Callable[..., int]) -> Callable[..., int]:
    def guarded(command, parameters, noise, state, q, measured):
        try:
            return checked(command, parameters, noise, state, q, measured)
        except Exception:
            return RAISED

    return guarded


@lru_cache(maxsize=64)
def _kernel(function: Callable[..., Any], *, of_spec: bool) -> Kernel | InterpretedKernel:
    return compile_own(function, _checked, _guarded, PLANT, of_spec=of_spec)


class OwnPlant(Plant, frozen=True, kw_only=True, tag="own"):
    """A plant written in plain Python; compiled if it can be, else interpreted, which a warning says.

    Parameters
    ----------
    function
        The function, or its place as ``FILE.py:NAME`` or ``MODULE:NAME``. Called as
        ``function(command, parameters, noise, state, q, measured)`` once a period, it updates the true configuration
        ``q`` (n) and the ``measured`` one in place. ``parameters`` are the period T in s, then those below; ``noise``
        are standard normal numbers from the run's seed.
    parameters
        Numbers handed to the function after T, in their order; names are for specs, grids and sweeps.
    state
        Numbers kept from step to step, as they are at the start.
    noise
        How many random numbers a step needs.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> def sticky(command, parameters, noise, state, q, measured):
    ...     for i in range(q.shape[0]):
    ...         if abs(command[i]) > parameters[1]:
    ...             q[i] += parameters[0] * command[i]
    ...         measured[i] = q[i]
    >>> plant = dqc.plants.OwnPlant(function=sticky, parameters=[0.5])
    >>> live = plant.start(dqc.load_robot("iiwa7"), np.zeros(7), period=0.1, steps=2, seed=0)
    >>> live.step(np.array([1.0, 0.1, 0, 0, 0, 0, 0]))
    >>> live.q[:2].tolist()
    [0.1, 0.0]
    """

    function: Any
    parameters: list[float] | dict[str, float] = []
    state: list[float] = []
    noise: int = 0

    def start(self, robot: Robot, start: Array, period: float, steps: int, seed: int) -> CompiledPlant:
        """Return the plant at start.

        Raises
        ------
        Error
            If an argument or a parameter does not fit.
        """
        start, period = start_configuration(robot, start), as_positive("period", period)
        parameters = np.array([period, *as_array("parameters", numbers_in(self.parameters), (None,))])
        state = as_array("state", self.state if len(self.state) else [0.0], (None,))
        noise = np.random.default_rng(seed).standard_normal((steps, max(as_count("noise", self.noise), 1)))
        kernel = _kernel(function_at("function", self.function), of_spec=isinstance(self.function, str))
        return CompiledPlant(kernel, parameters, state, start, noise)

    def linear_model(self, robot: Robot, start: Array, period: float) -> LinearModel | None:
        """Return all joints together, by finite differences without noise, as the plant rests at no command.

        None of robots with drives, of plants that jump or bend there, and of those whose joints do not move.
        """
        if len(robot.drives):
            return None
        live, n = self.start(robot, start, period, 1, 0), robot.configuration_size
        quiet, sizes = np.zeros_like(live.noise[0]), [n, 2 * n]
        rest = np.concatenate([live.measured, live.q, live.state])

        def step(change: Array) -> Array:
            measured, q, state = (part.copy() for part in np.split(rest + change[: rest.size], sizes))
            try:
                failed = live.kernel(change[rest.size :], live.parameters, quiet, state, q, measured)
            except DivergedError:  # one that is not compiled says so itself
                failed = RAISED
            return np.full_like(rest, np.nan) if failed else np.concatenate([measured, q, state])

        for _ in range(_PERIODS):
            rest = step(np.zeros(rest.size + robot.input_size))
        slopes = smooth_slopes(step, np.append(np.maximum(1.0, np.abs(rest)), np.ones(robot.input_size)))
        if slopes is None or not np.isfinite(slopes).all():
            return None
        return LinearModel(slopes[:, : rest.size], slopes[:, rest.size :]).reduced(round(_HORIZON / period))
