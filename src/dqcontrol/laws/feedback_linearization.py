"""Feedback linearisation of the hand's motion: the pose error behaves like a damped spring, whatever the robot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar, get_args

import numpy as np
from msgspec import Meta

from dqcontrol.compiled.compile import kernel
from dqcontrol.errors import ValueRangeError, unknown_name
from dqcontrol.laws.inverses import FilteredInverse, Inverse
from dqcontrol.laws.law import LAW, Law
from dqcontrol.laws.linearization import (
    COMMANDED,
    REALISED,
    Logarithm,
    VelocityState,
    linearization_parameters,
    linearization_state,
    linearization_work,
    linearize,
)
from dqcontrol.laws.loop_rates import LoopRates
from dqcontrol.laws.null_space import AnyNullSpace, BestHeading
from dqcontrol.laws.pose_inverse import DampedPoseInverse
from dqcontrol.laws.pose_law import checked_hysteresis
from dqcontrol.laws.unconstrained_drive import drive_table, feasible_inputs, turn_rates
from dqcontrol.robots import Robot

if TYPE_CHECKING:
    from dqcontrol.references import Reference


@kernel(LAW)
def feedback_linearization(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write what drives can do of z + J⁺ (ξ_b + T U − J z), and remember what was asked of them or what they do."""
    m, k = out.shape[0], q.shape[0] - out.shape[0]
    given = linearization_parameters(parameters, k)
    velocity_state = int(given.velocity_state)
    n = m if velocity_state == REALISED else m + k
    kept, own = linearization_state(state, n), linearization_work(work, m, n)
    status = linearize(pose, twist_jacobian, sample, given, kept, own)
    feasible_inputs(given.drives[0 : n - m], own.rates, out)
    if velocity_state == COMMANDED:
        turn_rates(given.drives, out, given.period, own.rates)
        for i in range(n):
            kept.last[i] = own.rates[i]
    else:
        for i in range(m):
            kept.last[i] = out[i]
    return status


# V measures a body twist by |[ω ; ṗ]|, so what cannot be done must be missed by the least of just that: then V falls
# at the rate proven in regulation also where J has lost rank, with another ℓ it may rise.
IN_BODY_TWISTS = FilteredInverse(threshold=0.02, damping=0.05, characteristic_length=1.0)


class FeedbackLinearization(Law, frozen=True, kw_only=True, tag="feedback-linearization"):
    """Make the hand move like a damped spring towards its desired pose. [S17 4.8–4.27, Wang and Yu 2013]

    With x̃ = x_d* x (the short way), its logarithm log x̃ = θ/2 n + ε½p̃_b and ξ̃ = ξ_b − Ad(x̃*) ξ_d,b:

    U = −k_p log x̃ − k_v ξ̃ + Ad(x̃*) ξ̇_d,b + (Ad(x̃*) ξ_d,b) × ξ̃,   u = z + J⁺ (ξ_b + T U − J z),   k_p = k̄/2.

    J is the Jacobian of body twists and ξ_b the hand's body twist, which the law remembers: J u of the last sample, 0
    at the start. So a robot that takes velocities is driven by accelerations: the first command is of the size of T U,
    however large the error.

    Guarantee: dξ̃/dt = −k_p log x̃ − k_v ξ̃, and V = |ξ̃|² + k̄ |log x̃|² falls at V̇ = −2 k_v |ξ̃|², for goals at
    rest and moving ones: asymptotically stable from everywhere but half a turn away. About a fixed axis, and for
    translations, θ̈ + k_v θ̇ + k̄/4 θ = 0. This holds in continuous time and where J⁺ is exact: at singularities the
    twist asked for does not lie in the range of J, and the hand may stay there, which S17 leaves open. `BestHeading`,
    the default, keeps drives out of those that their heading can avoid.

    S17's k_p = k̄ A₁/A₂, A₁ = ⟨log x̃, d log x̃/dt⟩, A₂ = ⟨log x̃, ξ̃⟩, is k̄/2 identically if the logarithm is taken
    with p̃ in the hand's axes; as printed, with p̃ in those of the desired pose, it is unbounded and may be negative.

    Sampling limits: with ideal joints stable for 0 < k_v T < 2 and (k̄/4) T² < 4 − 2 k_v T. V may rise by O(T²) a
    sample. Delays and lags are not in the loop of the velocity; they should be short against 1/k_v.

    Choice: ω_n = √k̄/2 is the natural frequency, ζ = k_v/√k̄ the damping ratio. k_v = √k̄ is critical, the fastest
    without overshoot: the error falls to 2 % in 5.8/ω_n. With much more k_v it decays at k̄/(4 k_v).

    Parameters
    ----------
    stiffness
        k̄ (k̄_p in S17), 1/s².
    damping
        k_v, 1/s.
    inverse
        How J is inverted; the default is exact where singular values exceed 0.02. Its ℓ is 1 m, unlike that of other
        laws: where J has lost rank, P the projection onto its range, V̇ = −2 k_v |ξ̃|² of a goal at rest needs ⟨ξ_b, P
        U⟩ = ⟨ξ_b, U⟩, which least squares in |[ω ; ṗ]| alone, V's own measure, gives. Without a null space motion the
        damping acts once a sample on the velocity itself: a `DampedInverse` is then friction σ²/(σ² + λ²) everywhere,
        more of it the shorter the period, and so is the `DampedPoseInverse` that S17 prints (4.19).
    hysteresis
        How far Re(x̃) must pass 0 before its sign flips.
    velocity_state
        ``"realised"``: ξ_b as above, with J the Jacobian of v, ω and q̇. S17 solves for ẋ, ẏ and φ̇ as if a base could
        move sideways, sends what drives can do of it (F, 4.27), and takes ξ_b = J(q(k)) q̇(k−1), which adds the
        acceleration J̇q̇ to U (4.17). Its q̇ is then either that solution, ``"commanded"``, or what was sent,
        ``"realised-unconstrained"``, which loses most of the motion in some directions every sample and hardly arrives
        anywhere: the print leaves open which is meant.
    logarithm
        ``"body"``, or ``"inertial"`` as S17 prints it (3.13). Its k_p is then k̄/2 as far as V̇ ≤ −k_v |ξ̃|² allows;
        where no k_p in (0, 4k̄) does, that sample takes the body logarithm. ``"inertial-unguarded"``: k_p = k̄ A₁/A₂, and
        k̄ where A₂ = 0, to the letter (4.44).
    null_space
        Motion preferred where the task leaves freedom. The inputs come to it at the rate k_v: z = u⁻ + k_v T (z₀ − u⁻)
        with the last inputs u⁻ and the preferred ones z₀, so that they start smoothly too, and singularities hold up
        accelerations but do not brake. With None, as published, the smallest inputs are taken: u = J⁺ (ξ_b + T U).

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> robot = dqc.load_robot("little-john")
    >>> q = np.array([0, 0, 0, 0.3, -0.8, 1.2, 0.6, 0.4])
    >>> target = dqc.Sample(robot.fkm(robot.integrate(q, [0.2, 0.1, 0, 0, 0, 0, 0], 1.0)))
    >>> law = dqc.laws.FeedbackLinearization(stiffness=1.0, damping=1.0).prepare(robot, None, dt=0.05)
    >>> state = law.initial_state(q)
    >>> for _ in range(400):
    ...     q = robot.integrate(q, law.command(q, target, state), law.dt)
    >>> float(np.abs(robot.fkm(q) - target.pose).max()) < 1e-3
    True
    """

    kernel = feedback_linearization
    gain_powers: ClassVar[Mapping[str, float]] = {"stiffness": 2, "damping": 1}
    stiffness: Annotated[float, Meta(gt=0, description="k̄, 1/s²")]
    damping: Annotated[float, Meta(gt=0, description="k_v, 1/s")]
    inverse: Inverse | DampedPoseInverse = IN_BODY_TWISTS
    hysteresis: Annotated[float, Meta(ge=0, lt=1)] = 0.2
    velocity_state: VelocityState = "realised"
    logarithm: Logarithm = "body"
    null_space: AnyNullSpace | None = BestHeading()

    def rows(self, robot: Robot, reference: Reference | None, dt: float) -> np.ndarray:
        """Return one row: inverse, hysteresis, period, gains, choices, and the table of drives."""
        for field, value, names in (
            ("velocity_state", self.velocity_state, VelocityState),
            ("logarithm", self.logarithm, Logarithm),
        ):
            if value not in get_args(names):
                raise unknown_name(field, str(value), get_args(names))
        drives = drive_table(robot)
        if len(drives) < len(robot.drives) and self.velocity_state == "realised-unconstrained":
            raise ValueRangeError(
                f"velocity_state: {self.velocity_state!r} is for the constrained form of {robot.name}, got the other"
            )
        return linearization_parameters.pack(
            inverse=self.inverse.parameters(),
            hysteresis=checked_hysteresis(self.hysteresis),
            period=dt,
            stiffness=self.stiffness,
            damping=self.damping,
            velocity_state=get_args(VelocityState).index(self.velocity_state),
            logarithm=get_args(Logarithm).index(self.logarithm),
            smooth=self.null_space is not None,
            drives=drives,
        )[None]

    def loop_rates(self, parameters: np.ndarray) -> LoopRates | None:
        """Return k̄/(4 k_v) behind a lag of k_v; None where the logarithm or sideways motion changes them."""
        drives = parameters.shape[1] > linearization_parameters.size(0)
        if self.logarithm != "body" or (self.velocity_state != "realised" and drives):
            return None
        rates = np.full(len(parameters), self.stiffness / (4 * self.damping))
        return LoopRates(rates, rates, lag=self.damping)

    def state_size(self, robot: Robot) -> int:
        """Return room for the sign, the hand's twist and the last inputs, with a sideways speed for each drive."""
        return linearization_state.size(robot.input_size + len(drive_table(robot)))

    def work_size(self, robot: Robot) -> int:
        """Return room for scratch, with a sideways speed for each drive."""
        return linearization_work.size(robot.input_size, robot.input_size + len(drive_table(robot)))
