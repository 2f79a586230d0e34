"""Where a run starts, in the units and forms that people think in, and hints for likely slips."""

import numpy as np
import pytest

from dqcontrol.algebra import rotation_from_rpy, translation
from dqcontrol.errors import Error, FileFormatError, NoteWarning, ReachError, ValueRangeError
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.experiments.spec import read_spec
from dqcontrol.experiments.sweep import read_sweep
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.robots import load_robot, postures

SPEC = {
    "name": "start",
    "robot": "ur5",
    "start": [0, -1.2, 1.4, 0.3, 1, 0],
    "period": 0.008,
    "reference": {"kind": "circle", "radius": 0.02, "duration": 1},
    "law": {"kind": "proportional", "gain": 4},
    "plant": {"kind": "servo"},
}


def said(**keys):
    with pytest.raises(Error) as error:
        prepare({**SPEC, **keys})
    return str(error.value)


@pytest.mark.parametrize("turn", [{"rpy": ["180 deg", 0, "30°"]}, {"quaternion": [0, 0.9659, 0.2588, 0]}])
def test_a_pose_of_the_hand_is_a_start(turn):
    with pytest.warns(NoteWarning, match=r"start: \[.*°.*\], nearest limit: elbow_joint, \d+.*° away"):
        setting = prepare({**SPEC, "start": {"position": [0.4, "200 mm", 0.4], **turn}})
    robot, start = setting.scene.robot, setting.scene.start
    hand = robot.fkm(start)
    assert translation(hand) == pytest.approx([0.4, 0.2, 0.4], abs=1e-5)
    assert abs(hand[:4] @ rotation_from_rpy([np.pi, 0, np.pi / 6])) == pytest.approx(1, abs=1e-8)
    repeated = parse_yaml("spec", setting.single_text(setting.cases[0], 0))
    assert (
        repeated["start"] == start.tolist()
    )  # a saved run starts where it did, whatever the solver finds later


def test_rounding_is_not_said():
    with pytest.warns(NoteWarning, match=r"start: \[-?0\.\d+, 0, 0°, [^e]*\], nearest"):
        prepare({**SPEC, "robot": "little-john", "start": {"position": [0.3, 0, 0.35]}})


def test_without_an_orientation_only_the_position_counts():
    with pytest.warns(NoteWarning):
        setting = prepare({**SPEC, "start": {"position": [0.4, 0.2, 0.4]}})
    assert translation(setting.scene.robot.fkm(setting.scene.start)) == pytest.approx(
        [0.4, 0.2, 0.4], abs=1e-5
    )


def test_the_best_of_several_solutions_is_taken():
    robot = load_robot("ur5")
    found = postures(robot, robot.fkm([0.3, -1.2, 1.4, 0.3, 1.0, 0.0]))
    assert len(found) > 4
    limits = robot.limits
    scores = []
    for each in found:
        room = np.minimum(each.q - limits.lower, limits.upper - each.q)
        assert each.margin == room.min() >= 0
        assert each.nearest == robot.joint_names[room.argmin()]
        assert each.manipulability == pytest.approx(robot.manipulability(each.q))
        scores.append(each.manipulability * (room / (0.5 * (limits.upper - limits.lower))).min())
    assert scores == sorted(scores, reverse=True)


def test_a_pose_out_of_reach_is_refused():
    with pytest.raises(
        ReachError, match=r"^start: unreachable: the position is 3.* m beyond the reach of ur5"
    ):
        prepare({**SPEC, "start": {"position": [4, 0, 0.4]}})


def test_numbers_take_units():
    circle = {"kind": "circle", "radius": "60 mm", "duration": "0.5 min", "start": {"rpy": ["90 deg", 0, 0]}}
    spec, _ = read_spec(
        {
            **SPEC,
            "start": [0, "-88.6 deg", "90deg", 0, "45°", "0.1 rad"],
            "period": "8 ms",
            "reference": circle,
            "plant": {"kind": "servo", "delay": "16 ms"},
            "skip_initial": "100 ms",
        }
    )
    assert spec.start == [0, np.radians(-88.6), np.pi / 2, 0, np.pi / 4, 0.1]
    assert (spec.period, spec.plant.delay, spec.skip_initial) == (0.008, 0.016, 0.1)
    assert (spec.reference.radius, spec.reference.duration) == (0.06, 30)
    assert spec.reference.start.rpy == (np.pi / 2, 0, 0)


def test_sets_grids_and_sweeps_take_units_too():
    noisy = {
        **SPEC,
        "law": {"kind": "linear-quadratic-dq", "error_weight": 1, "control_weight": 1, "horizon_time": 1},
    }
    spec, _ = read_spec({**noisy, "grids": {"linear-quadratic-dq": {"horizon_time": ["500 ms", 1]}}})
    assert spec.grids == {"linear-quadratic-dq": {"horizon_time": [0.5, 1]}}
    spec, _ = read_spec(
        {**noisy, "parameter_sets": {"short": {"linear-quadratic-dq": {"horizon_time": "500 ms"}}}}
    )
    assert spec.variants[0].law.horizon_time == 0.5
    data = {**SPEC, "sweep": {"over": {"plant.delay": ["8 ms", "16 ms"], "start.1": ["-60 deg", -1]}}}
    assert read_sweep(data).sampling.over == {"plant.delay": [0.008, 0.016], "start.1": [np.radians(-60), -1]}
    ranged = {"over": {"plant.delay": {"low": "8 ms", "high": "16 ms", "count": 2}}}
    assert read_sweep({**SPEC, "sweep": ranged}).sampling.over["plant.delay"].high == 0.016


def test_a_wrong_unit_is_refused():
    assert said(period="8 deg") == "spec: period: expected a number in s, got '8 deg'"
    assert said(skip_initial="1 mm") == "spec: skip_initial: expected a number in s, got '1 mm'"
    assert said(repeats="3 s") == "spec: repeats: expected a number without a unit, got '3 s'"
    assert "law.gain: expected a number without a unit, got '4 Hz'" in said(
        law={"kind": "proportional", "gain": "4 Hz"}
    )


def test_texts_stay_texts():
    own = {"kind": "own", "function": "a.py:b", "parameters": {"label": "5 mm"}}
    spec, _ = read_spec({**SPEC, "reference": own})
    assert spec.reference.parameters == {"label": "5 mm"}


def test_four_digits_of_a_quaternion_are_normalised_with_a_note():
    start = {"quaternion": [0.7071, 0, 0.7071, 0]}
    with pytest.warns(NoteWarning, match=r"reference.start.quaternion: normalised; its norm was 0.9999"):
        prepare({**SPEC, "reference": {**SPEC["reference"], "start": start}})
    with pytest.raises(
        ValueRangeError,
        match=r"must have norm 1 within 0.001, got 0.98.*; normalised it is \[0.707107, 0, 0.70",
    ):
        prepare({**SPEC, "reference": {**SPEC["reference"], "start": {"quaternion": [0.7, 0, 0.7, 0]}}})
    both = {"quaternion": [1, 0, 0, 0], "rpy": [0, 0, 0]}
    with pytest.raises(ValueRangeError, match=r"reference.start: has both 'quaternion' and 'rpy'"):
        prepare({**SPEC, "reference": {**SPEC["reference"], "start": both}})


def test_likely_slips_are_named():
    assert said(start=[0, -88.6, 90, 0, 45, 0]).endswith("; degrees? Angles are in rad; write -88.6 deg")
    assert "degrees" not in said(start=[0, -700, 0, 0, 0, 0])
    wide = said(reference={"kind": "circle", "radius": 60, "duration": 6})
    assert wide.endswith("; reference.radius is 60 m: metres? Write 60 mm for millimetres")
    assert "metres?" not in said(reference={"kind": "circle", "radius": 1, "duration": 6})


@pytest.mark.parametrize(
    ("wrong", "right"),
    [("frequency", "'period', 1/frequency"), ("dt", "'period'"), ("controller", "'law'"), ("trajectory", "'reference'"),
     ("q0", "'start'"), ("urdf", "'robot'")],
)  # fmt: skip
def test_names_of_other_programs_lead_to_ours(wrong, right):
    with pytest.raises(FileFormatError, match=rf"unknown key '{wrong}'; did you mean {right}\? "):
        prepare({**SPEC, wrong: 1})
