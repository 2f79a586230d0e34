"""Points, axes and lines of links, the centre of mass, and postures, of chains and trees."""

import numpy as np
import pytest
from test_task_levels import solved

import dqcontrol as dqc
from dqcontrol.controller import FurtherTask, PreparedTasks
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.robots import PoseTask

PANDA = dqc.load_robot("panda")
HOME = np.array([0.1, -0.5, 0.1, -2.2, 0.1, 1.7, 0.8])
TWO = dqc.load_robot("two-pandas")
START = np.array([-0.1, -0.5, 0.1, -2.2, 0.1, 1.7, 0.8, 0.3, -0.7, -0.2, -2.1, -0.1, 1.5, 0.7])
LAW, PLANT = dqc.laws.Proportional(gain=5.0), dqc.plants.Integrator()


def run(robot, q, tasks, duration=3.0, **other):
    """Hold the hand, or what the task is, in its place, and do further tasks."""
    target = dqc.references.SetPoint(robot.fkm(q))
    return dqc.simulate(robot, target, LAW, PLANT, q, period=0.01, duration=duration, tasks=tasks, **other)


def test_a_point_of_a_link_goes_where_it_is_wanted_as_far_as_the_hand_allows():
    elbow = PoseTask("frame", ("panda_joint4",), point=(-0.08, 0.0, 0.0))
    tree = dqc.robots.chain_as_tree(PANDA)
    other = HOME.copy()
    other[[0, 2]] += [0.3, -0.4]
    goal = dqc.references.SetPoint(tree.pose_of(elbow, other))
    record = run(PANDA, HOME, [FurtherTask(elbow, 2.0, goal, part="position")], duration=5.0)
    error = record.readings["task.point_of_panda_joint4"].values[:, 0]
    assert error[-1] < 0.7 * error[0]  # the null space of a hand held has one direction
    assert record.position_error.max() < 1e-4
    place = dqc.algebra.translation(tree.pose_of(elbow, record.q[-1]))
    assert np.linalg.norm(place - dqc.algebra.translation(goal.at(0).pose)) == pytest.approx(error[-1])
    jacobian, step = tree.pose_jacobian_of(elbow, HOME), 1e-6
    found = [
        (tree.pose_of(elbow, HOME + e) - tree.pose_of(elbow, HOME - e)) / (2 * step) for e in step * np.eye(7)
    ]
    assert np.abs(np.array(found).T - jacobian).max() < 1e-8


@pytest.mark.parametrize("part", ["axis", "line"])
def test_an_axis_and_a_line_leave_the_rest_free(part):
    """The right hand's x axis is held while the left one turns: about it, and along it, it is free."""
    arms = TWO.with_task("relative")
    axis = PoseTask("frame", ("right",), point=(0.0, 0.0, 0.1), axis=(1.0, 0.0, 0.0))
    goal = arms.fkm(START)
    turned = dqc.DualQuaternion(goal) * dqc.DualQuaternion.from_axis_angle([0, 0, 1], 0.5)
    record = dqc.simulate(
        arms, dqc.references.SetPoint(turned.vec8), LAW, PLANT, START, 0.01, 3.0,
        tasks=[FurtherTask(axis, 10.0, level=0, part=part)],
    )  # fmt: skip
    error = record.readings["task.point_of_right"].values
    assert error[:, 1].max() < 2e-3
    assert (error[:, 0].max() < 1e-3) if part == "line" else np.isnan(error[:, 0]).all()
    before, after = (dqc.algebra.matrix_from_pose(arms.pose_of(axis, record.q[k])) for k in (0, -1))
    assert (
        np.arccos(np.clip(before[:3, 0] @ after[:3, 0], -1, 1)) > 5 * error[-1, 1]
    )  # it turned about the axis
    assert record.position_error[-1] < 1e-4


def test_a_far_axis_takes_the_short_way():
    axis = PoseTask("frame", ("right",))
    away = dqc.DualQuaternion(TWO.pose_of(axis, START)) * dqc.DualQuaternion.from_axis_angle([0, 1, 0], 1.2)
    task = FurtherTask(axis, 3.0, dqc.references.SetPoint(away.vec8), part="axis")
    record = run(TWO.with_task("left"), START, [task])
    angle = record.readings["task.right"].values[:, 1]
    assert angle[0] == pytest.approx(1.2, abs=1e-9)
    assert np.diff(angle).max() < 1e-9
    assert angle[-1] < 1e-3


@pytest.mark.parametrize("robot", [PANDA, TWO], ids=["chain", "tree"])
def test_centre_of_mass_is_held_and_its_jacobian_is_right(robot):
    tree = robot if robot is TWO else dqc.robots.chain_as_tree(robot)
    q = START[: robot.configuration_size]
    jacobian, step = tree.twist_jacobian_of("center_of_mass", q), 1e-6

    def place(at):
        return dqc.algebra.translation(tree.pose_of("center_of_mass", at))

    found = [(place(q + e) - place(q - e)) / (2 * step) for e in step * np.eye(len(q))]
    assert np.abs(jacobian[:3]).max() == 0
    assert np.abs(np.array(found).T - jacobian[3:]).max() < 1e-8
    if robot is TWO:
        pose = dqc.DualQuaternion.from_translation(place(q) + np.array([0.02, 0.03, -0.02]))
        goal = dqc.references.SetPoint(pose.vec8)
        record = run(TWO.with_task("left"), q, [FurtherTask("center_of_mass", 3.0, goal, part="position")])
        assert record.readings["task.centre_of_mass"].values[-1, 0] < 1e-4
        assert record.position_error.max() < 1e-4


def test_a_posture_is_taken_as_far_as_all_else_allows():
    both = np.vstack([TWO.twist_jacobian_of(hand, START) for hand in ("left", "right")])
    wanted = START + 0.3 * np.linalg.svd(both)[2][-1]  # the elbows turn, the hands stay
    tasks = [FurtherTask("posture", 2.0, posture=wanted, level=3), FurtherTask("right", 5.0)]
    record = run(TWO.with_task("left"), START, tasks, duration=4.0)
    away = record.readings["task.posture"].values
    assert away[0, 1] == pytest.approx(np.abs(START - wanted).max())
    assert np.isnan(away[:, 0]).all()
    assert np.linalg.norm(record.q[-1] - wanted) < 0.2 * np.linalg.norm(START - wanted)
    assert record.position_error.max() < 1e-4
    assert record.readings["task.right"].values.max() < 1e-4
    alone = run(PANDA, HOME, [FurtherTask("posture", 2.0, posture=HOME + 0.1, level=0)], duration=4.0)
    assert np.abs(alone.q[-1] - HOME - 0.1).max() < 1e-3  # before the law's task


def test_in_a_spec_of_one_arm():
    start = {"robot": "panda", "start": HOME.tolist(), "period": 0.01, "plant": {"kind": "integrator"}}
    more = {
        "reference": {"kind": "circle", "radius": 0.05, "duration": 1},
        "law": {"kind": "proportional", "gain": 5},
    }
    tasks = [
        {"task": "posture", "gain": 1, "level": 3, "posture": HOME.tolist()},
        {
            "task": {"kind": "frame", "frames": ["panda_joint4"], "point": [0, 0, 0.1]},
            "gain": 1,
            "part": "position",
        },
        {"task": "center_of_mass", "gain": 1},
    ]
    ready = prepare({"name": "x", **start, **more, "tasks": tasks})
    assert ready.scene.tasks is not None
    assert ready.scene.tasks.labels == ["posture", "point of panda_joint4", "centre of mass"]


@pytest.mark.parametrize(
    ("task", "words"),
    [
        (FurtherTask("center_of_mass", 1.0), "has a position only; give part: position"),
        (FurtherTask("posture", 1.0, posture=[0.0]), "posture: expected shape"),
        (FurtherTask("left", 1.0, posture=START), "only the task 'posture' has one"),
        (FurtherTask("left", 1.0, part="lien"), "did you mean 'line'"),  # pyright: ignore[reportArgumentType]
    ],
)
def test_bad_input_is_named(task, words):
    with pytest.raises(dqc.Error, match=words):
        run(TWO.with_task("right"), START, [task])
    with pytest.raises(dqc.Error, match="put it beside the law's task"):
        TWO.with_task("center_of_mass")
    with pytest.raises(dqc.Error, match=r"task\.axis: must not be zero"):
        PoseTask("frame", ("left",), axis=(0.0, 0.0, 0.0))
    with pytest.raises(dqc.Error, match="has no inertia"):
        dqc.robots.chain_as_tree(dqc.load_robot("kuka-lwr4")).pose_of("center_of_mass", np.zeros(7))


def test_a_posture_moves_the_arm_of_a_mobile_robot_and_not_its_base():
    robot = dqc.load_robot("little-john")
    q = np.array([0.5, -0.4, 0.8, 0, -0.9, 0.9, 0.9, 0])
    wanted = q + np.array([1.0, 2.0, 0.5, 0.1, -0.1, 0.2, 0.1, 0.3])
    tasks = PreparedTasks(robot, [FurtherTask("posture", 2.0, posture=wanted, level=0)], q, np.zeros(1))
    found, out = robot.kinematics(q), np.zeros(robot.input_size)
    sample = dqc.Sample(robot.fkm(q)).numbers
    given = sample, 0, tasks.parameters, np.zeros(tasks.work_size), out
    assert tasks.kernel(q, found.pose, found.twist_jacobian, *given) == 0
    arm, m = robot.input_size - 5, robot.input_size
    own = np.repeat([0.3, 1.0], 3)[:, None] * robot.hand_jacobian(q)
    expected, _ = solved(
        [(np.eye(m)[arm:], 2.0 * (wanted - q)[3:], 0.0), (own, np.zeros(6), 0.0)], np.zeros(m)
    )
    np.testing.assert_allclose(out, expected, rtol=1e-5, atol=1e-7)


def test_how_far_a_posture_is_is_said_of_slides_and_turns_apart():
    lift = dqc.SerialArm.from_dh(
        [0, 0, 0], [0.4, 0, 0], [0, 0.3, 0.3], [0, 0, 0], joint_types=["prismatic", "revolute", "revolute"]
    )
    wanted, q = np.array([0.1, 0.2, 0.3]), np.array([[0.1, 0.2, 0.3], [0.4, 0.1, 0.8], [-0.3, 1.2, 0.3]])
    tasks = PreparedTasks(lift, [FurtherTask("posture", 0.0, posture=wanted)], wanted, np.zeros(1))
    (found,) = tasks.errors(q).values()
    np.testing.assert_allclose(found, [[0, 0], [0.3, 0.5], [0.4, 1.0]])
