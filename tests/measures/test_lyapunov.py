"""The Lyapunov certificate of a run: V falls as it should, up to what samples leave, in regulation and tracking."""

from dataclasses import fields

import numpy as np
import pytest
from msgspec.structs import replace

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.figures import lyapunov
from dqcontrol.laws import BestHeading, FeedbackLinearization, FilteredInverse
from dqcontrol.measures import Certificate, certificate
from dqcontrol.measures.lyapunov import LYAPUNOV
from dqcontrol.plants import Integrator
from dqcontrol.recording import export_record, load_record, save_record
from dqcontrol_theses.variants import PublishedLinearization

pytestmark = pytest.mark.usefixtures(
    "without_growth"
)  # V falls as proven where the exact inverse gives the command

HOME = np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
ARM_START = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])


@pytest.fixture(scope="module")
def body():
    return dqc.load_robot("little-john")


def regulation(body, law, period):
    goal = dqc.references.SetPoint(body.fkm(HOME + np.array([0.3, 0.2, 0.3, 0, 0.1, 0, 0, 0])))
    return dqc.simulate(body, goal, law, Integrator(), HOME, period, duration=15.0)


def tracking(law, period):
    arm = dqc.load_robot("iiwa7")
    circle = dqc.references.Circle(arm.fkm(ARM_START), radius=0.07, duration=6.0, turns=2)
    start = ARM_START + np.array([0.1, -0.1, 0.1, 0.2, 0.1, -0.2, 0.1])
    return arm, dqc.simulate(arm, circle, law, Integrator(), start, period, duration=5.9)


@pytest.mark.parametrize("damping", [0.5, 1.0, 2.0])
def test_regulation_to_first_order_in_the_period(body, damping):
    """V̇ = −2 k_v |ξ̃|² up to O(T); per step V misses by O(T²)."""
    law = FeedbackLinearization(stiffness=0.6, damping=damping)
    wrong, rises = [], []
    for period in (0.04, 0.02, 0.01):
        found = certificate(body, regulation(body, law, period), law)
        assert found.outside_range.max() == 0, "away from singularities"
        wrong.append(np.abs(found.rate - found.predicted_rate[:-1]).max())
        rises.append(found.largest_rise)
    assert wrong[1] / wrong[0] == pytest.approx(0.5, abs=0.06)
    assert wrong[2] / wrong[1] == pytest.approx(0.5, abs=0.06)
    assert rises[0] < 1e-3
    assert rises[1] <= 0.3 * rises[0]
    assert rises[2] <= 0.3 * rises[1]


@pytest.mark.parametrize("damping", [1.0, 4.0])
def test_tracking_to_first_order_in_the_period(damping):
    law = FeedbackLinearization(stiffness=4.0, damping=damping)
    wrong = []
    for period in (0.02, 0.01, 0.005):
        arm, record = tracking(law, period)
        found = certificate(arm, record, law)
        assert found.value[-1] < 0.2 * found.value[0]
        wrong.append(np.abs(found.rate - found.predicted_rate[:-1]).max())
    assert wrong[1] / wrong[0] == pytest.approx(0.5, abs=0.08)
    assert wrong[2] / wrong[1] == pytest.approx(0.5, abs=0.08)


def test_velocity_as_published_adds_an_acceleration():
    """J(q(k)) q̇(k−1) differs from the twist commanded by T J̇q̇: V then misses its rate by what no period makes small."""
    holonomic = dqc.WholeBody([dqc.robots.HolonomicBase(), dqc.load_robot("iiwa7")])
    start = np.r_[np.zeros(3), ARM_START]
    goal = dqc.references.SetPoint(holonomic.fkm(start + np.r_[0.5, 0.5, 1.5, np.full(7, 0.5)]))
    wrong = {}
    gains = {"stiffness": 9.0, "damping": 3.0, "null_space": BestHeading()}
    laws = {"ours": FeedbackLinearization(**gains), "published": PublishedLinearization(**gains)}
    for label, law in laws.items():
        for period in (0.004, 0.002):
            record = dqc.simulate(holonomic, goal, law, Integrator(), start, period, duration=2.0)
            found = certificate(holonomic, record, law)
            wrong[label, period] = np.abs(found.rate - found.predicted_rate[:-1]).max()
    left = {label: 2 * wrong[label, 0.002] - wrong[label, 0.004] for label in laws}  # T → 0
    assert abs(left["ours"]) < 0.1 * wrong["ours", 0.004]
    assert left["published"] > 0.3 * wrong["published", 0.004]


def test_matrosov_function(body):
    """At rest W₂ begins to fall at k̄/2 |log x̃|². [S17 4.43]"""
    law, period = FeedbackLinearization(stiffness=0.6, damping=1.0), 1e-4
    goal = body.fkm(HOME + np.array([0.3, 0.2, 0.3, 0, 0.1, 0, 0, 0]))
    record = dqc.simulate(
        body, dqc.references.SetPoint(goal), law, Integrator(), HOME, period, duration=10 * period
    )
    found = certificate(body, record, law)
    log = algebra.log_body(algebra.short(algebra.multiply(algebra.conjugate(goal), record.pose[0])))
    assert found.matrosov[0] == 0
    assert (found.matrosov[1] - found.matrosov[0]) / period == pytest.approx(-0.3 * log @ log, rel=1e-3)


def test_range_of_an_arm_of_five_joints():
    """Of six directions one is always missing: what lies outside is what least squares leaves."""
    arm = dqc.load_robot("ax18")
    q = np.array([0.2, -0.6, 0.9, 0.5, 0.3])
    law = FeedbackLinearization(stiffness=1.0, damping=1.0, null_space=None)
    goal = arm.fkm(q + np.array([0.2, 0.1, -0.2, 0.3, 0.1])).copy()
    goal = algebra.multiply(goal, algebra.exp_screw([0.1, 0.2, 0.05, 0, 0, 0]))
    record = dqc.simulate(arm, dqc.references.SetPoint(goal), law, Integrator(), q, 0.05, duration=0.1)
    found = certificate(arm, record, law)
    error = algebra.short(algebra.multiply(algebra.conjugate(goal), record.pose[0]))
    first = -0.05 * 0.5 * algebra.log_body(error)  # from rest: T U
    rotation = np.r_[record.pose[0, :4], np.zeros(4)]
    wanted = algebra.adjoint_twist(rotation, first)
    left = wanted - arm.hand_jacobian(q) @ record.command[0]
    assert found.outside_range[0] == pytest.approx(np.linalg.norm(left), rel=1e-9)
    assert found.smallest_singular_value.max() == 0


def test_v_falls_as_proven_where_rank_is_lost_in_its_own_measure_only():
    """Five joints: V̇ ≤ −2 k_v |ξ̃|² up to O(T) with the law's default ℓ = 1 m; with another ℓ no period makes it so."""
    arm = dqc.load_robot("ax18")
    q = np.array([0.2, -0.6, 0.9, 0.5, 0.3])
    goal = algebra.multiply(
        arm.fkm(q + np.array([0.2, 0.1, -0.2, 0.3, 0.1])), algebra.exp_screw([0.1, 0.2, 0.05, 0, 0, 0])
    )
    default = FeedbackLinearization(stiffness=1.0, damping=0.3, null_space=None)
    other = replace(default, inverse=FilteredInverse(threshold=1e-3))
    excess = {}
    for name, law in (("default", default), ("other", other)):
        for period in (0.02, 0.01):
            record = dqc.simulate(arm, dqc.references.SetPoint(goal), law, Integrator(), q, period, 15.0)
            found = certificate(arm, record, law)
            excess[name, period] = (found.rate - found.predicted_rate[:-1]).max()
            assert (found.largest_rise == 0) == (name == "default")
    assert excess["default", 0.01] < 0.6 * excess["default", 0.02]
    assert excess["other", 0.01] > 5 * excess["default", 0.01]
    assert excess["other", 0.01] > 0.9 * excess["other", 0.02]


def test_motion_of_the_unconstrained_form_is_what_its_drives_do(body):
    free = body.in_form("unconstrained")
    law = FeedbackLinearization(stiffness=0.6, damping=1.0)
    goal = dqc.references.SetPoint(body.fkm(HOME + np.array([0.2, 0.2, 0.3, 0, 0.1, 0, 0, 0])))
    record = dqc.simulate(free, goal, law, Integrator(), HOME, 1e-3, duration=0.5)
    found = certificate(free, record, law)
    moved = algebra.multiply(algebra.conjugate(record.pose[:-1]), record.pose[1:])
    speed = np.linalg.norm(2 * algebra.log_screw(moved) / 1e-3, axis=1)
    np.testing.assert_allclose(np.sqrt(found.velocity_part[1:]), speed, rtol=2e-3, atol=1e-9)


def test_runs_record_it(body, tmp_path):
    """V, its predicted rate and W₂ are in the recording and the exports of runs on ideal joints, and in no others."""
    spec = {
        "name": "certified",
        "robot": "little-john",
        "start": HOME.tolist(),
        "period": 0.05,
        "duration": 5,
        "reference": {"kind": "set-point", "offset": {"translation": [0.3, 0.1, 0]}},
        "law": {"kind": "feedback-linearization", "stiffness": 1.0, "damping": 1.0},
        "plant": {"kind": "integrator"},
    }
    run = dqc.run(spec)
    wanted = certificate(body, run.record, FeedbackLinearization(stiffness=1.0, damping=1.0))
    again = load_record(save_record(run.record, tmp_path / "record.mcap"))
    found = Certificate.recorded(again)
    assert found is not None
    for field in fields(wanted):
        np.testing.assert_array_equal(getattr(found, field.name), getattr(wanted, field.name))
    np.testing.assert_array_equal(again.readings[LYAPUNOV].values[:, 0], wanted.value)
    assert export_record(again, tmp_path / "log.csv").read_text().count("lyapunov.value [1/s²]") == 1
    for changes in ({"plant": {"kind": "servo"}}, {"law": {"kind": "proportional", "gain": 1.0}}):
        assert Certificate.recorded(dqc.run(spec | changes).record) is None


@pytest.mark.slow
def test_picture(body, tmp_path):
    law = FeedbackLinearization(stiffness=0.6, damping=1.0)
    figure = lyapunov(certificate(body, regulation(body, law, 0.05), law))
    figure.savefig(tmp_path / "lyapunov.png")
    assert [len(axes.lines) for axes in figure.axes] == [
        3,
        2,
        1,
        1,
        1,
    ]  # each of the last two has a unit of its own
