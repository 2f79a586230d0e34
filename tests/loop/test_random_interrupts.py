"""Loops on the clock and robots driven by keys, interrupted, killed or frozen at random moments.

Their robot writes down what it is told, in a process of its own for each trial; what is judged are these words and
their number, not how soon a busy machine lets them come. So many trials as LOSSES in the environment says.
"""

import os
import pty
import select
import signal
import struct
import sys
import time
import traceback
from collections import Counter
from contextlib import nullcontext, suppress

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.cli.live_commands import _drive
from dqcontrol.devices import Jog, Keyboard
from dqcontrol.loop import Clock, Live, Supervision, close_loop
from dqcontrol.loop.clock import allows_real_time, real_time
from dqcontrol.loop.interrupts import first_interrupt
from dqcontrol.loop.targets import Speeds
from dqcontrol.supervisor import Supervisor

TRIALS = int(os.environ.get("LOSSES", "8"))
T, Q0 = 0.01, np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
SPEED = 0.05  # m/s, of the reference and of the keys
PRIORITY = 20  # of real-time scheduling, where that is allowed
STEPS_TO_REST = 10  # 100 ms
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL, signal.SIGSTOP)
WORD = struct.Struct("15d")  # time, joints, command

ARM = dqc.load_robot("iiwa7")
JOGGED, GUARD = dqc.laws.ProportionalFeedforward(gain=2.0), Supervisor(ramp=0.0, acceleration=4.0)


class Robot:
    """Ideal joints that tell a pipe what they are told."""

    def __init__(self, pipe):
        self.q, self.measured, self.pipe = Q0.copy(), Q0.copy(), pipe

    def step(self, command):
        os.write(self.pipe, WORD.pack(time.monotonic(), *self.q, *command))
        self.q = self.q + T * command
        self.measured = self.q.copy()


def prepared():
    """Return what each trial needs, compiled."""
    circle = dqc.references.Circle(ARM.fkm(Q0), radius=0.05, duration=4 * np.pi, turns=2)  # 0.05 m/s
    samples = circle.samples(T * np.arange(1200))
    law = dqc.laws.Proportional(gain=2.0).prepare(ARM, circle, T)
    guard = GUARD.prepare(ARM, T)
    plant = dqc.plants.Integrator().start(ARM, Q0, T, 5, 0)
    close_loop(law, plant, samples[:5], interpreted=True, supervision=Supervision(guard, Q0))
    Live(ARM, JOGGED, dqc.plants.Integrator(), T, start=Q0)
    return law, guard, samples


def drive(kind, pipe, terminal, parts, folder):
    """Be the process that is interrupted."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    law, guard, samples = parts
    robot, priority = Robot(pipe), PRIORITY if allows_real_time(PRIORITY) else None
    if kind == "run":
        clock = Clock(overrun="skip", priority=priority)
        close_loop(law, robot, samples, supervision=Supervision(guard, Q0), clock=clock)
        return
    for stream in (0, 1, 2):
        os.dup2(terminal, stream)
    # Those of pytest are no terminal.
    sys.stdin, sys.stdout = os.fdopen(0, closefd=False), os.fdopen(1, "w", closefd=False)
    live = Live(ARM, JOGGED, robot, T, supervisor=GUARD, speeds=Speeds(2 * SPEED, 0.5))
    driven, keyboard = Jog(live), Keyboard()
    with keyboard, first_interrupt(live.end), real_time(priority) if priority else nullcontext():
        _drive(driven, keyboard, folder)


class Trial:
    """One process that drives, and what its robot was told."""

    def __init__(self, kind, parts, folder):
        self.master, terminal = pty.openpty()
        self.told, pipe = os.pipe()
        self.words, self.kind = b"", kind
        self.child = os.fork()
        if not self.child:
            code = 3
            try:
                drive(kind, pipe, terminal, parts, folder)
                code = 0
            except KeyboardInterrupt:
                code = 1
            except BaseException:
                (folder.parent / "failure").write_text(traceback.format_exc())
            finally:
                os._exit(code)
        os.close(pipe)
        os.close(terminal)

    def watch(self, until, seconds=60.0):
        """Press keys and listen, until something is so or the robot is told no more; return whether it is so."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if until():
                return True
            if self.kind == "jog":
                with suppress(OSError):
                    os.write(self.master, b"w")
            ready = select.select([self.told, self.master], [], [], 0.02)[0]
            if self.master in ready:
                with suppress(OSError):
                    os.read(self.master, 4096)
            if self.told in ready:
                heard = os.read(self.told, 4096)
                if not heard:
                    return until()
                self.words += heard
        return until()

    @property
    def rows(self):
        """What the robot was told: time, joints and command of each period."""
        whole = len(self.words) // WORD.size * WORD.size
        return np.array(list(WORD.iter_unpack(self.words[:whole])))

    @property
    def moves(self):
        return len(self.words) > 20 * WORD.size and self.rows[-1, 8:].any()

    def end(self):
        """Listen to its end, and return its exit code."""
        self.watch(lambda: False)
        code = os.waitstatus_to_exitcode(os.waitpid(self.child, 0)[1])
        os.close(self.told)
        os.close(self.master)
        return code


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="each trial is a fork")
@pytest.mark.parametrize("kind", ["run", "jog"])
def test_interrupted_killed_or_frozen_it_never_leaves_its_robot_moving_nor_lunges(kind, tmp_path):
    seed = time.time_ns() % 100_000
    print("seed", seed)
    rng, parts, steps, ratios, counts = np.random.default_rng(seed), prepared(), [], [], Counter()
    by_itself = 0
    while counts.total() < TRIALS:
        number, pause = SIGNALS[int(rng.integers(len(SIGNALS)))], float(10 ** rng.uniform(-2, 0.0))
        trial = Trial(kind, parts, tmp_path / "black-box")
        if not trial.watch(lambda trial=trial: trial.moves):  # a machine that is too busy stopped it
            by_itself += 1
            code = trial.end()
            assert code != 3, (tmp_path / "failure").read_text()
            assert by_itself < 20 + TRIALS
            continue
        trial.watch(lambda: False, rng.uniform(0.0, 1.5))
        about, at = f"{counts.total()}: {number.name}, pause {pause:.3f} s", len(trial.rows)
        os.kill(trial.child, number)
        if number == signal.SIGSTOP:
            time.sleep(pause)  # what is frozen tells nobody anything
            os.kill(trial.child, signal.SIGCONT)
            if kind == "jog":
                trial.watch(lambda trial=trial: not trial.rows[-1, 8:].any(), 0.3)
            os.kill(trial.child, signal.SIGINT)
        code = trial.end()
        rows = trial.rows
        hand = dqc.algebra.translation(ARM.fkm(np.vstack([rows[:, 1:8], rows[-1:, 1:8] + T * rows[-1:, 8:]])))
        speeds = np.linalg.norm(np.diff(hand, axis=0), axis=1) / T
        ratios.append(speeds[at - 1 :].max(initial=0.0) / max(SPEED, speeds[:at].max()))
        assert ratios[-1] <= 1.1, f"{about}: {ratios[-1]:.3f} times as fast as before"
        counts[number.name] += 1
        print(f"{kind} {about}: {ratios[-1]:.3f} of its speed", flush=True)
        if number == signal.SIGKILL:
            assert code == -9
            continue
        assert code in (0, 1), f"{about}: {code}"
        assert not rows[-1, 8:].any(), f"{about}: told to move in the end"
        gap = np.flatnonzero(np.diff(rows[at - 1 :, 0]) > 0.05)
        if number == signal.SIGSTOP and len(gap) and pause > 0.1:
            after = rows[at + gap[0] :, 8:]
            steps.append(int(np.flatnonzero(after.any(axis=1))[-1]) + 1 if after.any() else 0)
            assert steps[-1] <= STEPS_TO_REST, f"{about}: {steps[-1]} steps to rest"
    print(
        f"{kind}: {dict(counts)}, {by_itself} stopped by themselves before; {len(steps)} freezes end at rest within "
        f"{max(steps, default=0)} steps; hand at most {max(ratios):.3f} of its speed; load {os.getloadavg()[0]:.0f}"
    )
