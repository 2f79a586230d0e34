"""The H∞ guarantee measured: ratios against closed forms and linear recursions, premises, random cases."""

import math
from typing import Any

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import Error
from dqcontrol.laws import DampedInverse, HInfinity, HInfinityTracking, LinearQuadraticDQ
from dqcontrol.measures.attenuation import (
    Attenuation,
    Gammas,
    PremiseError,
    attenuation,
    attenuation_table,
    verify_attenuation,
)
from dqcontrol.plants import ConstantTwist, Disturbance, SinusoidalTwist, WorstCase

pytestmark = pytest.mark.usefixtures(
    "without_growth"
)  # the guarantee is that of the law with the exact inverse

SEED = 20261107
START = np.array([0.1, 0.6, 0.2, 1.6, -0.1, 0.6, 0.3])
LEVELS = Gammas(orientation=(0.4, 0.25), translation=(0.5, 0.3))
K_O, K_T = LEVELS.orientation_gain, LEVELS.translation_gain
PUSH = Disturbance(worst_case=WorstCase(level=0.1, direction=(1, -2, 2), gammas=(0.5, 0.3)))


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def measured(arm, disturbance, law: Any = HInfinity, form="right", levels=LEVELS, scale=1.0, **options):
    chosen: Any = {"start": START, "period": 0.01, "duration": 10.0} | options
    if not isinstance(law, dqc.laws.Law):
        gains = {"orientation_gain": scale * levels.orientation_gain}
        law = law(**gains, translation_gain=scale * levels.translation_gain, form=form)
    return attenuation(law, arm, disturbance, levels, **chosen)


def test_least_gains():
    assert pytest.approx(math.sqrt(2) * math.sqrt(0.4**-2 + 0.25**-2)) == K_O
    assert pytest.approx(math.sqrt(0.5**-2 + 0.3**-2)) == K_T
    equal = Gammas(orientation=(0.7, 0.7), translation=(0.2, 0.2))
    assert 0.7 * equal.orientation_gain == pytest.approx(2)
    assert 0.2 * equal.translation_gain == pytest.approx(math.sqrt(2))


@pytest.mark.parametrize("form", ["right", "left"])
@pytest.mark.parametrize("law", [HInfinity, HInfinityTracking])
@pytest.mark.parametrize("product", [0.03, 0.5, 1.0])
def test_the_worst_case_is_the_closed_form_and_tight(arm, law, form, product):
    """|p_e| = v/k (1 − (1 − kT)ⁿ) by the sampled loop, and the bound is v/k in every period."""
    period = product / K_T
    steps = math.ceil(16 / product)
    row = measured(arm, PUSH, law, form, period=period, duration=steps * period)
    error = 1 - (1 - product) ** np.arange(steps + 1)
    assert row.translation == pytest.approx(math.sqrt((error**2).sum() / steps), rel=2e-3)
    assert 0.95 <= row.translation <= 1
    assert math.isnan(row.orientation), "nothing turns the hand"
    assert row.largest_angle < 3e-3
    assert row.holds
    assert row.form == form


def test_the_printed_sum_cannot_exceed_half_the_root_of_two_with_equal_levels(arm):
    equal = Gammas(orientation=(0.4, 0.4), translation=(0.4, 0.4))
    push = Disturbance(worst_case=WorstCase(level=0.1, direction=(1, 0, 0), gammas=(0.4, 0.4)))
    row = measured(arm, push, levels=equal, duration=16 / equal.translation_gain)
    assert row.translation_sum == pytest.approx(row.translation / math.sqrt(2), rel=1e-12)
    assert 0.67 < row.translation_sum < 0.704


def test_any_other_split_of_the_push_leaves_slack(arm):
    def split(twist):
        total = np.array([0, 0, 0, 0.1, 0, 0])
        body = algebra.adjoint_twist(algebra.conjugate(arm.fkm(START)), (1 - twist) * total)
        sources = {
            "twist": ConstantTwist(value=tuple(twist * total)),
            "pose": ConstantTwist(value=tuple(body)),
        }
        return measured(arm, Disturbance(**sources))

    best = LEVELS.translation[0] ** -2 / K_T**2
    tight = split(best)
    assert tight.translation == pytest.approx(measured(arm, PUSH).translation, rel=1e-3)
    for share in (0.0, 0.5 * best, 1.5 * best, 1.0):
        row = split(share)
        expected = math.hypot(0.5 * best, 0.3 * (1 - best)) / math.hypot(0.5 * share, 0.3 * (1 - share))
        assert row.translation / tight.translation == pytest.approx(expected, rel=1e-3)
        assert expected < 1


@pytest.mark.parametrize("frequency", [0.1, 0.6, 3.0])
def test_a_sinusoidal_push_is_the_linear_recursion(arm, frequency):
    """p(k+1) = (1 − kT) p(k) + T v(k): sums of held values, as the measure takes them."""
    period, steps, speed = 0.01, 1500, 0.1
    wave = speed * np.sin(2 * math.pi * frequency * period * np.arange(steps))
    p = np.zeros(steps + 1)
    for k in range(steps):
        p[k + 1] = (1 - K_T * period) * p[k] + period * wave[k]
    push = Disturbance(twist=SinusoidalTwist(amplitude=(0, 0, 0, 0, speed, 0), frequency=frequency))
    for form in ("right", "left"):
        row = measured(arm, push, form=form, duration=steps * period)
        expected = np.linalg.norm(p) / (0.5 * np.linalg.norm(wave))
        assert row.translation == pytest.approx(expected, rel=5e-3)
        assert row.translation_sum == row.translation, "one source: both bounds are the same"


@pytest.mark.parametrize("angle", [0.1, 1.5, 2.65])
def test_a_constant_turn_is_its_own_differential_equation(arm, angle):
    """θ̇ = ω − k_O sin(θ/2) about a fixed axis; |1 − r_e| = 2 sin(θ/4): the slack of √2 closes towards half a turn."""
    rate, period, steps = K_O * math.sin(angle / 2), 2e-3, 5000
    p = algebra.translation(arm.fkm(START))
    turn = np.array([0, 0, rate])
    share = LEVELS.orientation[0] ** -2 / sum(g**-2 for g in LEVELS.orientation)
    hand = algebra.conjugate(arm.fkm(START))
    twist = np.concatenate([turn, np.cross(p, turn)])
    both = Disturbance(
        twist=ConstantTwist(value=tuple(share * twist)),
        pose=ConstantTwist(value=tuple((1 - share) * algebra.adjoint_twist(hand, twist))),
    )
    theta = np.zeros(steps + 1)
    for k in range(steps):
        theta[k + 1] = theta[k] + period * (rate - K_O * math.sin(theta[k] / 2))
    bound = rate / K_O * math.sqrt(2) * math.sqrt(steps)
    row = measured(arm, both, form="left", period=period, duration=steps * period)
    assert row.orientation == pytest.approx(np.linalg.norm(2 * np.sin(theta / 4)) / bound, rel=5e-3)
    assert row.largest_angle == pytest.approx(angle, rel=2e-3)
    if angle == 0.1:
        assert row.orientation == pytest.approx(math.sqrt(0.5), rel=0.05)
    if angle == 2.65:
        assert row.orientation > 0.85


def test_the_left_error_does_not_see_a_turn_about_the_hand(arm):
    """The right error's p_e contains the lever arm of the base's origin, so a turn of the hand moves the hand."""
    turn = Disturbance(pose=ConstantTwist(value=(0.4, 0.3, -0.2, 0, 0, 0)))
    offsets = {}
    for form in ("right", "left"):
        law = HInfinity(orientation_gain=K_O, translation_gain=K_T, form=form)
        target = dqc.references.SetPoint(arm.fkm(START))
        record = dqc.simulate(arm, target, law, dqc.plants.Integrator(), START, 1e-3, 5.0, disturbance=turn)
        offsets[form] = record.position_error[-1]
    assert offsets["right"] > 0.02
    assert offsets["left"] < 1e-3
    assert measured(arm, turn).holds, "the bound of the right error counts the lever arm"


def test_too_small_a_gain_breaks_the_bound(arm):
    row = measured(arm, PUSH, scale=0.5, duration=30.0)
    assert row.translation == pytest.approx(2, rel=0.05)
    assert not row.holds


def test_the_linear_quadratic_law_attenuates_at_its_rate(arm):
    """d|p_e|/dt ≤ −κ|p_e| + |v'| and dθ/dt ≤ −κθ + |ω|, |O| ≤ θ/2: κ = k_T is enough, and 2√2κ = k_O, tight in both."""
    levels = Gammas(orientation=(0.4, 0.25), translation=(0.8, 0.5))
    rate = levels.translation_gain
    assert levels.orientation_gain == pytest.approx(2 * math.sqrt(2) * rate)
    law = LinearQuadraticDQ(error_weight=rate**2, control_weight=1.0)
    options: dict[str, Any] = {"levels": levels, "duration": 16 / rate}
    push = Disturbance(worst_case=WorstCase(level=0.1, direction=(0, 1, 1), gammas=levels.translation))
    assert 0.95 < measured(arm, push, law, **options).translation <= 1
    share = levels.orientation[0] ** -2 / sum(g**-2 for g in levels.orientation)
    turn = np.array([0, 0, 0.2 * rate, 0, 0, 0])
    hand = algebra.adjoint_twist(algebra.conjugate(arm.fkm(START)), turn)
    both = Disturbance(
        twist=ConstantTwist(value=tuple(share * turn)), pose=ConstantTwist(value=tuple((1 - share) * hand))
    )
    assert 0.95 < measured(arm, both, law, **options).orientation <= 1


def test_premises_are_checked(arm):
    elsewhere = dqc.references.SetPoint(arm.fkm(START + 0.1))
    spin = Disturbance(pose=ConstantTwist(value=(0, 0, 1.2 * K_O, 0, 0, 0)))
    damped = HInfinity(orientation_gain=K_O, translation_gain=K_T, inverse=DampedInverse(damping=0.1))
    stretched = np.array([0, 0.02, 0, 0.02, 0, 0.02, 0])
    with pytest.raises(PremiseError, match="start: the guarantee is for zero error at the start"):
        measured(arm, PUSH, reference=elsewhere)
    with pytest.raises(PremiseError, match=r"law\.inverse: must be a FilteredInverse"):
        measured(arm, PUSH, damped)
    with pytest.raises(PremiseError, match="start: the arm comes to a singular value of"):
        measured(arm, PUSH, start=stretched)
    with pytest.raises(PremiseError, match="disturbance: turns the end effector half a turn from its target"):
        measured(arm, spin, duration=2.0)
    with pytest.raises(PremiseError, match="law: the run diverged at"):
        measured(arm, PUSH, period=1e3, duration=1e5)


@pytest.mark.parametrize(
    ("levels", "message"),
    [
        ((0.0, 1.0), "gammas.orientation: must be > 0, got 0"),
        ((1.0, -1.0), "gammas.orientation: must be > 0, got -1"),
        ((1.0, float("nan")), "gammas.orientation: must be finite"),
        ((1.0, 1.0, 1.0), r"gammas.orientation: expected shape \(…, 2\), got shape \(3,\)"),
    ],
)
def test_levels_that_are_none(levels, message):
    with pytest.raises(Error, match=message):
        Gammas(orientation=levels, translation=(1.0, 1.0))


@pytest.mark.slow
def test_random_cases_hold_and_the_worst_case_is_tight():
    print(f"seed {SEED}")
    rows = verify_attenuation(cases=40, seed=SEED)
    print(attenuation_table(rows).markdown())
    assert all(row.holds for row in rows)
    worst = [row.translation for row in rows if row.disturbance == "worst case"]
    assert len(worst) == 8
    assert min(worst) >= 0.95
    equal = [row for row in rows if row.gammas.translation[0] == row.gammas.translation[1]]
    assert len(equal) == 20
    assert max(row.translation_sum for row in equal) <= 0.707
    assert max(np.nanmax([row.orientation_sum for row in rows]), max(r.translation_sum for r in rows)) < 1
    combinations = {(row.law, row.form, row.disturbance, row in equal) for row in rows}
    assert len(combinations) == 40
    assert len({row.robot for row in rows}) >= 5
    assert max(row.largest_angle for row in rows) > 1, "large angles are among them"


@pytest.mark.slow
def test_the_seed_decides_the_cases():
    one, again, other = (verify_attenuation(cases=3, seed=seed) for seed in (4, 4, 5))
    ratios = [[(row.orientation, row.translation) for row in rows[1:]] for rows in (one, again, other)]
    assert ratios[0] == ratios[1]
    assert ratios[0] != ratios[2]
    assert verify_attenuation(cases=0) == []
    with pytest.raises(Error, match="cases: expected an integer ≥ 0, got -1"):
        verify_attenuation(cases=-1)


def test_table_shows_the_largest_of_each_group_and_what_fails():
    def row(law, translation, orientation=math.nan):
        return Attenuation(
            law, "left", "arm", "constant", LEVELS, orientation, translation, orientation, 0.5, math.pi / 4
        )

    table = attenuation_table([row("a", 0.5, 0.25), row("b", 1.5), row("a", 0.75, 0.125)])
    assert [list(map(str, line)) for line in table.texts()] == [
        ["a", "left", "constant", "2", "0.250", "0.750", "0.250", "0.500", "45", "yes"],
        ["b", "left", "constant", "1", "–", "1.500", "–", "0.500", "45", "no"],
    ]
    assert attenuation_table([]).rows == []
