"""Joint limits and link inertias: plain data that belongs to a robot."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.errors import ShapeError, ValueRangeError, as_array, as_positive


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of each coordinate and of each input; for an arm both are its joints.

    Parameters
    ----------
    lower, upper
        Position limits, shape (n,), rad or m; ±inf where a joint has none.
    velocity
        Largest speed of each input, shape (m,), rad/s or m/s; inf where unknown.
    effort
        Largest torque or force of each input, shape (m,), N·m or N; inf where unknown.

    Raises
    ------
    ShapeError, ValueRangeError
        If a limit is NaN, ``lower`` is not below ``upper``, or a velocity or effort is not positive.
    """

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    velocity: NDArray[np.float64]
    effort: NDArray[np.float64]

    def __post_init__(self) -> None:
        n, m = np.size(self.lower), np.size(self.velocity)
        for field, size in (("lower", n), ("upper", n), ("velocity", m), ("effort", m)):
            value = np.array(getattr(self, field), dtype=np.float64)
            if value.shape != (size,):
                raise ShapeError(f"limits.{field}: expected shape ({size},), got {value.shape}")
            if np.isnan(value).any():
                raise ValueRangeError(f"limits.{field}: must not be NaN, got {value}")
            value.flags.writeable = False
            object.__setattr__(self, field, value)
        for i in range(n):
            if self.lower[i] >= self.upper[i]:
                raise ValueRangeError(
                    f"limits: joint {i + 1} has lower {self.lower[i]:g} ≥ upper {self.upper[i]:g}; "
                    "lower must be below upper"
                )
        for i in range(m):
            for field in ("velocity", "effort"):
                if getattr(self, field)[i] <= 0:
                    raise ValueRangeError(
                        f"limits.{field}: joint {i + 1} has {getattr(self, field)[i]:g}; must be > 0"
                    )

    def __repr__(self) -> str:
        return f"Limits({len(self.lower)} coordinates, {len(self.velocity)} inputs)"

    @classmethod
    def none(cls, joint_count: int) -> Limits:
        """Return limits that exclude nothing."""
        inf = np.full(joint_count, np.inf)
        return cls(-inf, inf, inf, inf)


@dataclass(frozen=True, eq=False)
class Inertia:
    """Inertia of the body that each joint moves, in the joint's frame after its screw.

    Parameters
    ----------
    mass
        Shape (n,), kg.
    center
        Centre of mass, shape (n, 3), m.
    tensor
        Inertia about the centre of mass, axes of the joint frame, shape (n, 3, 3), kg m².

    Raises
    ------
    ShapeError, ValueRangeError
        If a shape is wrong, a value not finite or a mass negative.
    """

    mass: NDArray[np.float64]
    center: NDArray[np.float64]
    tensor: NDArray[np.float64]

    def __post_init__(self) -> None:
        mass = as_array("inertia.mass", self.mass, (None,))
        n = len(mass)
        if mass.ndim != 1 or (mass < 0).any():
            raise ValueRangeError(f"inertia.mass: expected {n} masses ≥ 0, got {mass}")
        object.__setattr__(self, "mass", mass)
        object.__setattr__(self, "center", as_array("inertia.center", self.center, (n, 3)))
        object.__setattr__(self, "tensor", as_array("inertia.tensor", self.tensor, (n, 3, 3)))

    @cached_property
    def table(self) -> NDArray[np.float64]:
        """The body table of ``gravity``, one row ``[mass, center]`` a joint, shape (n, 4); not to be written."""
        rows = np.column_stack([self.mass, self.center])
        rows.flags.writeable = False
        return rows

    def __repr__(self) -> str:
        return f"Inertia({len(self.mass)} bodies, {self.mass.sum():.3g} kg)"


def symmetric_limits(upper: ArrayLike, velocity: ArrayLike, effort: ArrayLike) -> Limits:
    """Return limits ±upper."""
    bound = as_array("limits.upper", upper, (None,))
    return Limits(-bound, bound, np.asarray(velocity), np.asarray(effort))


def as_limit(field: str, value: float) -> float:
    """Return a number > 0, which may be infinite, or raise a `ValueRangeError`."""
    return value if isinstance(value, float) and value > 0 else as_positive(field, value)
