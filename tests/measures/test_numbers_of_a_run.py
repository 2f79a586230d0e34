"""All numbers of a run beside the same formulas in NumPy: no joint, input or interval is as another."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dqcontrol import algebra
from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import Signal
from dqcontrol.measures.metrics import evaluate
from dqcontrol.measures.run_numbers import NUMBERS, DesiredMotion, run_numbers
from dqcontrol.robots.limits import Limits

LIMITS = Limits(*np.array([[-3, -4, -5], [4, 3, 6], [1.3, 0.8, 2.1], [9.0, 9, 9]]))


def poses(rng, count, spread=1.0):
    """Return poses along a curve, each with a sign of its own."""
    phase = np.linspace(0, 2, count)[:, None]
    turns = Rotation.from_rotvec(spread * np.sin(phase * rng.uniform(0.5, 2, 3) + rng.uniform(0, 6, 3)))
    places = np.sin(phase * rng.uniform(0.5, 2, 3) + rng.uniform(0, 6, 3))
    return algebra.pose(algebra.rotation_from_scipy(turns), places) * rng.choice([-1.0, 1.0], (count, 1))


def make_run(count, seed=5, spread=1.0):
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.5, 1.5, count)) / 10
    q, command = rng.normal(size=(count, 3)), rng.normal(size=(count, 3))
    samples = np.hstack([poses(rng, count, spread), rng.normal(size=(count, 12)), time[:, None]])
    return Record(time, q, q, command, poses(rng, count, spread), samples, ("a", "b", "c"))


def errors_of(run):
    """Return distances in mm, turns in degrees and |1 − x* x_d|, of the sign in which that is smaller."""
    desired = run.desired[:, :8]
    away = np.linalg.norm(algebra.translation(desired) - algebra.translation(run.pose), axis=1)
    one, other = (
        Rotation.from_quat(np.roll(algebra.rotation(each)[:, :4], -1, axis=1)) for each in (run.pose, desired)
    )
    between = algebra.multiply(algebra.conjugate(run.pose), desired)
    from_one = np.eye(8)[0]
    short = np.minimum(*(np.linalg.norm(from_one - sign * between, axis=1) for sign in (1, -1)))
    return 1e3 * away, np.degrees((one.inv() * other).magnitude()), short


def norms(total, square, peak, duration):
    return [total, total / duration, np.sqrt(square / duration), peak]


def joined(time, values, first=0):
    """Integrate a value between samples on straight lines, and its square."""
    time, values = time[first:], values[first:]
    a, b, h = values[:-1], values[1:], np.diff(time)
    return norms(
        np.trapezoid(values, time), (h * (a * a + a * b + b * b) / 3).sum(), values.max(), time[-1] - time[0]
    )


def held(values, intervals):
    return norms(values @ intervals, values**2 @ intervals, values.max(), intervals.sum())


def expected(run, skipped, judged, band):
    """Return all numbers, as their definitions have them."""
    time, errors = run.time, errors_of(run)
    h, count = np.diff(time), len(run)
    found = []
    for values in errors[:2]:
        found += [*joined(time, values)[1:], values[-1], *joined(time, values, skipped)[1:]]
    found += [*joined(time, errors[2]), *joined(time, errors[2], skipped), errors[2][-1]]
    places = algebra.translation(run.pose)
    velocity = np.diff(places, axis=0) / h[:, None]
    speed = np.linalg.norm(velocity, axis=1)
    between = 0.5 * (h[1:] + h[:-1])
    steps = np.linalg.norm(np.diff(run.q, axis=0), axis=1)
    asked = np.linalg.norm(run.command[:-1], axis=1)
    found += [*held(asked, h), *held(steps, h), *held(speed, h)]
    found += held(np.linalg.norm(np.diff(velocity, axis=0), axis=1) / between, between)
    outside = np.flatnonzero(errors[2] > band)
    slopes = np.diff(run.command, axis=0) / h[:, None]
    bends = np.linalg.norm(np.diff(slopes, axis=0), axis=1)
    shares = np.abs(run.command[:-1] / LIMITS.velocity).max(axis=1)
    settled = np.nan if outside[-1] == count - 1 else time[outside[-1] + 1] - time[0]
    margin = min((run.q - LIMITS.lower).min(), (LIMITS.upper - run.q).min())
    jerk = np.sqrt((bends[: count - 3] ** 2 / h[1:-1]).sum() / (time[-1] - time[0]))
    found += [steps.sum(), np.sqrt(asked**2 @ h), settled, margin, shares.max(), (shares >= 1).mean(), jerk]
    slow = count - 1 - max(1, count // 20)
    task = []
    for values in errors[:2]:
        task += [np.sqrt((values[judged:] ** 2).mean()), values[judged:].max()]
    mean_speed = (speed * h)[slow:].sum() / (time[-1] - time[slow])
    return found, [*task, mean_speed, *(values[0] for values in errors)]


@pytest.mark.parametrize("count", [3, 4, 19, 57, 200])
@pytest.mark.parametrize("skip", [0.0, 0.1])
def test_every_number_is_its_formula(count, skip):
    run = make_run(count)
    band = np.sort(errors_of(run)[2])[-2:].mean()  # one sample alone is beyond
    found = run_numbers(run, LIMITS, skip, band)
    skipped = int((run.time < run.time[0] + skip - 1e-9).sum())
    numbers, task = expected(run, skipped, skipped, band)
    assert (found.skipped, found.judged) == (skipped, skipped)
    for name, one, other in zip(NUMBERS, found.values, numbers, strict=True):
        assert one == pytest.approx(other, rel=1e-9, abs=1e-12, nan_ok=True), name
    assert list(found.task) == pytest.approx(task, rel=1e-9)


def test_further_tasks_have_the_same_formulas():
    run = make_run(30)
    away = np.random.default_rng(2).uniform(size=(30, 2))
    signal = Signal("task.elbow", ("distance", "angle"), ("m", "rad"), away)
    run = replace(run, readings={"task.elbow": signal})
    skip = 0.5 * (run.time[4] + run.time[5]) - run.time[0]
    found = evaluate(run, skip_initial=skip).tasks["elbow"]
    for deviation, values in (
        (found.position, 1e3 * away[:, 0]),
        (found.orientation, np.degrees(away[:, 1])),
    ):
        expected = [*joined(run.time, values)[1:], values[-1], *joined(run.time, values, 5)[1:]]
        assert list(vars(deviation).values()) == pytest.approx(expected)


def test_a_desired_motion_is_measured_from_its_mean_and_its_end():
    # Turns about one axis: their mean is the one by the mean of sine and cosine of half their angles.
    rng = np.random.default_rng(11)
    angles, places = rng.uniform(-0.9, 1.4, 40), rng.normal(size=(40, 3))
    axis = np.array([0.6, -0.3, 0.74]) / np.linalg.norm([0.6, -0.3, 0.74])
    turns = np.hstack([np.cos(angles / 2)[:, None], np.sin(angles / 2)[:, None] * axis])
    desired = algebra.pose(turns, places)
    signs = rng.choice([-1.0, 1.0], (40, 1))
    signs[0] = -1.0
    samples = np.hstack([signs * desired, np.zeros((40, 12)), np.arange(40.0)[:, None]])
    mean = 2 * np.arctan2(np.sin(angles / 2).mean(), np.cos(angles / 2).mean())
    steps = np.linalg.norm(np.diff(desired, axis=0), axis=1)
    found = DesiredMotion.of(samples).numbers
    assert (found.last_step, found.largest_step) == pytest.approx((steps[-1], steps.max()))
    assert found.distance == pytest.approx(np.sqrt(places.var(axis=0).sum()))
    assert found.angle == pytest.approx(np.sqrt(((angles - mean) ** 2).mean()))
    assert found.farthest == pytest.approx(np.linalg.norm(places - places[-1], axis=1).max())
    assert found.widest == pytest.approx(np.abs(angles - angles[-1]).max())


@pytest.mark.parametrize("flips", [False, True])
def test_a_motion_that_ends_at_rest_is_judged_in_the_last_tenth_of_its_rest_whatever_its_signs(flips):
    places = np.zeros((100, 3))
    places[:, 0] = np.minimum(np.arange(100.0), 59) / 59  # 40 samples rest
    samples = np.hstack([algebra.pose(np.tile(np.eye(4)[0], (100, 1)), places), np.zeros((100, 13))])
    if flips:
        samples[:, :8] *= np.where(np.arange(100) % 2, -1.0, 1.0)[:, None]
    found = DesiredMotion.of(samples)
    assert found.rest == 96
    assert found.numbers.last_step == 0
    assert found.numbers.largest_step == pytest.approx(1 / 59 / 2)
    moving = DesiredMotion.of(samples[:60])
    assert moving.rest is None
    assert DesiredMotion.of(samples[60:]).rest == 36  # of 40 that rest from the beginning


@pytest.mark.parametrize("last", [0.099, 0.101])
def test_who_moves_at_less_than_a_tenth_of_its_greatest_speed_rests(last):
    places = np.array([[0, 0, 0], [1.0, 0, 0], [1 + last, 0, 0]])
    samples = np.hstack([algebra.pose(np.tile(np.eye(4)[0], (3, 1)), places), np.zeros((3, 13))])
    assert (DesiredMotion.of(samples).rest is None) == (last > 0.1)


@pytest.mark.parametrize("angle", [0, 1e-9, 1e-3, 0.5, 2.0, 3.0, np.pi - 1e-6, np.pi])
def test_a_turn_is_as_wide_as_it_is(angle):
    axis = np.array([0.48, -0.6, 0.64])
    turned = algebra.pose(np.array([[np.cos(angle / 2), *(np.sin(angle / 2) * axis)]] * 3), np.ones((3, 3)))
    samples = np.hstack([np.tile(algebra.pose(np.eye(4)[0], np.zeros(3)), (3, 1)), np.zeros((3, 13))])
    run = Record(
        np.arange(3.0), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), turned, samples, tuple("abc")
    )
    found = evaluate(run).orientation
    assert found.peak == pytest.approx(np.degrees(angle), rel=1e-14)


@pytest.mark.parametrize("joint", [0, 1, 2])
@pytest.mark.parametrize("end", [-1, 1])
def test_the_joint_that_comes_nearest_to_a_limit_is_named(joint, end):
    run = make_run(20)
    q = np.tile([[0.5, -0.5, 0.5]], (20, 1))
    q[7, joint] = 0.9 * (LIMITS.upper if end > 0 else LIMITS.lower)[joint]
    run = Record(run.time, q, q, run.command, run.pose, run.desired, run.joint_names)
    found = run_numbers(run, LIMITS)
    assert found.limit_joint == "abc"[joint]
    assert found["limit_margin"] == pytest.approx(
        0.1 * abs((LIMITS.upper if end > 0 else LIMITS.lower)[joint])
    )


def test_directions_are_those_of_samples_that_move():
    time = np.array([0.0, 1, 2, 4, 5, 6, 7])
    places = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 4, 0], [2, 8, 0], [2, 8.001, 0], [2, 8.001, 0]])
    samples = np.hstack(
        [algebra.pose(np.tile(np.eye(4)[0], (7, 1)), places), np.zeros((7, 12)), time[:, None]]
    )
    moves, directions = DesiredMotion.of(samples).directions
    assert moves.tolist() == [True] * 5 + [False] * 2
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    np.testing.assert_allclose(
        directions[[0, 1, 3, 4]], [[1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 1, 0]], atol=1e-12
    )


def test_of_one_sample_further_tasks_have_a_peak_alone():
    signal = Signal("task.elbow", ("distance", "angle"), ("m", "rad"), np.array([[0.2, 0.1]]))
    run = make_run(3)
    one = Record(
        run.time[:1], run.q[:1], run.q[:1], run.command[:1], run.pose[:1], run.desired[:1], run.joint_names,
        readings={"task.elbow": signal},
    )  # fmt: skip
    found = evaluate(one).tasks["elbow"].position
    assert (found.peak, found.final) == (200.0, 200.0)
    assert np.isnan([found.mean, found.rms]).all()
