"""The loop gains that a law has, and those that a plant allows."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.controller import Controller
from dqcontrol.laws import Law
from dqcontrol.plants.linear_model import LinearModel, smooth_slopes
from dqcontrol.references.sample import POSE, SAMPLE_SIZE

Verdict = Literal[
    "good", "stable", "oscillatory", "unstable", "unstable for large errors", "drifts", "cannot be decided"
]

MOST_STATES = 200  # of a model: eigenvalues of more take too long
_GAINS = np.geomspace(1e-4, 1e6, 134)  # k T that are tried until one fails
GOOD_DAMPING = 0.7  # damping ratio of poles that hardly overshoot (5 %)
GOOD_MARGIN = 2.0  # of a gain: 6 dB, the usual gain margin
_AT_ONCE = 32  # gains
_TIE = 1e-6  # poles whose moduli are as near to the largest are as slow
_REAL = 1e-10  # as much less than 1 is the damping ratio of a real pole
_ROUNDING = 1e-12  # of eigenvalues of some tens of states
_FREQUENCIES = 2000  # over 3.5 decades: neighbours differ by 0.4 %
_LONGEST = 20_000  # periods of a step response
_MOST_INTEGRAL = 1e100  # k_I/k²; no loop is stable from far less on, and more would overflow


@dataclass(frozen=True)
class LoopGain:
    """The gain of one of a law's loops where its modulus is largest.

    Attributes
    ----------
    loop
        ``"position"``, ``"orientation"`` or ``"null space"``.
    value
        1/s; complex where errors oscillate even with ideal joints and a short period.
    time
        When that is, s; None if it is constant.
    integral_share
        k_I / k² of a law with an integral, u = −k y − k_I ∫y dt: with ideal joints its damping ratio is ½√(k²/k_I).
    lag
        k_v of a law of accelerations, u̇ = k_v (−k y − u), 1/s: with ideal joints its damping ratio is ½√(k_v/k).
    """

    loop: str
    value: complex
    time: float | None
    integral_share: float = 0.0
    lag: float = 0.0


def loop_gains(law: Law, prepared: Controller) -> tuple[LoopGain, ...] | None:
    """Return the gains of a law's loops, each at its largest; None if they are unknown."""
    rates = law.loop_rates(prepared.parameters)
    if rates is None:
        return None
    gains = []
    for loop, values in (("position", rates.position), ("orientation", rates.orientation)):
        if values is not None:
            k = int(np.abs(values).argmax())
            gain = complex(values[k])
            share = rates.integral / abs(gain) / abs(gain) if gain else 0.0  # its square may overflow
            share = min(share, _MOST_INTEGRAL)
            when = k * prepared.period if np.ptp(values) else None
            gains.append(LoopGain(loop, gain, when, share, rates.lag))
    rate = law.null_space.loop_rate(prepared.robot) if law.null_space else None
    if rate is not None and (prepared.robot.input_size > 6 or len(gains) < 2):
        gains.append(LoopGain("null space", rate, None, lag=rates.lag))
    return tuple(gains)


@dataclass(frozen=True)
class GainLimits:
    """Largest products k T of a loop gain and the period, or of its modulus if it is complex.

    Attributes
    ----------
    stable
        Below it all poles lie inside the unit circle.
    monotone
        Up to it the slowest pole is real and positive: the error ends without oscillation.
    recommended
        Up to it the slowest poles have a damping ratio of 0.7 or more, and twice the gain is stable.
    large
        From about there on large errors oscillate for ever at a supervisor's acceleration limit; see
        `large_error_limit`.
    """

    stable: float
    monotone: float
    recommended: float
    large: float = math.inf

    def verdict(self, product: float) -> Verdict:
        """Say what becomes of errors at this k T: good where they end well damped, with at most a little overshoot."""
        if product == 0:
            return "drifts"
        if product >= self.stable:
            return "unstable"
        if product >= self.large:
            return "unstable for large errors"
        return "good" if product <= max(self.monotone, self.recommended) * (1 + _TIE) else "oscillatory"


def gain_limits(
    model: LinearModel,
    period: float,
    direction: complex = 1.0,
    integral_share: float = 0.0,
    *,
    accelerations_limited: bool = False,
) -> GainLimits:
    """Return the limits of the loop u = −k y − k_I ∫y dt, with k along a direction of the complex plane.

    Each is the first gain, from zero on, at which its condition on the closed loop's poles fails.

    Parameters
    ----------
    model
        Of the plant.
    period
        T, s.
    direction
        k/|k|: 1 for all but laws whose own loop oscillates.
    integral_share
        k_I / |k|², which stays as it is when k grows.
    accelerations_limited
        Whether commands may change only at a limited rate on their way to the plant.

    Examples
    --------
    >>> import numpy as np
    >>> from dqcontrol.measures.stability import gain_limits
    >>> from dqcontrol.plants.linear_model import LinearModel
    >>> limits = gain_limits(LinearModel(np.ones((1, 1)), np.full((1, 1), 0.01)), 0.01)
    >>> [round(limit, 6) for limit in (limits.stable, limits.monotone, limits.recommended)]
    [2.0, 1.0, 1.0]
    """

    @cache
    def poles(product: float) -> NDArray[np.complex128]:
        gain = product / period
        return with_integral(model, integral_share * gain, period).poles(gain * direction)

    stable = first_failure(lambda product: spectral_radius(poles(product)) < 1 - _ROUNDING)
    monotone = first_failure(lambda product: _least_damping(poles(product)) > 1 - _REAL)
    damped = first_failure(lambda product: _least_damping(poles(product)) >= GOOD_DAMPING)
    large = large_error_limit(model, period) if accelerations_limited else math.inf
    return GainLimits(stable, min(monotone, stable), min(damped, stable / GOOD_MARGIN, large), large)


def stability_limit(
    model: LinearModel, period: float, direction: complex = 1.0, integral_share: float = 0.0
) -> float:
    """Return `GainLimits.stable` alone; many gains at once, which is several times faster. See `gain_limits`."""

    def stable(products: NDArray[np.float64]) -> NDArray[np.bool_]:
        gains = products / period
        loops = _closed_loops(model, gains * direction, integral_share * gains * period)
        return np.abs(np.linalg.eigvals(loops)).max(axis=-1) < 1 - _ROUNDING

    below, above = 0.0, math.inf
    for some in np.array_split(_GAINS, len(_GAINS) // _AT_ONCE + 1):
        failed = np.flatnonzero(~stable(some))
        if len(failed):
            below = float(some[failed[0] - 1]) if failed[0] else below
            above = float(some[failed[0]])
            break
        below = float(some[-1])
    else:
        return math.inf
    while above - below > 1e-7 * above and below > 0:
        inside = np.linspace(below, above, _AT_ONCE // 2 + 2)[1:-1]
        failed = np.flatnonzero(~stable(inside))
        first = int(failed[0]) if len(failed) else len(inside)
        ends = [below, *inside.tolist(), above]
        below, above = ends[first], ends[first + 1]
    return below


def damping_limit(
    model: LinearModel, period: float, damping: float = GOOD_DAMPING, integral_share: float = 0.0
) -> float:
    """Return the product k T of a real gain from which on the slowest poles have less than a damping ratio."""

    def damped(product: float) -> bool:
        gain = product / period
        return _least_damping(with_integral(model, integral_share * gain, period).poles(gain)) >= damping

    return first_failure(damped)


def gain_margin(gain: LoopGain, model: LinearModel, period: float) -> float:
    """Return by how much a loop's gain could be multiplied before a plant makes it unstable; infinite for no gain."""
    if not (size := abs(gain.value)):
        return math.inf
    direction = gain.value / size if gain.value.imag else 1.0
    behind = with_lag(model, gain.lag, period)
    return stability_limit(behind, period, direction, gain.integral_share) / (size * period)


def _closed_loops(model: LinearModel, gains: NDArray[Any], resets: NDArray[np.float64]) -> NDArray[Any]:
    """Return the transitions of u = −k w for each gain, with w of `with_integral` for each ρT, shape (g, s, s)."""
    transition, inputs = model.transition, model.inputs
    size, m = len(transition), inputs.shape[1]
    if not resets.any():
        feedback = np.zeros((size, size))
        feedback[:, :m] = inputs
        return transition - gains[:, None, None] * feedback
    loops = np.zeros((len(gains), size + m, size + m), dtype=gains.dtype)
    weight = 1 + resets[:, None, None]
    loops[:, :m, :m] = np.eye(m) - gains[:, None, None] * weight * inputs[:m]
    loops[:, :m, m:] = weight * transition[:m]
    loops[:, :m, m : 2 * m] -= np.eye(m)
    loops[:, m:, :m] = -gains[:, None, None] * inputs
    loops[:, m:, m:] = transition
    return loops


def large_error_limit(model: LinearModel, period: float) -> float:
    """Return the product k T from which on large errors may oscillate for ever, behind a limit of acceleration.

    A rate limit that is always reached turns a sine into a triangle, φ late and 8/π² cos φ times as high. So there is
    an oscillation that lasts where k G has the phase −180° + φ with 0 < φ < 90° and the modulus π²/(8 cos φ)
    (harmonic balance). With a lag τ in all that is from k = 1.23/τ on, however small the acceleration: the limit only
    says how large the error has to be, about a/k². Simulated loops do so from a gain up to a third higher on.

    Parameters
    ----------
    model
        Of the plant; each joint is looked at by itself.
    period
        T, s.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> from dqcontrol.measures.stability import large_error_limit
    >>> servo = dqc.plants.Servo(time_constant=0.05)
    >>> round(large_error_limit(servo.linear_model(dqc.load_robot("iiwa7"), None, 0.01), 0.01) / 0.01, 1)  # 1/s
    24.6
    """
    m, unit = model.inputs.shape[1], np.eye(len(model.transition))
    angles = np.geomspace(1e-3, np.pi, _FREQUENCIES + 1)[:-1]
    shifted = np.exp(1j * angles)[:, None, None] * unit - model.transition
    inputs = np.broadcast_to(model.inputs, (len(angles), *model.inputs.shape))
    responses = np.linalg.solve(shifted, inputs)[:, range(m), range(m)] / period
    late = np.pi + np.unwrap(np.angle(responses), axis=0)
    rated = (late > 1e-3) & (late < np.pi / 2 - 1e-6)
    gains = np.pi**2 / 8 / (np.abs(responses) * np.cos(np.where(rated, late, 0.0)))
    return float(gains[rated].min(initial=math.inf))


def with_mean(model: LinearModel, window: int, period: float, *, from_measured: bool) -> LinearModel:
    """Return a plant behind a supervisor that limits jerk: what leaves is the mean of so many of its last rates.

    Parameters
    ----------
    model
        Of the plant, y the first entries of its state.
    window
        Number of samples that the mean is of.
    period
        T, s.
    from_measured
        Whether commands count from y: then the mean is of positions, y⁺ + T u, as the supervisor moves its own.

    Examples
    --------
    >>> import numpy as np
    >>> from dqcontrol.measures.stability import gain_limits, with_mean
    >>> from dqcontrol.plants.linear_model import LinearModel
    >>> ideal = LinearModel(np.ones((1, 1)), np.full((1, 1), 0.01))
    >>> round(gain_limits(with_mean(ideal, 2, 0.01, from_measured=False), 0.01).stable, 6)  # half a sample late
    2.0
    """
    if window <= 1:
        return model
    m, size = model.inputs.shape[1], len(model.transition)
    memory = (window - 1) * m  # newest first: rates, or positions
    transition, inputs = np.zeros((size + memory, size + memory)), np.zeros((size + memory, m))
    transition[:size, :size] = model.transition
    shares = np.tile(np.eye(m) / window, window - 1)
    feed = model.inputs / period if from_measured else model.inputs
    transition[:size, size:] = feed @ shares
    inputs[:size] = model.inputs / window
    inputs[size : size + m] = period * np.eye(m) if from_measured else np.eye(m)
    if from_measured:  # target s⁺ = (y + T u + Σ past)/w, as the rate (s⁺ − y)/T
        transition[:size, :m] += feed * (1 / window - 1)
        transition[size : size + m, :m] = np.eye(m)
    transition[size + m :, size : size + memory - m] = np.eye(memory - m)
    return LinearModel(transition, inputs)


def with_integral(model: LinearModel, reset_rate: float, period: float) -> LinearModel:
    """Return a plant whose measured positions are w = y + ρ T Σy, y those of a model: a gain k on w is PI control of y.

    Parameters
    ----------
    model
        Of the plant, y the first entries of its state.
    reset_rate
        ρ = k_I / k, 1/s.
    period
        T, s.

    Examples
    --------
    >>> import numpy as np
    >>> from dqcontrol.measures.stability import with_integral
    >>> from dqcontrol.plants.linear_model import LinearModel
    >>> ideal = LinearModel(np.ones((1, 1)), np.full((1, 1), 0.01))
    >>> sorted(with_integral(ideal, 25.0, 0.01).poles(100.0).real.round(6).tolist())  # z² − (2 − kT(1 + ρT)) z + 1 − kT
    [0.0, 0.75]
    """
    if not reset_rate:
        return model
    m = model.inputs.shape[1]
    weight = 1 + reset_rate * period
    change = weight * model.transition[:m]
    change[:, :m] -= np.eye(m)
    transition = np.block([[np.eye(m), change], [np.zeros((len(model.transition), m)), model.transition]])
    return LinearModel(transition, np.vstack([weight * model.inputs[:m], model.inputs]))


def with_lag(model: LinearModel, lag: float, period: float) -> LinearModel:
    """Return a plant behind u⁺ = u + k_v T (w − u), semi-implicit: the w of this sample counts in its command.

    Parameters
    ----------
    model
        Of the plant, y the first entries of its state.
    lag
        k_v, 1/s; 0 for none.
    period
        T, s.

    Examples
    --------
    >>> import numpy as np
    >>> from dqcontrol.measures.stability import with_lag
    >>> from dqcontrol.plants.linear_model import LinearModel
    >>> ideal = LinearModel(np.ones((1, 1)), np.full((1, 1), 0.1))
    >>> sorted(with_lag(ideal, 4.0, 0.1).poles(1.0).real.round(6).tolist())  # z² − (2 − k_v T (1 + kT)) z + 1 − k_v T
    [0.688348, 0.871652]
    """
    if not lag:
        return model
    m, share = model.inputs.shape[1], lag * period
    rest = np.zeros((m, len(model.transition)))
    transition = np.block([[model.transition, (1 - share) * model.inputs], [rest, (1 - share) * np.eye(m)]])
    return LinearModel(transition, share * np.vstack([model.inputs, np.eye(m)]))


def overshoot(model: LinearModel, gain: float) -> float:
    """Return by how much of a step the loop u = k (r − y) passes it, 0 or more; infinite if it is unstable.

    Parameters
    ----------
    model
        Of the plant; each joint makes the step by itself.
    gain
        k, 1/s.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> from dqcontrol.measures.stability import overshoot
    >>> servo = dqc.plants.Servo(time_constant=0.05)
    >>> model = servo.linear_model(dqc.load_robot("iiwa7"), None, 0.001)
    >>> round(overshoot(model, 1 / (4 * 0.05 * 0.7**2)), 3)  # damping ratio 0.7: 4.6 %
    0.046
    """
    radius = spectral_radius(model.poles(gain))
    if radius >= 1 - _ROUNDING:
        return math.inf
    m = model.inputs.shape[1]
    transition = model.transition.copy()
    transition[:, :m] -= gain * model.inputs
    steps = _LONGEST if radius <= 0 else int(min(_LONGEST, max(10, math.log(_ROUNDING) / math.log(radius))))
    state, farthest = np.zeros((len(transition), m)), 1.0
    for _ in range(steps):
        state = transition @ state + gain * model.inputs
        farthest = max(farthest, float(np.diagonal(state[:m]).max()))
    return farthest - 1


def damped_overshoot(poles: NDArray[np.complex128]) -> float:
    """Return exp(−πζ/√(1 − ζ²)) with the damping ratio ζ of the slowest poles; infinite if they grow."""
    damping = _least_damping(poles)
    if damping <= 0:
        return math.inf
    return math.exp(-math.pi * damping / math.sqrt(1 - damping**2)) if damping < 1 else 0.0


def spectral_radius(poles: NDArray[np.complex128]) -> float:
    """Return the largest modulus: by so much an error shrinks a period, in the long run."""
    return float(np.abs(poles).max())


def _least_damping(poles: NDArray[np.complex128]) -> float:
    """Return the damping ratio −Re ln z / |ln z| of the slowest poles: 1 where they are real and positive."""
    moduli = np.abs(poles)
    if moduli.max() < _ROUNDING:
        return 1.0
    exponents = np.log(poles[moduli >= (1 - _TIE) * moduli.max()])
    sizes = np.abs(exponents)  # 0 at z = 1, which is real
    return float(np.min(np.divide(-np.real(exponents), sizes, out=np.ones_like(sizes), where=sizes > 0)))


def first_failure(holds: Callable[[float], bool]) -> float:
    """Return the product k T, or the factor, from which on a condition fails, to seven digits; infinite if it holds."""
    below = 0.0
    for above in _GAINS:
        if not holds(above):
            break
        below = above
    else:
        return float("inf")
    while above - below > 1e-7 * above and below > 0:
        middle = (below + above) / 2
        below, above = (middle, above) if holds(middle) else (below, middle)
    return float(below)


_CALLS = 200  # in which a law at rest comes to rest itself
_AT_REST = 1e-12  # rounding
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
    >>> from dqcontrol.measures.stability import linearise_law
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
        transition = np.kron(self.model.transition, joints)
        inputs = factor * np.kron(self.model.inputs, joints)
        rest = np.zeros((len(law.transition), len(transition)))
        closed = np.block([[transition, inputs @ law.outputs], [rest, law.transition]])
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
