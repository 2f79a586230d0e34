"""Targets out of reach: curvature against differences of the kinematics, its bound, and joints that come to rest."""

import msgspec
import numpy as np
import pytest
from hand_twist import hand_jacobian
from numba import njit
from scipy.optimize import minimize

import dqcontrol as dqc
from dqcontrol import algebra, constraints, laws
from dqcontrol.laws.growth import counted, curvature, drives_anywhere, growth_for, pose_error, square_bound
from dqcontrol.laws.law import LoopRates
from dqcontrol.loop import close_loop
from dqcontrol.loop.targets import PoseTarget, Speeds
from dqcontrol.robots.robot import Lag
from dqcontrol_theses import variants

SEED, LENGTH = 38, 0.3
STARTS = {
    "panda": [0, -0.3, 0, -2.0, 0, 1.7, 0.7],
    "ur5": [0, -1.2, 1.5, -1.8, -1.5, 0.3],
    "youbot-arm": [0.1, 0.4, -0.6, 0.3, 0.2],
    "little-john": [0, 0, 0, 0.3, -0.8, 1.2, 0.6, 0.4],
}


@njit
def found_curvature(jacobian, p, error, square_length):
    px, py, pz = p[0], p[1], p[2]
    return curvature(
        jacobian, px, py, pz, (error[0], error[1], error[2], error[3], error[4], error[5]), square_length
    )


@njit
def found_error(pose, desired):
    return pose_error(pose, desired)


def placed(pose, position):
    moved = np.zeros(8)
    moved[0], moved[5:8] = 1.0, 0.5 * np.asarray(position)
    return algebra.multiply(moved, np.concatenate([pose[:4], np.zeros(4)]))


def with_growth(law, growth):
    return msgspec.structs.replace(law, inverse=msgspec.structs.replace(law.inverse, growth=growth))


def all_laws(k):
    return {
        "K": laws.Proportional(gain=k),
        "K with an integral": laws.Proportional(gain=k, integral_gain=2.0),
        "K+FF": laws.ProportionalFeedforward(gain=k),
        "decoupled": laws.DecoupledProportional(gain=k),
        "position": laws.PartialProportional(part="position", gain=k),
        "HIR, right": laws.HInfinity(orientation_gain=2 * k, translation_gain=k),
        "HIRT, left": laws.HInfinityTracking(orientation_gain=2 * k, translation_gain=k, form="left"),
        "LQR-R8": laws.LinearQuadraticR8(error_weight=k * k, control_weight=1.0),
        "LQR-DQ": laws.LinearQuadraticDQ(error_weight=k * k, control_weight=1.0),
        "feedback linearisation": laws.FeedbackLinearization(
            stiffness=16 * k * k, damping=4 * k, null_space=None
        ),
        "reduced gradient": variants.ReducedGradient(gain=k),
    }


@pytest.mark.parametrize("prismatic", [(), (1,), (0, 3)])
def test_the_curvature_is_what_the_jacobian_leaves_out_of_the_hessian(make_arm, prismatic):
    """Of ½|e|² by differences of the kinematics, e = [ℓθ ; p_d − p] with the angle and axis θn as θ."""
    rng = np.random.default_rng(SEED)
    for i in range(6):
        arm, q = make_arm(6, prismatic, seed=i), rng.uniform(-1, 1, 6)
        target = algebra.multiply(arm.fkm(q), algebra.exp_screw(rng.uniform(-0.1, 0.1, 6)))

        def cost(q, arm=arm, target=target):
            pose = arm.fkm(q)
            turn = algebra.multiply(target, algebra.conjugate(pose))[:4]
            angle = 2 * np.arctan2(np.linalg.norm(turn[1:]), abs(turn[0]))
            away = algebra.translation(target) - algebra.translation(pose)
            return 0.5 * ((LENGTH * angle) ** 2 + away @ away)

        h, eye = 1e-3, np.eye(6)
        hessian = np.array(
            [
                [
                    (
                        cost(q + h * (a + b))
                        - cost(q + h * (a - b))
                        - cost(q - h * (a - b))
                        + cost(q - h * (a + b))
                    )
                    / (4 * h * h)
                    for b in eye
                ]
                for a in eye
            ]
        )
        jacobian = np.diag([LENGTH] * 3 + [1.0] * 3) @ hand_jacobian(arm, q)
        left_out = np.linalg.norm(hessian - jacobian.T @ jacobian)
        pose = arm.fkm(q)
        error = np.array(found_error(pose, target))
        found = found_curvature(arm.twist_jacobian(q), algebra.translation(pose), error, LENGTH**2)
        size = np.linalg.norm(error)
        assert found == pytest.approx(left_out, abs=0.2 * size * size + 1e-5)  # of second order in θ
        omega = jacobian[:3] / LENGTH
        bound = square_bound(tuple(error), LENGTH**2, (omega**2).sum(), (jacobian**2).sum())
        assert found**2 <= bound


def test_growth_is_half_the_gain_times_period_and_lag_but_not_too_small():
    arm = dqc.load_robot("ur5")
    rates = LoopRates(np.array([10.0, 100.0]), np.array([4.0, 4.0]))
    slow = LoopRates(np.array([10.0]), None, lag=40.0)
    for given, late, expected in ((rates, 0.0, [0.1, 0.5]), (rates, 0.07, [0.4, 4.0]), (slow, 0.0, [0.175])):
        found = growth_for(arm, given, late, 0.01)
        np.testing.assert_allclose(found.growth, expected)
        assert found.share == 1.0
    law = laws.Proportional(gain=10.0)
    lag = Lag((0.05,) * 6, (0.02,) * 6)
    assert law.prepare(arm, None, 0.01, lag=lag).parameters[0, 4] == pytest.approx(0.4)
    assert law.prepare(arm, None, 0.01).in_mode("integrated", lag).parameters[0, 4] == pytest.approx(0.4)
    assert with_growth(law, 0.3).prepare(arm, None, 0.01).parameters[0, 4] == 0.3
    changing = laws.Proportional(gain=laws.Schedule([0.0, 0.02], [10.0, 100.0])).prepare(arm, None, 0.01)
    np.testing.assert_allclose(changing.parameters[:, 4], [0.1, 0.275, 0.5])


def test_of_what_a_base_drives_away_a_share_counts():
    robot = dqc.load_robot("little-john")
    found = growth_for(robot, LoopRates(np.array([2.0, 20.0]), None), 0.01, 0.04)
    np.testing.assert_allclose(found.growth, [0.1, 0.5])
    np.testing.assert_allclose(found.share, [0.5, 1.0])
    error = (0.1, 0.2, 0.3, 0.3, 0.4, 0.6)
    assert counted(error, 1.0) == error
    np.testing.assert_allclose(counted(error, 0.5), [0.05, 0.1, 0.15, 0.15, 0.2, 0.6])


def follow(law, robot, q, target, period, steps, limits=None, start=None):
    """Return the commands of a loop on ideal joints, scaled to the velocity limits."""
    prepared = law.prepare(robot, None, period, limits)
    q, state, sample = q.copy(), prepared.initial_state(q), dqc.Sample(target)
    sent = np.empty((steps, robot.input_size))
    for k in range(steps):
        u = prepared.command(q, sample, state)
        u = u / max(1.0, np.max(np.abs(u) / robot.limits.velocity))
        prepared.sent(state, u)
        q, sent[k] = robot.integrate(q, u, period), u
    return sent, q


def turning_back(sent):
    """Return the share of periods in which some joint turns back, faster than 0.01 rad/s on both sides."""
    before, after = sent[:-1], sent[1:]
    moving = np.minimum(np.abs(before), np.abs(after)) > 0.01
    return float(((before * after < 0) & moving).any(axis=1).mean())


def unreachable(robot, q):
    """Return a target in the hand's direction, twice as far as the robot is long, and one far to its side."""
    pose = robot.fkm(q)
    here = algebra.translation(pose)
    way = {"little-john": 4.0}.get(robot.name, 2.0)
    direction = here / np.linalg.norm(here)
    return [placed(pose, way * direction), placed(pose, [0.2, -way, 0.3]), placed(pose, 10.0 * direction)]


@pytest.mark.parametrize("name", STARTS)
@pytest.mark.parametrize("law", all_laws(10.0))
def test_joints_come_to_rest_at_targets_out_of_reach(name, law):
    robot, q = dqc.load_robot(name), np.array(STARTS[name], dtype=float)
    steps = 600 if name == "little-john" else 400  # a base takes longer
    for target in unreachable(robot, q):
        sent, _ = follow(all_laws(10.0)[law], robot, q, target, 0.033, steps)
        assert turning_back(sent[-100:]) == 0


DRIVING = {
    "little-john": lambda: (dqc.load_robot("little-john"), STARTS["little-john"]),
    "drive and panda": lambda: (
        dqc.WholeBody([dqc.DifferentialDrive(wheel_radius=0.04, half_track=0.13), dqc.load_robot("panda")]),
        [0, 0, 0, *STARTS["panda"]],
    ),
    "holonomic and ur5": lambda: (
        dqc.WholeBody([dqc.HolonomicBase(), dqc.load_robot("ur5")]),
        [0, 0, 0, *STARTS["ur5"]],
    ),
}


@pytest.mark.parametrize("law", ["K", "decoupled", "feedback linearisation"])
@pytest.mark.parametrize("name", DRIVING)
def test_driving_bases_come_to_rest_too(name, law):
    """Also on the way to targets beside and behind the robot, which a base without sideways motion takes long to."""
    robot, q = DRIVING[name]()
    q = np.array(q, dtype=float)
    pose = robot.fkm(q)
    here = algebra.translation(pose)
    tilted = algebra.multiply(pose, algebra.exp_screw(np.array([0, 0.9, 0.3, 0, 0, 0])))
    for target in (
        placed(pose, [0.2, -4, 0.3]),
        placed(pose, [-3, 0.5, here[2] + 0.1]),
        placed(pose, 10.0 * here / np.linalg.norm(here)),
        placed(tilted, here + np.array([-0.3, 0.5, 1.2])),
        placed(tilted, here + np.array([0.3, 0.5, -2.0])),
    ):
        sent, _ = follow(all_laws(10.0)[law], robot, q, target, 0.033, 600)
        assert turning_back(sent[-100:]) == 0


@pytest.mark.parametrize("law", ["K", "decoupled"])
def test_a_drive_comes_to_rest_metres_beside_tilted_targets_that_are_too_high(law):
    """It cannot move sideways, so that x and y stay away there: they count in full. Up to kT = 0.5."""
    rng, period = np.random.default_rng(7), 0.033
    robot, q = dqc.load_robot("little-john"), np.array(STARTS["little-john"])
    pose, steps = robot.fkm(q), round(30.0 / period)
    prepared = all_laws(0.5 / period)[law].prepare(
        robot, None, period, dqc.limits.CommandLimits(velocity=True)
    )
    beside = 0
    for _ in range(40):
        tilted = algebra.multiply(pose, algebra.exp_screw(np.r_[rng.normal(size=3) * 0.5, 0, 0, 0]))
        height = algebra.translation(pose)[2] + rng.uniform(-0.1, 0.6)
        target = placed(tilted, [*rng.uniform(-3, 3, 2), height])
        samples = np.repeat(dqc.Sample(target).numbers[None], steps, axis=0)
        trace = close_loop(prepared, dqc.plants.Integrator().start(robot, q, period, steps, 0), samples)
        away = algebra.translation(target) - algebra.translation(robot.fkm(trace.q[-1]))
        beside += np.linalg.norm(away[:2]) > 0.5
        assert turning_back(trace.command[-steps // 4 :]) == 0
    assert beside > 5


@pytest.mark.parametrize("law", ["HIR, right", "LQR-DQ"])
def test_right_errors_are_those_printed_where_the_lever_is_short_or_damping_does_not_grow(law):
    """Beyond 3ℓ the lever, about θ × (p_d − p), is bounded: the hand would circle at the speed of its joints."""
    robot, q = dqc.load_robot("ur5"), np.array(STARTS["ur5"])
    pose = robot.fkm(q)
    turned = algebra.multiply(pose, algebra.exp_screw(np.array([0.4, 0, 0, 0, 0, 0])))

    def command(away, growth, turned=turned):
        target = placed(turned, algebra.translation(pose) + np.array([away, 0, 0]))
        prepared = with_growth(all_laws(10.0)[law], growth).prepare(robot, None, 0.01)
        return prepared.command(q, dqc.Sample(target), prepared.initial_state(q))

    near = 0.1
    np.testing.assert_array_equal(command(near, 1e-9), command(near, 0.0))
    assert np.abs(command(10.0, 1e-9) - command(10.0, 0.0)).max() > 1.0
    sent, _ = follow(all_laws(10.0)[law], robot, q, placed(pose, [0.0, -10.0, 0.0]), 0.033, 1200)
    assert np.abs(sent[-100:]).max() < 0.01


TWO_ARMS = np.array([-0.1, -0.5, 0.1, -2.2, 0.1, 1.7, 0.8, 0.3, -0.7, -0.2, -2.1, -0.1, 1.5, 0.7])


@pytest.mark.parametrize(
    ("task", "root"),
    [("relative", "midpoint"), ("left", "midpoint"), ("absolute", "midpoint"), ("absolute", "screw")],
)
@pytest.mark.parametrize("law", ["K+FF", "feedback linearisation"])
def test_two_arms_come_to_rest_too(law, task, root):
    """Up to kT = 0.5. The absolute pose keeps the sign that it starts with: the short way round it jumps."""
    period = 0.01
    k = 0.5 / period
    chosen = {
        "K+FF": laws.ProportionalFeedforward(gain=k),
        "feedback linearisation": laws.FeedbackLinearization(
            stiffness=4 * k / period, damping=1 / period, null_space=None
        ),
    }[law]
    two = dqc.load_robot("two-pandas")
    arms = dqc.TwoArms(two.left, two.right, task=task, root=root).from_start(TWO_ARMS)
    for target in unreachable(arms, TWO_ARMS):
        sent, _ = follow(chosen, arms, TWO_ARMS, target, period, 1200)
        assert turning_back(sent[-300:]) == 0


def jittering(robot, q, share, period, seconds):
    """Return poses that jitter by 3 mm and 0.5°, 30 times a second, at a share of the reach, and when new ones come."""
    rng, frames = (
        np.random.default_rng(SEED),
        (30.0 * period * np.arange(round(seconds / period))).astype(int),
    )
    pose = robot.fkm(q)
    here = algebra.translation(pose)
    along = here / np.linalg.norm(here)
    bounds = list(zip(robot.limits.lower, robot.limits.upper, strict=True))
    found = minimize(lambda x: -along @ algebra.translation(robot.fkm(x)), q, bounds=bounds).x
    far = algebra.translation(robot.fkm(found))
    noise = 0.003 * rng.normal(size=(frames[-1] + 1, 6))
    poses = [
        placed(
            algebra.multiply(pose, algebra.exp_screw([*(1.5 * each[3:]), 0, 0, 0])), share * far + each[:3]
        )
        for each in noise
    ]
    return [dqc.Sample(poses[frame]) for frame in frames], np.diff(frames) > 0


@pytest.mark.parametrize("share", [0.95, 1.01, 1.1])
@pytest.mark.parametrize("name", ["panda", "ur5", "youbot-arm"])
def test_where_a_target_jitters_joints_turn_back_with_it_and_never_on_their_own(name, share):
    """Within reach, at its edge and beyond; without growth they turn back in most periods between its frames too."""
    robot, q, period = dqc.load_robot(name), np.array(STARTS[name]), 0.01
    samples, fresh = jittering(robot, q, share, period, 6.0)
    samples = np.array([each.numbers for each in samples])
    on_its_own = {}
    for growth in (None, 0.0):
        law = with_growth(laws.DecoupledProportional(gain=10.0), growth)
        prepared = law.prepare(robot, None, period, dqc.limits.CommandLimits(velocity=True))
        plant = dqc.plants.Integrator().start(robot, q, period, len(samples), 0)
        sent = close_loop(prepared, plant, samples).command[200:]
        before, after = sent[:-1], sent[1:]
        turning = (before * after < 0) & (np.minimum(np.abs(before), np.abs(after)) > 0.01)
        on_its_own[growth] = (turning.any(axis=1) & ~fresh[200:]).mean()
    assert on_its_own[None] < 0.01
    if name != "youbot-arm" and share > 1:
        assert on_its_own[0.0] > 0.5


def test_a_jittering_target_at_the_edge_of_the_reach_turns_no_joint_back_through_a_pose_target():
    """Fed to the law as it is, it turned joints of this arm back in an eighth of the periods."""
    robot, q, period = dqc.load_robot("youbot-arm"), np.array(STARTS["youbot-arm"]), 0.01
    samples, fresh = jittering(robot, q, 1.01, period, 6.0)
    prepared = laws.DecoupledProportional(gain=10.0).prepare(robot, None, period)
    shares = []
    for speeds in (None, Speeds(linear=0.5, angular=1.5, acceleration=3.0)):
        at, state, sent = q, prepared.initial_state(q), np.empty((len(samples), 5))
        target = PoseTarget(speeds or Speeds())
        target.start(robot.fkm(q))
        for k, sample in enumerate(samples):
            if k == 0 or fresh[k - 1]:
                target.ask(k * period, sample.pose)
            moved = dqc.Sample.of_row(target.sample(k * period, robot.fkm(at)))
            u = prepared.command(at, moved if speeds else sample, state)
            sent[k] = u / max(1.0, np.max(np.abs(u) / robot.limits.velocity))
            prepared.sent(state, sent[k])
            at = robot.integrate(at, sent[k], period)
        before, after = sent[200:-1], sent[201:]
        turning = (before * after < 0) & (np.minimum(np.abs(before), np.abs(after)) > 0.12)
        shares.append(turning.any(axis=1).mean())
    assert shares[0] > 0.05
    assert shares[1] < 0.01


def test_without_growth_they_shake():
    robot, q = dqc.load_robot("panda"), np.array(STARTS["panda"])
    sent, _ = follow(
        with_growth(laws.Proportional(gain=10.0), 0.0), robot, q, unreachable(robot, q)[0], 0.033, 400
    )
    assert turning_back(sent[-100:]) > 0.9


@pytest.mark.parametrize("what", ["clamping", "constraints", "posture"])
def test_limits_constraints_and_preferred_motion_leave_them_calm(what):
    robot, q = dqc.load_robot("panda"), np.array(STARTS["panda"])
    options, limits = {}, None
    if what == "clamping":
        limits = dqc.limits.CommandLimits(position=dqc.limits.ModifiedClamping())
    if what == "constraints":
        options = {"constraints": constraints.Constraints()}
    if what == "posture":
        options = {"null_space": laws.Posture(gain=1.0)}
    for target in unreachable(robot, q):
        sent, _ = follow(laws.Proportional(gain=10.0, **options), robot, q, target, 0.01, 600, limits)
        assert turning_back(sent[-150:]) == 0


def test_further_tasks_leave_them_calm():
    from dqcontrol.controller.task_levels import FurtherTask, PreparedTasks

    robot, q = dqc.load_robot("panda"), np.array(STARTS["panda"])
    tasks = PreparedTasks(robot, [FurtherTask("posture", 5.0)], q, np.zeros(1))
    prepared = laws.Proportional(gain=10.0).prepare(robot, None, 0.01, tasks=tasks)
    state, sample, at = prepared.initial_state(q), dqc.Sample(unreachable(robot, q)[0]), q.copy()
    sent = np.empty((600, 7))
    for k in range(600):
        u = prepared.command(at, sample, state)
        sent[k] = u / max(1.0, np.max(np.abs(u) / robot.limits.velocity))
        at = at + 0.01 * sent[k]
    assert turning_back(sent[-150:]) == 0


DRIVEN = {
    "little-john": lambda: dqc.load_robot("little-john"),
    "holonomic": lambda: dqc.WholeBody([dqc.HolonomicBase(), dqc.load_robot("ur5")]),
    "without sideways": lambda: dqc.load_robot("little-john").in_form("unconstrained"),
}


@pytest.mark.parametrize("name", DRIVEN)
def test_bases_that_drive_are_recognised(name):
    robot = DRIVEN[name]()
    assert drives_anywhere(robot)
    assert not drives_anywhere(dqc.load_robot("ur5"))


@pytest.mark.parametrize("law", ["K", "decoupled", "feedback linearisation"])
def test_growth_does_not_slow_a_robot_that_drives_to_far_goals(law):
    """Times to the last error above 1 cm, at the goal that 40 s suffice for with growth and without."""
    robot, rng, ratios = dqc.load_robot("little-john"), np.random.default_rng(SEED), []
    home = np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
    limits = dqc.limits.CommandLimits(position=dqc.limits.ModifiedClamping())
    for _ in range(40):
        away = np.r_[rng.uniform(-3, 3, 3), rng.uniform(-0.5, 0.5, 5)]
        goal = dqc.references.SetPoint(robot.fkm(home + away))
        times = []
        for growth in (0.0, None):
            chosen = with_growth(all_laws(0.25 if law == "feedback linearisation" else 1.0)[law], growth)
            if law == "feedback linearisation":
                chosen = msgspec.structs.replace(
                    chosen, null_space=laws.FeedbackLinearization(stiffness=1.0, damping=1.0).null_space
                )
            record = dqc.simulate(
                robot, goal, chosen, dqc.plants.Integrator(), home, 0.05, 40.0, limits=limits
            )
            times.append(record.time[record.position_error > 0.01].max())
        if max(times) < 39.0:
            ratios.append(times[1] / times[0])
    print(f"{len(ratios)} arrived, times over those without growth {np.round(ratios, 3)}")
    assert len(ratios) >= 3
    assert np.median(ratios) < 1.02


@pytest.mark.parametrize("name", STARTS)
@pytest.mark.parametrize("law", [name for name in all_laws(1.0) if name != "feedback linearisation"])
def test_where_the_error_is_small_the_command_is_that_without_growth_to_the_bit(name, law):
    robot, q = dqc.load_robot(name), np.array(STARTS[name], dtype=float)
    rng, inputs = np.random.default_rng(SEED), robot.input_size
    for _ in range(5):
        begin = robot.integrate(q, rng.uniform(-0.2, 0.2, inputs), 1.0)
        sample = dqc.Sample(robot.fkm(robot.integrate(begin, rng.uniform(-2e-3, 2e-3, inputs), 1.0)))
        commands = []
        for growth in (None, 0.0):
            prepared = with_growth(all_laws(10.0)[law], growth).prepare(robot, None, 0.01)
            commands.append(prepared.command(begin, sample, prepared.initial_state(begin)))
        np.testing.assert_array_equal(*commands)


@pytest.mark.parametrize("law", ["K", "position"])
@pytest.mark.parametrize("name", ["panda", "ur5", "youbot-arm"])
def test_commands_are_those_without_growth_just_where_the_curvature_needs_no_damping(name, law):
    """To the bit, near and far, also where σ is below ε: up to c‖C‖ = 1/tr G⁻¹ ≤ σ²min, and not beyond."""
    robot, rng, equal = dqc.load_robot(name), np.random.default_rng(SEED), []
    prepared = [
        with_growth(all_laws(10.0)[law], growth).prepare(robot, None, 0.033) for growth in (None, 0.0)
    ]
    c, length = prepared[0].parameters[0, 4], LENGTH if law == "K" else 1.0
    for _ in range(300):
        q = np.array(STARTS[name]) + rng.uniform(-1, 1, robot.input_size)
        away = 10.0 ** rng.uniform(-4, 0) * rng.normal(size=3)
        place = algebra.translation(robot.fkm(q))
        jacobian = np.diag([length] * 3 + [1.0] * 3) @ hand_jacobian(robot, q)
        singular = np.linalg.svd(jacobian if law == "K" else jacobian[3:], compute_uv=False)
        curved = found_curvature(robot.twist_jacobian(q), place, np.array([0, 0, 0, *away]), length**2)
        needed = c * curved * (1 / singular**2).sum()
        if abs(needed - 1.0) < 1e-3 or singular[-1] < 1e-3:
            continue
        sample = dqc.Sample(placed(robot.fkm(q), place + away))
        commands = [each.command(q, sample, each.initial_state(q)) for each in prepared]
        equal.append(np.array_equal(*commands))
        assert equal[-1] == (needed < 1.0)
    assert 50 < sum(equal) < len(equal) - 50


def test_the_hand_rests_where_it_is_nearest():
    """Growth changes how fast the hand comes there, not where: at the end of the stretched arm."""
    robot, q = dqc.load_robot("ur5"), np.array(STARTS["ur5"])
    law = laws.PartialProportional(part="position", gain=10.0)
    target = unreachable(robot, q)[0]
    _, end = follow(law, robot, q, target, 0.01, 4000)
    away = algebra.translation(target) - algebra.translation(robot.fkm(end))
    slopes = hand_jacobian(robot, end)[3:].T @ away
    assert np.abs(slopes).max() < 2e-2 * np.linalg.norm(away)
