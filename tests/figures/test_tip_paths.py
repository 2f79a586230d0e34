"""Pictures of trees show every tip: paths in the room, branches from the base to each hand, and a camera that fits."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.algebra import translation
from dqcontrol.figures.paths import desired_in_room, tip_paths
from dqcontrol.figures.robots import silhouette
from dqcontrol.films.film import framing_of_arm
from dqcontrol.robots.files.description import drawn_reach

Q = np.array([-0.1, -0.5, 0.1, -2.2, 0.1, 1.7, 0.8, 0.3, -0.7, -0.2, -2.1, -0.1, 1.5, 0.7])


@pytest.mark.parametrize("task", ["relative", "absolute", "left"])
def test_paths_of_both_hands_are_in_the_room(task):
    robot = dqc.load_robot("two-pandas").with_task(task)
    law, rest = dqc.laws.Proportional(gain=5.0), dqc.references.SetPoint(robot.fkm(Q + 0.1))
    record = dqc.simulate(robot, rest, law, dqc.plants.Integrator(), Q, period=0.01, duration=0.5)
    paths = tip_paths(robot, record)
    assert len(paths) == (3 if task == "absolute" else 2)
    for path, hand in zip(paths, ("left", "right"), strict=False):
        assert np.abs(path - translation(robot.fkm(record.q, hand))).max() < 1e-12
    shown = translation(desired_in_room(robot, record.q, record.desired_pose))
    driven = paths[-1] if task == "absolute" else paths[0]
    assert np.linalg.norm(shown - driven, axis=1) == pytest.approx(record.position_error, abs=1e-9)


def test_a_branch_leads_from_the_base_to_each_hand():
    robot = dqc.load_robot("meka-a2-both")
    q = np.full(14, 0.2)
    branches, discs = silhouette(robot, robot.frames(q))
    assert not discs
    for branch, hand in zip(branches, ("left", "right"), strict=True):
        assert len(branch) == 9  # the base, seven joints, the hand
        assert np.abs(branch[-1] - translation(robot.fkm(q, hand))).max() < 1e-12


def test_the_camera_is_as_near_to_two_arms_as_their_size_allows():
    robot = dqc.load_robot("two-pandas")
    framing = framing_of_arm(robot, Q[None], translation(robot.fkm(Q))[None], [])
    assert framing.reach == drawn_reach(robot)
    assert framing.reach < 2.0  # as wide as lines are drawn for: one arm, not both and all their frames
    assert framing.distance < 4.5
