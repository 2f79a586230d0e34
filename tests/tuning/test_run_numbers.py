"""The numbers that a search finds in one pass are those of the metrics, and its loop is the loop."""

import math

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.laws.law import Law
from dqcontrol.limits import CommandLimits
from dqcontrol.loop.simulate import RepeatedLoop
from dqcontrol.measures.metric_tables import NUMBERS, RunMeasure
from dqcontrol.measures.metrics import evaluate

START = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
PANDA = np.array([0, -0.6, 0, -2.2, 0, 1.6, 0.8])


@pytest.mark.parametrize("away", [0.0, 0.05])
@pytest.mark.parametrize("name", ["iiwa7", "two-pandas"])
def test_they_are_the_metrics_of_the_same_run_to_the_last_bit(name, away):
    arm, plant = dqc.load_robot(name), dqc.plants.Servo(delay=0.02, encoder_noise=5e-4)
    start = np.resize(START if name == "iiwa7" else PANDA, arm.configuration_size)
    circle = dqc.references.Circle(arm.fkm(start + away), radius=0.05, duration=2.0)
    law = dqc.laws.ProportionalFeedforward(gain=5.0)
    record = dqc.simulate(arm, circle, law, plant, start, 0.01, seed=3)
    loop = RepeatedLoop(arm, plant, start, 0.01, circle.samples(0.01 * np.arange(201)), seed=3)
    ready = law.prepare(arm, circle, 0.01, CommandLimits(velocity=True), "integrated", lag=plant.lag(arm))
    loop.run(ready)
    seen = loop.run(ready)  # begins as the first
    assert not seen.failed
    for name in ("q", "measured", "command"):
        assert np.array_equal(getattr(seen, name), getattr(record, name)), name
    numbers = RunMeasure(arm, arm.limits)(seen.samples, seen.q, seen.command, skipped=50)
    metrics = evaluate(record, arm.limits, skip_initial=0.5).flat()
    for name, number in zip(NUMBERS, numbers.tolist(), strict=True):
        if name == "command_jerk":
            steps = np.diff(record.command[:-1], n=2, axis=0) / 0.01**2
            expected = math.sqrt(np.sum(steps[:] ** 2) * 0.01 / record.duration)
        else:
            expected = metrics[name]
        if expected is None:
            assert math.isnan(number), name
        else:
            assert number == pytest.approx(expected, rel=1e-9), name


def test_a_run_that_diverges_is_said_to_have_failed():
    arm = dqc.load_robot("iiwa7")
    samples = dqc.references.SetPoint(arm.fkm(START + 0.1)).samples(0.01 * np.arange(2000))
    plant = dqc.plants.Servo(rate_limit=False, position_limit=False, delay=0.05)
    loop = RepeatedLoop(arm, plant, START, 0.01, samples, seed=0)
    law = dqc.laws.Proportional(gain=1e5, inverse=dqc.laws.FilteredInverse(growth=0.0))
    assert loop.run(law.prepare(arm, None, 0.01, CommandLimits(velocity=False), "integrated")).failed


@pytest.mark.parametrize(
    "law",
    [
        dqc.laws.Proportional(gain=5.0, integral_gain=3.0),
        dqc.laws.HInfinityTracking(orientation_gamma=0.3, translation_gain=4.0),
        dqc.laws.LinearQuadraticDQ(error_weight=25.0, control_weight=1.0, horizon_time=30.0),
        dqc.laws.FeedbackLinearization(stiffness=16.0, damping=8.0),
        dqc.laws.PartialProportional(part="position", gain=dqc.laws.Schedule([0, 1], [1, 2])),
    ],
    ids=lambda law: type(law).__name__,
)
def test_a_law_scaled_has_all_its_loop_rates_scaled(law: Law):
    arm = dqc.load_robot("iiwa7")
    rates = [each.loop_rates(each.rows(arm, None, 0.01)) for each in (law, law.scaled(1.7))]
    assert rates[0] is not None
    assert rates[1] is not None
    for part in ("position", "orientation"):
        before, after = (getattr(rate, part) for rate in rates)
        if before is not None:
            assert np.abs(after).max() == pytest.approx(1.7 * np.abs(before).max(), rel=1e-6)
    assert rates[1].lag == pytest.approx(1.7 * rates[0].lag)
    assert rates[1].integral == pytest.approx(1.7**2 * rates[0].integral)
