"""Arrays of the contact stage, by name: what it is prepared with, remembers and writes."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from numba import types

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ, READ2, STATUS, WRITE
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.references.sample import SAMPLE_SIZE

REFERENCE, BASE, HAND = 0.0, 1.0, 2.0  # whose axes
MOST_GUARDS = 8  # guarded moves of a reference: a box is told by six touches
UNTOUCHED = 16  # status: three touches were to tell a plane, and told none

# measured pose, sample, its number, parameters, state, work; the work begins with the wrench that the host writes
CONTACT = STATUS(READ, READ, types.intp, READ, WRITE, WRITE)
# pose, twist Jacobian, command that left, parameters, state, work
LEFT = STATUS(READ, READ2, READ, READ, WRITE, WRITE)


class ContactParameters(NamedTuple):
    """What the stage is prepared with; axes in the order φx φy φz x y z, as states have them.

    Attributes
    ----------
    period
        T, s.
    axes
        `REFERENCE`, `BASE` or `HAND`.
    sensor
        Of the force sensor as seen from the hand: r (4), p (3).
    bias
        Force and torque that the sensor shows without load, (6,).
    tare
        Periods at the start of which the sensor's mean counts as its bias.
    tool_mass, tool_center, gravity
        Of what hangs on the sensor, kg and m in its axes; m/s² in the base frame.
    mass, damping, stiffness
        Of each axis, which is rigid where both mass and damping are 0.
    transition
        y and v after a period, by y, v and force: rows [F G] of each axis.
    ramp
        Periods in which the wanted wrench grows from what is measured at the start.
    dead_band
        N, in which forces along springy axes count for nothing.
    fastest, approach
        Largest rates of y, (6,), rad/s and m/s: in contact or before the first one, and after contact was lost.
    deepest
        Largest |y|, (6,), rad and m.
    touching, lost
        N: contact is made above one, lost below the other.
    lost_after, silent_after
        Periods.
    retreat, retreat_speed
        m and m/s along the wanted force, once the sensor has been silent for longer.
    begins
        Row from which on axes give way.
    speed, direction, fresh
        Of who goes on where the hand is led: m/s, 0 for none; where to at first, base axes; and what of the hand's
        velocity is taken over in a period.
    guarded, guards
        How many guarded moves there are; of each its first row, the one behind it, the force, N, or the way along the
        wanted one, m, that ends it, and the pose of its planned end.
    fit
        Rows between which three touches displace the plan onto their plane; 0 without such.
    lead
        Delay and lag by which the plan's twists lead, s.
    normal, origin
        Of the plane as planned, inertial frame.
    wanted
        Rows over time of the wrench that the environment is to exert, one a period or one for all.
    """

    period: float
    axes: float
    sensor: Annotated[Array, 7]
    bias: Annotated[Array, 6]
    tare: float
    tool_mass: float
    tool_center: Annotated[Array, 3]
    gravity: Annotated[Array, 3]
    mass: Annotated[Array, 6]
    damping: Annotated[Array, 6]
    stiffness: Annotated[Array, 6]
    transition: Annotated[Array, 6, 6]
    forced: Annotated[Array, 6]
    ramp: float
    dead_band: float
    fastest: Annotated[Array, 6]
    approach: Annotated[Array, 6]
    deepest: Annotated[Array, 6]
    touching: float
    lost: float
    lost_after: float
    silent_after: float
    retreat: float
    retreat_speed: float
    begins: float
    speed: float
    direction: Annotated[Array, 3]
    fresh: float
    guarded: float
    guards: Annotated[Array, MOST_GUARDS, 12]
    fit: Annotated[Array, 2]
    lead: Annotated[Array, 2]
    normal: Annotated[Array, 3]
    origin: Annotated[Array, 3]
    wanted: Annotated[Array, ..., 6]


class ContactState(NamedTuple):
    """What the stage remembers.

    Attributes
    ----------
    y, v
        Deflection [φ ; p] of the compliant frame from the desired one, in task axes, and its rate.
    wrench
        Last known wrench in task axes, moment first as y.
    begun
        The same at the first sample.
    begin
        Number of samples since the start, those of the tare left out.
    tare, tared
        Mean of what the sensor showed in the air, its axes, force first; of how many samples.
    silent
        Samples without a wrench, one after the other.
    above, below
        Samples with a force above the limit of contact, and below that of loss, one after the other.
    touches
        1 in contact.
    losses
        How often contact was lost.
    retreated
        m.
    hits
        Samples with what ends a guarded move, one after the other.
    gone
        How far the compliant frame was where the wanted force pushes it at the begin of a guarded move, m.
    touched, points
        Of each guarded move the row in which it touched, from 1, 0 if it did not, and where the hand was then, m.
    moved, held
        Displacement of the plan by touches so far, and the pose at the last one.
    screw, fitted
        What takes that to the plane of three touches, half a twist; 1 once it is known.
    way, seen
        Velocity of the hand, low-passed, and where it was at the last sample, base axes.
    energy
        What the environment has put into the hand, J.
    """

    y: Annotated[Array, 6]
    v: Annotated[Array, 6]
    wrench: Annotated[Array, 6]
    begun: Annotated[Array, 6]
    begin: Annotated[Array, 1]
    tare: Annotated[Array, 6]
    tared: Annotated[Array, 1]
    silent: Annotated[Array, 1]
    above: Annotated[Array, 1]
    below: Annotated[Array, 1]
    touches: Annotated[Array, 1]
    losses: Annotated[Array, 1]
    retreated: Annotated[Array, 1]
    hits: Annotated[Array, 1]
    gone: Annotated[Array, 1]
    touched: Annotated[Array, MOST_GUARDS]
    points: Annotated[Array, MOST_GUARDS, 3]
    moved: Annotated[Array, 8]
    held: Annotated[Array, 8]
    screw: Annotated[Array, 6]
    fitted: Annotated[Array, 1]
    way: Annotated[Array, 3]
    seen: Annotated[Array, 3]
    energy: Annotated[Array, 1]


class ContactWork(NamedTuple):
    """What the stage reads and writes at each sample.

    Attributes
    ----------
    wrench
        Force and torque at the sensor, its axes, (6,), N and N·m; NaN while it is silent. The host writes it.
    shaped
        The sample that the law follows in place of the desired one.
    planned
        The desired sample, where touches have displaced it to.
    asked, delivered
        Twist [ω ; ṗ] of the hand under what the law asks, before limits and constraints, and under what leaves.
    noted
        1 once the law has asked at this sample.
    back
        What the deflection gave back at this sample, along each axis.
    command
        What the law asked, (m,).
    """

    wrench: Annotated[Array, 6]
    shaped: Annotated[Array, SAMPLE_SIZE]
    planned: Annotated[Array, SAMPLE_SIZE]
    asked: Annotated[Array, 6]
    delivered: Annotated[Array, 6]
    noted: Annotated[Array, 1]
    back: Annotated[Array, 6]
    command: Annotated[Array, ...]


contact_parameters: MemoryLayout[ContactParameters] = MemoryLayout(ContactParameters, unchecked=True)
contact_state: MemoryLayout[ContactState] = MemoryLayout(ContactState, unchecked=True)
contact_work: MemoryLayout[ContactWork] = MemoryLayout(ContactWork, unchecked=True)

WRENCH = 6  # numbers at the begin of the work
CONTACT_STATE: int = contact_state.size()
