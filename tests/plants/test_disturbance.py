"""Disturbances over time: their values, their randomness, what is refused; one step of the joints."""

import math
from typing import Any

import msgspec
import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.plants import BandLimitedTwist, ConstantTwist, Disturbance, SinusoidalTwist, WorstCase

Q0 = np.array([0.2, 0.6, 0.1, 1.6, -0.3, 0.9, 0.4])
TWIST = np.array([0.3, -0.2, 0.5, 0.1, 0.25, -0.15])
SIX = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def pushed(arm, q, period, **sources):
    """Return the pose after one period of a disturbance, and the twist that the hand got."""
    live = Disturbance(**sources).start(arm, period, 1, 0)
    moved, realised = np.array(q, dtype=float), np.zeros(6)
    live.step(arm, 0, moved, realised)
    return moved, realised


def displacement(arm, q, moved):
    """Return [rotation vector ; translation] of the hand, inertial axes."""
    before, after = arm.fkm(q), arm.fkm(moved)
    turn = algebra.short(algebra.multiply(after, algebra.conjugate(before)))
    angle = 2 * math.asin(np.linalg.norm(turn[1:4]))
    axis = turn[1:4] / max(np.linalg.norm(turn[1:4]), 1e-300)
    return np.concatenate([angle * axis, algebra.translation(after) - algebra.translation(before)])


def test_a_twist_moves_the_hand_by_its_integral_up_to_the_square_of_the_period(arm):
    p = algebra.translation(arm.fkm(Q0))
    wanted = np.concatenate([TWIST[:3], TWIST[3:] - np.cross(p, TWIST[:3])])
    excess = []
    for period in (4e-3, 2e-3, 1e-3):
        moved, realised = pushed(arm, Q0, period, twist=ConstantTwist(value=tuple(TWIST)))
        assert realised == pytest.approx(TWIST, abs=1e-13)
        excess.append(np.linalg.norm(displacement(arm, Q0, moved) - period * wanted))
    assert 0 < excess[0] < 4e-3**2
    assert excess[0] / excess[1] == pytest.approx(4, rel=0.02)
    assert excess[1] / excess[2] == pytest.approx(4, rel=0.02)


def test_the_joints_move_as_little_as_gives_the_twist(arm):
    moved, _ = pushed(arm, Q0, 1e-3, twist=ConstantTwist(value=tuple(TWIST)))
    hand = arm.twist_jacobian(Q0).copy()
    hand[3:] -= np.cross(algebra.translation(arm.fkm(Q0)), hand[:3].T).T
    p = algebra.translation(arm.fkm(Q0))
    wanted = np.concatenate([TWIST[:3], TWIST[3:] - np.cross(p, TWIST[:3])])
    assert (moved - Q0) / 1e-3 == pytest.approx(np.linalg.pinv(hand) @ wanted, abs=1e-10)


def test_a_pose_disturbance_is_a_twist_in_the_hands_axes(arm):
    x = arm.fkm(Q0)
    _, realised = pushed(arm, Q0, 1e-3, pose=ConstantTwist(value=tuple(TWIST)))
    pure = np.concatenate([[0], TWIST[:3], [0], TWIST[3:]])
    turned = algebra.multiply(algebra.multiply(x, pure), algebra.conjugate(x))
    assert realised == pytest.approx(np.delete(turned, [0, 4]), abs=1e-13)


def test_both_sources_add(arm):
    source = ConstantTwist(value=tuple(TWIST))
    both = pushed(arm, Q0, 1e-3, twist=source, pose=source)[1]
    assert both == pytest.approx(
        pushed(arm, Q0, 1e-3, twist=source)[1] + pushed(arm, Q0, 1e-3, pose=source)[1], abs=1e-13
    )


def test_at_a_singularity_the_hand_gets_what_the_joints_can_make(arm):
    stretched = np.zeros(7)
    p = algebra.translation(arm.fkm(stretched))
    moved, realised = pushed(arm, stretched, 1e-3, twist=ConstantTwist(value=(0, 0, 0, 0, 0, 0.1)))
    assert np.abs(realised).max() < 1e-12, "nothing lifts a stretched arm"
    assert np.abs(moved - stretched).max() < 1e-12
    _, realised = pushed(arm, stretched, 1e-3, twist=ConstantTwist(value=(0, 0, 0, 0.1, 0, 0.1)))
    hand = np.concatenate([realised[:3], realised[3:] - np.cross(p, realised[:3])])
    assert hand == pytest.approx([0, 0, 0, 0.1, 0, 0], abs=1e-10)


def test_an_arm_of_few_joints_gets_the_nearest_twist(make_arm):
    arm = make_arm(3)
    q = np.array([0.3, -0.4, 0.5])
    p = algebra.translation(arm.fkm(q))
    hand = arm.twist_jacobian(q).copy()
    hand[3:] -= np.cross(p, hand[:3].T).T
    wanted = np.concatenate([TWIST[:3], TWIST[3:] - np.cross(p, TWIST[:3])])
    moved, realised = pushed(arm, q, 1e-3, twist=ConstantTwist(value=tuple(TWIST)))
    assert np.linalg.svd(hand)[1].min() > 0.02, "no damping here"
    assert (moved - q) / 1e-3 == pytest.approx(np.linalg.pinv(hand) @ wanted, abs=1e-10)
    assert realised == pytest.approx(arm.twist_jacobian(q) @ (moved - q) / 1e-3, abs=1e-10)


def test_values_over_time():
    times = np.array([0.0, 0.125, 0.25, 1.0])
    disturbance = Disturbance(
        twist=SinusoidalTwist(amplitude=SIX, frequency=1.0, phase=math.pi / 2), pose=ConstantTwist(value=SIX)
    )
    rows = disturbance.samples(times)
    cosine = np.array([1, math.sqrt(0.5), 0, 1])
    assert rows[:, :6] == pytest.approx(np.outer(cosine, SIX), abs=1e-15)
    assert np.array_equal(rows[:, 6:], np.tile(SIX, (4, 1)))
    assert Disturbance(pose=ConstantTwist(value=SIX)).samples([])[:, 0].shape == (0,)


def test_band_limited_noise_has_its_rms_and_no_more_than_its_band():
    rms, bandwidth, rate, count = np.array([0.1, 0, 0.2, 1, 2, 3]), 4.0, 50.0, 40_000
    rows = Disturbance(twist=BandLimitedTwist(rms=tuple(rms), bandwidth=bandwidth)).samples(
        np.arange(count) / rate, seed=3
    )[:, :6]
    assert rows.std(axis=0) == pytest.approx(rms, rel=0.03)
    assert np.abs(rows).max() <= math.sqrt(128) * rms.max()
    assert not rows[:, 1].any()
    window = np.blackman(count)[:, None]
    power = np.abs(np.fft.rfft(rows * window, axis=0)) ** 2
    frequency = np.fft.rfftfreq(count, 1 / rate)
    assert power[frequency > bandwidth + 0.02].sum() < 1e-9 * power.sum()
    eighths = [
        power[(frequency >= low) & (frequency < low + 0.5), 3:].sum(axis=0)
        for low in np.arange(0, bandwidth, 0.5)
    ]
    assert np.array(eighths) / power[:, 3:].sum(axis=0) == pytest.approx(np.full((8, 3), 1 / 8), abs=0.02)
    crossed = np.corrcoef(rows[:, 3:].T) - np.eye(3)
    assert np.abs(crossed).max() < 0.05, "the six numbers are independent"


def test_noise_is_nearly_normal():
    rows = Disturbance(twist=BandLimitedTwist(rms=(1, 1, 1, 1, 1, 1), bandwidth=10.0)).samples(
        np.arange(20_000) / 40, seed=1
    )
    fourth = (rows[:, :6] ** 4).mean(axis=0) / (rows[:, :6] ** 2).mean(axis=0) ** 2
    assert fourth == pytest.approx(np.full(6, 3.0), abs=0.15)


def test_the_seeds_decide_the_noise_and_the_period_does_not():
    source = BandLimitedTwist(rms=SIX, bandwidth=4.0)
    times = 0.01 * np.arange(300)
    one = Disturbance(twist=source, pose=source).samples(times, seed=5)
    assert np.array_equal(one, Disturbance(twist=source, pose=source).samples(times, seed=5))
    assert np.array_equal(one[::2], Disturbance(twist=source, pose=source).samples(times[::2], seed=5))
    assert np.array_equal(one[:, :6], Disturbance(twist=source).samples(times, seed=5)[:, :6])
    other = msgspec.structs.replace(source, seed=1)
    for different in (
        one[:, 6:],
        Disturbance(twist=source).samples(times, seed=6)[:, :6],
        Disturbance(twist=other).samples(times, seed=5)[:, :6],
    ):
        assert abs(np.corrcoef(one[:, 3], different[:, 3])[0, 1]) < 0.6
        assert not np.array_equal(one[:, :6], different)


def test_long_noise_is_drawn_in_parts_without_a_seam():
    source = Disturbance(twist=BandLimitedTwist(rms=SIX, bandwidth=1.0))
    times = 0.01 * np.arange(9000)
    whole = source.samples(times, seed=2)
    assert np.array_equal(whole[4000:8300], source.samples(times[4000:8300], seed=2))
    assert np.abs(np.diff(whole[:, 5])).max() < 2 * math.pi * 1.0 * 0.01 * SIX[5] * 4


def test_worst_case_splits_as_the_inverse_squares():
    case = WorstCase(level=0.05, direction=(0, 3, 4), gammas=(0.5, 1.0))
    assert case.shares() == pytest.approx((0.04, 0.01))
    gain = math.sqrt(0.5**-2 + 1.0**-2)
    assert case.bound() == pytest.approx(0.05 / gain)
    rows = Disturbance(worst_case=case).samples([0.0, 9.0])
    assert rows == pytest.approx(np.tile([0, 0, 0, 0, 0.03, 0.04, 0, 0, 0, 0, 0, 0], (2, 1)))
    for other in (0.02, 0.035, 0.045):  # any other split of the same push leaves slack
        assert math.hypot(0.5 * other, 1.0 * (0.05 - other)) > case.bound()


NAN = float("nan")
constant: Any = ConstantTwist  # called with what their types forbid
sinusoidal: Any = SinusoidalTwist
band_limited: Any = BandLimitedTwist
worst_case: Any = WorstCase
BAD = [
    (
        lambda: constant(value=(1, 2, 3)),
        ShapeError,
        r"disturbance.value: expected a list of length 6, got 3",
    ),
    (
        lambda: constant(value=(*SIX[:5], NAN)),
        ValueRangeError,
        r"disturbance.value\[5\]: must be finite, got nan",
    ),
    (
        lambda: constant(value="north"),
        ShapeError,
        "disturbance.value: expected a list, got text 'north'",
    ),
    (
        lambda: sinusoidal(amplitude=SIX, frequency=-1.0),
        ValueRangeError,
        "disturbance.frequency: must be > 0, got -1$",
    ),
    (lambda: sinusoidal(amplitude=SIX, frequency=0), ValueRangeError, "frequency: must be > 0, got 0$"),
    (
        lambda: sinusoidal(amplitude=SIX, frequency=1, phase=NAN),
        ValueRangeError,
        "phase: must be finite",
    ),
    (
        lambda: sinusoidal(amplitude=np.eye(6), frequency=1),
        ShapeError,
        r"amplitude\[0\]: expected a number, got a list",
    ),
    (
        lambda: band_limited(rms=SIX, bandwidth=NAN),
        ValueRangeError,
        "disturbance.bandwidth: must be finite",
    ),
    (
        lambda: band_limited(rms=(-1, 0, 0, 0, 0, 0), bandwidth=1),
        ValueRangeError,
        r"disturbance.rms\[0\]: must be ≥ 0",
    ),
    (
        lambda: band_limited(rms=SIX, bandwidth=1, seed=-1),
        ValueRangeError,
        "disturbance.seed: must be ≥ 0, got -1",
    ),
    (
        lambda: worst_case(level=0, direction=(1, 0, 0), gammas=(1, 1)),
        ValueRangeError,
        "disturbance.worst_case.level: must be > 0, got 0",
    ),
    (
        lambda: worst_case(level=1, direction=(0, 0, 0), gammas=(1, 1)),
        ValueRangeError,
        "direction: must not be zero",
    ),
    (
        lambda: worst_case(level=1, direction=(1, 0, 0), gammas=(1, 0)),
        ValueRangeError,
        r"gammas\[1\]: must be > 0, got 0",
    ),
    (
        lambda: worst_case(level=1, direction=(1, 0, 0), gammas=(1,)),
        ShapeError,
        "gammas: expected a list of length 2, got 1",
    ),
    (Disturbance, ShapeError, "^disturbance: give 'twist', 'pose' or 'worst_case'$"),
    (
        lambda: Disturbance(
            twist=constant(value=SIX), worst_case=worst_case(level=1, direction=(1, 0, 0), gammas=(1, 1))
        ),
        ShapeError,
        "'worst_case' holds both sources; give it alone",
    ),
    (
        lambda: Disturbance(twist=constant(value=SIX)).samples([[0.0]]),
        ShapeError,
        r"^times: expected shape \(N,\), got \(1, 1\)$",
    ),
]


@pytest.mark.parametrize(("make", "error", "text"), BAD)
def test_what_is_not_allowed_is_refused_with_its_name(make, error, text):
    with pytest.raises(error, match=text):
        make()


def test_frequencies_that_samples_cannot_show_are_refused(arm):
    for source, field in (
        (SinusoidalTwist(amplitude=SIX, frequency=50.0), "frequency"),
        (BandLimitedTwist(rms=SIX, bandwidth=50.0), "bandwidth"),
    ):
        with pytest.raises(
            ValueRangeError,
            match=rf"^disturbance.pose.{field}: must be below half the sampling rate, 50 Hz, got 50$",
        ):
            Disturbance(pose=source).start(arm, 0.01, 3, 0)
        Disturbance(pose=source).start(arm, 0.0099, 3, 0)
