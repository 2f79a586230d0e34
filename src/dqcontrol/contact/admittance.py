"""Admittance: how a compliant frame gives way to the wrench that is measured at the hand, in a loop or alone."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, Kernel
from dqcontrol.contact import contact_layout as layout
from dqcontrol.contact.admittance_step import admittance, contact_wrench_at
from dqcontrol.contact.tool import Tool
from dqcontrol.errors import DivergedError, ShapeError, ValueRangeError, as_positive
from dqcontrol.named_fields import NamedFields, Three
from dqcontrol.references.sample import SAMPLE_SIZE
from dqcontrol.references.sequence import Guards


class AdmittanceStage:
    """An admittance with its state.

    Parameters
    ----------
    admittance
        Its parameters.
    period
        T, s.

    Attributes
    ----------
    state
        See ``ContactState``.
    """

    state: layout.ContactState

    def __init__(self, admittance: Admittance, period: float) -> None:
        self._step = admittance.kernel.compiled
        self._parameters = admittance.parameters(as_positive("period", period))
        self._state, self._work = np.zeros(layout.contact_state.size()), np.zeros(layout.contact_work.size())
        self.state = layout.contact_state(self._state)
        self._k = 0

    def contact_wrench(self, pose: Array, wrench: Array) -> Array:
        """Return moment and force on the hand, shape (6,), along the axes of the base or its own, with nothing moved.

        Parameters
        ----------
        pose, wrench
            As for `step`; the tool's weight and bias, and what was tared, are taken off.
        """
        out = np.empty(6)
        contact_wrench_at(pose, self._parameters, wrench, self.state.tare, out)
        return out

    def step(self, pose: Array, sample: Array, wrench: Array) -> Array:
        """Return the sample (21,) that a law follows for one period.

        Parameters
        ----------
        pose
            Of the hand, measured, shape (8,).
        sample
            Desired, shape (21,): pose, twist, twist rate, time.
        wrench
            Force and torque at the sensor that tool and environment exert on the hand, its axes, shape (6,), N and N·m;
            NaN where it says nothing.

        Raises
        ------
        DivergedError
            If the result is not finite.
        """
        self._work[:6] = wrench
        out = self._work[6 : 6 + SAMPLE_SIZE]
        status = self._step(pose, sample, self._k, self._parameters, self._state, self._work)
        self._k += 1
        if status != OK:
            raise DivergedError("contact: the compliant frame is not finite")
        return out.copy()


AXES = {"reference": layout.REFERENCE, "base": layout.BASE, "hand": layout.HAND}
_TURN = 2.0  # rad: a deflection below half a turn keeps its logarithm smooth
_RIGID = "rigid"
_ROUNDING = 1e-6  # of a period: times are sums

NO_GUARDS = Guards()
NEEDS_CONTACT = "reference: 'until' and 'touch' need a force sensor, which 'contact' describes; give it"
NotNegative = Annotated[float, Meta(ge=0)]
Stiffness = NotNegative | Literal["rigid"]
_THREE = Meta(min_length=3, max_length=3)


class Compliance(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """M, D and K of three axes: one number for all, or one an axis.

    Parameters
    ----------
    mass
        M, kg or kg m². Small is best for arms that follow positions: M/D is a lag in the loop (`contact_limits`).
    damping
        D, N·s/m or N·m·s/rad.
    stiffness
        K, N/m or N·m/rad; 0 for none, as force control has, and ``rigid`` for an axis that does not give way.
    """

    spec_key: ClassVar[str] = "contact.translation"
    mass: NotNegative | Annotated[list[NotNegative], _THREE] = 0.0
    damping: NotNegative | Annotated[list[NotNegative], _THREE] = 0.0
    stiffness: Stiffness | Annotated[list[Stiffness], _THREE] = 0.0

    def rows(self, field: str) -> Array:
        """Return [M, D, K] of each axis, shape (3, 3); all 0 of rigid ones.

        Raises
        ------
        ValueRangeError
            If a number is negative, or an axis has neither mass nor damping.
        """
        rows = np.zeros((3, 3))
        for k, name in enumerate(("mass", "damping", "stiffness")):
            given = getattr(self, name)
            each = given if isinstance(given, list) else (given,) * 3
            for i, value in enumerate(each):
                rows[i, k] = math.nan if isinstance(value, str) else float(value)
        for i, axis in enumerate("xyz"):
            if np.isnan(rows[i, 2]):
                rows[i] = 0.0
            elif not rows[i, 0] and not rows[i, 1]:
                raise ValueRangeError(
                    f"contact.{field}: along {axis} mass and damping are both 0; give one, or stiffness: rigid"
                )
        return rows


class ForceReference(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A force over time: linear between given times, held before the first and after the last.

    Parameters
    ----------
    times
        s, increasing.
    values
        N or N·m at each.
    """

    spec_key: ClassVar[str] = "contact.force"
    times: Annotated[list[float], Meta(min_length=1, description="s")]
    values: Annotated[list[float], Meta(min_length=1)]

    def __post_init__(self) -> None:
        if len(self.times) != len(self.values) or (np.diff(self.times) <= 0).any():
            raise ShapeError("contact.force: expected as many values as times, which increase")


Wanted = Annotated[float, Meta(description="N")] | ForceReference
WantedMoment = Annotated[float, Meta(description="N·m")] | ForceReference


class WantedWrench(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the environment is to exert on the hand, by axis; what is left out is not controlled.

    Who pushes along −z wants a force of the environment along +z.
    """

    spec_key: ClassVar[str] = "contact.force"
    x: Wanted | None = None
    y: Wanted | None = None
    z: Wanted | None = None
    mx: WantedMoment | None = None
    my: WantedMoment | None = None
    mz: WantedMoment | None = None

    @property
    def components(self) -> list[Wanted | WantedMoment | None]:
        """In the order of the stage: moments, then forces."""
        return [self.mx, self.my, self.mz, self.x, self.y, self.z]


class ForceSensor(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the force sensor is, how late it is, and what hangs on it.

    Parameters
    ----------
    position, rpy
        As seen from the hand: m, and roll, pitch, yaw, rad.
    filter
        Time constant of its low pass, s.
    tool
        What it carries and its bias; nothing if the wrench has no weight in it. In specs perhaps the name of a file
        that ``dqcontrol identify tool`` wrote.
    tare
        s at the start in which nothing may touch and the reference rests: what the sensor shows then counts as bias.
    """

    spec_key: ClassVar[str] = "contact.sensor"
    position: Annotated[Three, Meta(description="m")] = (0.0, 0.0, 0.0)
    rpy: Annotated[Three, Meta(description="rad")] = (0.0, 0.0, 0.0)
    filter: Annotated[float, Meta(ge=0, description="s")] = 0.0
    tool: Tool | None = None
    tare: Annotated[float, Meta(ge=0, le=60, description="s")] = 0.0

    @property
    def pose(self) -> Array:
        """As seen from the hand, unit dual quaternion (8,)."""
        return algebra.pose(algebra.rotation_from_rpy(self.rpy), self.position)


class DeflectionLimits(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How fast and how far the compliant frame may leave the desired one; not bounded where omitted.

    Parameters
    ----------
    speed, turn_speed
        Along and about each axis, m/s and rad/s.
    depth, turn
        Along and about each axis, m and rad; ``turn`` at most 2 rad, its default.
    """

    spec_key: ClassVar[str] = "contact.limits"
    speed: Annotated[float, Meta(gt=0, description="m/s")] | None = None
    turn_speed: Annotated[float, Meta(gt=0, description="rad/s")] | None = None
    depth: Annotated[float, Meta(gt=0, description="m")] | None = None
    turn: Annotated[float, Meta(gt=0, le=_TURN, description="rad")] = _TURN


class GoesOn(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A hand that goes on by itself where it is led, as on a crank or a door whose axis nobody knows.

    Its compliant frame moves at a speed along the direction in which the hand has been moving; what it holds yields
    along that way and leads it aside along the axes that give way.

    Parameters
    ----------
    speed
        m/s; against what resists it falls by w/D.
    direction
        Where to at first, base axes: some 20° off will do.
    filter
        Time constant of the low pass on the hand's velocity, s.
    """

    spec_key: ClassVar[str] = "contact.goes_on"
    speed: Annotated[float, Meta(gt=0, description="m/s")]
    direction: Annotated[Three, Meta(description="not zero")]
    filter: Annotated[float, Meta(gt=0, description="s")] = 0.25

    def __post_init__(self) -> None:
        if not any(self.direction):
            raise ValueRangeError("contact.goes_on.direction: must not be zero, got [0, 0, 0]")


class LostContact(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """When contact counts as lost, and how fast the force axes then look for it again.

    Parameters
    ----------
    below
        Force, N. Contact is made above twice of it, for three samples.
    after
        For how long, s.
    speed
        Along each axis until contact is made again, m/s; as ``limits.speed`` if omitted.
    """

    spec_key: ClassVar[str] = "contact.lost"
    below: Annotated[float, Meta(gt=0, description="N")] = 0.5
    after: Annotated[float, Meta(gt=0, description="s")] = 0.05
    speed: Annotated[float, Meta(gt=0, description="m/s")] | None = None


class SilentSensor(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What happens when the sensor says nothing, or no number.

    For three samples the last value stands, then force axes rest.

    Parameters
    ----------
    after
        s; from then on the hand retreats along the force that it wanted, or holds where ``retreat`` is 0.
    retreat
        By how much, m.
    speed
        m/s.
    """

    spec_key: ClassVar[str] = "contact.silent"
    after: Annotated[float, Meta(gt=0, description="s")] = 0.05
    retreat: Annotated[float, Meta(ge=0, description="m")] = 0.005
    speed: Annotated[float, Meta(gt=0, description="m/s")] = 0.02


class Admittance(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A stage before any law: the frame that the law follows gives way to the measured wrench.

    M ÿ + D ẏ + K y = w − w_d along each axis, y the deflection from the desired pose, w what the environment exerts and
    w_d what it is to exert; solved exactly over a period. The law gets the pose of the compliant frame, its twist and
    twist rate, so give it one with feed-forward: without, the stiffness that the loop bears is a third. What it bears
    says `contact_limits`.

    Parameters
    ----------
    axes
        In which M, D, K and the force are given: of the ``reference``, of the ``base``, or as the ``hand`` feels them
        (the deflection is then counted along the axes of the reference, which the hand follows).
    sensor
        See `ForceSensor`.
    translation, rotation
        See `Compliance`; ``rigid``: does not give way.
    force
        See `WantedWrench`.
    ramp
        s in which the wanted force grows from what is measured at the start.
    dead_band
        N, along axes without a wanted force: friction for leading by hand.
    goes_on
        See `GoesOn`; only by the reference if omitted.
    limits, lost, silent
        See `DeflectionLimits`, `LostContact`, `SilentSensor`.
    gravity
        m/s² in the base frame, for the tool's weight.
    allow_unstable
        True: runs are not refused against something so stiff that the loop is unstable.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> push = dqc.contact.Admittance(
    ...     translation=dqc.contact.Compliance(damping=200.0, stiffness=["rigid", "rigid", 0.0]),
    ...     force=dqc.contact.WantedWrench(z=2.0), ramp=0.0)
    >>> stage, x = push.start(0.004), dqc.DualQuaternion.from_translation([0.5, 0, 0.3]).vec8
    >>> sample = np.concatenate([x, np.zeros(13)])
    >>> shaped = stage.step(x, sample, np.zeros(6))  # in free air it comes down at 2 N / 200 N·s/m
    >>> float(shaped[13].round(9))
    -0.01
    """

    spec_key: ClassVar[str] = "contact"
    kernel: ClassVar[Kernel] = admittance
    axes: Literal["reference", "base", "hand"] = "reference"
    sensor: ForceSensor = ForceSensor()
    translation: Compliance | Literal["rigid"] = "rigid"
    rotation: Compliance | Literal["rigid"] = "rigid"
    force: WantedWrench = WantedWrench()
    ramp: Annotated[float, Meta(ge=0, description="s")] = 0.5
    dead_band: Annotated[float, Meta(ge=0, description="N")] = 0.0
    goes_on: GoesOn | None = None
    limits: DeflectionLimits = DeflectionLimits()
    lost: LostContact = LostContact()
    silent: SilentSensor = SilentSensor()
    gravity: Annotated[Three, Meta(description="m/s²")] = (0.0, 0.0, -9.81)
    allow_unstable: bool = False

    def __post_init__(self) -> None:
        rows, wanted = self.axis_rows, self.force.components
        for i, name in enumerate(("mx", "my", "mz", "x", "y", "z")):
            if wanted[i] is not None and not rows[i, :2].any():
                raise ValueRangeError(f"contact.force.{name}: is wanted along a rigid axis; let it give way")
        if self.goes_on is not None and not rows[3:, 1].any():
            raise ValueRangeError(
                "contact.goes_on: no axis of 'translation' has damping, along which it could go"
            )
        if not rows[:, :2].any():
            raise ValueRangeError(
                "contact: all axes are rigid; give 'translation' or 'rotation' that gives way"
            )

    @property
    def axis_rows(self) -> Array:
        """[M, D, K] of each axis φx φy φz x y z, shape (6, 3); all 0 of rigid ones."""
        parts = (self.rotation, "rotation"), (self.translation, "translation")
        return np.vstack([np.zeros((3, 3)) if isinstance(p, str) else p.rows(field) for p, field in parts])

    @property
    def rigid(self) -> NDArray[np.bool_]:
        """Which axes φx φy φz x y z do not give way, shape (6,)."""
        return self.axis_rows[:, :2].max(axis=1) == 0.0

    def turned_to_axes(self, vectors: Array, poses: Array, desired: Array) -> Array:
        """Return vectors of the base frame (N, 3) along its own axes, with the poses (N, 8) of hand and reference."""
        if self.axes == "base":
            return vectors
        frame = algebra.matrix_from_pose(desired if self.axes == "reference" else poses)[:, :3, :3]
        return np.einsum("nji,nj->ni", frame, vectors)

    def wanted_forces(self, times: Array) -> dict[str, Array]:
        """Return the wanted force (N) over times (N,), s, of each axis x, y, z that has one."""
        forces = zip("xyz", self.force.components[3:], strict=True)
        return {axis: _over(times, each) for axis, each in forces if each is not None}

    def parameters(self, period: float, guards: Guards = NO_GUARDS) -> Array:
        """Return what the kernel reads, with a period, s, and what of the reference touches end or displace.

        Raises
        ------
        ValueRangeError
            If that are more than eight guarded moves, or one ends by a drop and no force is wanted.
        """
        moves, plane, lead = guards
        if len(moves) > layout.MOST_GUARDS:
            raise ValueRangeError(f"reference: has {len(moves)} guarded moves, at most {layout.MOST_GUARDS}")
        if any(np.isfinite(each.drop) for each in moves) and not any(self.force.components[3:]):
            raise ValueRangeError(
                "reference: 'until.drop' goes by the wanted force, and 'contact.force' has none; give it"
            )
        guarding = np.zeros((layout.MOST_GUARDS, 12))
        for row, each in zip(guarding, moves, strict=False):
            # first rows of it and after
            row[:2] = np.ceil(np.array([each.begin, each.end]) / period - _ROUNDING)
            row[2:4] = each.force, each.drop
            row[4:] = each.pose
        fit = np.zeros(2) if plane is None else np.round(np.array([plane.begin, plane.end]) / period)
        rows, wanted = self.axis_rows, self.force.components
        on = self.goes_on
        direction = np.zeros(3) if on is None else np.array(on.direction) / np.linalg.norm(on.direction)
        tool, sensor, limits, lost = self.sensor.tool or Tool(), self.sensor, self.limits, self.lost
        deepest = np.repeat([limits.turn, limits.depth or np.inf], 3)
        fastest = np.repeat([limits.turn_speed or np.inf, limits.speed or np.inf], 3)
        approach = fastest.copy()
        approach[3:] = min(lost.speed or np.inf, fastest[3])
        return layout.contact_parameters.pack(
            period=period,
            axes=AXES[self.axes],
            sensor=[*algebra.rotation_from_rpy(sensor.rpy), *sensor.position],
            bias=[*tool.force_bias, *tool.torque_bias],
            tare=round(sensor.tare / period),
            tool_mass=tool.mass,
            tool_center=tool.center,
            gravity=self.gravity,
            mass=rows[:, 0],
            damping=rows[:, 1],
            stiffness=rows[:, 2],
            transition=[exact_step(m, d, k, period) for m, d, k in rows],
            forced=[each is not None for each in wanted],
            ramp=round(self.ramp / period),
            dead_band=self.dead_band,
            fastest=fastest,
            approach=approach,
            deepest=deepest,
            touching=2 * lost.below,
            lost=lost.below,
            lost_after=lost.after / period,
            silent_after=self.silent.after / period,
            retreat=self.silent.retreat,
            retreat_speed=self.silent.speed,
            begins=fit[1],
            speed=0.0 if on is None else on.speed,
            direction=direction,
            fresh=0.0 if on is None else -math.expm1(-period / on.filter),
            guarded=len(moves),
            guards=guarding,
            fit=fit,
            lead=lead,
            normal=np.zeros(3) if plane is None else plane.normal,
            origin=np.zeros(3) if plane is None else plane.origin,
            wanted=self._wanted_rows(period),
        )

    def _wanted_rows(self, period: float) -> Array:
        wanted = self.force.components
        ends = [each.times[-1] for each in wanted if isinstance(each, ForceReference)]
        times = period * np.arange(math.ceil(max(ends, default=0.0) / period) + 1, dtype=np.float64)
        return np.column_stack([_over(times, each) for each in wanted])

    def start(self, period: float) -> AdmittanceStage:
        """Return the stage at work, alone, with a period, s."""
        return AdmittanceStage(self, period)


def _over(times: Array, wanted: float | ForceReference | None) -> Array:
    """Return a wanted component over times, 0 where none is."""
    if isinstance(wanted, ForceReference):
        return np.interp(times, np.array(wanted.times), np.array(wanted.values))
    return np.full(len(times), wanted or 0.0)


def exact_step(mass: float, damping: float, stiffness: float, period: float) -> Array:
    """Return [F G] of y and v after a period by y, v and a force that is held, six numbers: the matrix exponential.

    Without mass v is the mean rate.

    Examples
    --------
    >>> exact_step(0.0, 200.0, 0.0, 0.004).tolist()  # 2 N move it by 40 µm
    [1.0, 0.0, 2e-05, 0.0, 0.0, 0.005]
    """
    if mass == 0.0 and damping == 0.0:
        return np.zeros(6)
    if mass == 0.0:
        if stiffness == 0.0:
            return np.array([1.0, 0.0, period / damping, 0.0, 0.0, 1 / damping])
        left = math.exp(-stiffness * period / damping)
        gone = -math.expm1(-stiffness * period / damping)
        return np.array([left, 0, gone / stiffness, -gone / period, 0, gone / stiffness / period])
    from scipy.linalg import expm

    rates = np.array([[0, 1, 0], [-stiffness / mass, -damping / mass, 1 / mass], [0, 0, 0]])
    return np.asarray(expm(rates * period), dtype=np.float64)[:2].ravel()
