"""The stage that keeps joints within their position limits; it asks the law with Jacobians of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import INPUT, READ, STATUS, WRITE, WRITE2, Kernel
from dqcontrol.compiled.intrinsics import ADDRESS
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.errors import ValueRangeError
from dqcontrol.named_fields import NamedFields

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot

# Where a limit fixes an input at a value, it hands the law this share of its column of J and z = value/share: the law
# then reckons with the value in y − J z, and its inverse moves the input by no more than the share's square: rounding.
FIXED = 1e-8

# law, what it takes, the limit's own parameters and work (2 m numbers and as many as the state), out; the state ends
# with the limit's memory, and that with the last command that left; the twist Jacobian is handed back as it was but for
# columns of inputs that are 0, the preferred motion may be overwritten
POSITION_LIMIT = STATUS(
    ADDRESS,  # of the law
    INPUT,
    WRITE,
    WRITE2,
    WRITE2,
    READ,
    READ,
    WRITE,
    WRITE,
    READ,
    WRITE,
    WRITE,
)


class PositionLimit(NamedFields, frozen=True, kw_only=True, tag_field="kind", forbid_unknown_fields=True):
    """How position limits are kept; subclasses name a kernel of signature `POSITION_LIMIT`.

    Mobile bases have no limits and are passed over.
    """

    spec_key: ClassVar[str] = "limits.position"
    kernel: ClassVar[Kernel]

    def parameters(
        self, robot: Robot, period: float, command_mode: str, velocity: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the kernel's parameters, for the parameters of the limit on velocities (none without).

        Raises
        ------
        Error
            If one is not allowed, or the robot has no limits to keep.
        """
        raise NotImplementedError

    def memory(self, robot: Robot, command_mode: str, period: float) -> int:
        """Return how many numbers are kept from sample to sample, the last m of them the command that left."""
        return 0


class InputRanges(NamedTuple):
    """Limits of what each input moves, and which coordinate that is."""

    lower: Annotated[Array, "m"]
    upper: Annotated[Array, "m"]
    coordinate: Annotated[Array, "m"]


input_ranges: MemoryLayout[InputRanges] = MemoryLayout(InputRanges, "m")


def position_limits(field: str, robot: Robot) -> InputRanges:
    """Return the position limits of a robot.

    Raises
    ------
    ValueRangeError
        If no joint has limits.
    """
    lower, upper, input_coordinates = robot.limits.lower, robot.limits.upper, robot.input_coordinates
    if not (np.isfinite(lower) | np.isfinite(upper)).any():
        raise ValueRangeError(f"{field}: {robot.name} has no joint limits to keep")
    return InputRanges(
        lower[input_coordinates], upper[input_coordinates], input_coordinates.astype(np.float64)
    )
