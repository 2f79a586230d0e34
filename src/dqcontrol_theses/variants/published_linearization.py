"""Feedback linearisation to the letter of S17: drives taken as if they could move sideways, and its logarithm."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import numpy as np

from dqcontrol.algebra.dual_quaternion_kernels import adjoint_twist, conjugate, log_body, log_inertial
from dqcontrol.arrays import Array
from dqcontrol.compiled import LAW, MemoryLayout, inline, kernel
from dqcontrol.errors import ValueRangeError
from dqcontrol.laws import AnyNullSpace, FeedbackLinearization, LoopRates, parts
from dqcontrol.robots import Robot
from dqcontrol_theses.variants.sideways_drives import (
    feasible_inputs,
    turn_rates,
    twist_jacobian_with_sideways,
)

if TYPE_CHECKING:
    from dqcontrol.references import Reference

LOGARITHMS = ("body", "inertial", "inertial-unguarded")
BODY, INERTIAL, INERTIAL_UNGUARDED = range(3)

# Of the decrease 2 k_v |ξ̃|² of V that the body logarithm has, the inertial one may give up this share: below 1 V still
# decreases; at 0 the inertial logarithm would be left wherever it does worse at all.
_GIVEN_UP = 0.5


class PublishedParameters(NamedTuple):
    """What compiled code knows of these laws.

    Attributes
    ----------
    linear
        That of `FeedbackLinearization`.
    is_commanded
        1 where the last rates are those that were solved for, 0 where those that were sent.
    logarithm
        Place in `LOGARITHMS`.
    drives
        Of those that cannot move sideways, see `drive_table`.
    """

    linear: Annotated[Array, parts.linearization_parameters.size()]
    is_commanded: float
    logarithm: float
    drives: Annotated[Array, "drives", 2]


class PublishedWork(NamedTuple):
    """Their scratch; columns are those of m inputs, and one for each drive that cannot move sideways."""

    preferred: Annotated[Array, "m"]
    jacobian: Annotated[Array, 6, "columns"]
    rates: Annotated[Array, "columns"]
    linear: Annotated[Array, parts.linearization_work.sized("columns")]


published_parameters: MemoryLayout[PublishedParameters] = MemoryLayout(PublishedParameters, "drives")
published_work: MemoryLayout[PublishedWork] = MemoryLayout(PublishedWork, "m", "columns")


@inline
def spring(relative, error_twist, stiffness, damping, logarithm, out):
    """Write k_p log x̃ of the body logarithm with k_p = k̄/2, or of the inertial one as far as V then decreases.

    With the inertial logarithm V̇ = 2 (k̄ A₁ − k_p A₂) − 2 k_v |ξ̃|², and k_p A₂ ≥ k̄ A₁ − s k_v |ξ̃|² leaves
    V̇ ≤ −2 (1 − s) k_v |ξ̃|². Where no k_p between 0 and 4 k̄ does that, the body logarithm takes its place. Unguarded, it
    is k̄ A₁/A₂ whatever that is, and k̄ where A₂ = 0 [S17 4.44].
    """
    log_body(relative, out)
    gain = 0.5 * stiffness
    if logarithm != BODY:
        first, square = 0.0, 0.0
        for i in range(6):
            first += 0.5 * out[i] * error_twist[i]  # A₁ = ⟨L, L̇⟩, the same for both logarithms
            square += error_twist[i] * error_twist[i]
        needed = stiffness * first - _GIVEN_UP * damping * square
        log_inertial(relative, out)
        second = 0.0
        for i in range(6):
            second += out[i] * error_twist[i]  # A₂ = ⟨L, ξ̃⟩
        if logarithm == INERTIAL_UNGUARDED:
            gain = stiffness * first / second if second != 0.0 else stiffness
        elif second > 0.0 and gain * second < needed:
            gain = needed / second
        elif second < 0.0 and gain * second < needed:
            gain = min(gain, needed / second)
        if logarithm == INERTIAL and (
            gain < 0.0 or gain > 4.0 * stiffness or gain * second < needed - 1e-12 * abs(needed)
        ):  # rounding: needed / second · second is needed to some 2⁻⁵³
            log_body(relative, out)
            gain = 0.5 * stiffness
    for i in range(6):
        out[i] *= gain


@inline
def linearize_sideways(pose, twist_jacobian, sample, given, kept, own):
    """Write into ``rates`` z + J⁺ (ξ_b + T U − J z), J with a sideways column for each drive, ξ_b = J q̇(k−1)."""
    m, n = twist_jacobian.shape[1], own.rates.shape[0]
    linear, inner = parts.linearization_parameters(given.linear), parts.linearization_work(own.linear, n)
    twist_jacobian_with_sideways(given.drives, twist_jacobian, own.jacobian)
    for i in range(n):
        inner.preferred[i] = own.preferred[i] if i < m else 0.0
    conjugate(pose, inner.opposite)
    parts.twist_of_inputs(own.jacobian, kept.last, inner.twist)
    adjoint_twist(inner.opposite, inner.twist, kept.twist)
    parts.motion_errors(pose, sample, linear, kept, inner)
    spring(
        inner.relative, inner.error_twist, linear.stiffness, linear.damping, int(given.logarithm), inner.twist
    )
    return parts.solve_rates(pose, own.jacobian, sample, linear, kept, inner, own.rates)


@kernel(LAW)
def published_linearization(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write what drives can do of the rates, and remember what was asked of them or what they do."""
    m, k = out.shape[0], q.shape[0] - out.shape[0]
    given, kept = published_parameters(parameters, k), parts.linearization_state(state, m + k)
    own = published_work(work, m, m + k)
    status = linearize_sideways(pose, twist_jacobian, sample, given, kept, own)
    feasible_inputs(given.drives, own.rates, out)
    if given.is_commanded != 0.0:
        turn_rates(given.drives, out, parts.linearization_parameters(given.linear).period, own.rates)
        for i in range(m + k):
            kept.last[i] = own.rates[i]
    else:
        for i in range(m):
            kept.last[i] = out[i]
    return status


class PublishedLinearization(FeedbackLinearization, frozen=True, kw_only=True, tag="published-linearization"):
    """Feedback linearisation as S17 prints it, u = F J⁺ (ξ_b + T U) with ξ_b = J(q(k)) q̇(k−1). [S17 4.8–4.27]

    It differs from `FeedbackLinearization` in three ways. It solves for ẋ, ẏ and φ̇ as if a base could move sideways,
    and sends what drives can do of that (F, 4.27). The hand's twist is J of now times the last rates, which adds the
    acceleration J̇q̇ to U (4.17). The logarithm may be the printed one. No decay is guaranteed: the hand does not move
    as J⁺ means it to.

    Sampling limits and choice: those of `FeedbackLinearization`.

    Parameters
    ----------
    stiffness, damping, inverse, hysteresis, null_space
        As of `FeedbackLinearization`; as printed there is no null space motion.
    velocity_state
        What the last rates q̇(k−1) are, which the print leaves open: ``"commanded"``, what was solved for, or
        ``"realised"``, what was sent, which loses most of the motion in some directions every sample and hardly arrives
        anywhere.
    logarithm
        ``"body"``, or ``"inertial"`` as S17 prints it (3.13). Its k_p is then k̄/2 as far as V̇ ≤ −k_v |ξ̃|² allows;
        where no k_p in (0, 4k̄) does, that sample takes the body logarithm. ``"inertial-unguarded"``: k_p = k̄ A₁/A₂, and
        k̄ where A₂ = 0, to the letter (4.44).

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> from dqcontrol_theses.variants import PublishedLinearization
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> gains, target = {"stiffness": 9.0, "damping": 3.0}, dqc.Sample(arm.fkm(q + 0.1))
    >>> published = PublishedLinearization(**gains).command(arm, q, target, period=0.01)
    >>> ours = dqc.laws.FeedbackLinearization(**gains, null_space=None).command(arm, q, target, period=0.01)
    >>> np.allclose(published, ours)  # from rest, and without drives
    True
    """

    kernel = published_linearization
    velocity_state: Literal["commanded", "realised"] = "commanded"
    logarithm: Literal["body", "inertial", "inertial-unguarded"] = "body"
    null_space: AnyNullSpace | None = None

    def rows(self, robot: Robot, reference: Reference | None, period: float) -> np.ndarray:
        """Return one row: that of `FeedbackLinearization`, the choices, and the table of drives."""
        drives = parts.drive_table(robot)
        if len(drives) < len(robot.drives) and self.velocity_state == "realised":
            raise ValueRangeError(
                f"velocity_state: 'realised' is for the constrained form of {robot.name}, got the other"
            )
        return published_parameters.pack(
            linear=super().rows(robot, reference, period),
            is_commanded=self.velocity_state == "commanded",
            logarithm=LOGARITHMS.index(self.logarithm),
            drives=drives,
        )

    def loop_rates(self, parameters: np.ndarray) -> LoopRates | None:
        """Return those of `FeedbackLinearization`; None where the logarithm or sideways motion changes them."""
        drives = parameters.shape[1] > published_parameters.size(0)
        return None if self.logarithm != "body" or drives else super().loop_rates(parameters)

    def state_size(self, robot: Robot) -> int:
        """Return room for the sign, the hand's twist and the last inputs, with a sideways speed for each drive."""
        return parts.linearization_state.size(robot.input_size + len(parts.drive_table(robot)))

    def work_size(self, robot: Robot) -> int:
        """Return room for the preferred motion and scratch, with a sideways speed for each drive."""
        return published_work.size(robot.input_size, robot.input_size + len(parts.drive_table(robot)))
