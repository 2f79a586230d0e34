"""Disturbances of the end effector: twists that nobody commanded. [P16 3.15–3.17]"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike

from dqcontrol.algebra.dual_quaternion_kernels import position, rotated
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, READ, READ2, STATUS, WRITE, Kernel, kernel
from dqcontrol.compiled.intrinsics import ADDRESS
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.errors import DivergedError, ShapeError, ValueRangeError, as_array, as_positive
from dqcontrol.laws.growth import NO_ERROR
from dqcontrol.laws.hand_twist import solve_hand_twist, twist_work
from dqcontrol.laws.inverses import FilteredInverse, inverse_parameters
from dqcontrol.named_fields import NamedFields, Three
from dqcontrol.robots.kinematics.driving import DRIVE_COLUMNS, advance
from dqcontrol.robots.kinematics.kinematics_kernels import call_chain, split
from dqcontrol.robots.robot import Robot

Six = tuple[float, float, float, float, float, float]
_Rms = Annotated[float, Meta(ge=0)]
_SixNotNegative = tuple[_Rms, _Rms, _Rms, _Rms, _Rms, _Rms]

LINES = 64  # sines that a band-limited disturbance is made of
_CHUNK = 4096  # times at once


class DisturbanceSource(NamedFields, frozen=True, kw_only=True, tag_field="kind", forbid_unknown_fields=True):
    """A twist over time."""

    spec_key: ClassVar[str] = "disturbance"

    def values(self, times: Array, seed: list[int]) -> Array:
        """Return the twist at each time, shape (N, 6); the seed draws all chance."""
        raise NotImplementedError

    def highest_frequency(self) -> tuple[str, float]:
        """Return the name of the parameter that limits the frequencies, and the limit in Hz."""
        return "", 0.0


class ConstantTwist(DisturbanceSource, frozen=True, kw_only=True, tag="constant"):
    """The same twist all the time.

    Parameters
    ----------
    value
        [ω ; v], rad/s and m/s.
    """

    value: Annotated[Six, Meta(description="[ω ; v], rad/s and m/s")]

    def values(self, times: Array, seed: list[int]) -> Array:
        """Return the twist at each time, shape (N, 6)."""
        return np.tile(np.asarray(self.value, dtype=np.float64), (len(times), 1))


class SinusoidalTwist(DisturbanceSource, frozen=True, kw_only=True, tag="sinusoidal"):
    """amplitude · sin(2π frequency t + phase).

    Parameters
    ----------
    amplitude
        [ω ; v], rad/s and m/s.
    frequency
        Hz, below half the sampling rate.
    phase
        rad.
    """

    amplitude: Annotated[Six, Meta(description="[ω ; v], rad/s and m/s")]
    frequency: Annotated[float, Meta(gt=0, description="Hz")]
    phase: Annotated[float, Meta(description="rad")] = 0.0

    def values(self, times: Array, seed: list[int]) -> Array:
        """Return the twist at each time, shape (N, 6)."""
        wave = np.sin(2 * math.pi * self.frequency * times + self.phase)
        return wave[:, None] * np.asarray(self.amplitude, dtype=np.float64)

    def highest_frequency(self) -> tuple[str, float]:
        """Return the frequency."""
        return "frequency", self.frequency


class BandLimitedTwist(DisturbanceSource, frozen=True, kw_only=True, tag="band-limited"):
    """Noise with a flat spectrum up to the bandwidth, and nothing above.

    Each of the six numbers is a sum of 64 sines of equal amplitude, with random phases and one random frequency in each
    64th of the band. So it is a function of time that does not depend on the control period, nearly normally
    distributed, and never beyond √128 times its RMS. The RMS is that of a run of many periods of the band,
    64 / bandwidth or more.

    Parameters
    ----------
    rms
        Of each of [ω ; v], rad/s and m/s.
    bandwidth
        Hz, below half the sampling rate.
    seed
        Another one gives another course with the same seed of the run.
    """

    rms: Annotated[_SixNotNegative, Meta(description="of each of [ω ; v], rad/s and m/s")]
    bandwidth: Annotated[float, Meta(gt=0, description="Hz")]
    seed: Annotated[int, Meta(ge=0)] = 0

    def values(self, times: Array, seed: list[int]) -> Array:
        """Return the twist at each time, shape (N, 6)."""
        rng = np.random.default_rng([*seed, self.seed])
        frequency = self.bandwidth * (np.arange(LINES) + rng.random((6, LINES))) / LINES
        phase = 2 * math.pi * rng.random((6, LINES))
        amplitude = math.sqrt(2 / LINES) * np.asarray(self.rms, dtype=np.float64)
        out = np.empty((len(times), 6))
        for first in range(0, len(times), _CHUNK):
            angle = 2 * math.pi * frequency * times[first : first + _CHUNK, None, None] + phase
            out[first : first + _CHUNK] = amplitude * np.sin(angle).sum(axis=2)
        return out

    def highest_frequency(self) -> tuple[str, float]:
        """Return the bandwidth."""
        return "bandwidth", self.bandwidth


AnySource = ConstantTwist | SinusoidalTwist | BandLimitedTwist


class WorstCase(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The constant translation against which the H∞ guarantee on the position is tight. [P16 3.26, corrected]

    A law with |T|² ≤ γ_w²|v_w|² + γ_c²|v_c|² needs the gain k_T = √(γ_w⁻² + γ_c⁻²) at least. Both sides are equal, with
    |T| = level / k_T, where twist and pose source push in one direction with speeds that are as γ_w⁻² to γ_c⁻².

    Parameters
    ----------
    level
        |v_w| + |v_c|, m/s.
    direction
        Inertial axes; its length does not matter.
    gammas
        γ_w and γ_c, s.

    Examples
    --------
    >>> case = WorstCase(level=0.05, direction=(0, 0, 1), gammas=(1.0, 2.0))
    >>> case.shares()
    (0.04, 0.01)
    """

    spec_key: ClassVar[str] = "disturbance.worst_case"
    level: Annotated[float, Meta(gt=0, description="m/s")]
    direction: Annotated[Three, Meta(description="inertial axes")]
    gammas: Annotated[
        tuple[Annotated[float, Meta(gt=0)], Annotated[float, Meta(gt=0)]], Meta(description="γ_w and γ_c, s")
    ]

    def __post_init__(self) -> None:
        if not any(self.direction):
            raise ValueRangeError("disturbance.worst_case.direction: must not be zero")

    def shares(self) -> tuple[float, float]:
        """Return the speeds |v_w| and |v_c|, m/s."""
        twist, pose = (gamma**-2 for gamma in self.gammas)
        return self.level * twist / (twist + pose), self.level * pose / (twist + pose)

    def bound(self) -> float:
        """Return √(γ_w²|v_w|² + γ_c²|v_c|²), the guaranteed |T|, m."""
        return math.hypot(*(gamma * share for gamma, share in zip(self.gammas, self.shares(), strict=True)))


# A robot that is pushed knows nothing of the law's weight between angles and positions, nor of its thresholds: these
# are those of feedback linearisation, whose V measures twists in the same way (docs/laws.md).
_INVERSE = FilteredInverse(threshold=0.02, damping=0.05, characteristic_length=1.0)
ROW = 12  # of a disturbance: inertial twist, then twist of the hand in its own axes

# kinematics, chain, row, parameters, work, q, realised inertial twist
DISTURBANCE = STATUS(ADDRESS, READ2, READ, READ, WRITE, WRITE, WRITE)


class DisturbanceParameters(NamedTuple):
    """What compiled code knows of a disturbed robot."""

    period: float
    inverse: Annotated[Array, inverse_parameters.size()]
    drives: Annotated[Array, ..., DRIVE_COLUMNS]


class DisturbanceWork(NamedTuple):
    """Scratch; nothing is preferred."""

    kinematics: Annotated[Array, "8 + 14 * m"]
    velocity: Annotated[Array, "m"]
    preferred: Annotated[Array, "m"]
    hand: Annotated[Array, 6]
    solver: Annotated[Array, twist_work.sized("m")]


disturbance_parameters: MemoryLayout[DisturbanceParameters] = MemoryLayout(DisturbanceParameters)
disturbance_work: MemoryLayout[DisturbanceWork] = MemoryLayout(DisturbanceWork, "m")


@kernel(DISTURBANCE)
def disturb(kinematics, chain, row, parameters, work, q, realised):
    """Let u = J_h⁺ t act for T with t = [ω ; ṗ] of v_w + Ad(x) w, and write the twist J_w J_h⁺ t that comes of it."""
    n = q.shape[0] - int(chain[q.shape[0], 7])  # inputs
    given = disturbance_parameters(parameters)
    own = disturbance_work(work, n)
    buffer, velocity, hand = own.kinematics, own.velocity, own.hand
    status = call_chain(kinematics, chain, q, buffer)
    if status != OK:
        return status
    pose, _, twist_jacobian = split(buffer)
    px, py, pz = position(buffer)
    ax, ay, az = rotated(buffer, row[6:9])
    vx, vy, vz = rotated(buffer, row[9:12])
    hand[0], hand[1], hand[2] = row[0] + ax, row[1] + ay, row[2] + az
    hand[3] = row[3] - (py * row[2] - pz * row[1]) + vx
    hand[4] = row[4] - (pz * row[0] - px * row[2]) + vy
    hand[5] = row[5] - (px * row[1] - py * row[0]) + vz
    inverse, solver = given.inverse, own.solver
    status = solve_hand_twist(pose, twist_jacobian, hand, NO_ERROR, own.preferred, inverse, solver, velocity)
    if status != OK:
        return status
    for i in range(6):
        realised[i] = 0.0
        for k in range(n):
            realised[i] += twist_jacobian[i, k] * velocity[k]
    advance(given.drives, velocity, given.period, q)
    return OK


class RunningDisturbance:
    """A disturbance at work on one robot; made by `Disturbance.start`.

    Attributes
    ----------
    kernel
        Compiled function of signature `DISTURBANCE`.
    rows
        One a period, or one for all, shape (N, 12): inertial twist, then twist of the hand in its own axes.
    """

    def __init__(self, kernel: Kernel, rows: Array, period: float, input_size: int, drives: Array) -> None:
        self.kernel = kernel
        self.rows: Array = np.ascontiguousarray(rows)
        self.parameters: Array = disturbance_parameters.pack(
            period=period, inverse=_INVERSE.parameters(), drives=drives
        )
        self.work: Array = np.zeros(disturbance_work.size(input_size))

    def step(self, robot: Robot, k: int, q: Array, realised: Array) -> None:
        """Move q, shape (n,), by what acts in period k; write the inertial twist that this gives, shape (6,).

        Raises
        ------
        DivergedError
            If q is not finite.
        """
        row = self.rows[min(k, len(self.rows) - 1)]
        kinematics = robot.kernels.twist_kinematics.pointer
        if self.kernel(kinematics, robot.table, row, self.parameters, self.work, q, realised):
            raise DivergedError("the plant produced NaN or infinity")


class Disturbance(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What moves the end effector beside the command: ẋ = ½(J_w q̇ + v_w + v_c) x, v_c = Ad(x)(2 c*ċ). [P16 3.15–3.17]

    ``twist`` is v_w, a twist of all that carries the end effector. ``pose`` is a real end effector x = x_E c(t) that
    wanders from where the joints say it is, given as the twist 2 c*ċ of c in the end effector's axes.

    Both are realised through the joints: before the plant steps, q moves by T J_h⁺[ω ; ṗ], the smallest move that gives
    the end effector this twist (to first order in T), so that laws and metrics see it as any other motion. With ideal
    joints the end effector drifts with the sum of command and disturbance. A servo pulls its joints back to their
    targets: with integrated commands it gives way by about its time constant times the disturbance, with measured ones,
    whose target follows, it drifts with e^(−T/τ) of it. Near singularities, and for arms of fewer than six joints, the
    end effector gets the part that the joints can make, the nearest in |[ω ; ṗ]|; the record holds what it got.

    Each value is held from its sample to the next.

    Parameters
    ----------
    twist
        v_w = ω + ε(ṗ + p × ω), inertial axes: the last three numbers are the velocity (m/s) of the point at the
        inertial *origin*. Without rotation that is the end effector's; with it, the end effector's is v − p × ω.
    pose
        [ω ; v], rad/s and m/s: rotation about the end effector's own point and velocity of that point, both in the
        hand's axes.
    worst_case
        Both sources at once, in place of the two above.

    Raises
    ------
    ShapeError
        If there is none of them, or a worst case beside others.

    Examples
    --------
    >>> import numpy as np
    >>> wind = Disturbance(twist=ConstantTwist(value=(0, 0, 0, 0.01, 0, 0)))
    >>> wind.samples(np.array([0.0, 0.1]), seed=0)[1, :6].tolist()
    [0.0, 0.0, 0.0, 0.01, 0.0, 0.0]
    """

    spec_key: ClassVar[str] = "disturbance"
    twist: AnySource | None = None
    pose: AnySource | None = None
    worst_case: WorstCase | None = None

    def __post_init__(self) -> None:
        if self.twist is None and self.pose is None and self.worst_case is None:
            raise ShapeError("disturbance: give 'twist', 'pose' or 'worst_case'")
        if self.worst_case is not None and (self.twist is not None or self.pose is not None):
            raise ShapeError("disturbance: 'worst_case' holds both sources; give it alone")

    def samples(self, times: ArrayLike, seed: int = 0) -> Array:
        """Return what acts at each time, shape (N, 12): inertial twist, then twist in the end effector's axes.

        Parameters
        ----------
        times
            Shape (N,), s.
        seed
            Of the run.
        """
        times = as_array("times", times, (None,))
        if times.ndim != 1:
            raise ShapeError(f"times: expected shape (N,), got {times.shape}")
        rows = np.zeros((len(times), ROW))
        for i, source in enumerate((self.twist, self.pose)):
            if source is not None:
                rows[:, 6 * i : 6 * i + 6] = source.values(times, [seed, 1 + i])
        if self.worst_case is not None:
            direction = np.array(self.worst_case.direction, dtype=np.float64)
            rows[:, 3:6] = self.worst_case.level * direction / np.linalg.norm(direction)
        return rows

    def start(self, robot: Robot, period: float, steps: int, seed: int) -> RunningDisturbance:
        """Return the disturbance of a number of periods (s); the seed draws all its chance.

        Raises
        ------
        ValueRangeError
            If a frequency reaches half the sampling rate, where samples no longer show it.
        ShapeError
            If the robot is a whole body with drives in its unconstrained form.
        """
        period = as_positive("period", period)
        if len(robot.drives) and robot.configuration_size == robot.input_size:
            raise ShapeError(
                f"disturbance: needs the constrained form of {robot.name}, because drives do not move sideways; "
                "use in_form('constrained')"
            )
        for name, source in (("twist", self.twist), ("pose", self.pose)):
            field, frequency = source.highest_frequency() if source is not None else ("", 0.0)
            if frequency >= 0.5 / period:
                raise ValueRangeError(
                    f"disturbance.{name}.{field}: must be below half the sampling rate, {0.5 / period:g} Hz, "
                    f"got {frequency:g}"
                )
        rows = self.samples(period * np.arange(steps), seed)
        return RunningDisturbance(disturb, rows, period, robot.input_size, robot.drives)
