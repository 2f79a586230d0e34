"""The range condition: against least squares, and that it tells runs that are stuck from those that arrive."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.experiments import load_run
from dqcontrol.experiments.run_comparison import summary
from dqcontrol.figures import range_condition
from dqcontrol.laws import FeedbackLinearization, FilteredInverse, GuidedProportional
from dqcontrol.limits import CommandLimits, ModifiedClamping
from dqcontrol.loop.record import part_of
from dqcontrol.loop.signals import Signal
from dqcontrol.measures import task_range
from dqcontrol.measures.task_range import RANGE, lost_share, outside_range, with_range
from dqcontrol.plants import Integrator
from dqcontrol.references import DriveTo, SetPoint, random_goals

HOME = np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
BESIDE = np.array([-0.5, 0.5, 0, 0, 0, 0, 0, 0])
SEED = 20261203


@pytest.fixture(scope="module")
def robot():
    return dqc.load_robot("little-john")


def drive(robot, law, goal, seconds=60.0, limits=None, start=HOME):
    return dqc.simulate(robot, SetPoint(goal), law, Integrator(), start, 0.05, seconds, limits=limits)


def test_outside_is_what_least_squares_leaves():
    """An arm of five joints: of six directions one is missing everywhere."""
    arm, rng = dqc.load_robot("ax18"), np.random.default_rng(SEED)
    q = np.array([0.2, -0.6, 0.9, 0.5, 0.3])
    record = drive(arm, dqc.laws.Proportional(gain=1.0), arm.fkm(q + 0.2), 2.0, start=q)
    asked = rng.standard_normal((len(record), 6))
    found = task_range(arm, record, asked, FilteredInverse(characteristic_length=0.5))
    weight = np.array([0.5, 0.5, 0.5, 1, 1, 1])
    np.testing.assert_allclose(found.asked, np.linalg.norm(weight * asked, axis=1))
    for k in (0, 10, 40):
        rotation = np.r_[record.pose[k, :4], np.zeros(4)]
        wanted, jacobian = algebra.adjoint_twist(rotation, asked[k]), arm.hand_jacobian(record.q[k])
        wanted, jacobian = weight * wanted, weight[:, None] * jacobian
        left = wanted - jacobian @ np.linalg.lstsq(jacobian, wanted, rcond=None)[0]
        assert found.outside[k] == pytest.approx(np.linalg.norm(left), rel=1e-9)
    assert found.smallest_singular_value.max() == 0


def test_asked_is_the_straight_way_to_the_goal(robot):
    """Following it for a second arrives: the translation, and the rotation each about their own."""
    record = drive(robot, dqc.laws.Proportional(gain=0.5), robot.fkm(HOME + BESIDE), 1.0)
    asked = task_range(robot, record).asked
    turn, way = record.orientation_error, record.position_error
    np.testing.assert_allclose(
        asked, np.hypot(FilteredInverse().characteristic_length * turn, way), rtol=1e-9
    )


def test_a_stuck_run_ends_outside_and_one_that_arrives_does_not(robot):
    goal = robot.fkm(HOME + BESIDE)
    law = FeedbackLinearization(stiffness=1.0, damping=1.0)
    stuck = drive(robot, msgspec.structs.replace(law, null_space=None), goal)
    arrived = drive(robot, law, goal)
    assert stuck.error[-1] > 0.01
    assert task_range(robot, stuck, inverse=law.inverse).share[-1] > 0.99
    assert arrived.error[-1] < 1e-3
    assert task_range(robot, arrived, inverse=law.inverse).share[-1] < 0.01


def test_joints_that_rest_at_their_limits_are_no_range(robot):
    """A goal that needs joint 2 beyond its limit: with clamping it rests there, and the error left is outside."""
    start = HOME + np.eye(8)[4] * 0.5
    beyond = start + np.array([0, 0, 0, 0, -2.4, 0, 0, 0])
    limits = CommandLimits(position=ModifiedClamping())
    law = dqc.laws.Proportional(gain=1.0)
    found = []
    for seed in range(30):
        goal = robot.fkm(beyond + np.random.default_rng(seed).uniform(-0.3, 0.3, 8))
        record = drive(robot, law, goal, 40.0, limits, start)
        at = np.abs(
            record.q[-1] - np.clip(record.q[-1], robot.limits.lower + 1e-6, robot.limits.upper - 1e-6)
        )
        if at.max() > 0 and record.error[-1] > 1e-2 and np.abs(record.command[-1]).max() < 1e-6:
            found.append(task_range(robot, record, inverse=FilteredInverse(threshold=0.05)).share[-1])
        if len(found) == 5:
            break
    assert found, "some end at a limit, at rest"
    assert np.median(found) > 0.9


def test_a_plan_asks_for_nothing_outside(robot):
    """J u is in the range of J: of what the reference asks nothing is lost, at random goals with any arm."""
    law = GuidedProportional(gain=1.0)
    for goal in robot.fkm(random_goals(robot, HOME, 5, reach=1.5, seed=SEED)):
        way = DriveTo.pose(robot, HOME, goal)
        record = dqc.simulate(robot, way, law, Integrator(), HOME, 0.05)
        found = task_range(robot, record, inverse=FilteredInverse(threshold=1e-6))
        assert found.asked.max() > 0.05
        assert found.outside.max() < 1e-5


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::dqcontrol.errors.LimitWarning")
def test_runs_record_it_and_tables_show_its_share(robot, tmp_path):
    spec = {
        "name": "range",
        "robot": "little-john",
        "start": HOME.tolist(),
        "period": 0.05,
        "duration": 20,
        "reference": {"kind": "set-point", "offset": {"translation": [-0.5, 0.5, 0]}},
        "law": {"kind": "proportional", "gain": 0.5},
        "plant": {"kind": "integrator"},
    }
    run = dqc.run(spec)
    found = task_range(robot, run.record)
    values = run.record.readings[RANGE].values
    np.testing.assert_array_equal(values[:, 1], found.outside)
    mean = (values[1:] + values[:-1]) / 2
    share = mean[:, 1].sum() / mean[:, 0].sum()
    assert share > 0.3
    assert run.metrics.outside_range == pytest.approx(share)
    run.save(tmp_path / "run")
    assert '<figure id="range">' in (tmp_path / "run/report.html").read_text(encoding="utf-8")
    assert load_run(tmp_path / "run").metrics.outside_range == run.metrics.outside_range
    table = summary({"stuck": run})
    assert table.rows[0][[column.title for column in table.columns].index("outside range of J")] > 0.3


def test_arms_have_none_and_a_run_that_diverged_has_gaps(robot):
    arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    record = drive(arm, dqc.laws.Proportional(gain=1.0), arm.fkm(q + 0.1), 1.0, start=q)
    assert RANGE not in with_range(arm, record).readings
    assert np.isnan(outside_range(record))
    good = drive(robot, dqc.laws.Proportional(gain=0.5), robot.fkm(HOME + BESIDE), 1.0)
    bad = good.q.copy()
    bad[-1], bad[-2, 0] = np.nan, 1e9
    diverged = with_range(robot, replace(good, q=bad, pose=robot.fkm(np.nan_to_num(bad))))
    values = diverged.readings[RANGE].values
    assert np.isfinite(values[:-2]).all()
    assert np.isnan(values[-2:]).all()


@pytest.mark.slow
def test_picture(robot, tmp_path):
    record = drive(robot, dqc.laws.Proportional(gain=0.5), robot.fkm(HOME + BESIDE), 10.0)
    figure = range_condition(task_range(robot, record), record.error)
    figure.savefig(tmp_path / "range.png")
    assert [len(axes.lines) for axes in figure.axes] == [1, 2, 1]


def test_what_a_singularity_takes_follows_the_inverse_of_the_law_and_its_part():
    """Nearly upright, and asked to turn about x: how much of that is lost depends on ℓ and on the threshold."""
    arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.03, 0, 0.06, 0, 0.03, 0])
    turned = algebra.multiply(algebra.pose([np.cos(0.1), np.sin(0.1), 0, 0], [0, 0, 0]), arm.fkm(q))
    turned = algebra.pose(turned[:4], algebra.translation(arm.fkm(q)))
    found = []
    for length, threshold in ((0.1, 0.005), (1.0, 0.005), (1.0, 0.02), (0.3, 0.02)):
        inverse = FilteredInverse(threshold=threshold, characteristic_length=length)
        weight = np.array([length] * 3 + [1.0] * 3)
        left, values, _ = np.linalg.svd(weight[:, None] * arm.hand_jacobian(q))
        found.append(lost_share(arm, q, turned, inverse=inverse))
        wanted = np.linalg.norm(left[0, values < threshold])  # of a turn about x
        assert found[-1] == pytest.approx(wanted, abs=1e-9)
    assert found[0] > 0.98
    assert found[1] == 0
    assert 0.4 < found[2] < 0.6
    down = algebra.multiply(algebra.pose([1, 0, 0, 0], [0, 0, -0.1]), arm.fkm(q))
    least = np.linalg.svd(arm.hand_jacobian(q)[3:], compute_uv=False)[-1]
    for threshold, lost in ((1.1 * least, 1.0), (0.9 * least, 0.0)):
        inverse = FilteredInverse(threshold=threshold)
        assert lost_share(arm, q, down, "position", inverse) == pytest.approx(lost, abs=0.01)


def test_a_record_of_one_sample_has_its_range_and_a_task_that_is_done_loses_nothing(robot):
    record = drive(robot, dqc.laws.Proportional(gain=0.5), robot.fkm(HOME + BESIDE), 1.0)
    found = task_range(robot, record)
    at = len(record) // 2
    one = task_range(robot, part_of(record, at, at + 1))
    assert (one.asked[0], one.outside[0]) == (found.asked[at], found.outside[at])
    arm, q = dqc.load_robot("iiwa7"), np.zeros(7)
    assert lost_share(arm, q, arm.fkm(q)) == 0


@pytest.mark.parametrize(
    ("asked", "outside", "share"), [([2.0, 2, 2], [0.0, 1, 2], 0.5), ([0.0, 0, 0], [0.0] * 3, None)]
)
def test_the_share_outside_is_of_what_was_asked_over_time(robot, asked, outside, share):
    record = part_of(drive(robot, dqc.laws.Proportional(gain=0.5), robot.fkm(HOME), 1.0), 0, 3)
    values = np.column_stack([asked, outside, np.ones(3)])
    found = outside_range(
        replace(record, readings={RANGE: Signal(RANGE, ("", "", ""), ("", "", ""), values)})
    )
    assert np.isnan(found) if share is None else found == pytest.approx(share)
