"""Several tasks at once: levels against projections written out, runs of two arms, and what is refused."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.controller import FurtherTask, PreparedTasks
from dqcontrol.controller.task_levels import task_levels
from dqcontrol.errors import InterpretedWarning, ReachError, ShapeError, UnknownNameError, ValueRangeError
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.loop import Record
from dqcontrol.robots.robot import Lag

Q = np.array([-0.1, -0.5, 0.1, -2.2, 0.1, 1.7, 0.8, 0.3, -0.7, -0.2, -2.1, -0.1, 1.5, 0.7])
LAW = dqc.laws.ProportionalFeedforward(gain=5.0)


@pytest.fixture(scope="module")
def arms():
    return dqc.load_robot("two-pandas")


@pytest.fixture(scope="module")
def on_a_torso():
    torso = dqc.SerialArm.from_dh([0, 0], [0.4, 0.1], [0, 0.1], [1.2, 0.3])
    sides = [
        dqc.SerialArm.join([dqc.DualQuaternion.from_translation([0, y, 0]), dqc.load_robot("ur5")])
        for y in (0.4, -0.4)
    ]
    return dqc.TwoArms(*sides, base=torso)


def stands_still(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    _ = "".join(str(type(object())))  # no compiled code for this
    out[:] = 0.0


def circle(robot, q, **other):
    return dqc.references.Circle(robot.fkm(q), radius=0.06, duration=2.0, **other)


def run(robot, tasks, plant=None, q=Q, law=LAW, **other):
    plant = plant or dqc.plants.Integrator()
    return dqc.simulate(robot, circle(robot, q), law, plant, q, period=0.01, tasks=tasks, **other)


def asked(robot, task, q, sample, gain):
    """Return the Jacobian of a task's [ω ; ṗ] and what it asks for."""
    chosen = robot.with_task(task)
    x, want = dqc.DualQuaternion(chosen.fkm(q)), dqc.DualQuaternion(sample[:8])
    error = (want * x.conj()).short()
    axis, angle = dqc.DualQuaternion.from_pose(error.rotation, [0, 0, 0]).axis_angle()
    move = (
        gain * (want.translation - x.translation) + sample[11:14] + np.cross(sample[8:11], want.translation)
    )
    return chosen.hand_jacobian(q), np.concatenate([gain * angle * axis + sample[8:11], move])


def solved(stages, u):
    """Return u with what each level (J, y, c‖C‖) adds, and by how much each was damped."""
    change, left, dampings = np.zeros(len(u)), np.eye(len(u)), []
    for jacobian, rate, grown in stages:
        projected = jacobian @ left
        gram = projected @ projected.T
        smallest = np.linalg.eigvalsh(gram)[0]
        least = 1 / np.trace(np.linalg.inv(gram)) if smallest > 1e-9 else 0.0
        damping = max(0.02**2 * (1 - least / 0.04**2), grown - least, 0.0)
        inverse = projected.T @ np.linalg.inv(gram + damping * np.eye(len(gram)))
        change = change + inverse @ (rate - jacobian @ (u + change))
        left = left - inverse @ projected
        dampings.append(damping)
    return u + change, dampings


@pytest.mark.parametrize(("level", "sign"), [(0, 1), (1, 1), (2, 1), (1, -1)])
def test_levels_are_projections(on_a_torso, level, sign):
    """Both hands on one torso want to go where they cannot go together: six, then eight rows of 14 inputs."""
    robot, rng = on_a_torso.with_task("left"), np.random.default_rng(3)
    length = np.diag([0.3, 0.3, 0.3, 1, 1, 1])
    for _ in range(5):
        q, u = rng.uniform(-1, 1, 14), rng.uniform(-0.3, 0.3, 14)
        sample = dqc.Sample(robot.fkm(q + 0.1, "right"), rng.uniform(-0.1, 0.1, 6))
        held = FurtherTask("right", 4.0, level=level)
        tasks = PreparedTasks(robot, [held, FurtherTask("relative", 2.0, level=3)], q + 0.1, np.zeros(1))
        samples = []
        for i in range(2):  # targets that move, of either sign
            given = tasks.samples_in(tasks.parameters, i)[0]
            given[:8] *= sign
            given[8:14] = rng.uniform(-0.2, 0.2, 6)
            samples.append(given)
        found = robot.kinematics(q)
        out = u.copy()
        assert (
            tasks.kernel(
                q,
                found.pose,
                found.twist_jacobian,
                sample.numbers,
                0,
                tasks.parameters,
                np.zeros(tasks.work_size),
                out,
            )
            == 0
        )
        first = robot.hand_jacobian(q), robot.hand_jacobian(q) @ u
        right, last = asked(robot, "right", q, samples[0], 4.0), asked(robot, "relative", q, samples[1], 2.0)
        stages = {0: ([right], [first]), 1: ([first, right],), 2: ([first], [right])}[level]
        whole = [
            (
                np.vstack([length @ each[0] for each in stage]),
                np.concatenate([length @ each[1] for each in stage]),
            )
            for stage in (*stages, [last])
        ]
        expected, _ = solved([(*each, 0.0) for each in whole], u)
        np.testing.assert_allclose(out, expected, rtol=1e-5, atol=1e-7)


def curvature(hand, error, square_length):
    """Return the Frobenius norm of Σ eᵢ ∂²xᵢ, of a chain whose joints have the columns [ω ; a] in their order."""
    m = hand.shape[1]
    second = np.zeros((m, m))
    for i in range(m):
        for j in range(i, m):
            turn = np.cross(hand[:3, i], hand[3:, j]) @ error[3:]
            turn += 0.5 * square_length * error[:3] @ np.cross(hand[:3, i], hand[:3, j])
            second[i, j] = second[j, i] = turn
    return np.linalg.norm(second)


@pytest.mark.parametrize(
    ("part", "turns", "moves"), [("pose", 1, 1), ("position", 0, 1), ("orientation", 1, 0)]
)
@pytest.mark.parametrize("level", [0, 1])
def test_damping_grows_with_the_curvature_of_the_errors_of_the_first_level(arms, part, turns, moves, level):
    """λ² = c‖C‖ of the law's error and c_t‖C_t‖ of a task's, less 1/tr (AAᵀ)⁻¹; what follows is damped as it is."""
    robot, rng = arms.with_task("left"), np.random.default_rng(9)
    q, u, weight, late, own_growth = (
        Q + rng.uniform(-0.2, 0.2, 14),
        rng.uniform(-0.3, 0.3, 14),
        2.0,
        0.25,
        3.0,
    )
    task = FurtherTask("right", 8.0, level=level, part=part, weight=weight)
    tasks = PreparedTasks(robot, [task], q + rng.uniform(-0.3, 0.3, 14), np.zeros(1))
    at = task_levels.place("growth")
    tasks.parameters[at : at + 3] = own_growth, late, 0.6
    wanted = tasks.samples_in(tasks.parameters, 0)[0]
    found, sample, out = robot.kinematics(q), dqc.Sample(robot.fkm(q + 0.1)), u.copy()
    given = sample.numbers, 0, tasks.parameters, np.zeros(tasks.work_size), out
    assert tasks.kernel(q, found.pose, found.twist_jacobian, *given) == 0

    def grown(chosen, goal, square_length, square_move):
        between = dqc.algebra.short(dqc.algebra.multiply(goal, dqc.algebra.conjugate(chosen.fkm(q))))
        away = dqc.algebra.translation(goal) - dqc.algebra.translation(chosen.fkm(q))
        error = np.concatenate([2 * between[1:4] * (square_length > 0), square_move * away])
        return curvature(chosen.hand_jacobian(q), np.array([0.6] * 5 + [1.0]) * error, square_length)

    right = robot.with_task("right")
    rows = np.repeat([0.3 * turns, moves], 3) * np.sqrt(weight)
    hand, rates = asked(robot, "right", q, wanted, 8.0)
    further = (rows[:, None] * hand)[rows > 0], (rows * rates)[rows > 0]
    own = np.repeat([0.3, 1.0], 3)[:, None] * robot.hand_jacobian(q)
    growth = own_growth * grown(robot, sample.pose, 0.09, 1.0)
    growth_of_task = max(0.1, 8.0 * late) * grown(right, wanted[:8], 0.09 * weight * turns, weight * moves)
    if level == 0:
        stages = [(*further, growth_of_task), (own, own @ u, growth)]
    else:
        both = np.vstack([own, further[0]]), np.concatenate([own @ u, further[1]])
        stages = [(*both, growth + growth_of_task)]
    expected, damping = solved(stages, u)
    assert min(damping) > 1e-3, "it is damped"
    np.testing.assert_allclose(out, expected, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("part", ["axis", "line"])
def test_an_axis_takes_the_short_way_and_leaves_what_is_free_about_and_along_it(on_a_torso, part):
    """In the desired axes: the two turns across it, of a line the two moves across it too"""
    robot, rng = on_a_torso.with_task("left"), np.random.default_rng(5)
    for _ in range(6):
        q, u = rng.uniform(-1, 1, 14), rng.uniform(-0.3, 0.3, 14)
        task = FurtherTask("right", 3.0, level=0, part=part)
        posture = FurtherTask("posture", 0.5, posture=q + rng.uniform(-0.2, 0.2, 14), level=3, weight=0.25)
        tasks = PreparedTasks(robot, [task, posture], q + rng.uniform(-0.3, 0.3, 14), np.zeros(1))
        sample = tasks.samples_in(tasks.parameters, 0)[0]
        sample[8:14] = rng.uniform(-0.2, 0.2, 6)
        found, out = robot.kinematics(q), u.copy()
        given = dqc.Sample(robot.fkm(q)).numbers, 0, tasks.parameters, np.zeros(tasks.work_size), out
        assert tasks.kernel(q, found.pose, found.twist_jacobian, *given) == 0
        chosen = robot.with_task("right")
        present, desired = (
            dqc.algebra.matrix_from_rotation(dqc.algebra.rotation(x)) for x in (chosen.fkm(q), sample[:8])
        )
        turn = np.cross(present[:, 2], desired[:, 2])
        angle = np.arctan2(np.linalg.norm(turn), present[:, 2] @ desired[:, 2])
        _, wanted = asked(robot, "right", q, sample, 3.0)
        wanted[:3] = 3.0 * angle * turn / np.linalg.norm(turn) + sample[8:11]
        across = np.kron(np.eye(2), desired[:, :2].T)[: 4 if part == "line" else 2]
        jacobian = across @ chosen.hand_jacobian(q)
        np.testing.assert_allclose(jacobian @ out, across @ wanted, atol=1e-9)
        weights = np.repeat([0.3, 1.0], 2)[: len(across), None]
        own = np.repeat([0.3, 1.0], 3)[:, None] * robot.hand_jacobian(q)
        joints = 0.5 * np.eye(14), 0.5 * 0.5 * (np.asarray(posture.posture) - q)
        stages = [
            (weights * jacobian, weights[:, 0] * (across @ wanted), 0.0),
            (own, own @ u, 0.0),
            (*joints, 0.0),
        ]
        expected, damping = solved(stages, u)
        assert damping[:2] == [0.0, 0.0]
        np.testing.assert_allclose(out, expected, rtol=1e-5, atol=1e-7)


def test_a_task_before_the_law_s_is_done_whatever_that_wants(arms):
    absolute = arms.with_task("absolute")
    alone, held = run(absolute, []), run(absolute, [FurtherTask("relative", 20.0, level=0)])
    assert held.position_error.max() < 1e-3
    relative = dqc.measures.evaluate(held).tasks["left_seen_from_right"]
    assert relative.position.peak < 0.05  # mm
    drift = np.abs(arms.relative_pose(alone.q) - arms.relative_pose(Q)).max()
    assert drift > 20 * np.abs(arms.relative_pose(held.q) - arms.relative_pose(Q)).max()


def test_tasks_follow_references_of_their_own(arms):
    relative = arms.with_task("relative")
    sheet = dqc.references.Circle(arms.fkm(Q, "right"), radius=0.05, duration=2.0, plane="yz")
    record = run(relative, [FurtherTask("right", 5.0, sheet)])
    assert record.position_error.max() < 1e-3
    assert dqc.measures.evaluate(record).tasks["right"].position.peak < 1.0  # mm
    only = run(relative, [FurtherTask("right", 5.0, sheet, part="position")])
    right = dqc.measures.evaluate(only).tasks["right"]
    assert right.position.peak < 1.0
    assert np.isnan(right.orientation.peak)


@pytest.mark.parametrize("plant", [dqc.plants.Integrator(), dqc.plants.Servo()])
def test_interpreted_and_compiled_are_equal(arms, plant):
    tasks = [FurtherTask("relative", 20.0, level=0), FurtherTask("left", 1.0, part="orientation")]
    records = [run(arms.with_task("absolute"), tasks, plant, interpreted=each) for each in (False, True)]
    assert (records[0].q == records[1].q).all()


def test_half_a_turn_between_the_hands_is_no_jump():
    """The hands pass half a turn while both are driven: the command stays small."""
    panda = dqc.load_robot("panda")
    q = np.concatenate([Q[:7], Q[:7]])
    x = dqc.DualQuaternion(panda.fkm(Q[:7]))
    turn = dqc.DualQuaternion.from_axis_angle([0, 0, 1], np.radians(170))
    away = dqc.DualQuaternion.from_translation([0.2, 0.3, 0])
    arms = dqc.TwoArms(dqc.SerialArm.join([panda, turn]), dqc.SerialArm.join([away, panda]))
    assert x.vec8.shape == (8,)
    absolute = arms.with_task("absolute")
    poses = np.array([arms.relative_pose(q)] * 2)
    poses[1] = (
        dqc.DualQuaternion(poses[1]) * dqc.DualQuaternion.from_axis_angle([0, 0, 1], np.radians(30))
    ).vec8
    turning = dqc.references.ViaPoints([0.0, 3.0], poses)
    still = dqc.references.SetPoint(absolute.fkm(q))
    for sign in (1, -1):
        start = type(still)(sign * still.at(0).pose)
        record = dqc.simulate(
            absolute, start, LAW, dqc.plants.Integrator(), q, period=0.01, duration=3.0,
            tasks=[FurtherTask("relative", 10.0, turning, level=0)],
        )  # fmt: skip
        assert isinstance(record, Record)
        real = arms.relative_pose(record.q)[:, 0]
        assert real.min() < 0 < real.max()  # past half a turn
        assert np.abs(np.diff(record.command[:-2], axis=0)).max() < 0.02  # it ends at speed
        assert record.position_error.max() < 1e-4
        assert record.orientation_error.max() < 1e-3


def spec(**other):
    return {
        "name": "both", "robot": {"source": "two-pandas", "task": "absolute"}, "start": Q.tolist(), "period": 0.01,
        "reference": {"kind": "circle", "radius": 0.05, "duration": 1}, "law": {"kind": "proportional", "gain": 5},
        "plant": {"kind": "integrator"}, "tasks": [{"task": "relative", "gain": 10, "level": 0}],
    } | other  # fmt: skip


def test_a_spec_keeps_its_tasks(tmp_path):
    ready = prepare(spec())
    (tmp_path / "spec.yaml").write_text(ready.text)
    again = prepare(tmp_path / "spec.yaml")
    assert again.text == ready.text
    assert again.fingerprint() == ready.fingerprint()
    assert (
        again.fingerprint()
        != prepare(spec(tasks=[{"task": "relative", "gain": 9, "level": 0}])).fingerprint()
    )


PANDA = {"robot": "panda", "start": Q[:7].tolist(), "tasks": [{"task": "relative", "gain": 1}]}
FAR = {"kind": "set-point", "start": {"position": [0, 3, 0]}}
REFUSED = (
    (PANDA, UnknownNameError, r"tasks\[0\]: frame: unknown name 'relative'"),
    (
        PANDA | {"tasks": [{"task": "hand", "gain": 1}]},
        ValueRangeError,
        r"tasks\[0\]: hand is what the law drives",
    ),
    (
        PANDA | {"robot": {"source": "panda", "task": "relative"}},
        ShapeError,
        r"robot\.task: panda is one chain",
    ),
    (
        {"tasks": [{"task": "rigth", "gain": 1}]},
        UnknownNameError,
        r"tasks\[0\]: frame: unknown name 'rigth'; did you mean 'right'",
    ),
    (
        {"tasks": [{"task": "absolute", "gain": 1}]},
        ValueRangeError,
        r"tasks\[0\]: left and right is what the law drives",
    ),
    (
        {"tasks": [{"task": {"kind": "relative", "frames": ["left"]}, "gain": 1}]},
        ShapeError,
        r"tasks\[0\]: task: relative needs 2 frames, got left",
    ),
    (
        {
            "robot": {"source": "two-pandas", "task": "relative"},
            "tasks": None,
            "reference": FAR,
            "duration": 1,
        },
        ReachError,
        r"out of reach of two-pandas: the position is [\d.]+ m beyond",
    ),
    (
        {"tasks": [{"task": "right", "gain": 1, "reference": FAR}]},
        ReachError,
        r"tasks\[0\]: reference: at t = 0 s .* m beyond the reach",
    ),
    (
        {"limits": {"position": {"kind": "modified-clamping"}}},
        ValueRangeError,
        r"limits\.position: keeps the limits for the law's own task alone",
    ),
)


@pytest.mark.parametrize(("change", "error", "message"), REFUSED)
def test_what_is_refused_is_named(change, error, message):
    with pytest.raises(error, match=message):
        prepare({key: value for key, value in spec(**change).items() if value is not None})


def test_how_far_tasks_are_is_the_length_and_angle_between_poses(arms):
    rng, robot = np.random.default_rng(12), arms.with_task("left")
    tasks = PreparedTasks(
        robot, [FurtherTask("right", 1.0), FurtherTask("right", 1.0, part="position")], Q, np.zeros(1)
    )
    assert len(tasks.labels) == len(set(tasks.labels)) == 2
    assert tasks.labels[1] == f"{tasks.labels[0]} 2"
    q = Q + rng.uniform(-0.5, 0.5, (5, 14))
    first, second = tasks.errors(q).values()
    goal = dqc.DualQuaternion(robot.fkm(Q, "right"))
    for k in range(5):
        pose = dqc.DualQuaternion(robot.fkm(q[k], "right"))
        _, angle = (pose.conj() * goal).short().axis_angle()
        assert first[k] == pytest.approx([np.linalg.norm(pose.translation - goal.translation), abs(angle)])
    np.testing.assert_array_equal(second[:, 0], first[:, 0])
    assert np.isnan(second[:, 1]).all()


def test_a_law_in_python_takes_the_sample_of_a_task_by_its_time(arms):
    """Asked without a number it rounds the time to periods; beyond the end the last sample stays."""
    goal = circle(arms, Q)
    law = dqc.laws.OwnLaw(function=stands_still)
    task = FurtherTask("right", 3.0, dqc.references.Circle(arms.fkm(Q, "right"), radius=0.1, duration=2.0))
    tasks = PreparedTasks(arms.with_task("left"), [task], Q, 0.01 * np.arange(201))
    with pytest.warns(InterpretedWarning):
        prepared = law.prepare(arms.with_task("left"), goal, 0.01, tasks=tasks)
    state, numbered = prepared.initial_state(Q), np.empty(14)
    found = []
    for time, k in ((0.0, 0), (0.5, 50), (0.504, 50), (0.506, 51), (-0.1, 0)):
        sample = goal.at(0).numbers.copy()
        sample[20] = time
        by_time = prepared.command(Q, dqc.Sample(*np.split(sample[:20], [8, 14]), time), state)
        prepared.step(Q, sample, k, state, numbered)
        np.testing.assert_array_equal(by_time, numbered)
        found.append(by_time.copy())
    assert np.abs(found[1] - found[0]).max() > 1e-2
    assert np.abs(found[3] - found[2]).max() > 1e-4


@pytest.mark.parametrize(
    ("given", "rows"),
    [
        ([("right", 1)], 12),
        ([("right", 2)], 6),
        ([("right", 2), ("relative", 2), ("right", 3)], 12),
        ([("posture", 3), ("right", 2)], 14),
        ([("posture", 1), ("right", 0)], 20),
    ],
)
def test_scratch_is_for_the_level_of_most_rows(arms, given, rows):
    tasks = [FurtherTask(name, 1.0, level=level) for name, level in given]
    prepared = PreparedTasks(arms.with_task("left"), tasks, Q, np.zeros(1))
    assert task_levels(prepared.parameters).rows == rows


def test_constraints_are_told_what_errors_of_further_tasks_weigh(arms):
    """Σ w Jᵀ J: before the law's task an error counts a hundred times, after it a tenth."""
    robot, m = arms.with_task("left"), 14
    given = [FurtherTask("right", 1.0, level=level, weight=2.0) for level in (0, 1, 2)]
    tasks = PreparedTasks(robot, given, Q, np.zeros(1))
    work, found = np.full(tasks.work_size + m * m, 7.0), robot.kinematics(Q)
    sample = dqc.Sample(robot.fkm(Q)).numbers
    assert (
        tasks.kernel(Q, found.pose, found.twist_jacobian, sample, 0, tasks.parameters, work, np.zeros(m)) == 0
    )
    rows = np.repeat([0.3, 1.0], 3)[:, None] * robot.with_task("right").hand_jacobian(Q)
    expected = 2.0 * (100**2 + 1 + 0.1**2) * rows.T @ rows
    np.testing.assert_allclose(work[-m * m :].reshape(m, m), expected, atol=1e-9)


def test_what_is_late_is_half_of_period_delay_and_lag(arms):
    tasks = PreparedTasks(arms.with_task("left"), [FurtherTask("right", 1.0)], Q, np.zeros(1))
    lag = Lag((0.05,) * 14, (0.03,) * 14)
    prepared = LAW.prepare(
        arms.with_task("left"), circle(arms.with_task("left"), Q), 0.01, tasks=tasks, lag=lag
    )
    assert task_levels(prepared._parts.tasking).late == pytest.approx(0.5 * (0.01 + 0.05 + 0.03))


@pytest.mark.parametrize("level", [0, 9])
def test_levels_from_0_to_9_are_taken(arms, level):
    PreparedTasks(arms.with_task("left"), [FurtherTask("right", 1.0, level=level)], Q, np.zeros(1))
    with pytest.raises(ValueRangeError, match="level: must be a whole number from 0 to 9, got"):
        PreparedTasks(arms, [FurtherTask("right", 1.0, level=10 if level else -1)], Q, np.zeros(1))
