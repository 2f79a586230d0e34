"""Linear quadratic control of the pose, in R⁸ and in the space of twists."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from msgspec import Meta

from dqcontrol import algebra
from dqcontrol.algebra.dual_quaternion_kernels import (
    adjoint_twist,
    body_translation,
    conjugate,
    conjugate_multiply,
    half_angle,
    multiply,
    translation,
)
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import Kernel, inline, kernel
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.laws import riccati
from dqcontrol.laws.desired_twist import Feedforward, FeedforwardLaw, desired_twist, signed_state
from dqcontrol.laws.hand_twist import solve_hand_twist, solve_left_twist, twist_at_end_effector, twist_work
from dqcontrol.laws.inverses import FilteredInverse, Inverse, inverse_parameters
from dqcontrol.laws.law import LAW, Law, LoopRates, check_steps, largest_rates
from dqcontrol.laws.pose_error import LEVER_CURVES, left_error, short_sign, shorten_lever, solve_left_error
from dqcontrol.laws.riccati import Steps
from dqcontrol.references.sample import POSE, TWIST

if TYPE_CHECKING:
    from dqcontrol.references import Reference
    from dqcontrol.robots import Robot

Weight = Annotated[
    float | list[float | list[float]] | Steps,
    Meta(description="number, diagonal, matrix, or those over time"),
]
_MOST_SUBSTEPS = 500_000  # a few seconds


class PoseFeedback(NamedTuple):
    """What compiled code knows of `LinearQuadraticR8`: R⁻¹P row by row, and R⁻¹ξ."""

    inverse: Annotated[Array, inverse_parameters.size()]
    hysteresis: float
    gain: Annotated[Array, 64]
    offset: Annotated[Array, 8]


class TwistFeedback(NamedTuple):
    """What compiled code knows of `LinearQuadraticDQ`: R⁻¹P, whether y has the angle or its sine; for second order."""

    inverse: Annotated[Array, inverse_parameters.size()]
    hysteresis: float
    gain: Annotated[Array, 6, 6]
    is_logarithm: float
    second_order: Annotated[Array, ...]


class LinearQuadraticWork(NamedTuple):
    """Scratch of these laws."""

    preferred: Annotated[Array, "m"]
    relative: Annotated[Array, 8]
    opposite: Annotated[Array, 8]
    error: Annotated[Array, 8]
    target: Annotated[Array, 8]
    desired: Annotated[Array, 6]
    solver: Annotated[Array, twist_work.sized("m")]


pose_feedback: MemoryLayout[PoseFeedback] = MemoryLayout(PoseFeedback)
twist_feedback: MemoryLayout[TwistFeedback] = MemoryLayout(TwistFeedback, unchecked=True)
linear_quadratic_work: MemoryLayout[LinearQuadraticWork] = MemoryLayout(
    LinearQuadraticWork, "m", unchecked=True
)
# In place of the layout's parts, with which LLVM adds up R⁻¹P e in another order, and the last digits change.
_HYSTERESIS, _GAIN, _OFFSET = (pose_feedback.place(name) for name in ("hysteresis", "gain", "offset"))
_BEFORE_SOLVER = linear_quadratic_work.place("solver", 0)


class LinearQuadratic(Law, frozen=True, kw_only=True):
    """What both linear quadratic laws have in common: weights, horizon, inverse, sign."""

    work = linear_quadratic_work
    feedback: ClassVar[MemoryLayout[Any]]
    gain_powers: ClassVar[Mapping[str, float]] = {"error_weight": 2, "final_weight": 1}
    error_weight: Weight
    control_weight: Weight
    final_weight: Annotated[
        float | list[float | list[float]], Meta(description="number, diagonal or matrix")
    ] = 0.0
    horizon_time: (
        Annotated[float, Meta(gt=0, description="t_f, s; default: as long as the reference")] | None
    ) = None
    inverse: Inverse = FilteredInverse()
    hysteresis: Annotated[float, Meta(ge=0, lt=1)] = 0.2

    def horizon(self, reference: Reference | None) -> float:
        """Return t_f in s; infinite for a set-point or without a reference."""
        if self.horizon_time is not None:
            return self.horizon_time
        return reference.duration if reference is not None else math.inf

    def _weights(self, size: int) -> tuple[tuple[Array, Array], tuple[Array, Array], Array]:
        weights = riccati.weight_pieces("error_weight", self.error_weight, size, definite=False)
        controls = riccati.weight_pieces("control_weight", self.control_weight, size, definite=True)
        return (
            weights,
            controls,
            riccati.weight_matrix("final_weight", self.final_weight, size, definite=False),
        )

    def rows(self, robot: Robot, reference: Reference | None, period: float) -> Array:
        """Return the kernel's parameters, one row a sample, or one row for an infinite horizon."""
        end = self.horizon(reference)
        size = self._size()
        weights, controls, final = self._weights(size)
        if not math.isfinite(end):
            if len(weights[0]) > 1 or len(controls[0]) > 1:
                raise ShapeError(
                    "error_weight, control_weight: must be constant where the horizon is infinite"
                )
            gain = np.linalg.solve(controls[1][0], riccati.steady_solution(weights[1][0], controls[1][0]))
            return self._packed(gain[None], np.zeros((1, size)))
        if end < period:
            raise ValueRangeError(f"horizon_time: must be at least one period of {period:g} s, got {end:g} s")
        check_steps("horizon_time", end / period)
        times = period * np.arange(math.ceil(end / period - 1e-9) + 1, dtype=np.float64)
        solution, offset = self.riccati_solution(weights, controls, final, times, end, reference)
        inverse_controls = riccati.at_times((controls[0], np.linalg.inv(controls[1])), times)
        return self._packed(inverse_controls @ solution, (inverse_controls @ offset[:, :, None])[:, :, 0])

    def _packed(self, gains: Array, offsets: Array) -> Array:
        return self.feedback.pack(
            inverse=self.inverse.parameters(),
            hysteresis=self.hysteresis,
            **self._own_parameters(gains, offsets),
        )

    def _own_parameters(self, gains: Array, offsets: Array) -> dict[str, Any]:
        raise NotImplementedError

    def loop_rates(self, parameters: Array) -> LoopRates:
        """Return the largest eigenvalues of R⁻¹P's imaginary parts; of the whole where it couples both."""
        size = self._size()
        small = slice(None) if size == 6 else [1, 2, 3, 5, 6, 7]
        gains = self.feedback(parameters).gain.reshape(-1, size, size)[:, small][:, :, small]
        coupling = max(np.abs(gains[:, :3, 3:]).max(), np.abs(gains[:, 3:, :3]).max())
        if coupling > 1e-9 * np.abs(gains).max():
            whole = largest_rates(gains)
            return LoopRates(position=whole, orientation=whole)
        return LoopRates(
            position=largest_rates(gains[:, 3:, 3:]), orientation=largest_rates(gains[:, :3, :3])
        )

    def _size(self) -> int:
        raise NotImplementedError

    def riccati_solution(
        self,
        weights: tuple[Array, Array],
        controls: tuple[Array, Array],
        final: Array,
        times: Array,
        end: float,
        reference: Reference | None,
    ) -> tuple[Array, Array]:
        """Return P and ξ at each time, from their values at the last one backwards.

        Parameters
        ----------
        weights, controls
            Q and R: the times from which pieces hold, the first 0, and their matrices.
        final
            S.
        times
            Of the samples up to the end of the horizon, s.
        end
            Of the horizon, s.
        reference
            What is followed.
        """
        raise NotImplementedError


@kernel(LAW)
def linear_quadratic_r8(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write q̇ = N⁺ R⁻¹ (P e + ξ)."""
    n = pose_jacobian.shape[1]
    scratch = work[n:]
    error, target = scratch[0:8], scratch[8:16]
    left_error(pose, sample, parameters[_HYSTERESIS], state, error)
    for i in range(8):
        value = parameters[_OFFSET + i]
        for k in range(8):
            value += parameters[_GAIN + 8 * i + k] * error[k]
        target[i] = value
    return solve_left_error(
        target, error, pose, twist_jacobian, sample, work[0:n], parameters, scratch[_BEFORE_SOLVER:], out
    )


class LinearQuadraticR8(LinearQuadratic, frozen=True, kw_only=True, tag="linear-quadratic-r8"):
    """LQR in R⁸: q̇ = N⁺ R⁻¹ (P(t) e + ξ(t)), optimal for ½e_f'S e_f + ½∫(e'Qe + u'Ru) dt. [P16 3.34–3.45]

    The error e = vec8(1 − x*x_d) obeys ė = A e + u + c with A = H⁻(x_d*ẋ_d), c = −vec8(x_d*ẋ_d), u = −N q̇, and
    Ṗ = −PA − AᵀP + P R⁻¹P − Q, ξ̇ = −Aᵀξ + P R⁻¹ξ − Pc backwards from S and 0, solved by Runge–Kutta steps that resolve
    their decay.
    Because N N⁺ projects u, an arm pays more than the optimum of the linear model: for a turn θ by about
    θ²/64 of it (0.4 % for 0.5 rad, 1.6 % for 1 rad), for a translation nothing. Away from the end of the horizon,
    Q = qI and R = rI give nearly the law K+FF with k = √(q/r) (P is not quite scalar while the target translates), and
    at a resting target without horizon exactly K; q = 0 is refused there.

    Sampling limits: the loop gain k is the largest eigenvalue of R⁻¹P(t): √(q/r), but s/r at the end of a horizon.
    With ideal joints kT < 2 is stable and kT ≤ 1 monotone, with one sample of delay kT < 1 and kT ≤ 1/4; for servos
    and physics ask ``dqcontrol check``.

    Choice: r = 1 and q = k² for the wanted rate k. S = 0 lets the error go in the last 3/k seconds or so; S = √(qr)
    I keeps the gain to the end.

    Parameters
    ----------
    error_weight, control_weight
        Q (semidefinite) and R (definite): number, 8 diagonal entries, 8 × 8, or `Steps` of those.
    final_weight
        S.
    horizon_time
        t_f, s; the reference's duration if omitted, infinite for a set-point.
    inverse
        How J is inverted; the default is exact away from singularities.
    hysteresis
        How far Re(x*x_d) must pass 0 before the sign of x_d flips.
    null_space
        Motion preferred where the task leaves freedom.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> sample = dqc.Sample(arm.fkm(q + 0.1))
    >>> u = dqc.laws.LinearQuadraticR8(error_weight=9.0, control_weight=1.0).command(arm, q, sample, period=0.01)
    >>> np.allclose(u, dqc.laws.Proportional(gain=3.0).command(arm, q, sample, period=0.01))
    True
    """

    kernel = linear_quadratic_r8
    feedback = pose_feedback

    def _size(self) -> int:
        return 8

    def _own_parameters(self, gains: Array, offsets: Array) -> dict[str, Any]:
        return {"gain": gains.reshape(len(gains), -1), "offset": offsets}

    def riccati_solution(self, weights, controls, final, times, end, reference):
        """Return P and ξ at each time, by Runge–Kutta steps that resolve their decay."""
        period = times[1] - times[0]
        at_samples = (
            riccati.at_times(weights, times),
            riccati.at_times((controls[0], np.linalg.inv(controls[1])), times),
        )
        solution, offset = np.empty((len(times), 8, 8)), np.empty((len(times), 8))
        work = np.zeros(riccati.WORK_SIZE)  # finite: the first stage takes 0 × a slope
        starts = np.union1d(weights[0], controls[0])
        starts = starts[starts <= times[-1]]
        pieces = riccati.at_times(weights, starts), riccati.at_times(controls, starts)
        substeps = riccati.substeps_for(*pieces, final, period)
        if substeps * len(times) > _MOST_SUBSTEPS:
            raise ValueRangeError(
                f"error_weight, control_weight: so fast a decay needs {substeps:,} steps in each period; "
                f"at most {_MOST_SUBSTEPS // len(times):,} for {len(times):,} periods (√(q/r) T must stay below 2)"
            )
        fine = np.clip(
            period / (2 * substeps) * np.arange(2 * substeps * (len(times) - 1) + 1), 0.0, times[-1]
        )
        drifts, offsets = moving_target(reference, fine)
        riccati.sweep(drifts, offsets, *at_samples, final, period, substeps, solution, offset, work)
        return solution, offset


def moving_target(reference: Reference | None, times: Array) -> tuple[Array, Array]:
    """Return the drift A and the offset c of the error dynamics at the given times, which are changed."""
    # a reference that ends at speed is at rest from its end on, but the horizon is before it
    times[-1] -= 1e-8
    if reference is None:
        velocity = np.zeros((len(times), 8))
    else:
        samples = reference.samples(times)
        pose = samples[:, POSE]
        twist = np.insert(samples[:, TWIST], [0, 3], 0.0, axis=1)
        velocity = algebra.multiply(algebra.conjugate(pose), 0.5 * algebra.multiply(twist, pose))
    return np.ascontiguousarray(algebra.hamilton_minus(velocity)), np.ascontiguousarray(-velocity)


@inline
def _tangent(relative, sign, is_logarithm, error):
    """Write the orientation part of y, 2 a(r) or 2 Im r."""
    for i in range(8):
        relative[i] *= sign
    if is_logarithm:
        half_angle(relative[0:4], error[0:3])
    else:
        for i in range(3):
            error[i] = relative[1 + i]
    for i in range(3):
        error[i] *= 2.0


@inline
def _subtract_feedback(gain, error, twist):
    """Subtract R⁻¹P y."""
    for i in range(6):
        for k in range(6):
            twist[i] -= gain[i, k] * error[k]


@kernel(LAW)
def linear_quadratic_dq(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write q̇ = J⁺ (−R⁻¹P y + Ad(x_e) ξ_d), an inertial twist; y = [2 a(r_e) or 2 Im r_e ; p_e], x_e = x x_d*."""
    m = out.shape[0]
    given, own = twist_feedback(parameters), linear_quadratic_work(work, m)
    relative, error, twist = own.relative, own.error, own.target
    conjugate(sample, own.opposite)
    multiply(pose, own.opposite, relative)
    sign = short_sign(relative[0], given.hysteresis, state)
    _tangent(relative, sign, given.is_logarithm != 0.0, error)
    translation(relative, error[3:6])
    shorten_lever(error, pose, sample, given.inverse)
    desired_twist(sample, pose, twist_jacobian, given.second_order, signed_state(state, m).last, own.desired)
    adjoint_twist(relative, own.desired, twist)
    _subtract_feedback(given.gain, error, twist)
    hand_twist = twist_at_end_effector(twist, pose)
    a, b, c, d, e, f = twist_at_end_effector(error, pose)
    s = -LEVER_CURVES
    missing = s * a, s * b, s * c, s * d, s * e, s * f
    return solve_hand_twist(
        pose, twist_jacobian, hand_twist, missing, own.preferred, given.inverse, own.solver, out
    )


@kernel(LAW)
def linear_quadratic_dq_left(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write q̇ = J⁺ (−R⁻¹P y + Ad(x_l*) ξ_d,b), a body twist; y as for the right error, but of x_l = x_d* x."""
    m = out.shape[0]
    given, own = twist_feedback(parameters), linear_quadratic_work(work, m)
    relative, error, twist = own.relative, own.error, own.target
    desired_twist(sample, pose, twist_jacobian, given.second_order, signed_state(state, m).last, own.desired)
    conjugate_multiply(sample, pose, relative)
    sign = short_sign(relative[0], given.hysteresis, state)
    _tangent(relative, sign, given.is_logarithm != 0.0, error)
    body_translation(relative, error[3:6])
    for i in range(6):
        twist[i] = 0.0
    _subtract_feedback(given.gain, error, twist)
    return solve_left_twist(
        twist, 1.0, pose, twist_jacobian, sample, own.desired, own.preferred, given.inverse, own.solver, out
    )


_DQ_KERNELS = {"right": linear_quadratic_dq, "left": linear_quadratic_dq_left}


class LinearQuadraticDQ(
    FeedforwardLaw, LinearQuadratic, frozen=True, kw_only=True, tag="linear-quadratic-dq"
):
    """LQR in dual quaternion space: q̇ = J_w⁺ (−R⁻¹P(t) y + Ad(x_e) ξ_d), x_e = x x_d*. [P16 3.49, 3.57–3.61]

    y = [θ_e n ; p_e], the error's rotation vector and position. Ṗ = P R⁻¹P − Q, P(t_f) = S, in closed form, for
    piecewise constant weights chained backwards. With scalar weights and the ``log`` form this is the exact optimum of
    the nonlinear pose problem ½s|y_f|² + ½∫(q|y|² + r|u_c|²) dt away from θ = π, u_c the corrective twist; its value is
    ½P(0)|y_0|². With matrices it is optimal only near the target: d|y|²/dt = 2 y·u_c does not carry over to y'Qy. The
    ``sin`` form takes 2 Im r_e for θ_e n: the same for small errors. (The print halves the errors, which runs at κ/2.)
    Without horizon |p_e| and θ_e decay at κ = √(q/r) with ideal joints.

    Sampling limits: the loop gain k is the largest eigenvalue of R⁻¹P(t): √(q/r), but s/r at the end of a horizon.
    With ideal joints kT < 2 is stable and kT ≤ 1 monotone, with one sample of delay kT < 1 and kT ≤ 1/4; for servos
    and physics ask ``dqcontrol check``.

    Choice: as for `LinearQuadraticR8`; diagonal weights give orientation and position rates of their own.

    Parameters
    ----------
    error_weight, control_weight
        Q (semidefinite) and R (definite): number, 6 diagonal entries (orientation, position), 6 × 6, or `Steps`.
    final_weight
        S.
    horizon_time
        t_f, s; the reference's duration if omitted, infinite for a set-point.
    form
        ``"log"`` or ``"sin"``.
    error
        ``"right"`` (as published) or ``"left"``: y and twist in the end effector's axes, x_l = x_d* x. The right
        error's p_e contains the lever arm of the base's origin: with a goal whose orientation cannot be reached, the
        end effector rests that much beside its position. Rates, value and bounds are the same.
    feedforward
        As of `ProportionalFeedforward`.
    inverse
        How J is inverted; the default is exact away from singularities.
    hysteresis
        How far Re(r_e) must pass 0 before the sign of x_e flips.
    null_space
        Motion preferred where the task leaves freedom.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> target = dqc.references.SetPoint(arm.fkm(q + 0.1))
    >>> law = dqc.laws.LinearQuadraticDQ(error_weight=9.0, control_weight=1.0)
    >>> record = dqc.simulate(arm, target, law, dqc.plants.Integrator(), q, 0.01, duration=3.0)
    >>> bool(record.error[-1] < 1e-3 * record.error[0])
    True
    """

    form: Literal["log", "sin"] = "log"
    error: Literal["right", "left"] = "right"
    parameters_before = twist_feedback.place("second_order")
    feedforward: Feedforward = "second-order"
    feedback = twist_feedback

    @property
    def kernel(self) -> Kernel:  # type: ignore[override]
        """The kernel of the error."""
        return _DQ_KERNELS[self.error]

    def _size(self) -> int:
        return 6

    def _own_parameters(self, gains: Array, offsets: Array) -> dict[str, Any]:
        return {"gain": gains, "is_logarithm": float(self.form == "log"), "second_order": np.zeros(0)}

    def riccati_solution(self, weights, controls, final, times, end, reference):
        """Return P at each time in closed form; ξ is 0."""
        solution = riccati.piecewise_solution(weights, controls, final, np.minimum(times, end), end)
        return solution, np.zeros((len(times), 6))
