"""Every law on whole bodies: a drive under a short arm and under a long one, and a base that moves sideways."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import laws
from dqcontrol.plants import Integrator
from dqcontrol.references import DriveTo, SetPoint
from dqcontrol_theses import variants

GAIN = 2.0
WEIGHTS = {"error_weight": GAIN**2, "control_weight": 1.0}
H_INFINITY = {"orientation_gain": 2 * GAIN, "translation_gain": GAIN}
SECOND_ORDER = {"stiffness": 16.0, "damping": 4.0}

BODIES = {
    "little-john": lambda: dqc.load_robot("little-john"),
    "youbot": lambda: dqc.load_robot("youbot"),
    "Panda on a drive": lambda: dqc.WholeBody(
        [
            dqc.DifferentialDrive(wheel_radius=0.0985, half_track=0.2022, rim_speed=1.0),
            dqc.DualQuaternion.from_translation([0.1, 0, 0.4]),
            dqc.load_robot("panda"),
        ]
    ),
}
STARTS = {
    "little-john": [0, 0, 0, 0, -0.9, 0.9, 0.9, 0],
    "youbot": [0, 0, 0, 0, 0.5, 0.8, 0.5, 0],
    "Panda on a drive": [0, 0, 0, 0, -0.4, 0, -2, 0, 1.6, 0.8],
}
AWAY = [0.15, 0.1, 0.2, 0, 0.1, 0.1, 0.1]  # of base and first joints
LAWS = {
    "classic-proportional": variants.ClassicProportional(gain=GAIN),
    "proportional": laws.Proportional(gain=GAIN),
    "gain over time": laws.Proportional(gain=laws.Schedule([0, 5], [1.0, GAIN])),
    "reduced-gradient": variants.ReducedGradient(gain=GAIN),
    "proportional-feedforward": laws.ProportionalFeedforward(gain=GAIN),
    "decoupled-proportional": laws.DecoupledProportional(gain=GAIN),
    "partial-proportional": laws.PartialProportional(part="position", gain=GAIN),
    "h-infinity": laws.HInfinity(**H_INFINITY),
    "h-infinity, left": laws.HInfinity(form="left", **H_INFINITY),
    "h-infinity-tracking": laws.HInfinityTracking(**H_INFINITY),
    "linear-quadratic-r8": laws.LinearQuadraticR8(**WEIGHTS),
    "linear-quadratic-dq": laws.LinearQuadraticDQ(**WEIGHTS),
    "feedback-linearization": laws.FeedbackLinearization(**SECOND_ORDER),
    "guided-proportional": laws.GuidedProportional(gain=GAIN),
}
SIDEWAYS = {  # these take every base for one that can move sideways
    "cascade": variants.Cascade(**SECOND_ORDER),
    "classic-whole-body": variants.ClassicWholeBody(gain=GAIN),
    "classic-cascade": variants.ClassicCascade(gain=GAIN),
}


def drive(body, law, q, goal):
    """Return ten seconds on the way to a goal, along a plan if the law needs one."""
    planned = isinstance(law, laws.GuidedProportional | laws.OpenLoop)
    reference = DriveTo(body, q, goal) if planned else SetPoint(body.fkm(goal))
    return dqc.simulate(body, reference, law, Integrator(), q, 0.02, 10.0)


@pytest.fixture(params=BODIES)
def task(request):
    """Return a body, a start and a configuration near it at the goal."""
    body, q = BODIES[request.param](), np.array(STARTS[request.param], dtype=float)
    away = np.zeros_like(q)
    away[: len(AWAY)] = AWAY
    return body, q, q + away


@pytest.mark.parametrize("name", LAWS)
def test_it_reaches_a_near_goal(task, name):
    record = drive(task[0], LAWS[name], task[1], task[2])
    assert record.stopped == "duration"
    position = np.linalg.norm(record.position - dqc.algebra.translation(task[0].fkm(task[2])), axis=1)
    assert position[0] > 0.1
    assert position[-1] < 1e-6
    if name != "partial-proportional":
        assert record.error[-1] < 1e-6


@pytest.mark.parametrize("name", SIDEWAYS)
def test_those_that_move_bases_sideways_reach_it_without_drives_only(task, name):
    """Little John is left beside its goal; the redundant Panda makes up for what its drive cannot do."""
    record = drive(task[0], SIDEWAYS[name], task[1], task[2])
    assert record.stopped == "duration"
    if task[0].name == "little-john":
        assert record.error[-1] > 0.05
    elif name == "classic-whole-body" or not len(task[0].drives):
        assert record.error[-1] < 1e-6


def test_open_loop_follows_a_plan(task):
    """With an exact inverse its error is what the period leaves; what damping takes near singularities is lost."""
    body, q, goal = task
    law, errors = laws.OpenLoop(inverse=laws.FilteredInverse(threshold=1e-3)), []
    for period in (0.02, 0.01):
        record = dqc.simulate(body, DriveTo(body, q, goal), law, Integrator(), q, period, 5.0)
        errors.append(record.error[-1])
    print(errors)
    assert errors[0] < 5e-3
    assert errors[1] < 0.7 * errors[0]
