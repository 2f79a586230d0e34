"""A user's own law."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from dqcontrol.compiled.compile import NOT_FINITE, OK, RAISED, InterpretedKernel, Kernel, compile_own
from dqcontrol.errors import ShapeError, as_array
from dqcontrol.extensions.user_code import function_at, numbers_in
from dqcontrol.laws.law import LAW, Law
from dqcontrol.robots.kinematics.kinematics_kernels import fill_pose_jacobian
from dqcontrol.robots.robot import Robot


def finite_checked(function: Callable[..., Any]) -> Callable[..., int]:
    """Return what calls a user's function as a kernel of signature `LAW`, and says whether its command is finite."""

    def own_law(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
        fill_pose_jacobian(pose, twist_jacobian, pose_jacobian)
        out[:] = math.nan  # what the function leaves out must not reach a joint
        function(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out)
        for i in range(out.shape[0]):
            if not math.isfinite(out[i]):
                return NOT_FINITE
        return OK

    return own_law


def _guarded(checked: Callable[..., int]) -> Callable[..., int]:
    def guarded(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
        try:
            return checked(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out)
        except Exception:
            return RAISED

    return guarded


@lru_cache(maxsize=64)
def _kernel(function: Callable[..., Any], *, of_spec: bool) -> Kernel | InterpretedKernel:
    return compile_own(function, finite_checked, _guarded, LAW, of_spec=of_spec)


class OwnLaw(Law, frozen=True, kw_only=True, tag="own"):
    """A law written in plain Python; compiled if it can be, else interpreted, which a warning says.

    Sampling limits: ``dqcontrol check`` finds by finite differences at the start how many times the command may be
    multiplied.

    Parameters
    ----------
    function
        The function, or its place as ``FILE.py:NAME`` or ``MODULE:NAME``. Called as
        ``function(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out)`` once a period, it
        writes the inputs into ``out`` (rad/s or m/s). ``q`` (n), measured; ``pose`` (8), ``pose_jacobian`` (8, m) and
        ``twist_jacobian`` (6, m) belong to it; ``sample`` (21): desired pose ``[0:8]``, twist ``[8:14]``, twist rate
        ``[14:20]``, inertial, and time ``[20]``; ``parameters`` and ``state`` as below; ``work`` is scratch, its first
        m numbers the motion preferred in the null space.
    parameters
        Numbers handed to the function, in their order; names are for specs, grids and sweeps.
    memory
        Length of ``state``, zeros at the start, kept from sample to sample.
    scratch
        Length of ``work`` beyond its first m numbers.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> def jacobian_transpose(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    ...     for i in range(out.shape[0]):
    ...         out[i] = 0.0
    ...         for k in range(8):
    ...             out[i] += parameters[0] * pose_jacobian[k, i] * (sample[k] - pose[k])
    >>> arm = dqc.load_robot("iiwa7")
    >>> q = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> law = dqc.laws.OwnLaw(function=jacobian_transpose, parameters=[2.0])
    >>> float(np.abs(law.command(arm, q, dqc.Sample(arm.fkm(q)), period=0.01)).max()) < 1e-12
    True
    """

    function: Any
    parameters: list[float] | dict[str, float] = []
    memory: Annotated[int, Meta(ge=0)] = 1
    scratch: Annotated[int, Meta(ge=0)] = 0

    @property
    def kernel(self) -> Kernel | InterpretedKernel:  # type: ignore[override]
        """The compiled function, or one that calls the Python function."""
        return _kernel(function_at("function", self.function), of_spec=isinstance(self.function, str))

    def state_size(self, robot: Robot) -> int:
        """Return the length of the state."""
        return self.memory

    def parameter_rows(self, robot: Robot, times: np.ndarray) -> np.ndarray:
        """Return the parameters."""
        parameters = as_array("parameters", numbers_in(self.parameters) or [0.0], (None,))
        if parameters.ndim != 1:
            raise ShapeError(f"parameters: expected a row of numbers, got shape {parameters.shape}")
        return parameters[None, :]

    def work_size(self, robot: Robot) -> int:
        """Return room for the preferred motion and the function's scratch."""
        return robot.input_size + self.scratch
