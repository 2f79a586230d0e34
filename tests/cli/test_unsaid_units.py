"""One rule for angles and times: a plain number is rad or s, a unit may be written, and where it must be is asked."""

import copy
import math

import numpy as np
import pytest
import yaml
from test_cli import call, here  # noqa: F401

from dqcontrol.algebra import rotation, rotation_from_rpy
from dqcontrol.errors import FileFormatError, NoteWarning
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.experiments.spec import read_spec, spec_text
from dqcontrol.experiments.sweep import read_sweep, sweep_of_text
from dqcontrol.robots import load_robot

SPEC = {
    "name": "units",
    "robot": "ur5",
    "start": [0, -1.2, 1.4, 0.3, 1, 0],
    "period": 0.008,
    "duration": 30,
    "reference": {"kind": "set-point"},
    "law": {"kind": "proportional", "gain": 4},
    "plant": {"kind": "servo"},
}
WALL = {"box": [0.1, 1, 1], "position": [2, 0, 0]}


def changed(path, value):
    spec = copy.deepcopy(SPEC)
    *names, last = path.split(".")
    inner = spec
    for name in names:
        inner = inner.setdefault(name, {})
    inner[last] = value
    return spec


ANGLES = [
    ("reference.offset.rotation", [0, 0, 90], "reference.offset.rotation[2]: 90 is more than a full turn"),
    ("reference.start.rpy", [180, 0, 0], "reference.start.rpy[0]: 180 is more than a full turn in radians"),
    ("reference.transform.rpy", [0, -35, 0], "write -35 deg or -35 rad"),
    ("start", {"position": [0.4, 0.2, 0.4], "rpy": [180, 0, 0]}, "start.rpy[0]: 180 is more"),
    ("world", {"wall": WALL | {"rpy": [0, 0, 45]}}, "world.wall.rpy[2]: 45 is more"),
    ("constraints.zones", {"room": WALL | {"rpy": [0, 0, 45]}}, "zones.room.rpy[2]: 45 is more"),
    ("constraints.angles", {"up": {"direction": [0, 0, 1], "at_most": 35}}, "up.at_most: 35 is more"),
    ("constraints.sights", {"see": {"place": [0, 0, 1], "at_most": 20}}, "see.at_most: 20 is more"),
    ("plant.encoder_noise", 30, "write 30 deg or 30 rad or 30 m"),
]
TIMES = [
    ("period", 8, "period: 8 s is long for a period; write 8 ms or 8 s"),
    ("plant.delay", 30, "plant.delay: 30 s is long for a delay; write 30 ms or 30 s"),
    (
        "plant.time_constant",
        [50, 50, 50, 50, 50, 50],
        "plant.time_constant[0]: 50 s is long for a time constant",
    ),
    ("reference.preview", {"lag": 40}, "reference.preview.lag: 40 s is long for a lag"),
    (
        "limits.compensation",
        {"delay": 30, "lag": 0.05},
        "limits.compensation.delay: 30 s is long for a delay",
    ),
]


@pytest.mark.parametrize(("key", "value", "message"), ANGLES + TIMES)
def test_a_number_that_needs_its_unit_is_asked_for_it(key, value, message):
    with pytest.raises(FileFormatError) as error:
        read_spec(changed(key, value))
    assert message in str(error.value)


def with_units(value, unit):
    if isinstance(value, dict):
        return {key: with_units(each, unit) for key, each in value.items()}
    if isinstance(value, list):
        return [with_units(each, unit) for each in value]
    return f"{value} {unit}" if isinstance(value, int) and abs(value) > 6 else value


@pytest.mark.parametrize(("key", "value", "_"), ANGLES + TIMES)
def test_with_its_unit_it_is_taken(key, value, _):
    unit = "ms" if (key, value, _) in TIMES else "deg"
    read_spec(changed(key, with_units(value, unit)))


def test_degrees_turn_the_hand_by_degrees():
    def turned(angle):
        reference = prepare(changed("reference.offset.rotation", [0, 0, angle])).scene.reference
        return rotation(reference.at(0.0).pose)

    hand = rotation(load_robot("ur5").fkm(SPEC["start"]))
    for angle in ("50 deg", math.radians(50)):
        assert 2 * math.acos(min(1.0, abs(turned(angle) @ hand))) == pytest.approx(math.radians(50), abs=1e-7)


def test_a_written_spec_can_be_read_again():
    """Numbers that were given with their unit are asked for it when they are read without."""
    spec, folder = read_spec(
        changed("reference.offset.rotation", ["400 deg", "7 rad", 0.1]) | {"period": "2 s"}
    )
    text = spec_text(spec, folder)
    assert "7.0 rad" in text
    again, _ = read_spec(yaml.safe_load(text))
    assert again == spec


def test_sweeps_ask_too_and_keep_what_was_said():
    def sweep(values):
        return {**SPEC, "plant": {"kind": "servo", "delay": 0.01}, "sweep": {"over": {"plant.delay": values}}}

    with pytest.raises(
        FileFormatError, match=r"sweep.over.plant.delay\[1\]: 30 s is long for a delay; write 30 ms"
    ):
        read_sweep(sweep([0.01, 30]))
    with pytest.raises(FileFormatError, match=r"sweep.over.plant.delay.high: 30 s is long for a delay"):
        read_sweep(sweep({"low": 0.01, "high": 30, "count": 3}))
    study = read_sweep(sweep({"low": "10 ms", "high": "2 s", "count": 3}))
    assert study.setting({"plant.delay": 2.0}).spec.plant.delay == 2.0
    again = sweep_of_text(study.text, study.folder)
    assert again.sampling == study.sampling


def test_a_configuration_in_degrees_of_joints_without_limits_is_said():
    spec = changed("null_space", {"kind": "posture", "gain": 1, "rest": [0, -90, 90, 0, 0, 0]})
    with pytest.warns(
        NoteWarning, match=r"null_space.rest: shoulder_lift_joint is -90 rad, 14.3 turns; for degrees"
    ):
        prepare(spec)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("robots solve ur5 --position 0.4 -0.2 0.4 --rpy 180 0 -30", "--rpy: 180 is more than a full turn"),
        ("gains iiwa7 --period 8ms --delay 30", "--delay: 30 s is long for a delay; write 30 ms or 30 s"),
        ("gains iiwa7 --period 8 --delay 30ms", "--period: 8 s is long for a period; write 8 ms or 8 s"),
        ("excite ur5 --lag 50", "--lag: 50 s is long for a lag"),
        ("excite ur5 --amplitude 17", "--amplitude: 17 is more than a full turn in radians; write 17 deg"),
        ("excite ur5 --start=0,-90,90,-90,-90,0", "degrees? Angles are in rad; write -90 deg"),
        (
            "excite ur5 --start=0,-90kg,0,0,0,0",
            "--start: expected numbers in rad or m with commas, got '-90kg'",
        ),
        ("clip a b.png --azimuth 60", "--azimuth: 60 is more than a full turn in radians; write 60 deg"),
        ("new new.yaml --yes --period 8", "period: 8 s is long for a period; write 8 ms or 8 s"),
        ("jog ur5 --angular-speed 30mm", "expected a number in rad/s, or with a unit as 30deg/s, got '30mm'"),
    ],
)
def test_the_command_line_has_the_same_rule(here, capsys, words, message):  # noqa: F811
    code, _, err = call(*words.split(), capsys=capsys)
    assert (code, err.count("\n")) == (2, 1), err
    assert message in err


def test_radians_and_degrees_on_the_command_line_are_one(capsys):
    def found(*angles):
        at = ["robots", "solve", "ur5", "--position", "0.4", "-0.2", "0.4", "--top", "1"]
        return call(*at, "--rpy", *angles, capsys=capsys)[1]

    assert found("180deg", "0", "-30deg") == found(repr(math.pi), "0", repr(-math.pi / 6))
    start = np.array(
        yaml.safe_load(found("180deg", "0", "-30 deg").splitlines()[-1].partition("   #")[0])["start"]
    )
    hand = rotation(load_robot("ur5").fkm(start))
    assert abs(hand @ rotation_from_rpy([math.pi, 0, -math.pi / 6])) == pytest.approx(1, abs=1e-8)
