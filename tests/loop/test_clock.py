"""The clock on a time that the tests make pass, and the loop in real time."""

import gc
import os
import threading
from contextlib import suppress

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import Error, RealTimeWarning
from dqcontrol.laws import OwnLaw, Proportional
from dqcontrol.loop import Clock, Stop, close_loop
from dqcontrol.loop.clock import allows_real_time, real_time, threads_of_process
from dqcontrol.plants import Servo
from dqcontrol.references import SetPoint

Q0 = np.array([0.2, 0.6, 0.1, 1.6, -0.3, 0.9, 0.4])
LOOK = 1e-6  # s that a look at the clock takes


class MadeTime:
    """A time that passes only when somebody looks, sleeps or works; sleepers wake late by what is told."""

    def __init__(self, oversleep=0.0):
        self.seconds, self.oversleep, self.slept = 1234.5, oversleep, []

    def now(self):
        self.seconds += LOOK
        return self.seconds

    def sleep(self, seconds):
        assert seconds > 0
        self.slept.append(seconds)
        self.seconds += seconds + self.oversleep

    def work(self, seconds):
        self.seconds += seconds


def paced(time, period, works):
    """Run steps whose command and whose rest take so long each; return the timing."""
    clock = Clock(time.now, time.sleep)
    with clock.running(period, len(works)):
        for command, rest in works:
            clock.await_step()
            time.work(command)
            clock.commanded()
            time.work(rest)
    return clock.timing


def test_deadlines_are_kept_and_do_not_drift():
    timing = paced(MadeTime(), 0.01, [(0.002, 0.003)] * 500)
    assert timing.begin == pytest.approx(0.01 * np.arange(500), abs=3 * LOOK)
    assert timing.begin[1:].min() >= 0.01
    assert timing.computation == pytest.approx(0.002, abs=3 * LOOK)
    assert timing.idle[1:] == pytest.approx(0.005, abs=6 * LOOK)
    assert timing.idle[0] == pytest.approx(0, abs=3 * LOOK)
    assert timing.overruns == 0
    assert len(timing.periods) == 499


@pytest.mark.slow
def test_sleepers_that_wake_late_delay_their_own_step_only():
    time = MadeTime(oversleep=0.0005)
    timing = paced(time, 0.01, [(0.001, 0.0)] * 100)
    late = timing.begin[1:] - 0.01 * np.arange(1, 100)
    assert late.min() >= 0
    assert late.max() < 0.0005
    assert timing.overruns == 0, "the work was done in time"
    assert len(time.slept) == 99, "one sleep a step, none after waking late"


def test_sleepers_that_wake_a_little_late_are_in_time():
    """Sleeping ends before the deadline by more than they oversleep; the rest is spun."""
    timing = paced(MadeTime(oversleep=0.0001), 0.01, [(0.001, 0.0)] * 100)
    assert timing.begin == pytest.approx(0.01 * np.arange(100), abs=3 * LOOK)


@pytest.mark.slow
def test_overruns_are_counted_and_caught_up():
    works = [(0.001, 0.001)] * 20
    works[5] = (0.001, 0.024)  # step 6 is late, and those after it make up for it, a tenth faster
    timing = paced(MadeTime(), 0.01, works)
    assert np.flatnonzero(timing.late).tolist() == [6]
    assert timing.overruns == 1
    assert timing.begin[6] == pytest.approx(0.075, abs=1e-4)
    assert timing.periods[6:] == pytest.approx(0.01 / 1.1, abs=1e-4)
    assert timing.idle[6] == pytest.approx(0, abs=3 * LOOK)
    longer = [*works, *[(0.001, 0.001)] * 20]
    begin = paced(MadeTime(), 0.01, longer).begin
    assert begin[24:] == pytest.approx(0.01 * np.arange(24, 40), abs=3 * LOOK), (
        "and keep their deadlines again"
    )


@pytest.mark.slow
def test_steps_that_always_take_too_long():
    timing = paced(MadeTime(), 0.01, [(0.015, 0.0)] * 10)
    assert timing.overruns == 9
    assert timing.periods == pytest.approx(0.015, abs=1e-4)


@pytest.mark.slow
def test_the_garbage_collector_rests_meanwhile():
    clock = Clock()
    assert gc.isenabled()
    with suppress(KeyError), clock.running(0.01, 1):
        assert not gc.isenabled()
        raise KeyError
    assert gc.isenabled()
    gc.disable()
    try:
        with clock.running(0.01, 1):
            pass
        assert not gc.isenabled(), "what it was before"
    finally:
        gc.enable()


def test_nothing_measured_yet():
    with pytest.raises(Error, match=r"^clock: has paced no loop yet; pass it to close_loop first$"):
        _ = Clock().timing


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def drive(arm, law, plant, samples, **options):
    period = samples[1, -1]
    prepared = law.prepare(arm, None, period)
    return close_loop(prepared, plant.start(arm, Q0, period, len(samples), 0), samples, **options)


def test_the_loop_in_real_time_does_what_it_does_without(arm):
    period = 0.004
    samples = SetPoint(arm.fkm(Q0 + 0.1)).samples(period * np.arange(100))
    clock, plant = Clock(), Servo(delay=2 * period, encoder_noise=1e-4)
    paced_trace = drive(arm, Proportional(gain=10.0), plant, samples, clock=clock)
    trace = drive(arm, Proportional(gain=10.0), plant, samples)
    assert np.array_equal(paced_trace.q, trace.q)
    assert np.array_equal(paced_trace.command, trace.command)
    timing = clock.timing
    assert timing.period == period
    assert len(timing.begin) == len(timing.computation) == len(timing.idle) == 100
    assert (timing.periods > 0).all()
    rounding = 1e-9  # of a clock that counts from when the machine started
    assert (timing.begin >= period * np.arange(100) - rounding).all(), "no step begins early"
    assert (timing.computation > 0).all()
    assert (timing.idle >= 0).all()


@pytest.mark.slow
def test_a_loop_that_ends_early(arm):
    samples = SetPoint(arm.fkm(Q0)).samples(0.001 * np.arange(1000))
    clock = Clock()
    trace = drive(
        arm, Proportional(gain=10.0), Servo(), samples, stop=Stop(error=0.1, samples=5), clock=clock
    )
    assert trace.stopped == "settled"
    assert len(clock.timing.begin) == len(trace.q) == 5
    drive(arm, Proportional(gain=10.0), Servo(), samples[:20], clock=clock)
    assert len(clock.timing.begin) == 20, "a clock can be used again"


def test_the_loop_asks_the_clock_around_the_law(arm):
    """A law that takes 3 ms of made time, in a period of 10 ms."""
    time = MadeTime()

    def slow(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
        time.work(0.003)
        out[:] = 0.0

    samples = SetPoint(arm.fkm(Q0)).samples(0.01 * np.arange(30))
    clock = Clock(time.now, time.sleep)
    with pytest.warns(UserWarning, match="slow"):
        drive(arm, OwnLaw(function=slow), Servo(), samples, clock=clock)
    assert clock.timing.computation == pytest.approx(0.003, abs=1e-4)
    assert clock.timing.begin == pytest.approx(0.01 * np.arange(30), abs=1e-4)
    assert clock.timing.idle[1:] == pytest.approx(0.007, abs=1e-4)
    assert clock.timing.overruns == 0


@pytest.mark.slow
def test_skipped_periods_move_all_deadlines():
    works = [(0.001, 0.001)] * 20
    works[5] = (0.001, 0.024)  # 25 ms: two periods are missed
    made = MadeTime()
    clock = Clock(made.now, made.sleep, overrun="skip")
    with clock.running(0.01, len(works)):
        for command, rest in works:
            assert clock.await_step()
            made.work(command)
            clock.commanded()
            made.work(rest)
    timing = clock.timing
    assert timing.overruns == 1
    expected = 0.01 * (np.arange(20) + 2 * (np.arange(20) > 5))
    assert timing.begin == pytest.approx(expected, abs=3 * LOOK)
    assert timing.computation == pytest.approx(0.001, abs=3 * LOOK)


def test_an_overrun_may_end_the_loop(arm):
    made = MadeTime()

    def slow(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
        made.work(0.003 if sample[-1] < 0.1 else 0.03)
        out[:] = 0.0

    samples = SetPoint(arm.fkm(Q0)).samples(0.01 * np.arange(30))
    clock = Clock(made.now, made.sleep, overrun="stop")
    with pytest.warns(UserWarning, match="slow"):
        trace = drive(arm, OwnLaw(function=slow), Servo(), samples, clock=clock)
    assert trace.stopped == "halted at 0.1 s: the work of a period took 20 ms too long"
    assert len(trace.q) == 11


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"overrun": "skipp"}, "clock.overrun: unknown name 'skipp'; did you mean 'skip'?"),
        ({"priority": 100}, "clock.priority: must be 1 … 99, got 100"),
    ],
)
def test_clocks_that_are_not_allowed(options, message):
    with pytest.raises(Error) as caught:
        Clock(**options)
    assert message in str(caught.value)


@pytest.mark.slow
def test_real_time_scheduling_is_asked_for_and_refusal_is_told(monkeypatch):
    calls = []
    monkeypatch.setattr(os, "sched_getscheduler", lambda pid: 0, raising=False)
    monkeypatch.setattr(os, "sched_getparam", lambda pid: "before", raising=False)
    monkeypatch.setattr(os, "sched_param", lambda priority: priority, raising=False)
    monkeypatch.setattr(os, "sched_setscheduler", lambda *args: calls.append(args), raising=False)
    with Clock(priority=7).running(0.01, 1):
        assert calls == [(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, 7)]
    assert calls[1:] == [(0, 0, "before")]
    assert allows_real_time(7)
    with real_time(7, threads_of_process()):
        assert {call[0] for call in calls if call[2] == 7} >= {threading.get_native_id()}

    def refuse(*args):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse, raising=False)
    assert not allows_real_time(7)
    with (
        pytest.warns(
            RealTimeWarning,
            match=r"priority 7 was refused \(Operation not permitted\); the loop runs without it",
        ),
        Clock(priority=7).running(0.01, 1),
    ):
        pass
