"""Runs that fail in ten ways and more, and good ones: the first line and the exit status say it, with the cause."""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest
import yaml

import dqcontrol as dqc
from dqcontrol import cli
from dqcontrol.experiments.verdict import Judge
from dqcontrol.loop import Record
from dqcontrol.measures.metrics import metrics_of
from dqcontrol.measures.task_result import task_result

IIWA = {"robot": "iiwa7", "start": [0, 0.6, 0, 1.6, 0, 0.6, 0], "period": 0.01}
PANDA = {"robot": "panda", "start": [0, 0.3, 0, -1.8, 0, 2.1, 0.78], "period": 0.01}
JOHN = {"robot": "little-john", "start": [0, 0, 0, 0, -0.504, 1.397, 0, 0], "period": 0.02}
LIMITED = {"limits": {"velocity": True}}
K = {"kind": "proportional", "gain": 2}
FEED_FORWARD = {"kind": "proportional-feedforward", "gain": 5}
IDEAL = {"plant": {"kind": "integrator"}}


def going(duration, *translation):
    """Return a set-point so far from the hand, m."""
    return {
        "reference": {"kind": "set-point", "duration": duration, "offset": {"translation": list(translation)}}
    }


BALL = {
    "sphere": 0.1,
    "position": [-0.16, -0.8, 1],
    "moves": {"path": [[0, 0, 0, 0], [0.3, 0, 0.8, 0]]},
}
WALL = {"box": [0.1, 2, 0.2], "position": [0.9, 0, 0.1]}
REST = {"reference": {"kind": "set-point", "duration": 2}}
GRIPPER = {"closes": "y", "schedule": [{"time": 0.2, "closed": True}, {"time": 1.5, "closed": False}]}
TALL = """
name: tall
angles: degrees
parts:
  - kind: differential-drive
    wheel_radius: 0.0985
    half_track: 0.2022
    rim_speed: 1.0
    chassis: {mass: 60, radius: 0.27, height: 0.3, wheel_mass: 2, wheel_torque: 10, caster_distance: 0.22}
  - {kind: pose, position: [0.1, 0, 0.4]}
  - {kind: arm, robot: panda}
"""
FAILURES = {
    "floor": (
        PANDA | IDEAL | LIMITED | going(4, 0, 0, -0.44) | {"law": K},
        r"through the floor: panda_link7 −8\d\.?\d* mm at 4 s; reached",
    ),
    "table": (
        JOHN
        | going(3, 0.05, 0, -0.1)
        | {
            "law": K,
            "plant": {"kind": "mobile"},
            "world": {"table": {"box": [0.6, 1, 0.18], "position": [0.7, 0, 0.09]}},
        },
        r"hit table: link_\d [\d.]+ N, [\d.]+ mm deep at [\d.]+ s; ",
    ),
    "wall": (
        JOHN
        | going(8, 1.0, 0, 0.2)
        | IDEAL
        | {
            "law": K,
            "world": {"wall": WALL},
            "constraints": {"self_collision": False, "clear_of": {"wall": {"links": ["hand"]}}},
        },
        r"in wall: chassis −\d+\.?\d* mm at [\d.]+ s; ",
    ),
    "itself": (
        {
            "robot": {"source": "two-pandas", "task": "left"},
            "start": [-0.1, -0.5, 0.1, -2.2, 0.1, 1.7, 0.8, 0.8, -0.5, -0.1, -2.2, -0.1, 1.7, 0.8],
            "period": 0.01,
        }
        | going(4, 0, -0.5, 0)
        | IDEAL
        | LIMITED
        | {"law": K},
        r"in itself: left/[\w.]+ and right/[\w.]+ −\d+\.?\d* mm at [\d.]+ s; reached",
    ),
    "grip": (
        JOHN
        | REST
        | {
            "law": K,
            "plant": {"kind": "mobile", "gripper": GRIPPER},
            "world": {
                "cube": {"box": 0.03, "position": [0.6, 0.2, 0.015], "mass": 0.02},
                "basket": {"container": [0.16, 0.16, 0.08], "position": [0.6, 0.5, 0]},
            },
        },
        r"gripped nothing at 0\.2 s; not placed: cube 220 mm from basket; reached",
    ),
    "toppled": (
        {
            "robot": "tall.yaml",
            "start": [0, 0, 0, 0, -0.8, 0, -2, 0, 1.6, 0.8],
            "period": 0.02,
            "reference": {"kind": "points", "file": "there-and-back.csv"},
            "law": {"kind": "proportional-feedforward", "gain": 0.5},
            "plant": {"kind": "mobile", "base": {"centre_height": 2.5, "wheel_torque": 60, "friction": 3.0}},
        },
        r"toppled at [\d.]+ s: the base tilts by 2\d°, more than 20°",
    ),
    "saturated": (
        IIWA
        | IDEAL
        | LIMITED
        | {
            "reference": {"kind": "circle", "radius": 0.1, "plane": "yz", "duration": 0.5},
            "law": FEED_FORWARD,
        },
        r"saturated: joint_\d at its velocity limit for \d\d % of the time; not followed: errs by \d+\.?\d* mm",
    ),
    "unreachable": (
        IIWA
        | IDEAL
        | {
            "reference": {
                "kind": "set-point",
                "start": {"position": [-0.26668, 0, 0.46333], "rpy": [0, 4.0, 0]},
                "duration": 12,
            },
            "limits": {"velocity": True, "position": {"kind": "modified-clamping"}},
            "law": K,
        },
        r"out of reach: rests \d+\.?\d* mm short; not reached: rests \d+\.?\d* mm",
    ),
    "late": (
        IIWA
        | IDEAL
        | {
            "reference": {"kind": "circle", "radius": 0.06, "plane": "yz", "duration": 3},
            "law": K,
            "skip_initial": 1,
        },
        r"too late: \d\d\.\d mm behind; not followed: errs by \d\d\.?\d* mm RMS",
    ),
    "crossed": (
        IIWA
        | REST
        | IDEAL
        | {"law": K, "world": {"ball": BALL}, "constraints": {"acceleration": 5, "clear_of": "all"}},
        r"crossed: ball −\d+\.?\d* mm \(link_\d\) at [\d.]+ s; ",
    ),
}
BEYOND = {"kind": "proportional", "gain": 205}  # 1/s; at 10 ms the largest stable one is 200
SHAKES = r"shakes: joint_\d turns back 9\d times a second, at \d+\.?\d* % of its velocity limit on average; "
FAILURES |= {
    "shakes": (IIWA | IDEAL | LIMITED | going(4, 0, 0.1, 0) | {"law": BEYOND}, f"{SHAKES}reached"),
    "shakes under a supervisor": (
        IIWA | IDEAL | LIMITED | going(4, 0, 0.1, 0) | {"law": BEYOND, "supervisor": True},
        f"{SHAKES}held by the supervisor: acceleration limit for [4-9]\\d % of the time; reached",
    ),
    "shakes on a circle": (
        IIWA
        | IDEAL
        | {"reference": {"kind": "circle", "radius": 0.06, "duration": 4}, "supervisor": True}
        | {"law": FEED_FORWARD | {"gain": 250}},
        f"{SHAKES}held by the supervisor: acceleration limit for [4-9]\\d % of the time; ",
    ),
}
PHYSICS = ("table", "grip", "toppled")
GOOD = {
    "a stiff loop": (IIWA | IDEAL | LIMITED | going(4, 0, 0.1, 0) | {"law": K | {"gain": 190}}, "reached"),
    "reached": (IIWA | IDEAL | LIMITED | going(4, 0, 0.1, 0) | {"law": K}, "reached"),
    "followed": (
        IIWA | IDEAL | {"reference": {"kind": "circle", "radius": 0.06, "duration": 4}, "law": FEED_FORWARD},
        "followed",
    ),
    "cut short": (
        IIWA
        | IDEAL
        | {
            "reference": {"kind": "circle", "radius": 0.06, "duration": 4},
            "law": FEED_FORWARD,
            "duration": 0.5,
        },
        "followed (only the first 0.5 s of 4 s)",
    ),
}


def test_only_who_followed_the_reference_is_told_how_much_of_it(tmp_path):
    """Not a run that another motion led, nor one whose points file is gone since."""
    given = dqc.run({"name": "run"} | GOOD["cut short"][0])
    assert given.verdict.words.endswith("(only the first 0.5 s of 4 s)")
    away = dqc.algebra.multiply(dqc.algebra.pose([1, 0, 0, 0], [0, 0, 0.1]), given.record.desired[:, :8])
    other = replace(given.record, desired=np.hstack([away, given.record.desired[:, 8:]]))
    assert "only the first" not in replace(given, record=other).verdict.words
    x, y, z = given.record.position[0].tolist()
    file = tmp_path / "way.csv"
    file.write_text(f"time,x,y,z\n0,{x},{y},{z}\n4,{x},{y + 0.1},{z}\n")
    spec = (
        {"name": "run"}
        | IIWA
        | IDEAL
        | {"reference": {"kind": "points", "file": str(file)}, "law": FEED_FORWARD, "duration": 0.5}
    )
    saved = dqc.run(spec)
    assert "only the first 0.5 s" in saved.verdict.words
    file.unlink()
    assert replace(saved).verdict.words.startswith("followed")


@pytest.fixture
def said(tmp_path, monkeypatch, capsys):
    """Run a spec by the command line; return its first line and its exit status."""

    def run(spec):
        file = tmp_path / "spec.yaml"
        file.write_text(yaml.safe_dump({"name": "run"} | spec), encoding="utf-8")
        monkeypatch.setattr(
            sys, "argv", ["dqcontrol", "run", str(file), "--out", str(tmp_path / "out"), "--no-figures"]
        )
        status = 0
        try:
            cli.main()
        except SystemExit as exit_:
            status = exit_.code
        out, err = capsys.readouterr()
        return (out or err).splitlines()[0], status

    return run


def there_and_back(spec, folder):
    """Write the robot of a spec, and the points that its hand goes to: a metre ahead in a second, and back."""
    (folder / spec["robot"]).write_text(TALL, encoding="utf-8")
    x, y, z = dqc.algebra.translation(
        dqc.load_robot(folder / spec["robot"]).fkm(np.array(spec["start"], float))
    )
    lines = ["time,x,y,z", *(f"{k},{x + way},{y},{z}" for k, way in enumerate((0, 1, 0, 0)))]
    (folder / spec["reference"]["file"]).write_text("\n".join(lines), encoding="utf-8")


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", FAILURES)
def test_a_failure_is_said_first_with_cause_and_number_and_by_the_exit_status(name, said, tmp_path):
    if name in PHYSICS:
        pytest.importorskip("mujoco")
    spec, words = FAILURES[name]
    if name == "toppled":
        there_and_back(spec, tmp_path)
    line, status = said(spec)
    assert re.match(words, line), line
    assert status == 1


@pytest.mark.parametrize("name", GOOD)
def test_a_good_run_says_so_and_ends_with_0(name, said):
    spec, words = GOOD[name]
    assert said(spec) == (words, 0)


@pytest.mark.parametrize(("comes", "words"), [(True, "too late: "), (False, "not reached: still moves, ")])
def test_a_hand_that_sways_below_its_goal_is_not_late(comes, words):
    """It hangs 20 mm low and goes to and fro by a millimetre at 3 Hz; or it still comes nearer at the end."""
    robot, time = dqc.load_robot("iiwa7"), np.linspace(0, 2, 401)
    q = np.tile(np.array(IIWA["start"], float), (len(time), 1))
    q[:, 0] += 0.1 * np.exp(-time) if comes else 2e-3 * np.sin(6 * np.pi * time)
    goal = robot.fkm(np.array(IIWA["start"], float)) if comes else robot.fkm(q[0])
    if not comes:
        goal = dqc.algebra.pose(goal[:4], np.add(dqc.algebra.translation(goal), [0, 0, 0.02]))
    desired = np.hstack([np.tile(goal, (len(time), 1)), np.zeros((len(time), 13))])
    record = Record(time, q, q, np.zeros_like(q), robot.fkm(q), desired, robot.joint_names)
    result = task_result(record, robot=robot)
    metrics = metrics_of(record, result, robot.limits, 0.0)
    assert Judge(robot).verdict(record, metrics, result).words.startswith(words)


TWO_ARMS = {
    "robot": {"source": "two-pandas", "task": "left"},
    "start": [-0.1, -0.5, 0.1, -2.2, 0.1, 1.7, 0.8, 0.3, -0.7, -0.2, -2.1, -0.1, 1.5, 0.7],
    "period": 0.01,
    "law": {"kind": "proportional-feedforward", "gain": 5},
    "reference": {"kind": "circle", "radius": 0.05, "duration": 2},
}
AWAY = {"kind": "set-point", "duration": 2, "offset": {"translation": [0.0, 0.0, 0.1]}}
FURTHER = {
    "kept": ([{"task": "right", "gain": 5, "level": 0}], r"followed; right: kept$", 0),
    "reached": ([{"task": "right", "gain": 5, "reference": AWAY}], r"followed; right: reached$", 0),
    "short": (
        [{"task": "right", "gain": 0.5, "level": 1, "reference": AWAY}],
        r"right: not reached: still moves, 4\d\.\d mm off; followed",
        1,
    ),
    "in the way": (
        [{"task": "relative", "gain": 5, "level": 0}, {"task": "right", "gain": 5, "level": 1}],
        r"right: not kept: errs by \d+\.?\d* mm, 3.\d° RMS; not followed",
        1,
    ),
    "what is left": (
        [{"task": "relative", "gain": 5, "level": 2}, {"task": "right", "gain": 5, "level": 1}],
        r"followed; left seen from right: not kept: errs by \d\d\.?\d* mm RMS; right: kept$",
        0,
    ),
    "nothing asked": ([{"task": "relative", "gain": 0, "level": 0}], r"(not )?followed[^;]*$", None),
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", FURTHER)
def test_further_tasks_are_judged_too(name, said):
    tasks, words, status = FURTHER[name]
    found = said(TWO_ARMS | IDEAL | {"tasks": tasks})
    assert re.match(words, found[0]), found[0]
    assert status is None or found[1] == status
