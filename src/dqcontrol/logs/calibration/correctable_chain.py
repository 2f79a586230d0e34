"""An arm whose geometry has small corrections: each is one more joint of a longer chain.

So its poses and their derivatives by all corrections are the forward kinematics and the Jacobian of that chain. Between
the joints i and i + 1 it is Rz(qᵢ) Rz(δθ) Tz(δd) Fᵢ Tx(δa) Rx(δα) Ry(δβ), Fᵢ the fixed pose of the arm: θ, d, a, α are
those of a standard Denavit–Hartenberg row; β is Hayati's, as a, α, θ and d cannot turn axes that are parallel out of
the plane across a. Base and tool have three shifts and three turns each.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.robots import SerialArm
from dqcontrol.robots.poses import compose, inverse7, rotation_x, rotation_y, rotation_z, shift

BASE, TOOL = "base", "tool"
FRAME = ("x", "y", "z", "rz", "ry", "rx")
_LENGTHS = {"x", "y", "z", "d", "a"}
# what turns z into the axis of a correction
_AXIS = {"x": rotation_y(np.pi / 2), "y": rotation_x(-np.pi / 2), "z": shift()}
_AXIS_OF = {"rx": "x", "ry": "y", "rz": "z", "theta": "z", "d": "z", "a": "x", "alpha": "x", "beta": "y"}


class Parameter(NamedTuple):
    """What may be corrected: ``part`` is ``"base"``, ``"tool"`` or the name of a joint."""

    part: str
    name: str

    def __str__(self) -> str:
        return f"{self.part}.{self.name}"


class CorrectableChain:
    """An arm with corrections of its geometry.

    Parameters
    ----------
    arm
        As it is known.
    base, tool
        Fixed poses (7,) before and behind it, in the frame that measures and to what is measured.

    Attributes
    ----------
    parameters
        What may be corrected, in the order of the values that the methods take: those of base and tool first.
    """

    def __init__(self, arm: SerialArm, base: Array, tool: Array) -> None:
        self.arm = arm
        self._ends = base, tool
        self.order: list[Parameter | int] = []
        fixed, types = list[Array](), list[str]()
        pending = shift()

        def joint(what: Parameter | int, kind: str, along: str) -> None:
            nonlocal pending
            fixed.append(compose(pending, _AXIS[along]))
            types.append(kind)
            self.order.append(what)
            pending = inverse7(_AXIS[along])

        def correction(part: str, name: str) -> None:
            what = Parameter(part, name)
            joint(what, "prismatic" if name in _LENGTHS else "revolute", _AXIS_OF.get(name, name))

        for name in FRAME:
            correction(BASE, name)
        pending = compose(pending, base)
        n = arm.configuration_size
        for i in range(n):
            pending = compose(pending, arm.chain[i, :7])
            joint(i, arm.joint_types[i], "z")
            correction(arm.joint_names[i], "theta")
            correction(arm.joint_names[i], "d")
            if i < n - 1:
                pending = compose(pending, arm.chain[i + 1, :7])
                for name in ("a", "alpha", "beta"):
                    correction(arm.joint_names[i], name)
                pending = compose(pending, inverse7(arm.chain[i + 1, :7]))
        pending = compose(pending, arm.chain[n, :7], tool)
        for name in FRAME:
            correction(TOOL, name)
        self._long = SerialArm([*fixed, pending], types)
        self._fixed = np.array([*fixed, pending])
        self.joint_columns: list[int] = [self.order.index(i) for i in range(n)]
        found = [each for each in self.order if isinstance(each, Parameter)]
        kinds = ("a", "alpha", "theta", "d", "beta")  # where two say the same, the later ones stay 0
        ends = [each for each in found if each.part in (BASE, TOOL)]
        rows = sorted((each for each in found if each not in ends), key=lambda each: kinds.index(each.name))
        self.parameters: list[Parameter] = [*ends, *rows]

    @cached_property
    def columns(self) -> list[int]:
        """Of the long chain, those of the parameters."""
        return [self.order.index(each) for each in self.parameters]

    def poses(self, q: Array, values: Array) -> Array:
        """Return the poses (N, 8) of what is measured."""
        return self._long.fkm(self._coordinates(q, values))

    def jacobian(self, q: Array, values: Array) -> Array:
        """Return the derivatives of turn (rad) and position (m) by the parameters, shape (N, 6, P), measuring axes."""
        return self._long.hand_jacobian(self._coordinates(q, values))[:, :, self.columns]

    def _coordinates(self, q: Array, values: Array) -> Array:
        coordinates = np.zeros((len(q), len(self.order)))
        coordinates[:, self.joint_columns] = q
        coordinates[:, self.columns] = values
        return coordinates

    def end(self, part: str, values: Array) -> Array:
        """Return the fixed pose (7,) of base or tool with its corrections."""
        given = {each.name: float(values[k]) for k, each in enumerate(self.parameters) if each.part == part}
        turns = rotation_z(given["rz"]), rotation_y(given["ry"]), rotation_x(given["rx"])
        corrected = compose(shift(given["x"], given["y"], given["z"]), *turns)
        return compose(corrected, self._ends[0]) if part == BASE else compose(self._ends[1], corrected)

    def corrected(self, values: Array, *, base: bool, tool: bool) -> SerialArm:
        """Return the arm with its corrections, those of its base and tool and what lies beyond if asked for."""
        arm, n = self.arm, self.arm.configuration_size
        at = {str(each): float(value) for each, value in zip(self.parameters, values, strict=True)}
        fixed = [arm.chain[i, :7].copy() for i in range(n + 1)]
        for i, name in enumerate(arm.joint_names):
            about = compose(rotation_z(at[f"{name}.theta"]), shift(z=at[f"{name}.d"]))
            behind = [about, fixed[i + 1]]
            if i < n - 1:
                across = compose(shift(x=at[f"{name}.a"]), rotation_x(at[f"{name}.alpha"]))
                behind += [across, rotation_y(at[f"{name}.beta"])]
            fixed[i + 1] = compose(*behind)
        if base:
            fixed[0] = compose(self.end(BASE, values), fixed[0])
        if tool:
            fixed[n] = compose(fixed[n], self.end(TOOL, values))
        return SerialArm(
            np.array(fixed),
            arm.joint_types,
            limits=arm.limits,
            joint_names=arm.joint_names,
            name=arm.name,
            inertia=arm.inertia,
        )
