"""Laws of whole bodies: the classic one against its definition, the best heading, how many random goals are reached."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import Error
from dqcontrol.laws import BestHeading, FeedbackLinearization, Proportional
from dqcontrol.loop import Stop
from dqcontrol.plants import Integrator
from dqcontrol_theses.variants import ClassicWholeBody, PublishedLinearization

SEED = 20170402
HOME = np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
T = 0.05
CRITICAL = {"stiffness": 1.0, "damping": 1.0}
CONJUGATE = np.diag([1.0, -1, -1, -1, 1, -1, -1, -1])


@pytest.fixture(scope="module")
def robot():
    return dqc.load_robot("little-john")


def random_goals(robot, count, reach, heading, arm=0.0):
    """Return hand poses of base poses within ± reach and ± heading, and of arm configurations near home."""
    rng = np.random.default_rng([SEED, round(10 * reach)])
    away = np.hstack(
        [
            rng.uniform(-reach, reach, (count, 2)),
            rng.uniform(-heading, heading, (count, 1)),
            rng.uniform(-arm, arm, (count, 5)),
        ]
    )
    return robot.fkm(HOME + away)


def settled(robot, law, goals, seconds=100.0):
    """Return how many goals are reached to 1e-3 for 50 samples."""
    stop = Stop(error=1e-3, samples=50)
    runs = [
        dqc.simulate(robot, dqc.references.SetPoint(goal), law, Integrator(), HOME, T, seconds, stop=stop)
        for goal in goals
    ]
    return sum(run.stopped == "settled" for run in runs)


@pytest.mark.usefixtures("without_growth")
def test_classic_command_is_the_definition(robot):
    """u_f = F N⁺ K vec8(1 − x*x_d) with the holonomic Jacobian. [S17 4.46]"""
    rng, free = np.random.default_rng(SEED), robot.in_form("unconstrained")
    gains = rng.uniform(0.3, 2.0, 8)
    for _ in range(10):
        q = np.r_[rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 5)]
        x, xd = dqc.DualQuaternion(robot.fkm(q)), dqc.DualQuaternion(robot.fkm(q + rng.uniform(-0.3, 0.3, 8)))
        error = np.eye(8)[0] - (x.conj() * xd).vec8
        jacobian = algebra.hamilton_minus(xd.vec8) @ CONJUGATE @ free.pose_jacobian(q)
        rates = np.linalg.pinv(jacobian, rcond=1e-9) @ (gains * error)
        u = ClassicWholeBody(gain=gains.tolist()).command(robot, q, dqc.Sample(xd), T)
        np.testing.assert_allclose(u, robot.feasible_inputs(q, rates), atol=1e-8)


@pytest.mark.parametrize("name", ["iiwa7", "little-john"])
def test_classic_law_without_drives_is_proportional(name):
    robot = dqc.load_robot(name)
    robot = robot.in_form("unconstrained") if isinstance(robot, dqc.WholeBody) else robot
    q = np.linspace(0.2, 0.9, robot.configuration_size)
    goal = dqc.Sample(robot.fkm(q + 0.1))
    commands = [law(gain=1.5).command(robot, q, goal, T) for law in (ClassicWholeBody, Proportional)]
    np.testing.assert_allclose(*commands, atol=1e-12)


@pytest.mark.parametrize("name", ["little-john", "base on an arm", "seven joints on a drive"])
def test_best_heading_is_that_of_the_largest_determinant(name):
    """Against det(JJᵀ) of every heading, the other columns as they are."""
    drive = dqc.DifferentialDrive(0.05, 0.1)
    bodies = {
        "little-john": [drive, dqc.load_robot("ax18")],
        "base on an arm": [dqc.load_robot("youbot-arm"), drive, dqc.load_robot("ax18")],
        "seven joints on a drive": [drive, dqc.load_robot("iiwa7")],
    }
    body, rng = dqc.WholeBody(bodies[name]), np.random.default_rng([SEED, len(name)])
    j = body.input_names.index("v") if "v" in body.input_names else int(body.drives[0, 0])
    for _ in range(10):
        q = rng.uniform(-1.2, 1.2, body.configuration_size)
        jacobian = body.twist_jacobian(q)
        axis, heading = jacobian[:3, j + 1], jacobian[3:, j]
        angles = np.linspace(-np.pi / 2, np.pi / 2, 2001)
        turned = np.repeat(jacobian[None], len(angles), axis=0)
        turned[:, 3:, j] = np.outer(np.cos(angles), heading) + np.outer(
            np.sin(angles), np.cross(axis, heading)
        )
        best = angles[np.linalg.det(turned @ turned.transpose(0, 2, 1)).argmax()]
        z = np.zeros(body.input_size)
        preference = BestHeading(gain=2.0)
        preference.kernel(q, jacobian, preference.parameters(body), np.zeros(42), z)
        difference = (z[j + 1] / 2.0 - best + np.pi / 2) % np.pi - np.pi / 2
        assert abs(difference) < 2e-3
        assert np.count_nonzero(z) == 1


def test_best_heading_leaves_other_robots_alone():
    for robot in (dqc.load_robot("iiwa7"), dqc.load_robot("little-john").in_form("unconstrained")):
        preference, z = BestHeading(), np.ones(robot.input_size)
        preference.kernel(np.zeros(8), np.ones((6, len(z))), preference.parameters(robot), np.zeros(42), z)
        assert not z.any()
    with pytest.raises(Error, match=r"null_space.gain: must be > 0, got 0"):
        BestHeading(gain=0).parameters(dqc.load_robot("little-john"))


@pytest.mark.parametrize(("arm", "count"), [(0.0, 98), (0.5, 95)])
def test_near_goals_are_reached(robot, arm, count):
    goals = random_goals(robot, 100, 0.5, np.pi / 4, arm)
    assert settled(robot, FeedbackLinearization(**CRITICAL), goals) >= count


@pytest.mark.slow
def test_far_goals_need_the_heading(robot):
    """Goals beside and behind, with any heading: regulation as published ends in singularities."""
    goals = random_goals(robot, 100, 1.5, np.pi)
    assert settled(robot, FeedbackLinearization(**CRITICAL, null_space=None), goals) <= 65
    assert settled(robot, FeedbackLinearization(**CRITICAL), goals) >= 95
    assert settled(robot, Proportional(gain=0.5, null_space=BestHeading()), goals) >= 95


@pytest.mark.usefixtures("without_growth")  # S17's law has none
def test_velocity_states(robot):
    """[S17 4.17] leaves open which velocity is fed back; realised and then projected it hardly arrives anywhere."""
    goals = random_goals(robot, 30, 0.5, np.pi / 4)
    laws = {
        "constrained": FeedbackLinearization(**CRITICAL, null_space=None),
        "commanded": PublishedLinearization(**CRITICAL),
        "realised": PublishedLinearization(**CRITICAL, velocity_state="realised"),
    }
    reached = {label: settled(robot, law, goals) for label, law in laws.items()}
    assert reached["realised"] <= 1
    assert reached["constrained"] >= 15
    assert reached["commanded"] < reached["constrained"]
