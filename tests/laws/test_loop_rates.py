"""The rates that laws claim against the derivatives of their commands: u = −L (q − q_d), eigenvalues of L."""

from typing import Any

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.laws import (
    DecoupledProportional,
    FeedbackLinearization,
    HInfinity,
    HInfinityTracking,
    LinearQuadraticDQ,
    LinearQuadraticR8,
    OpenLoop,
    OwnLaw,
    PartialProportional,
    Proportional,
    ProportionalFeedforward,
    Schedule,
    Steps,
)
from dqcontrol.laws.inverses import inverse_parameters
from dqcontrol.laws.law import LoopRates
from dqcontrol.laws.linear_quadratic import pose_feedback
from dqcontrol_theses.variants import Cascade, ClassicProportional, PublishedLinearization

SEED = 20260732
T = 0.01
Q0 = np.array([0.2, 0.6, 0.1, 1.6, -0.3, 0.9, 0.4])
DIAGONAL = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def random_weight(size, seed):
    """Return a symmetric positive definite matrix far from diagonal."""
    root = np.random.default_rng([SEED, seed]).normal(size=(size, size))
    return (root @ root.T + 0.1 * np.eye(size)).tolist()


def measured_rates(arm, law, row=0):
    """Return the eigenvalues, beside those of the free motions, of −∂u/∂q where the hand is on its target."""
    prepared = law.prepare(arm, None, T)
    sample = dqc.Sample(arm.fkm(Q0), time=row * T)
    step, columns = 1e-6, []
    for unit in np.eye(7):
        ahead, behind = (
            prepared.command(Q0 + side * step * unit, sample, prepared.initial_state(Q0)) for side in (1, -1)
        )
        columns.append((behind - ahead) / (2 * step))
    values = np.linalg.eigvals(np.array(columns).T)
    return values[np.abs(values) > 1e-4]


def claims(law, rows) -> Any:
    """Return the claimed rates at rows of parameters."""
    return law.loop_rates(rows)


def claimed(arm, law, row=0) -> list[Any]:
    """Return the claimed position and orientation rate at one sample."""
    rates = claims(law, law.prepare(arm, None, T).parameters)
    return [None if part is None else part[row] for part in (rates.position, rates.orientation)]


LAWS = [  # with their position and orientation rates
    (ClassicProportional(gain=3.0), 3, 3),
    (Proportional(gain=3.0), 3, 3),
    (Proportional(gain=DIAGONAL), 8, 4),
    (ProportionalFeedforward(gain=DIAGONAL), 8, 4),
    (DecoupledProportional(gain=DIAGONAL), 4, 8),
    (PartialProportional(part="position", gain=3.0), 3, None),
    (PartialProportional(part="rotation", gain=3.0), None, 3),
    (PartialProportional(part="axis", gain=3.0), None, 3),
    (HInfinity(translation_gain=3.0, orientation_gain=4.0), 3, 2),
    (HInfinity(translation_gamma=0.5, orientation_gamma=0.5, form="left"), np.sqrt(2) / 0.5, 2),
    (HInfinityTracking(translation_gain=1.0, orientation_gain=4.0), 1, 2),
    (LinearQuadraticR8(error_weight=8.0, control_weight=2.0), 2, 2),
    (LinearQuadraticR8(error_weight=[1.0, 4, 4, 4, 1, 9, 9, 9], control_weight=1.0), 3, 2),
    (LinearQuadraticDQ(error_weight=[4.0, 4, 4, 9, 9, 9], control_weight=1.0), 3, 2),
    (LinearQuadraticDQ(error_weight=[4.0, 4, 4, 9, 9, 9], control_weight=1.0, form="sin"), 3, 2),
]


@pytest.mark.parametrize(("law", "position", "orientation"), LAWS, ids=lambda value: str(value)[:40])
def test_rates_are_those_of_the_command(arm, law, position, orientation):
    assert claimed(arm, law) == [value and pytest.approx(value) for value in (position, orientation)]
    rates = measured_rates(arm, law)
    assert np.abs(rates.imag).max() < 1e-4
    for value in (position, orientation):
        if value is not None:
            assert np.abs(rates - value).min() < 1e-4 * value
    assert rates.real.max() == pytest.approx(max(filter(None, (position, orientation))), rel=1e-4)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("kind", [LinearQuadraticR8, LinearQuadraticDQ])
@pytest.mark.parametrize("horizon", [None, 0.3])
def test_general_weights(arm, kind, seed, horizon):
    print("seed", SEED, seed)
    size = 8 if kind is LinearQuadraticR8 else 6
    law = kind(
        error_weight=random_weight(size, seed),
        control_weight=random_weight(size, seed + 100),
        final_weight=random_weight(size, seed + 200),
        horizon_time=horizon,
    )
    for row in (0, 20, 30) if horizon else (0,):
        rates = measured_rates(arm, law, row)
        largest = rates[np.abs(rates).argmax()]
        for value in claimed(arm, law, row):
            assert abs(value) == pytest.approx(abs(largest), rel=1e-4)
            assert value.real == pytest.approx(largest.real, rel=1e-4)
            assert abs(np.imag(value)) == pytest.approx(abs(largest.imag), abs=1e-3 * abs(largest))


def test_rates_that_turn():
    """R⁻¹P of the imaginary parts alone may have complex eigenvalues: both of the largest pair are as large."""
    law = LinearQuadraticR8(error_weight=1.0, control_weight=1.0)
    turning = np.eye(8)
    turning[1:3, 1:3] = [[2.0, -3.0], [3.0, 2.0]]
    row = pose_feedback.pack(
        inverse=np.zeros(inverse_parameters.size()), hysteresis=0.0, gain=turning.ravel(), offset=np.zeros(8)
    )
    rates = claims(law, row[None])
    assert rates.orientation[0].real == pytest.approx(2)
    assert abs(rates.orientation[0].imag) == pytest.approx(3)
    assert rates.position[0] == pytest.approx(1)


def test_schedules_have_a_rate_each_sample(arm):
    law = HInfinity(translation_gain=Schedule([0.0, 0.1], [2.0, 4.0]), orientation_gain=6.0)
    rates = claims(law, law.prepare(arm, None, T).parameters)
    assert rates.position == pytest.approx(np.linspace(2, 4, 11))
    assert rates.orientation == pytest.approx(np.full(11, 3.0))


def test_the_end_of_a_horizon(arm):
    """With S = 0 the gain falls to 0; with more than √(qr) it rises to s/r."""
    for final, last in ((0.0, 0.0), (50.0, 50.0)):
        for kind in (LinearQuadraticR8, LinearQuadraticDQ):
            law = kind(error_weight=9.0, control_weight=1.0, final_weight=final, horizon_time=3.0)
            rates = claims(law, law.prepare(arm, None, T).parameters)
            assert rates.position[0] == pytest.approx(3, rel=1e-6)
            assert rates.position[-1] == pytest.approx(last, abs=1e-9)
            assert rates.orientation[-1] == pytest.approx(last, abs=1e-9)


def test_weights_over_time(arm):
    law = LinearQuadraticDQ(
        error_weight=Steps([0.0, 5.0], [1.0, 25.0]), control_weight=1.0, final_weight=5.0, horizon_time=10.0
    )
    rates = claims(law, law.prepare(arm, None, T).parameters)
    assert rates.position[[0, 500, 999]] == pytest.approx([1, 5, 5], rel=1e-3)


def test_laws_without_a_loop_or_with_one_unknown(arm):
    law = OpenLoop()
    rates = claims(law, law.prepare(arm, None, T).parameters)
    assert rates.position.tolist() == rates.orientation.tolist() == [0]
    assert not len(measured_rates(arm, law))
    assert OwnLaw(function=print).loop_rates(np.zeros((1, 1))) is None
    body = dqc.load_robot("little-john")
    gains = {"stiffness": 2.0, "damping": 1.0}
    for law, known in (
        (FeedbackLinearization(**gains), True),
        (PublishedLinearization(**gains), False),
        (PublishedLinearization(**gains, logarithm="inertial"), False),
        (Cascade(**gains), False),
    ):
        rates = law.loop_rates(law.prepare(body, None, T).parameters)
        assert (rates is not None) == known
        assert rates is None or rates == LoopRates(pytest.approx([0.5]), pytest.approx([0.5]), lag=1.0)
