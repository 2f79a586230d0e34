"""Driving a robot by keys, and keeping the poses that it is brought to."""

from __future__ import annotations

import time
from contextlib import suppress

import numpy as np

from dqcontrol.algebra import translation
from dqcontrol.arrays import Array
from dqcontrol.controller import Controller
from dqcontrol.errors import Error, FallenError
from dqcontrol.loop.black_box import BlackBox
from dqcontrol.loop.control import Control, Phase
from dqcontrol.loop.interrupts import first_interrupt
from dqcontrol.loop.sample_sink import SampleSink
from dqcontrol.loop.supervision import Senses
from dqcontrol.loop.targets import Speeds, TwistTarget
from dqcontrol.plants.live_plant import PlantProtocol, live_plant
from dqcontrol.references.points_writer import PointsWriter
from dqcontrol.supervisor import PreparedSupervisor

# Axis of the twist (linear, then angular) and direction: forward, left, up; turns by the right hand.
MOVES = {
    "w": (0, 1),
    "s": (0, -1),
    "a": (1, 1),
    "d": (1, -1),
    "r": (2, 1),
    "f": (2, -1),
    "l": (3, 1),
    "j": (3, -1),
    "i": (4, 1),
    "k": (4, -1),
    "u": (5, 1),
    "o": (5, -1),
}
END = "q"
HELP = (
    "hold to move   w s  x   a d  y   r f  z     to turn   l j  x   i k  y   u o  z",
    "+ - faster, slower    h axes of hand or base    p keep this pose",
    "space stop    g resume after a stop    q quit, also by c or Ctrl-C",
)
_MOST_BRAKING_STEPS = 100_000
_HOLD = 0.15  # s that one key press lasts: keys held down repeat sooner


class Jog:
    """A plant that keys drive through a law and a supervisor; a key moves the hand while it repeats.

    Parameters
    ----------
    law
        From ``law.prepare``; its reference is not asked.
    supervisor
        From ``supervisor.prepare``, of the law's robot and period.
    plant
        At rest.
    poses
        What keeps poses; none are kept if omitted.
    speeds
        The fastest.
    steps
        For which the plant was started; its noise then repeats.

    Attributes
    ----------
    share
        Of the fastest speeds, that keys ask for.
    of_hand
        Whether they mean the axes of the hand, or those of the base.
    recording
        Gets every step, if there is one; when it cannot be written the robot stops.
    spec
        Text of the experiment that it was made from, kept with its black box.

    Raises
    ------
    ValueRangeError
        If a joint is beyond its limits.
    """

    speeds: Speeds
    share: float
    of_hand: bool

    def __init__(
        self,
        law: Controller,
        supervisor: PreparedSupervisor,
        plant: PlantProtocol,
        poses: PointsWriter | None = None,
        speeds: Speeds | None = None,
        steps: int = 100_000,
    ) -> None:
        self.speeds, self._poses, self._plant, self._steps = (
            speeds or Speeds(),
            poses,
            live_plant(plant),
            steps,
        )
        self._target = TwistTarget(self.speeds, timeout=_HOLD)
        self._control = Control(law, self._target, supervisor)
        self._control.activate(self._plant.measured.copy())
        self._time, self._done, self._dt = 0.0, 0, law.period
        self._senses = Senses(plant, supervisor)
        self.share, self.of_hand, self._ending = 0.5, False, False
        self.recording: SampleSink | None = None
        self.spec = self._fallen = ""

    @property
    def period(self) -> float:
        """Control period of `step`, s."""
        return self._dt

    @property
    def ended(self) -> bool:
        """Whether the robot has come to rest after `end`."""
        return not self._control.is_commanding

    @property
    def pose(self) -> Array:
        """Measured pose of the hand, shape (8,), inertial frame."""
        return self._control.robot.fkm(self._plant.measured)

    @property
    def reason(self) -> str:
        """What the supervisor does, or why the robot stopped."""
        return self._control.reason

    @property
    def condition(self) -> str:
        """What it does, and what the supervisor does about it."""
        words = [self._control.phase.value, self._control.reason, self._fault]
        return ": ".join(word for word in words if word)

    @property
    def status(self) -> str:
        """Where the hand is, what keys mean, and `condition`."""
        x, y, z = translation(self.pose)
        keys = f"{self.share * self.speeds.linear:.2g} m/s {self.share * self.speeds.angular:.2g} rad/s"
        axes = "hand" if self.of_hand else "base"
        return f"x {x:+.3f} y {y:+.3f} z {z:+.3f} m  {keys}  {axes} axes  {self.condition}"

    def press(self, key: str) -> str:
        """Do what a key says; return what there is to tell, if anything. Keys without a meaning do nothing."""
        if key in MOVES:
            self._move(*MOVES[key])
        elif key in ("+", "-"):
            self.share = min(1.0, max(1 / 64, self.share * (2.0 if key == "+" else 0.5)))
        elif key == "h":
            self.of_hand = not self.of_hand
        elif key == " ":
            self._control.emergency_stop()
        elif key in (END, "c"):
            self.end()
        elif key in ("g", "p"):
            try:
                return self._keep() if key == "p" else self._go_on()
            except Error as error:
                return str(error)
        return ""

    def end(self) -> None:
        """Stop softly, and be `ended` then; interrupts may call it."""
        self._ending = True

    def step(self, elapsed: float | None = None) -> None:
        """Move for one period; ``elapsed`` s after the last step, a period if omitted.

        A plant that raises is braked first, as far as it still takes commands.
        """
        try:
            self._step(elapsed)
        except BaseException:
            with first_interrupt(self._control.emergency_stop):
                self.brake()
            raise

    def brake(self) -> None:
        """Stop as hard as the supervisor may, one step after the other, whatever the plant raises."""
        self._control.emergency_stop()
        for _ in range(_MOST_BRAKING_STEPS):
            if self._control.phase is Phase.STOPPED or not self._control.is_commanding:
                return
            time.sleep(self._dt)
            with suppress(Exception):
                self._step(None)

    @property
    def is_stopped(self) -> bool:
        """Whether it was stopped, and holds until it is told to go on."""
        return self._control.phase is Phase.STOPPED

    @property
    def black_box(self) -> BlackBox:
        """Its last seconds."""
        return self._control.black_box

    def _step(self, elapsed: float | None) -> None:
        plant, control = self._plant, self._control
        if self._ending and control.phase is Phase.ACTIVE:
            control.deactivate()
        elif self._ending and control.phase is Phase.STOPPED:
            control.reset()
        if self._fault and control.phase is Phase.ACTIVE:
            control.emergency_stop()
        senses = self._senses
        control.step(self._time, plant.measured.copy(), senses.age, elapsed, senses.effort, senses.wrench)
        if self.recording:
            control.record(self.recording, self._done * self._dt, plant.q)
        self._time, self._done = self._time + self._dt, self._done + 1
        if self._done % self._steps == 0:
            plant.rewind()
        try:
            plant.step(control.command)
        except FallenError as error:  # it lies there, and may be looked at
            self._fallen = str(error)

    @property
    def _fault(self) -> str:
        return self._fallen or self._plant.fault

    def _move(self, axis: int, sign: int) -> None:
        asked = np.zeros((2, 3))
        speed = (self.speeds.linear, self.speeds.angular)[axis // 3]
        asked[axis // 3, axis % 3] = sign * self.share * speed
        self._target.ask(self._control.time, asked[0], asked[1], of_hand=self.of_hand)

    def _keep(self) -> str:
        if self._poses is None:
            return "no file for poses"
        joints = ", ".join(f"{angle:.6g}" for angle in self._plant.measured)
        count = self._poses.add(self.pose, f"start: [{joints}]")
        return f"pose {count} kept in {self._poses.path}"

    def _go_on(self) -> str:
        self._control.reset()
        self._control.activate(self._plant.measured.copy())
        self._time = 0.0
        return "resumed"
