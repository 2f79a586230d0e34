"""Law and supervisor in the hands of messages that get lost, come late, twice and in disorder: no limit is crossed."""

import numpy as np
import pytest

from dqcontrol.algebra import translation
from dqcontrol.errors import Error
from dqcontrol.loop.control import Control, Phase
from dqcontrol.ros2.diagnostics import PeriodMonitor
from dqcontrol.ros2.loading import load
from dqcontrol.ros2.messages import NANOSECONDS, RefusedError, Stamps

SPEC = {
    "name": "tiny", "robot": "iiwa7", "start": [0, 0.6, 0, 1.6, 0, 0.6, 0], "period": 0.01,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 1.0},
    "law": {"kind": "proportional", "gain": 5}, "plant": {"kind": "servo"},
}  # fmt: skip


@pytest.fixture(scope="module")
def loaded():
    return load(SPEC)


def control_of(loaded, interface="velocity"):
    return Control(loaded.prepared_law("spec"), loaded.target("spec"), loaded.prepared_supervisor(interface))


def drive(loaded, control, steps):
    plant = loaded.case.plant.start(loaded.robot, loaded.case.scene.start, loaded.period, steps, 0)
    control.activate(plant.measured.copy())
    for k in range(steps):
        control.step(k * loaded.period, plant.measured.copy(), 0.0)
        if not control.is_commanding:
            return k
        plant.step(control.command)
    return steps


def test_follows_to_the_end_and_stops_softly(loaded):
    control = control_of(loaded)
    steps = drive(loaded, control, 400)
    assert 101 <= steps < 200  # one second and the soft stop
    assert (control.phase, control.reason) == (Phase.INACTIVE, "soft stop")
    assert not control.command.any()
    assert drive(loaded, control, 50) == 50  # and once more
    assert control.phase is Phase.ACTIVE


def test_an_emergency_stop_holds_until_reset(loaded):
    control = control_of(loaded)
    drive(loaded, control, 40)
    control.emergency_stop()
    for k in range(40, 80):
        control.step(k * 0.01, loaded.case.scene.start, 0.0)
    assert (control.phase, control.is_commanding) == (Phase.STOPPED, True)
    assert "emergency stop" in control.reason
    assert not control.rate.any()
    with pytest.raises(Error, match="is stopped, not inactive"):
        control.activate(loaded.case.scene.start)
    control.reset()
    assert (control.phase, control.is_commanding) == (Phase.INACTIVE, False)


def test_an_emergency_stop_keeps_an_inactive_controller_from_starting(loaded):
    control = control_of(loaded)
    drive(loaded, control, 400)
    assert control.stop_category is None
    control.emergency_stop()
    assert control.stop == "stop category 1: emergency stop"
    with pytest.raises(Error, match="stopped"):
        control.activate(loaded.case.scene.start)
    for act in (control.deactivate, control_of(loaded).reset):
        with pytest.raises(Error):
            act()


def test_measurements_that_are_no_numbers_stop_it(loaded):
    control = control_of(loaded)
    drive(loaded, control, 40)
    for k in range(40, 80):
        control.step(k * 0.01, np.full(7, np.nan), 0.0)
        assert np.isfinite(control.command).all()
    assert control.phase is Phase.STOPPED
    assert control.stop == "stop category 1: measurement stale or impossible"
    assert len(control.black_box.record(control.stop)) == 80


def test_bursts_never_give_more_steps_than_periods():
    rng = np.random.default_rng(3)
    for _ in range(50):
        pace, times = PeriodMonitor(0.01), np.sort(rng.uniform(0, 2, 600))
        pace.start(0.0, 0.0)
        taken = [t for t in times if pace.hear(t, t)]
        steps = np.arange(len(taken))
        for first in (0, 20, 50):  # from any of them on
            late = np.array(taken[first:]) - taken[first]
            assert (steps[: len(late)] <= late / 0.01 + 1.5).all()


@pytest.mark.parametrize("interface", ["velocity", "position"])
def test_no_limit_is_crossed_whatever_the_messages_do(loaded, interface):
    """Both directions lose, delay, double and swap messages; 40 random links of 1.5 s each."""
    limits, period = loaded.robot.limits, loaded.period
    acceleration = loaded.supervisor.acceleration
    for seed in range(40):
        rng = np.random.default_rng([seed, 7])
        loss, delay, twice = rng.uniform(0, 0.5), rng.uniform(0, 0.06), rng.uniform(0, 0.5)
        control, pace, stamps = control_of(loaded, interface), PeriodMonitor(period), Stamps("joint states")
        guard, from_measured = loaded.limits_alone(interface)
        state = guard.start(loaded.case.scene.start)
        plant = loaded.case.plant.start(loaded.robot, loaded.case.scene.start, period, 200, 0)
        up, down = [], []  # (time of arrival, what)
        asked, out = None, np.zeros(7)
        before, rate_before = guard.position(state).copy(), np.zeros(7)
        for tick in range(150):
            for now in (tick * period + 0.001, tick * period + 0.006):
                for _, (stamp, q) in sorted((m for m in up if m[0] <= now), key=lambda m: m[0]):
                    try:
                        stamps.check(int(stamp * NANOSECONDS))
                    except RefusedError:
                        continue
                    if control.phase is Phase.INACTIVE:
                        control.activate(q)
                        pace.start(now, stamp)
                    elif control.is_commanding and pace.hear(now, stamp):
                        control.step(stamp, q, pace.age(now))
                        send(rng, down, now, control, interface, (loss, delay, twice))
                up = [m for m in up if m[0] > now]
                if control.is_commanding and pace.is_overdue(now):
                    control.step(now, None, pace.age(now))
                    send(rng, down, now, control, interface, (loss, delay, twice))
                if control.is_commanding:
                    assert (np.abs(control.rate) <= limits.velocity * (1 + 1e-12)).all(), seed
                    assert np.isfinite(control.position).all()
            for _, what in sorted((m for m in down if m[0] <= now), key=lambda m: m[0]):
                asked = what
            down = [m for m in down if m[0] > now]
            position = guard.position(state)
            wanted = np.zeros(7) if asked is None else asked
            if interface == "position":
                goal = position if asked is None else asked
                wanted = (goal - (plant.measured if from_measured else position)) / period
            guard.step(plant.measured, wanted, state, 0.0, 0, out)
            plant.step(out)
            rate = (guard.position(state) - before) / period
            assert (np.abs(rate) <= limits.velocity * (1 + 1e-9)).all(), seed
            assert (np.abs(rate - rate_before) <= acceleration * period * (1 + 1e-6) + 1e-9).all(), seed
            assert ((plant.q >= limits.lower) & (plant.q <= limits.upper)).all(), seed
            before, rate_before = guard.position(state).copy(), rate
            for _ in range(1 + (rng.random() < twice)):
                if rng.random() >= loss:
                    up.append(
                        ((tick + 1) * period + rng.exponential(delay), (tick * period, plant.measured.copy()))
                    )


def send(rng, down, now, control, interface, faults):
    loss, delay, twice = faults
    what = (control.rate if interface == "velocity" else control.position).copy()
    for _ in range(1 + (rng.random() < twice)):
        if rng.random() >= loss:
            down.append((now + rng.exponential(delay), what))


def test_a_clock_of_another_speed_does_not_make_messages_old_and_a_queue_that_fills_does():
    for drift, age in ((2e-4, 0.0), (-2e-4, 0.0), (-5e-3, 0.4)):  # s a second; the last one is a queue
        pace = PeriodMonitor(0.01)
        now = 0.0
        pace.start(now, 1000.0)
        for k in range(1, 10_000):
            now = 0.01 * k
            pace.hear(now, 1000.0 + now * (1 + drift))
        assert pace.age(now) == pytest.approx(age, abs=1e-3), drift


@pytest.fixture(scope="module")
def driving():
    base = {
        "robot": "little-john",
        "start": [0.2, -0.1, 0.4, 0, -0.9, 0.9, 0.9, 0],
        "period": 0.05,
        "reference": {"kind": "circle", "radius": 0.1, "duration": 8.0},
        "law": {"kind": "feedback-linearization", "stiffness": 2.0, "damping": 2.0},
        "plant": {"kind": "integrator"},
        "supervisor": {"stale_after": 1.0, "frozen_after": 1.0},
    }
    return load(SPEC | base)


@pytest.mark.parametrize(("lost", "steps_without"), [(0.05, False), (0.05, True), (0.2, True)])
def test_a_base_that_rolls_on_without_messages_follows_nearly_as_well(driving, lost, steps_without):
    """Some are lost at random; either nothing is done then, or a step is taken without one."""
    means, draw = [], np.random.default_rng(0)
    for share in (0.0, lost):
        law, supervisor = driving.prepared_law("spec"), driving.prepared_supervisor("velocity")
        control = Control(law, driving.target("spec"), supervisor, driving.longest_advance)
        q, errors = driving.case.scene.start.copy(), []
        control.activate(q)
        for k in range(round(8.0 / driving.period)):
            if k == 0 or draw.random() >= share:
                control.step(k * driving.period, q, 0.0)
                hand = translation(driving.robot.fkm(q))
                errors.append(np.linalg.norm(hand - translation(control.desired[:8])))
            elif steps_without:
                control.step(k * driving.period, None, driving.period)
            q = driving.robot.integrate(q, control.rate, driving.period)
        assert control.phase is Phase.ACTIVE, control.reason
        means.append(np.mean(errors))
    assert 0.02 < means[0] < 0.023
    assert means[1] == pytest.approx(means[0], rel=0.1)
