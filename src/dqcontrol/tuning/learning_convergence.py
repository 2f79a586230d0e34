"""Convergence of learning, found from the model before anything moves."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.contact.admittance import exact_step
from dqcontrol.controller import Controller
from dqcontrol.errors import ShapeError
from dqcontrol.measures.stability import LoopGain
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.references import Previewed, Reference
from dqcontrol.references.sample import POSE, SAMPLE_SIZE, TWIST
from dqcontrol.robots import Robot

_TWIST = 1e-3  # rad/s and m/s that a feed-forward is asked for
_LEAST_ANGLE = 1e-9  # where the loop is at rest, z = 1


@dataclass(frozen=True)
class LoopShape:
    """A law as one loop of a direction of the end effector: u = C(z) (w − y) + κ F(z) (z − 1) w/T.

    Attributes
    ----------
    gain
        Of position or orientation, the smaller: what learns slowest.
    feedforward
        κ: 1 for laws with feed-forward of the desired twist, 0 for others.
    period
        T, s.
    ahead, part, share
        Steps n by which twists come early, p of one more, and a, of F(z) = zⁿ (1 − p + p z) (1 − a/z)/(1 − a), see
        `Previewed`; 0 without preview.
    """

    gain: LoopGain
    feedforward: float
    period: float
    ahead: int = 0
    part: float = 0.0
    share: float = 0.0

    def response(self, model: LinearModel, frequencies: Array) -> NDArray[np.complex128]:
        """Return from shift to measured joints, shape (frequencies, m, m); frequencies in Hz."""
        angles = np.maximum(2 * np.pi * self.period * frequencies, _LEAST_ANGLE)
        z = np.exp(1j * angles)[:, None, None]
        size, m = model.inputs.shape
        unit = np.eye(m)
        inputs = np.broadcast_to(model.inputs, (len(z), size, m))
        plant = np.linalg.solve(z * np.eye(size) - model.transition, inputs)[:, :m]
        value = abs(self.gain.value)
        control = value + self.gain.integral_share * value**2 * self.period * z / (z - 1)
        if self.gain.lag:
            share = min(self.gain.lag * self.period, 1.0)
            control = control * share * z / (z - 1 + share)
        led = z**self.ahead * (1 + self.part * (z - 1)) * (1 - self.share / z) / (1 - self.share)
        shifted = plant @ (unit * (control + self.feedforward * led * (z - 1) / self.period))
        return np.asarray(np.linalg.solve(unit + control * plant, shifted), dtype=np.complex128)


@dataclass(frozen=True)
class ForceShape(LoopShape):
    """A law behind an admittance along an axis with a wanted force: how far its compliant frame gives way.

    With F the sensor's filter, G the admittance from force to deflection y, K_e the stiffness of what is touched and s
    where its surface is, y = G (K_e F (s − x) − f_d) and x = T w + T₀ y, T₀ the loop without preview. Of a shift w the
    deflection becomes y₀ − R w with R = (Z + T₀)⁻¹ T and Z = 1/(G K_e F): about 1 below the bandwidth of the force.

    Attributes
    ----------
    mass, damping, given_stiffness
        M, D and K of the axis, kg, N·s/m and N/m.
    filter
        Time constant of the sensor, s.
    stiffness
        K_e, N/m.
    """

    mass: float = 0.0
    damping: float = 0.0
    given_stiffness: float = 0.0
    filter: float = 0.0
    stiffness: float = math.inf

    def response(self, model: LinearModel, frequencies: Array) -> NDArray[np.complex128]:
        """Return from shift to −y, as if each joint were such an axis, shape (frequencies, m, m)."""
        angles = np.maximum(2 * np.pi * self.period * frequencies, _LEAST_ANGLE)
        z = np.exp(1j * angles)
        step = exact_step(self.mass, self.damping, self.given_stiffness, self.period).reshape(2, 3)
        inputs = np.broadcast_to(step[:, 2:], (len(z), 2, 1))
        moved = np.linalg.solve(z[:, None, None] * np.eye(2) - step[:, :2], inputs)
        read = 1 / (1 + 1j * angles / self.period * self.filter)
        shifted = super().response(model, frequencies)
        alone = LoopShape(self.gain, self.feedforward, self.period).response(model, frequencies)
        given = (1 / (moved[:, 0, 0] * self.stiffness * read))[:, None, None] * np.eye(shifted.shape[1])
        return np.asarray(np.linalg.solve(given + alone, shifted), dtype=np.complex128)


def loop_shape(
    robot: Robot,
    prepared: Controller,
    gains: tuple[LoopGain, ...] | None,
    start: Array,
    reference: Reference,
) -> LoopShape:
    """Return a prepared law as a loop that follows shifts of a reference with the reference's preview, if it has one.

    Raises
    ------
    ShapeError
        If its gains are unknown, or it corrects nothing.
    """
    moving = [gain for gain in gains or () if gain.loop != "null space" and gain.value]
    if not moving:
        why = "are unknown" if gains is None else "are 0"
        raise ShapeError(f"law: its loop gains {why}; learning needs a law that corrects errors of the pose")
    slowest = min(moving, key=lambda gain: abs(gain.value))
    shape = LoopShape(slowest, _feedforward(robot, prepared, start), prepared.period)
    if not isinstance(reference, Previewed):
        return shape
    period = prepared.period
    # Twists of points go from middle to middle, or are constant.
    smoothed = period < reference.smoothed
    steps = reference.delay / period - 0.5 * smoothed
    ahead = math.floor(steps + 1e-9)
    part = smoothed * round(steps - ahead, 9)
    share = math.exp(-period / reference.lag) if reference.lag else 0.0
    return replace(shape, ahead=ahead, part=part, share=share)


def _feedforward(robot: Robot, prepared: Controller, start: Array) -> float:
    """Return which share of a desired twist the law commands besides what errors ask for."""
    sample, share = np.zeros(SAMPLE_SIZE), []
    sample[POSE] = robot.fkm(start)
    jacobian = robot.twist_jacobian(start)
    for axis in range(6):
        sample[TWIST] = 0.0
        sample[TWIST.start + axis] = _TWIST
        command = np.zeros(robot.input_size)
        prepared.step(start, sample, 0, prepared.initial_state(start), command)
        share.append(float((jacobian @ command)[axis]) / _TWIST)
    return float(np.clip(np.round(np.median(share), 3), 0.0, 1.0))


_FREQUENCIES = 240  # neighbours on a logarithmic scale differ by some percent
_EVEN = 513  # frequencies, equally far apart
_LOWEST = 0.02  # Hz
_LEAST = 0.1  # Hz, of a cut-off
HIGHEST = 8.0  # Hz; bands above it were never tried
_GROWTH = 1.02  # of what is hardly learnt a repeat, at most: the guard on growing errors does the rest
_STEP = 1.05  # between cut-offs that are tried


@dataclass(frozen=True)
class Convergence:
    """The learning operator of a loop, and how errors change from repeat to repeat.

    w⁺ = w + Q L Q e with L = T̄*/(|T̄|² + ρ mean|T̄|²), T̄ from a shift of the reference to the end effector, the mean
    over the joints, and the low pass Q = 1/(1 + (f/f_c)⁴). With another plant's T the error of a frequency is
    multiplied by I − Q²LT: it shrinks where all eigenvalues lie inside the unit circle. The mean over frequencies is
    that without preview, with which all of them pass, and learning would be slower for nothing.

    Attributes
    ----------
    shape
        The law.
    models
        Of plants, the nominal one first.
    caution
        ρ.
    cutoff
        f_c, Hz.
    others
        Shapes that the loop may have as well.
    """

    shape: LoopShape
    models: tuple[LinearModel, ...]
    caution: float
    cutoff: float
    others: tuple[LoopShape, ...] = ()
    _known: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)  # shared by all cut-offs

    def _once(self, name: str, make: Callable[[], Any]) -> Any:
        if name not in self._known:
            self._known[name] = make()
        return self._known[name]

    def low_pass(self, frequencies: Array) -> Array:
        """Return Q."""
        return 1 / (1 + (frequencies / self.cutoff) ** 4)

    def operator(self, frequencies: Array) -> NDArray[np.complex128]:
        """Return L at each frequency, Hz."""
        mean = self._mean(frequencies)
        return np.asarray(np.conj(mean) / (np.abs(mean) ** 2 + self.caution * self._power), np.complex128)

    def _mean(self, frequencies: Array, shape: LoopShape | None = None) -> NDArray[np.complex128]:
        responses = (shape or self.shape).response(self.models[0], frequencies)
        return np.diagonal(responses, axis1=1, axis2=2).mean(axis=1)

    @property
    def _power(self) -> float:
        """Mean of |T̄|² over all frequencies up to half a sample rate, without preview."""
        shape = replace(self.shape, ahead=0, part=0.0, share=0.0)
        return self._once("power", lambda: float(np.mean(np.abs(self._mean(self._even, shape)) ** 2)))

    @property
    def _even(self) -> Array:
        return np.linspace(0, 0.5 / self.shape.period, _EVEN)

    def factors(self) -> tuple[Array, Array]:
        """Return frequencies, Hz, and by what the error of each is multiplied in a repeat, of the worst plant."""
        frequencies = np.geomspace(_LOWEST, 0.5 / self.shape.period, _FREQUENCIES)
        operator = self._once("operator", lambda: self.operator(frequencies))
        shapes = (self.shape, *self.others)
        responses = self._once(
            "responses",
            lambda: [each.response(model, frequencies) for each in shapes for model in self.models],
        )
        weight = self.low_pass(frequencies) ** 2 * operator
        worst = np.zeros(len(frequencies))
        for response in responses:
            answer = weight[:, None, None] * response
            left = np.eye(answer.shape[1]) - answer
            worst = np.maximum(worst, np.abs(np.linalg.eigvals(left)).max(axis=1))
        return frequencies, worst

    @property
    def worst(self) -> tuple[float, float]:
        """The largest factor, and its frequency, Hz."""
        frequencies, factors = self.factors()
        place = int(factors.argmax())
        return float(factors[place]), float(frequencies[place])

    @property
    def breaks_at(self) -> float | None:
        """The lowest frequency at which errors grow, Hz; None if they do nowhere."""
        frequencies, factors = self.factors()
        grown = np.flatnonzero(factors > _GROWTH)
        return float(frequencies[grown[0]]) if len(grown) else None

    @property
    def noise_factor(self) -> float:
        """Standard deviation that white noise of a repeat's measurement adds to the next motion, over the noise's."""
        even = self._even
        answer = self.low_pass(even) ** 2 * self.operator(even) * self._mean(even)
        return float(np.sqrt(np.mean(np.abs(answer) ** 2)))


def widest(
    shape: LoopShape,
    models: Sequence[LinearModel],
    caution: float,
    *,
    highest: float,
    others: tuple[LoopShape, ...] = (),
) -> Convergence | None:
    """Return the operator with the highest cut-off at which no error grows; None if there is none from 0.1 Hz on."""
    found = Convergence(shape, tuple(models), caution, min(highest, 0.4 / shape.period), others)
    while found.cutoff >= _LEAST:
        if found.breaks_at is None:
            return found
        found = replace(found, cutoff=found.cutoff / _STEP)
    return None
