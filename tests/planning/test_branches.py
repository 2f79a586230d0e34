"""Postures from which a whole path of the hand goes, and what is said where there is none."""

import numpy as np
import pytest
from obstacles import around, box, sphere
from planning_scenes import load

import dqcontrol as dqc
from dqcontrol.errors import NoteWarning, PlanError, ShapeError
from dqcontrol.planning import CertifiedEdges, branch_along
from dqcontrol.planning.followed_path import SINGULAR, continued, first_through

Q = np.array([0.3, -1.2, 1.4, -0.6, -1.4, 0.0])


def circle(robot, q=Q, radius=0.08):
    poses = dqc.references.Circle(robot.fkm(q), radius=radius, duration=10.0).samples(np.linspace(0, 10, 61))
    return poses[:, :8]


def test_a_branch_is_at_all_poses_and_keeps_what_is_asked_between_them():
    robot = load("ur5")
    poses = circle(robot)
    table = dqc.constraints.Constraints(**around({"table": box((0.75, 0, -0.05), (1.0, 2.0, 0.04))}))
    q = branch_along(robot, table, poses)
    signs = np.sign((robot.fkm(q) * poses).sum(axis=1, keepdims=True))
    assert np.abs(signs * robot.fkm(q) - poses).max() < 1e-5
    assert CertifiedEdges(robot, table).clear(q[:-1], q[1:]).certified.all()
    assert np.linalg.svd(robot.hand_jacobian(q), compute_uv=False)[:, -1].min() >= SINGULAR
    assert np.abs(np.diff(q, axis=0)).max() < 0.5


def test_of_all_postures_one_that_is_clear_is_found_where_the_best_is_not():
    """A ball where the elbow of the best posture is."""
    robot = load("ur5")
    poses = circle(robot)
    best, *_ = dqc.robots.postures(robot, poses[0])
    elbow = dqc.algebra.translation(robot.frames(best.q))[2]
    ball = dqc.constraints.Constraints(**around({"ball": sphere(elbow, 0.05)}))
    assert continued(CertifiedEdges(robot, ball), best.q, poses).pair.startswith("ball")
    q = branch_along(robot, ball, poses)
    assert np.abs(q[0] - best.q).max() > 0.1
    assert CertifiedEdges(robot, ball).clear(q[:-1], q[1:]).certified.all()


def test_where_none_goes_through_sample_and_pair_are_told():
    robot = load("ur5")
    poses = circle(robot)
    ahead = dqc.algebra.translation(poses[30])
    ball = dqc.constraints.Constraints(**around({"ball": sphere(ahead, 0.06)}))
    with pytest.raises(
        PlanError, match=r"of \d+ postures none goes through; the farthest stops at sample \d+ of 61: ball: "
    ) as told:
        branch_along(robot, ball, poses)
    assert told.value.reason == "path"
    assert told.value.pair.startswith("ball: ")
    assert told.value.sample is not None
    assert 5 < told.value.sample < 30
    assert f"sample {told.value.sample} of 61" in str(told.value)
    assert str(told.value).endswith("postures there none is clear and not singular")


def test_where_nobody_may_start_the_posture_that_lacks_least_is_told():
    """A ball behind the hand, where all postures have wrists, some of them deeper in it."""
    robot = load("ur5")
    poses = circle(robot)
    hand = dqc.algebra.translation(poses[0])
    ball = dqc.constraints.Constraints(**around({"ball": sphere(hand, 0.02)}))
    with pytest.raises(PlanError, match=r"none goes through; the best at sample 0 of 61: ball: ") as told:
        branch_along(robot, ball, poses)
    assert told.value.sample == 0
    starts = [each.q for each in dqc.robots.postures(robot, poses[0])]
    rooms = CertifiedEdges(robot, ball).room_at(np.array(starts))[0]
    assert rooms.max() < 0
    assert np.array_equal(told.value.nearest, starts[rooms.argmax()])


def test_joints_to_spare_are_moved_aside_as_the_law_moves_them():
    """A Panda whose nearest configurations all end at a limit; the law with constraints goes all of the circle."""
    robot = load("panda")
    keep = dqc.constraints.Constraints(self_collision=False, acceleration=10)
    around_q = dqc.references.Circle(
        robot.fkm([2.02, 0.0, -2.3, -0.81, -0.31, 0.22, -0.09]), radius=0.1, duration=10.0
    )
    poses = around_q.samples(np.linspace(0, 10, 61))[:, :8]
    edges = CertifiedEdges(robot, keep)
    starts = [(each.q, poses) for each in dqc.robots.postures(robot, poses[0])]
    with pytest.raises(PlanError, match="none goes through; the farthest stops at sample"):
        first_through(starts, edges, aside=False)
    q = branch_along(robot, keep, poses)
    assert edges.clear(q[:-1], q[1:]).certified.all()
    law = dqc.laws.ProportionalFeedforward(gain=5, constraints=keep)
    record = dqc.simulate(robot, around_q, law, dqc.plants.Integrator(), q[0], 0.01, 10.0)
    assert record.error.max() < 2e-3


def test_a_path_out_of_reach_names_the_sample():
    robot = load("ur5")
    with pytest.raises(PlanError, match="stops at sample") as told:
        branch_along(robot, dqc.constraints.Constraints(), circle(robot, radius=0.6))
    assert told.value.reason == "path"
    with pytest.raises(PlanError, match=r"poses\[0\]: unreachable") as told:
        branch_along(robot, dqc.constraints.Constraints(), [dqc.algebra.pose([1, 0, 0, 0], [3, 0, 0])] * 2)
    assert told.value.sample == 0
    with pytest.raises(ShapeError, match=r"poses: expected shape \(N, 8\)"):
        branch_along(robot, dqc.constraints.Constraints(), circle(robot)[0])


def test_a_spec_that_starts_at_a_pose_takes_the_posture_that_goes_through():
    robot = load("ur5")
    poses = circle(robot)
    best, *_ = dqc.robots.postures(robot, poses[0])
    elbow = dqc.algebra.translation(robot.frames(best.q))[2]
    start = dqc.DualQuaternion(poses[0])
    spec = {
        "name": "around",
        "robot": "ur5",
        "start": {"position": start.translation.tolist(), "quaternion": poses[0, :4].tolist()},
        "period": 0.01,
        "reference": {"kind": "circle", "radius": 0.08, "duration": 10},
        "law": {"kind": "proportional-feedforward", "gain": 5},
        "plant": {"kind": "integrator"},
    }
    with pytest.warns(NoteWarning, match="start: "):
        free = dqc.experiments.prepare(spec).scene.start
    assert np.abs(free - best.q).max() < 1e-6
    kept = {
        "world": {"ball": {"sphere": 0.05, "position": elbow.tolist()}},
        "constraints": {"clear_of": "all"},
    }
    with pytest.warns(NoteWarning, match="start: "):
        clear = dqc.experiments.prepare(spec | kept).scene.start
    assert np.abs(clear - best.q).max() > 0.1
    done = dqc.run(spec | kept | {"start": clear.tolist()})
    assert done.metrics.position.peak < 1.0  # mm


def test_check_says_what_stands_in_the_way():
    post = {"post": {"capsule": [0.05, 1.0], "position": [0.3, 0.2, 0.5]}}
    arm = load("panda")
    goal = dqc.DualQuaternion(arm.fkm([1.5, -0.8, 0, -2.4, 0, 1.6, 0.8]))
    pose = {"position": goal.translation.tolist(), "quaternion": goal.vec8[:4].tolist()}
    spec = {
        "name": "way",
        "robot": "panda",
        "start": [0, -0.8, 0, -2.4, 0, 1.6, 0.8],
        "period": 0.01,
        "duration": 5,
        "reference": {"kind": "set-point", "start": pose},
        "law": {"kind": "proportional", "gain": 2},
        "plant": {"kind": "integrator"},
        "constraints": {"clear_of": "all"},
        "world": post,
    }
    said = "\n".join(dqc.experiments.check(spec).remarks())
    assert "straight to the set-point joints meet post: panda_link" in said
    assert "plan-to" in said
    square = {"kind": "square", "side": 0.2, "duration": 10}
    spec = spec | {"reference": square, "duration": None}
    far = {"post": {"capsule": [0.05, 1.0], "position": [0.3, -1.2, 0.5]}}
    assert "the path meets" not in "\n".join(dqc.experiments.check(spec | {"world": far}).remarks())
    path = dqc.experiments.prepare(spec | {"world": far}).scene.samples[:, :8]
    corner = dqc.algebra.translation(path[len(path) // 2]).tolist()
    said = "\n".join(
        dqc.experiments.check(spec | {"world": {"ball": {"sphere": 0.03, "position": corner}}}).remarks()
    )
    assert "s the path meets ball: panda_link7" in said
