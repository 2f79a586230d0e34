"""What arms that stand hold in physics: a box between the pads of two hands, a cube in a gripper."""

import re
import shutil
from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.controller import FurtherTask
from dqcontrol.errors import ValueRangeError
from dqcontrol.files.output_file import yaml_text
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.plants import Gripper, GripperEvent, MujocoPlant, Pads
from dqcontrol.reports.run_report import _held_box as held_box
from dqcontrol.world import Body

EXAMPLES = Path(__file__).parents[2] / "examples"
Q = np.array([-0.1, 0, -0.1, -2.2, -1.7, 1.75, 0.6, 0.1, 0, 0.1, -2.2, 1.7, 1.75, -0.6])
LAW = dqc.laws.ProportionalFeedforward(gain=5.0)
GRASP = FurtherTask("relative", gain=0.0, level=0)


APART = 0.4138  # m


def between(arms, **box):
    """Return a world with a box between the hands where they start."""
    middle = tuple(0.5 * (np.add(*(dqc.algebra.translation(arms.frames(Q)[row]) for row in arms.ends))))
    return dqc.World(bodies={"box": Body(box=[0.2, APART - 0.02, 0.2], position=middle, mass=1.0, **box)})


def carried(duration, **pads):
    arms = dqc.load_robot("two-pandas").with_task("absolute")
    circle = dqc.references.StartRamp(dqc.references.Circle(arms.fkm(Q), radius=0.05, duration=duration), 0.5)
    plant = MujocoPlant(pads=Pads(**pads), world=between(arms))
    return dqc.simulate(arms, circle, LAW, plant, Q, period=0.01, tasks=[GRASP])


@pytest.mark.slow
def test_the_box_goes_where_the_hands_go():
    record = carried(3.0)
    place = record.readings["box_position"].values
    away = np.linalg.norm(place - record.position, axis=1)
    assert away.max() < 0.01
    force = record.readings["grip_force"].values[20:]
    assert force.min() > 9.81 / 2 / 0.8  # what friction needs at least, each hand half the weight
    assert (
        np.abs(force[:, 0] - force[:, 1]).max() < 0.5 * force.max()
    )  # gravity and acceleration are the rest


def test_a_report_tells_the_least_internal_force():
    times = np.arange(5) * 0.1
    for forces, verdict, words in (
        ([0, 20, 30, 25, 24], "held", "internal force 20 N at least, after 0.1 s"),
        ([0, 20, 30, 0, 0], "let go", "internal force 0 N at least, after 0.1 s"),
    ):
        grip = SimpleNamespace(
            values=np.column_stack([forces, np.array(forces) + 1.0]) * (np.array(forces) > 0)[:, None]
        )
        record = SimpleNamespace(time=times, readings={"grip_force": grip})
        ((_, cell, said),) = held_box(record)
        assert (cell, said) == (verdict, words)


@pytest.mark.slow
def test_without_a_squeeze_it_falls():
    record = carried(1.0, squeeze=0.0)
    assert record.readings["box_position"].values[-1, 2] < record.position[-1, 2] - 0.3
    assert (record.readings["grip_force"].values[-1] == 0).all()


LIFT = parse_yaml("lift.yaml", (EXAMPLES / "lift.yaml").read_text())


def lifted(tmp_path, **changes):
    """Return the run of the example in which two arms lift a box from a table into a crate."""
    shutil.copytree(EXAMPLES / "points", tmp_path / "points")
    (tmp_path / "lift.yaml").write_text(yaml_text({**LIFT, **changes}))
    return dqc.run(tmp_path / "lift.yaml")


@pytest.mark.slow
def test_two_arms_lift_what_lies_on_a_table(tmp_path):
    run = lifted(tmp_path)
    assert run.verdict.failure == "", run.verdict.words
    assert run.verdict.words.startswith("box in crate; ")
    assert "let go of the box at 7." in run.verdict.words
    place = run.record.readings["box_position"].values
    assert place[100] == pytest.approx([0.5054, 0, 0.3669], abs=1e-3)  # it lay on the table
    assert place[:, 2].max() == pytest.approx(0.3669 + 0.16, abs=4e-3)  # held without slipping


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::dqcontrol.errors.TaskWarning")
def test_a_box_that_slips_is_said(tmp_path):
    world = {**LIFT["world"], "box": {**LIFT["world"]["box"], "friction": 0.05}}
    run = lifted(tmp_path, world=world)
    assert run.verdict.failure == "outcome"
    assert re.match(r"not so: box [\d.]+ mm from crate", run.verdict.words), run.verdict.words


def test_what_is_refused():
    panda = dqc.load_robot("panda")
    plant = MujocoPlant(pads=Pads(), world=dqc.World(bodies={"box": Body(box=0.1, position=(3, 0, 0))}))
    with pytest.raises(ValueRangeError, match=r"plant\.pads: are on two end effectors, and panda has 1"):
        plant.start(panda, Q[:7], 0.01, 1, 0)
    with pytest.raises(ValueRangeError, match=r"plant\.pads: both end effectors start 0 m apart, too near"):
        plant.start(dqc.TwoArms(panda, panda), np.concatenate([Q[:7], Q[:7]]), 0.01, 1, 0)
    with pytest.raises(ValueRangeError, match=r"plant\.pads: press a body of the world .* give 'world'"):
        MujocoPlant(pads=Pads()).start(panda, Q[:7], 0.01, 1, 0)
    with pytest.raises(ValueRangeError, match="close_gripper: the plant has no gripper"):
        MujocoPlant().start(panda, Q[:7], 0.01, 1, 0).close_gripper()


HOME = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.7, 0.0])
LONG = dqc.SerialArm.join([dqc.load_robot("panda"), dqc.algebra.pose([1, 0, 0, 0], [0, 0, 0.16])], "panda")
GRIPPER = Gripper(points="z", closes="y", length=0.09, force=20.0, speed=0.1)


def picked(gripper, tell=None):
    """Return what a run is like in which an arm lowers its hand to a cube on a table, waits, and lifts it."""
    hand = dqc.algebra.translation(LONG.fkm(HOME))
    top = hand[2] - 0.1
    bodies = {
        "table": Body(box=[0.4, 0.4, 0.1], position=(hand[0], hand[1], top - 0.05)),
        "cube": Body(box=0.04, position=(hand[0], hand[1], top + 0.02), mass=0.1),
    }
    live = MujocoPlant(gripper=gripper, world=dqc.World(bodies=bodies)).start(LONG, HOME, 0.01, 400, 0)
    down, law, found = dqc.algebra.pose([1, 0, 0, 0], [0, 0, -0.08]), dqc.laws.Proportional(gain=4.0), []
    ways = [dqc.algebra.multiply(down, LONG.fkm(HOME)), LONG.fkm(HOME)]
    for way in ways:
        target = dqc.references.SetPoint(way)
        control, sample = law.prepare(LONG, target, 0.01), target.at(0.0)
        state = control.initial_state(live.measured)
        for _ in range(200):
            if tell is not None:
                live.close_gripper(tell(live.time))
            live.step(control.command(live.measured.copy(), sample, state))
        found.append(live.data.body("world: cube").xpos[2] - top)
    return live, found


@pytest.mark.parametrize("by_command", [False, True])
def test_a_fixed_arm_grips_a_cube_by_schedule_or_command(by_command):
    if by_command:
        live, heights = picked(GRIPPER, lambda time: time > 1.5)
    else:
        live, heights = picked(
            msgspec.structs.replace(GRIPPER, schedule=[GripperEvent(time=1.5, closed=True)])
        )
    assert heights[0] == pytest.approx(0.02, abs=2e-3)  # it lay on the table
    assert heights[1] == pytest.approx(0.10, abs=5e-3)  # and was lifted by 80 mm
    assert live.channels[-1].name == "gripper_opening"
    assert live.readings[-1] == pytest.approx(0.04, abs=2e-3)  # as wide as the cube


def test_an_open_gripper_lifts_nothing():
    live, heights = picked(GRIPPER)
    assert heights[1] == pytest.approx(0.02, abs=2e-3)
    assert live.readings[-1] == pytest.approx(0.06, abs=2e-3)
