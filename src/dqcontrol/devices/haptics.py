"""Two arms that feel each other: one goes where the other is led, which feels what the first one touches."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import msgspec
import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.contact import ContactLimits, LoosePart, contact_limits
from dqcontrol.errors import ValueRangeError, as_positive
from dqcontrol.loop.live import Live
from dqcontrol.loop.targets import LeaderTarget
from dqcontrol.plants.servo import Servo


class Haptics:
    """A leader and a follower, stepped together: pose there, wrench back, after a delay each way.

    Both move alike in the room, from where they are at the begin: p_f − p_f0 = p_l − p_l0, the follower no faster than
    its ``speeds``. The leader's law has a
    contact without stiffness, so that it goes where it is pushed; it feels ``force_scale`` times what the environment
    exerts on the follower beside what its own sensor measures, and rests where both are in balance.

    Parameters
    ----------
    leader
        Its law has ``contact``.
    follower
        Its plant measures a wrench; the same period.
    force_scale
        Newtons at the leader for one at the follower.
    delay
        s each way, in whole periods.

    Attributes
    ----------
    push
        What a hand that no sensor of the leader feels exerts on it, force and torque, axes of the room, shape (6,): for
        simulations.

    Raises
    ------
    ValueRangeError
        If the leader has no contact, the follower no wrench, periods differ, or a number is negative.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), [0, 0.6, 0, -1.6, 0, 0.9, 0]
    >>> soft = dqc.contact.Admittance(axes="base", translation=dqc.contact.Compliance(damping=100.0))
    >>> law, servo = dqc.laws.ProportionalFeedforward, dqc.plants.Servo(time_constant=0.02, wrist=dqc.plants.Wrist())
    >>> leader = dqc.loop.Live(arm, law(gain=1.0, contact=soft), servo, 0.004, start=q)
    >>> follower = dqc.loop.Live(arm, law(gain=1.0), servo, 0.004, start=q)
    >>> both = dqc.devices.Haptics(leader, follower)
    >>> both.push[0] = -5.0  # N, for a second: by 5 N / 100 N·s/m both go at 5 cm/s, less while they set off
    >>> for _ in range(250):
    ...     both.step()
    >>> x = dqc.algebra.translation(arm.fkm(np.array(q)))[0]
    >>> [round(float(dqc.algebra.translation(live.state.pose)[0] - x), 2) for live in (leader, follower)]
    [-0.04, -0.04]
    """

    leader: Live
    follower: Live
    push: Array

    def __init__(self, leader: Live, follower: Live, force_scale: float = 1.0, delay: float = 0.0) -> None:
        if leader.law.contact is None:
            raise ValueRangeError("leader: its law has no contact, so that it feels nothing; give it one")
        if not len(follower.plant.wrench):
            raise ValueRangeError(
                "follower: its plant measures no wrench; give it a force sensor, as a 'wrist'"
            )
        if leader.period != follower.period:
            raise ValueRangeError(
                f"follower: has a period of {follower.period:g} s, the leader {leader.period:g} s; give both the same"
            )
        self.leader, self.follower, self.push = leader, follower, np.zeros(6)
        self._scale = as_positive("force_scale", force_scale)
        self._delay = round(as_positive("delay", delay, zero_allowed=True) / leader.period)
        self._sent = deque([leader.state.pose] * self._delay)
        self._delayed = deque([np.zeros(6)] * self._delay)
        self._target = LeaderTarget(follower.speeds)
        self._target.start(follower.state.pose, follower.control.time)
        follower.control.target = self._target

    def step(self) -> None:
        """Move both for one period."""
        leader, follower = self.leader, self.follower
        pose, hand = (live.robot.fkm(live.plant.measured) for live in (leader, follower))
        self._sent.append(pose)
        self._delayed.append(_turned(follower.plant.wrench, hand))
        self._target.ask(follower.control.time, self._sent.popleft())
        leader.pushed = _turned(self.push + self._scale * self._delayed.popleft(), algebra.conjugate(pose))
        leader.step()
        follower.step()

    def limits(self, environment: float = 1e4) -> ContactLimits:
        """Return what the leader's contact bears of what the follower touches; see `contact_limits`.

        The follower's lag and both ways of signals count as a delay of the leader's joints; give the filter of the
        follower's sensor as that of the leader's ``contact.sensor``.
        A scaled force is that of a stiffness scaled alike.
        """
        leader, (later, delay) = self.leader, self.follower.lag.mean
        time, own = leader.lag.mean
        late = own + later + delay + (2 * self._delay + 1) * leader.period
        contact = leader.law.contact
        assert contact is not None
        law = msgspec.structs.replace(leader.law, contact=None).prepare(leader.robot, None, leader.period)
        found = contact_limits(
            contact, law, Servo(time_constant=time, delay=late), leader.state.q, self._scale * environment
        )
        part = found.loose_part
        return replace(
            found,
            stiffness=found.stiffness / self._scale,
            loose_part=LoosePart(part.stiffness / self._scale, part.mass),
        )


def _turned(wrench: Array, pose: Array) -> Array:
    """Return force and torque along the axes of a pose's frame as those outside of it."""
    turn = algebra.matrix_from_pose(pose)[:3, :3]
    return np.concatenate([turn @ wrench[:3], turn @ wrench[3:]])
