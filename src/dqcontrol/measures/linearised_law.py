"""Laws of unknown loop gains: linear near rest by finite differences, and the loop that they close."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.controller import Controller
from dqcontrol.measures.stability import first_failure
from dqcontrol.plants.linear_model import LinearModel, smooth_slopes
from dqcontrol.references.sample import POSE, SAMPLE_SIZE

_CALLS = 200  # in which a law at rest comes to rest itself
_AT_REST = 1e-12
_MARGINAL = 1e-5  # so near to 1 a pole neither decays nor grows: what a law leaves free


@dataclass(frozen=True)
class LinearisedLaw:
    """u = D y + C s, s⁺ = A s + B y about rest, y the change of position along each input.

    Attributes
    ----------
    transition, inputs
        A and B, shapes (s, s) and (s, m).
    outputs, feedthrough
        C and D, shapes (m, s) and (m, m), 1/s.
    """

    transition: Array
    inputs: Array
    outputs: Array
    feedthrough: Array


def linearise_law(prepared: Controller, start: Array) -> LinearisedLaw | None:
    """Return a law near a configuration, its target at rest at the end effector; None where it is not smooth.

    Parameters
    ----------
    prepared
        The law, with its parameters of the first sample.
    start
        Configuration, shape (n,), rad or m.

    Raises
    ------
    DivergedError
        If the law fails there.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> from dqcontrol.measures.linearised_law import linearise_law
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> law = linearise_law(dqc.laws.Proportional(gain=5.0).prepare(arm, None, 0.01), q)
    >>> sorted(np.linalg.eigvals(law.feedthrough).real.round(6).tolist())[:6]
    [-5.0, -5.0, -5.0, -5.0, -5.0, -5.0]
    """
    robot, m = prepared.robot, prepared.robot.input_size
    sample = np.zeros(SAMPLE_SIZE)
    sample[POSE] = robot.fkm(start)
    rest = prepared.initial_state(start)
    size = len(rest)

    def step(change: Array) -> Array:
        state, out = rest + change[m:], np.empty(m)
        prepared.step(robot.integrate(start, change[:m], 1.0), sample, 0, state, out)
        return np.concatenate([out, state])

    for _ in range(_CALLS):
        before, rest = rest, step(np.zeros(m + size))[m:]
        if np.abs(rest - before).max(initial=0.0) < _AT_REST:
            break
    slopes = smooth_slopes(step, np.concatenate([np.ones(m), np.maximum(1.0, np.abs(rest))]))
    if slopes is None:
        return None
    return LinearisedLaw(slopes[m:, m:], slopes[m:, :m], slopes[:m, m:], slopes[:m, :m])


@dataclass(frozen=True)
class NumericLoop:
    """A linearised law, closed by a plant.

    Attributes
    ----------
    law, model
        Of law and plant.
    """

    law: LinearisedLaw
    model: LinearModel

    @property
    def size(self) -> int:
        """Number of states of plant and law."""
        joints = len(self.law.feedthrough) // self.model.inputs.shape[1]
        return joints * len(self.model.transition) + len(self.law.transition)

    @property
    def drifts(self) -> bool:
        """Whether the command does not depend on the position."""
        law = self.law
        through = np.abs(law.outputs).max(initial=0.0) * np.abs(law.inputs).max(initial=0.0)
        return bool(max(np.abs(law.feedthrough).max(), through) < _AT_REST)

    def poles(self, factor: float = 1.0) -> NDArray[np.complex128]:
        """Return the poles of the loop with its command multiplied by a factor, without what it leaves free."""
        law, m = self.law, len(self.law.feedthrough)
        joints = np.eye(m // self.model.inputs.shape[1])  # one stands for all, or all are there
        transition, inputs = (
            np.kron(self.model.transition, joints),
            factor * np.kron(self.model.inputs, joints),
        )
        closed = np.block(
            [
                [transition, inputs @ law.outputs],
                [np.zeros((len(law.transition), len(transition))), law.transition],
            ]
        )
        closed[:, :m] += np.vstack([inputs @ law.feedthrough, law.inputs])
        poles = np.linalg.eigvals(closed)
        return poles[np.abs(poles - 1) > _MARGINAL].astype(np.complex128)

    def is_stable_with(self, factor: float) -> bool:
        """Return whether all poles that move lie within the unit circle, with the command multiplied by a factor."""
        return bool(np.abs(self.poles(factor)).max(initial=0.0) < 1)

    @cached_property
    def is_stable(self) -> bool:
        """Whether errors shrink."""
        return self.is_stable_with(1.0)

    @cached_property
    def margin(self) -> float:
        """Factor on the command at which the loop turns unstable: above 1 if it is stable; may be infinite."""
        if self.is_stable:
            return first_failure(lambda factor: factor <= 1 or self.is_stable_with(factor))
        return first_failure(self.is_stable_with)

    @property
    def radius(self) -> float:
        """Factor by which errors shrink a period, in the long run."""
        return float(np.abs(self.poles()).max(initial=0.0))
