"""The compiled loop against the interpreted one, early stops, runs that diverge."""

import re

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.laws import DampedInverse, Proportional, ProportionalFeedforward, Schedule
from dqcontrol.loop import Stop, close_loop
from dqcontrol.plants import Integrator, Servo
from dqcontrol.references import Circle, SetPoint

T = 0.01
Q0 = np.array([0.2, 0.6, 0.1, 1.6, -0.3, 0.9, 0.4])
LAWS = [
    Proportional(gain=5.0),
    Proportional(gain=Schedule([0.1, 0.5], [2.0, 8.0]), inverse=DampedInverse(damping=0.02), hysteresis=0.0),
    ProportionalFeedforward(gain=[3.0, 3, 3, 3, 4, 4, 4, 4]),
]
PLANTS = [
    Integrator(),
    Servo(delay=2 * T, encoder_noise=1e-3, encoder_resolution=1e-4),
    Servo(command_mode="measured", time_constant=0.01, sag=0.1, stiffness=900.0),
]


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


@pytest.fixture(scope="module")
def circle(arm):
    return Circle(arm.fkm(Q0 + 0.02), radius=0.05, duration=2.0)


def loop(arm, law, plant, samples, stop=None, seed=3, **options):
    prepared = law.prepare(arm, None, T)
    return close_loop(prepared, plant.start(arm, Q0, T, len(samples), seed), samples, stop, **options)


@pytest.mark.parametrize("stop", [None, Stop(error=0.02, samples=5)], ids=["to the end", "stop"])
@pytest.mark.parametrize("plant", PLANTS, ids=["integrator", "servo", "sagging"])
@pytest.mark.parametrize("law", LAWS, ids=["K", "K scheduled", "K+FF"])
def test_compiled_and_interpreted_are_equal_to_the_last_bit(arm, circle, law, plant, stop):
    samples = circle.samples(T * np.arange(201))
    fast = loop(arm, law, plant, samples, stop)
    slow = loop(arm, law, plant, samples, stop, interpreted=True)
    assert fast.stopped == slow.stopped == ("settled" if stop else "duration")
    assert len(fast.q) == len(slow.q)
    assert (len(fast.q) == 201) == (stop is None)
    for name in ("q", "measured", "command"):
        assert np.array_equal(getattr(fast, name), getattr(slow, name)), name
    assert np.isfinite(fast.command).all()


def test_rows_are_what_was_before_and_commanded_at_each_sample(arm, circle):
    samples = circle.samples(T * np.arange(50))
    trace = loop(arm, LAWS[0], Integrator(), samples)
    assert np.array_equal(trace.q[0], Q0)
    assert trace.q[1:] == pytest.approx(trace.q[:-1] + T * trace.command[:-1], abs=1e-15)
    state = LAWS[0].prepare(arm, None, T).initial_state(Q0)
    for k in (0, 17, 49):
        sample = dqc.Sample(samples[k, :8], samples[k, 8:14], samples[k, 14:20], samples[k, 20])
        assert LAWS[0].command(arm, trace.q[k], sample, T, state) == pytest.approx(
            trace.command[k], abs=1e-13
        )


@pytest.mark.parametrize("interpreted", [False, True])
def test_the_noise_is_measured_and_does_not_move_the_record_of_truth(arm, circle, interpreted):
    samples = circle.samples(T * np.arange(100))
    trace = loop(arm, LAWS[0], Servo(encoder_noise=1e-3), samples, interpreted=interpreted)
    assert np.array_equal(trace.q[0], trace.measured[0]), "the first sample is exact"
    assert (trace.measured[1:] - trace.q[1:]).std() == pytest.approx(1e-3, rel=0.2)
    other = loop(arm, LAWS[0], Servo(encoder_noise=1e-3), samples, seed=4, interpreted=interpreted)
    assert not np.array_equal(trace.q, other.q)


@pytest.mark.parametrize("interpreted", [False, True])
@pytest.mark.parametrize("count", [1, 2, 50])
def test_stop_after_so_many_consecutive_samples(arm, count, interpreted):
    target = SetPoint(arm.fkm(Q0 + 0.05))
    samples = target.samples(T * np.arange(600))
    whole = loop(arm, LAWS[0], Integrator(), samples)
    poses = arm.fkm(whole.q)
    error = np.linalg.norm(algebra.multiply(algebra.conjugate(poses), samples[:, :8]) - np.eye(8)[0], axis=1)
    assert np.diff(error[:200]).max() < 0
    first = int(np.argmax(error < 1e-3))
    trace = loop(
        arm, LAWS[0], Integrator(), samples, Stop(error=1e-3, samples=count), interpreted=interpreted
    )
    assert trace.stopped == "settled"
    assert len(trace.q) == first + count
    assert np.array_equal(trace.q, whole.q[: first + count])


@pytest.mark.parametrize("interpreted", [False, True])
def test_an_interrupted_settling_counts_anew(arm, interpreted):
    """Two targets in turn, each reached for three samples only: four in a row never come."""
    near, far = arm.fkm(Q0), arm.fkm(Q0 + 0.3)
    samples = SetPoint(near).samples(T * np.arange(40))
    samples[3::4, :8] = far
    law = Proportional(gain=1e-9)
    for count, stopped, length in ((3, "settled", 3), (4, "duration", 40)):
        trace = loop(
            arm, law, Integrator(), samples, Stop(error=1e-3, samples=count), interpreted=interpreted
        )
        assert (trace.stopped, len(trace.q)) == (stopped, length)


@pytest.mark.parametrize("interpreted", [False, True])
def test_a_pose_and_its_negative_settle_alike(arm, interpreted):
    samples = SetPoint(-arm.fkm(Q0)).samples(T * np.arange(10))
    trace = loop(arm, LAWS[0], Integrator(), samples, Stop(error=1e-6, samples=4), interpreted=interpreted)
    assert (trace.stopped, len(trace.q)) == ("settled", 4)


@pytest.mark.parametrize("interpreted", [False, True])
def test_a_command_that_overflows_ends_the_run(arm, interpreted):
    law = Proportional(gain=Schedule([0.0, 0.049, 0.05], [1.0, 1.0, 1.7e308]))
    samples = SetPoint([0, 1, 0, 0, 0, 0, 1e3, 0]).samples(T * np.arange(20))
    trace = loop(arm, law, Integrator(), samples, interpreted=interpreted)
    assert trace.stopped == "diverged at 0.05 s: the command is not finite"
    assert len(trace.q) == len(trace.command) == 5
    assert all(np.isfinite(part).all() for part in (trace.q, trace.measured, trace.command))


@pytest.mark.parametrize("interpreted", [False, True])
def test_joints_that_overflow_end_the_run(slide, interpreted):
    """kT = 1e60 on a sliding joint: the first step leads where no robot goes."""
    samples = SetPoint(slide.fkm([0.1])).samples(T * np.arange(50))
    law = Proportional(gain=1e62).prepare(slide, None, T)
    trace = close_loop(
        law, Integrator().start(slide, np.zeros(1), T, 50, 0), samples, interpreted=interpreted
    )
    assert re.match(r"diverged at 0.0\d* s: a joint went beyond 10000 rad or m", trace.stopped)
    assert len(trace.q) == 1
    assert np.isfinite(trace.q).all()
    assert np.isfinite(trace.command).all()


class Failing:
    """A user's plant whose encoder fails after some steps."""

    def __init__(self, good):
        self.q, self.measured, self.left = Q0.copy(), Q0.copy(), good

    def step(self, command):
        self.left -= 1
        self.q += T * command
        self.measured[:] = self.q if self.left else np.nan


def test_a_users_plant_that_fails(arm, circle):
    samples = circle.samples(T * np.arange(50))
    trace = close_loop(LAWS[0].prepare(arm, None, T), Failing(7), samples)
    assert trace.stopped == "diverged at 0.07 s: the measured configuration is not finite"
    assert len(trace.q) == 7
    assert np.isfinite(trace.measured).all()
    wanted = loop(arm, LAWS[0], Integrator(), samples)
    assert trace.q == pytest.approx(wanted.q[:7], abs=1e-14)


def test_a_users_plant_may_raise_its_own_errors(arm, circle):
    class Refusing(Failing):
        def step(self, command):
            raise ValueRangeError("gripper: must be closed")

    with pytest.raises(ValueRangeError, match="gripper"):
        close_loop(LAWS[0].prepare(arm, None, T), Refusing(7), circle.samples(T * np.arange(5)))


def test_progress_is_told_every_fifty_steps(arm, circle):
    told = []
    samples = circle.samples(T * np.arange(170))
    loop(arm, LAWS[0], Integrator(), samples, interpreted=True, progress=lambda *steps: told.append(steps))
    assert told == [(50, 170), (100, 170), (150, 170)]


@pytest.mark.parametrize("interpreted", [False, True])
def test_parts_that_do_not_fit_together(arm, make_arm, circle, interpreted):
    samples = circle.samples(T * np.arange(20))
    law = LAWS[0].prepare(arm, None, T)
    other = make_arm(6)
    for plant, rows, text in (
        (Integrator().start(other, np.zeros(6), T, 20, 0), samples, r"^plant: expected 7 joints, as the law"),
        (
            Integrator().start(arm, Q0, T, 19, 0),
            samples,
            r"^plant: was started for 19 periods, got 20 samples$",
        ),
        (Integrator().start(arm, Q0, T, 20, 0), samples[:, :20], r"^samples: expected shape \(…, 21\)"),
        (
            Integrator().start(arm, Q0, T, 20, 0),
            samples[0],
            r"^samples: expected shape \(N, 21\), got \(21,\)$",
        ),
    ):
        with pytest.raises(ShapeError, match=text):
            close_loop(law, plant, rows, interpreted=interpreted)
    samples[3, 2] = np.nan
    with pytest.raises(ValueRangeError, match=r"^samples: must be finite"):
        close_loop(law, Integrator().start(arm, Q0, T, 20, 0), samples, interpreted=interpreted)
