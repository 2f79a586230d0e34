"""References out of reach: refused before anything moves, with distance and time."""

import re
import warnings

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import LimitWarning, ReachError
from dqcontrol.experiments.prepared_experiment import check_reach, prepare

Q0 = [0, 0.6, 0, 1.6, 0, 0.6, 0]
SHOULDER = np.array([0, 0, 0.34])
BASE = {
    "name": "reach",
    "robot": "iiwa7",
    "start": Q0,
    "period": 0.01,
    "law": {"kind": "proportional", "gain": 1},
    "plant": {"kind": "integrator"},
}


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


def refused(reference, **changes):
    """Return distance and time of the refusal."""
    with pytest.raises(
        ReachError, match=r"^reference: at t = \S+ s the desired position is \S+ m out of reach"
    ) as caught:
        prepare({**BASE, **changes, "reference": reference})
    words = str(caught.value).split()
    return float(words[words.index("is") + 1]), float(words[words.index("=") + 1])


def test_a_set_point_too_far_by_geometry():
    for position in ([2.0, 0, 0.3], [0, -0.9, 1.2], [0, 0, -0.7]):
        distance, time = refused({"kind": "set-point", "start": {"position": position}}, duration=1)
        assert distance == pytest.approx(np.linalg.norm(position - SHOULDER) - 0.926, rel=5e-3)
        assert time == 0


def test_a_line_that_ends_too_far_by_geometry(arm):
    """The end is the farthest: 1.5 m along x in 4 s, worst at the end."""
    hand = algebra.translation(arm.fkm(Q0))
    spiral = {"kind": "spiral", "radius": 1e-4, "length": 1.5, "axis": "x", "duration": 4}
    distance, time = refused(spiral)
    assert time == pytest.approx(4, abs=0.02)
    assert distance == pytest.approx(
        np.linalg.norm(hand + np.array([1.5, 0, 0]) - SHOULDER) - 0.926, abs=2e-3
    )


def test_a_line_too_far_for_the_wrist_only(arm):
    """Backwards along the hand's own axis: the hand stays near enough, its wrist leaves its sphere. Seen by solving."""
    pose = arm.fkm(Q0)
    hand, back = algebra.translation(pose), -algebra.matrix_from_pose(pose)[:3, 2]
    wrist = hand + 0.126 * back
    length = np.linspace(0, 2, 200001)
    out = np.linalg.norm(wrist + length[:, None] * back - SHOULDER, axis=1) > 0.8
    crossing = length[out.argmax()]
    end = crossing + 0.1
    assert np.linalg.norm(hand + end * back - SHOULDER) < 0.8
    spiral = {"kind": "spiral", "radius": 1e-6, "length": end, "axis": back.tolist(), "duration": 10 * end}
    with pytest.raises(ReachError) as caught:
        prepare({**BASE, "reference": spiral})
    text = str(caught.value)
    found = re.search(r"t = (\S+) s the desired pose is out of reach of iiwa7: .* found is (\S+) mm", text)
    assert found, text
    time, distance = map(float, found.groups())
    assert 10 * crossing <= time < 10 * crossing + 0.3
    assert 1 < distance < 20


def test_what_can_be_reached_passes(arm):
    """Also near singularities, and without a warning."""
    rng = np.random.default_rng(20260716)
    for _ in range(100):
        q = rng.uniform(-1, 1, 7)
        samples = np.zeros((3, 21))
        samples[:, :8] = arm.fkm(q)
        samples[:, 20] = [0, 1, 2]
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            check_reach(arm, np.array(Q0), samples)
    prepare({**BASE, "reference": {"kind": "circle", "radius": 0.05, "duration": 3}})


def test_joint_limits_in_the_way_are_warned_of(arm):
    q = np.array([0, 0.6, 0, -2.4, 0, 0.6, 0])
    assert (q < arm.limits.lower).any()
    samples = np.zeros((1, 21))
    samples[:, :8] = arm.fkm(q)
    with pytest.warns(LimitWarning, match=r"t = 0 s .* needs iiwa7 beyond its limits: .*joint_4 at"):
        check_reach(arm, np.array(Q0), samples)


def test_of_an_arm_with_five_joints_only_the_distance_is_checked():
    arm = dqc.load_robot("ax18")
    assert arm.configuration_size == 5
    q0 = np.full(5, 0.3)
    samples = np.zeros((1, 21))
    hand = arm.fkm(q0)
    turned = algebra.conjugate(hand)[:4]
    samples[:, :8] = algebra.pose(turned, algebra.translation(hand))
    check_reach(arm, q0, samples)
    samples[:, :8] = algebra.pose(turned, [3, 0, 0])
    with pytest.raises(ReachError, match=r"out of reach of ax18$"):
        check_reach(arm, q0, samples)


def test_a_sliding_first_joint_has_no_sphere(make_arm):
    arm = make_arm(7, (0,))
    q0 = np.full(7, 0.4)
    far = q0.copy()
    far[0] += 5  # m along the rail
    samples = np.zeros((1, 21))
    samples[:, :8] = arm.fkm(far)
    check_reach(arm, q0, samples)


@pytest.mark.parametrize("name", ["iiwa7", "ur5", "meka-a2", "ax18"])
def test_a_stretched_arm_may_stay_where_it_is(name):
    """The hand of an outstretched arm is as far as its length to the last digits: rounding is no distance."""
    arm = dqc.load_robot(name)
    rng = np.random.default_rng(20261122)
    for _ in range(10):
        q = np.zeros(arm.configuration_size)
        q[0], q[-1] = rng.uniform(-0.3, 0.3, 2)
        q = np.clip(q, arm.limits.lower, arm.limits.upper)
        samples = np.zeros((1, 21))
        samples[:, :8] = arm.fkm(q)
        check_reach(arm, q, samples)
