"""Constraints of trees: as those of the same chain, kept between samples by both arms, and named frames."""

import numpy as np
import pytest
from constraint_scenes import least_room
from obstacles import around, plane, sphere

import dqcontrol as dqc
from dqcontrol.geometry import Capsule
from dqcontrol.robots import LinkShape, LinkShapes

PLANT = dqc.plants.Integrator()
TWO = dqc.load_robot("two-pandas")
START = np.array([-0.1, -0.5, 0.1, -2.2, 0.1, 1.7, 0.8, 0.3, -0.7, -0.2, -2.1, -0.1, 1.5, 0.7])
FILE = "examples/robots/six-axis.urdf"
BEAM = """<robot name="beam"><link name="base"/><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
<joint name="one" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" velocity="1"/></joint>
<joint name="two" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" velocity="1"/><mimic joint="one" multiplier="-0.5" offset="0.1"/></joint>
<joint name="three" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="0 0 0.3"/><axis xyz="1 0 0"/>
<limit lower="-0.3" upper="0.3" velocity="1"/></joint>
<joint name="four" type="revolute"><parent link="a"/><child link="d"/><origin xyz="0.2 0 0.3"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" velocity="1"/></joint></robot>"""


def test_a_chain_and_the_tree_of_it_are_kept_alike():
    chain, tree = dqc.load_robot(FILE, "base", "tool"), dqc.load_robot(FILE, "base", tips=["tool"])
    shapes = [
        LinkShape("arm", 3, Capsule([0, 0, 0], [0.2, 0, 0], 0.04)),
        LinkShape("foot", 0, Capsule([0.1] * 3, [0.2] * 3, 0.05)),
    ]
    chain.shapes = tree.shapes = LinkShapes(tuple(shapes), ((0, 1),))
    q = np.array([0, 0.418, 1.716, 0, 1.007, 0])
    hand = dqc.DualQuaternion(chain.fkm(q)).translation
    given = dqc.constraints.Constraints(
        **around(
            {"ball": sphere(center=tuple(hand + np.array([0, 0.15, 0])), radius=0.05, links=["arm", "hand"])}
        ),
        zones={"room": dqc.constraints.Zone(position=tuple(hand), box=(0.5, 0.5, 0.2))},
        angles={
            "cone": dqc.constraints.Angle(
                direction=tuple(dqc.algebra.matrix_from_pose(chain.fkm(q))[:3, 2]), at_most=0.3
            )
        },
        sights={"seen": dqc.constraints.LineOfSight(target="ball", at_most=2.5)},
        acceleration=20.0,
    )
    goal = dqc.references.SetPoint(chain.fkm(q + np.array([0.9, 0.3, -0.2, 0.4, 0.5, 0])))
    runs = []
    for robot in (chain, tree):
        chosen = robot if robot is chain else robot.with_task("tool")
        law = dqc.laws.Proportional(gain=3.0, constraints=given)
        runs.append(dqc.simulate(chosen, goal, law, PLANT, q, period=0.01, duration=1.5))
    assert np.abs(runs[0].command - runs[1].command).max() < 1e-9
    assert runs[0].readings["constraint_distance"].values.min() < 0.0101  # something pressed


def test_two_arms_keep_apart_between_samples():
    rng = np.random.default_rng(3)
    for task in ("relative", "absolute"):
        arms = TWO.with_task(task)
        law = dqc.laws.Proportional(gain=3.0, constraints=dqc.constraints.Constraints(margin=0.02))
        near = np.array([0.9, -0.2, 0.1, -1.6, 0.1, 1.5, 0.8, -0.9, -0.3, -0.2, -1.6, -0.1, 1.5, 0.7])
        goal = dqc.references.SetPoint(arms.fkm(near + rng.uniform(-0.1, 0.1, 14)))
        record = dqc.simulate(arms, goal, law, PLANT, START, period=0.01, duration=1.5)
        prepared = law.prepare(arms, goal, 0.01)
        assert least_room(prepared, record, 0.01) > -1e-9
    names = prepared.constraints.labels  # pyright: ignore[reportOptionalMemberAccess]
    assert "left/panda_link7, right/panda_link7" in names or "right/panda_link7, left/panda_link7" in names


def test_hands_of_a_tree_have_names():
    zones = {"side": dqc.constraints.Zone(plane=(0, 1, 0), position=(0, 0.1, 0), frame="left")}
    angles = {"level": dqc.constraints.Angle(direction=(0, 0, -1), at_most=0.3, frame="right")}
    obstacles = {"wall": plane(normal=(1, 0, 0), offset=0.2, links=["hand"])}
    given = dqc.constraints.Constraints(zones=zones, angles=angles, **around(obstacles), self_collision=False)
    law = dqc.laws.Proportional(gain=2.0, constraints=given)
    arms = TWO.with_task("relative")
    prepared = law.prepare(arms, None, 0.01)
    assert prepared.constraints is not None
    assert prepared.constraints.labels == ("wall: left", "wall: right", "side", "level")
    goal = dqc.references.SetPoint(arms.fkm(START + 0.4))
    record = dqc.simulate(arms, goal, law, PLANT, START, period=0.01, duration=1.0)
    assert least_room(prepared, record, 0.01) > -1e-9


def test_joints_that_follow_others_are_reckoned_with(tmp_path):
    (tmp_path / "beam.urdf").write_text(BEAM)
    tree = dqc.load_robot(tmp_path / "beam.urdf", tips=["c", "d"])
    bars = [
        LinkShape("b", 2, Capsule([0, 0, 0], [0, 0, 0.3], 0.05)),
        LinkShape("d", 4, Capsule([0, 0, 0], [0, 0, 0.4], 0.05)),
    ]
    tree.shapes = LinkShapes(tuple(bars), ((0, 1),))
    ball = sphere(center=(-0.35, 0, 0.4), radius=0.1)
    law = dqc.laws.Proportional(gain=3.0, constraints=dqc.constraints.Constraints(**around({"ball": ball})))
    rng = np.random.default_rng(0)
    for _ in range(6):
        goal = dqc.references.SetPoint(tree.fkm(rng.uniform(-1.5, 1.5, 3) * [1, 0.2, 1]))
        record = dqc.simulate(tree, goal, law, PLANT, np.zeros(3), period=0.01, duration=1.0)
        assert least_room(law.prepare(tree, goal, 0.01), record, 0.01) > -1e-9


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (
            {"zones": {"x": dqc.constraints.Zone(plane=(0, 1, 0), frame="lfet")}},
            "zones.x.frame: unknown name 'lfet'; did you mean 'left'",
        ),
        (
            {"angles": {"x": dqc.constraints.Angle(direction=(0, 0, 1), at_most=0.5)}},
            "give one as 'frame', left or right",
        ),
        (
            around({"x": sphere(center=(1, 0, 0), radius=0.1, links=["rihgt"])}),
            "did you mean 'right'",
        ),
    ],
)
def test_bad_input_is_named(given, words):
    law = dqc.laws.Proportional(gain=1.0, constraints=dqc.constraints.Constraints(**given))
    with pytest.raises(dqc.Error, match=words):
        law.prepare(TWO, None, 0.01)
    arm = dqc.load_robot("panda")
    zone = dqc.constraints.Zone(plane=(0, 1, 0), position=(0, -2, 0), frame="left")
    law = dqc.laws.Proportional(gain=1.0, constraints=dqc.constraints.Constraints(zones={"x": zone}))
    with pytest.raises(dqc.Error, match="panda is a chain and has one hand"):
        law.prepare(arm, None, 0.01)


def test_what_both_hands_hold_gives_way_last():
    arms = TWO.with_task("absolute")
    circle = dqc.references.Circle(arms.fkm(START), radius=0.08, duration=2.0)
    wall = plane(normal=(0, 0, -1), offset=-0.78, links=["left", "right"])
    keep = dqc.constraints.Constraints(**around({"ceiling": wall}), acceleration=20.0)
    law = dqc.laws.ProportionalFeedforward(gain=5.0, constraints=keep)
    tasks = [dqc.controller.FurtherTask("relative", gain=20.0, level=0)]
    record = dqc.simulate(arms, circle, law, PLANT, START, period=0.01, tasks=tasks)
    assert record.readings["constraint_distance"].values.min() > 0.01 - 1e-6
    metrics = dqc.measures.evaluate(record)
    assert metrics.position.peak > 2.0  # mm: the circle leads through the ceiling
    held = metrics.tasks["left_seen_from_right"]
    assert held.position.peak < 0.1  # mm: 0.07
    limits, law = (
        dqc.limits.CommandLimits(position=dqc.limits.ModifiedClamping()),
        dqc.laws.Proportional(gain=5.0),
    )
    with pytest.raises(dqc.Error, match="with further tasks give 'constraints'"):
        dqc.simulate(arms, circle, law, PLANT, START, 0.01, tasks=tasks, limits=limits)
