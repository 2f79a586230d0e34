"""References of a spec: every kind, the keys that modify them, sequences, and what is said of bad input."""

import copy
import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from dqcontrol import algebra, references as shapes
from dqcontrol.errors import Error, FileFormatError, ShapeError, ValueRangeError
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.experiments.spec import read_spec, spec_text
from dqcontrol.references.sample import point_motion

START = algebra.pose([0.5, 0.5, -0.5, 0.5], [0.4, -0.2, 0.6])
CIRCLE = {"kind": "circle", "radius": 0.05, "duration": 4}
SQUARE = {"kind": "square", "side": 0.1, "duration": 8}
PAUSE = {"kind": "set-point", "duration": 1}
LIMITS = {"velocity": 0.1, "acceleration": 0.5, "jerk": 5}
BASE = {
    "name": "a",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.01,
    "law": {"kind": "proportional", "gain": 10},
    "plant": {"kind": "integrator"},
}


def spec_of(reference):
    return {**copy.deepcopy(BASE), "reference": copy.deepcopy(reference)}


def build(reference, folder=None):
    spec, _ = read_spec(spec_of(reference))
    return spec.reference.build(START, folder or Path())


def same(built, expected, end=None):
    assert built.duration == pytest.approx(expected.duration)
    times = np.linspace(0.0, end or expected.duration, 301)
    np.testing.assert_allclose(built.samples(times), expected.samples(times), rtol=1e-12, atol=1e-12)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "places.csv").write_text("time, x, y, z\n0, 0.4, 0, 0.5\n1, 0.5, 0, 0.5\n3, 0.5, 0.1, 0.6\n")
    (tmp_path / "poses.csv").write_text("x,y,z,qw,qx,qy,qz\n0.4,0,0.5,0,1,0,0\n0.5,0,0.5,0.6,0.8,0,0\n")
    (tmp_path / "line.txt").write_text("speed 0.1\nline 0.1 0\n")
    (tmp_path / "placed.txt").write_text("start 0.4 0 0.5 0 1 0 0\nspeed 0.1\nline 0.1 0\n")
    return tmp_path


def test_points(folder):
    built = build({"kind": "points", "file": "places.csv"}, folder)
    same(built, shapes.load_points(folder / "places.csv", START))
    built = build({"kind": "points", "file": "poses.csv", "duration": 2}, folder)
    same(built, shapes.load_points(folder / "poses.csv", duration=2.0))


def test_via_points(folder):
    points = shapes.load_points(folder / "places.csv", START)
    same(
        build({"kind": "via-points", "file": "places.csv"}, folder),
        shapes.ViaPoints(points.times, points.poses),
    )


def test_points_take_their_missing_orientation_from_the_start(folder):
    start = {"start": {"quaternion": [0, 1, 0, 0]}, "offset": {"rotation": [0, 0, math.pi]}}
    built = build({"kind": "points", "file": "places.csv", **start}, folder)
    np.testing.assert_allclose(np.abs(built.samples([0.0])[0, :4]), [0, 0, 1, 0], atol=1e-15)


def test_set_point_with_and_without_an_end():
    assert build({"kind": "set-point"}).duration == math.inf
    assert build(PAUSE).duration == 1.0


@pytest.fixture
def square():
    return shapes.Square(START, side=0.1, duration=8.0)


DISPLACEMENT = {"position": [0.1, 0.2, 0.3], "quaternion": [0.8, 0.6, 0, 0]}
BY = algebra.pose([0.8, 0.6, 0, 0], [0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"repeat": 3}, lambda square: shapes.Repeat(square, 3)),
        ({"ramp": 2}, lambda square: shapes.StartRamp(square, 2.0)),
        ({"corner_stops": 0.5}, lambda square: shapes.CornerStops(square, 0.5)),
        ({"jerk_limits": LIMITS}, lambda square: shapes.JerkLimited(square, **LIMITS)),
        ({"transform": DISPLACEMENT}, lambda square: shapes.Transformed(square, BY)),
        (
            {"transform": DISPLACEMENT, "jerk_limits": LIMITS, "repeat": 2},
            lambda square: shapes.Transformed(shapes.JerkLimited(shapes.Repeat(square, 2), **LIMITS), BY),
        ),
        ({"repeat": 2, "ramp": 3}, lambda square: shapes.StartRamp(shapes.Repeat(square, 2), 3.0)),
    ],
)
def test_modifiers_in_their_order(keys, expected, square):
    same(build({**SQUARE, **keys}), expected(square))


def test_sequence_goes_on_where_it_was():
    arc = {**CIRCLE, "turns": 0.25}
    built = build({"kind": "sequence", "references": [PAUSE, arc, SQUARE, {"kind": "set-point"}]})
    first = shapes.Circle(START, radius=0.05, duration=4.0, turns=0.25)
    end = first.samples([4.0])[0, :8]
    np.testing.assert_allclose(
        algebra.translation(end) - algebra.translation(START), [0.05, 0, -0.05], atol=1e-15
    )
    parts = [
        shapes.SetPoint(START, 1.0),
        first,
        shapes.Square(end, side=0.1, duration=8.0),
        shapes.SetPoint(end),
    ]
    same(built, shapes.Sequence(parts), end=20.0)


def test_sequences_in_sequences_modified_as_one(square):
    inner = {"kind": "sequence", "references": [CIRCLE, SQUARE], "repeat": 2}
    built = build({"kind": "sequence", "references": [PAUSE, inner], "jerk_limits": LIMITS})
    twice = shapes.Repeat(shapes.Sequence([shapes.Circle(START, radius=0.05, duration=4.0), square]), 2)
    same(built, shapes.JerkLimited(shapes.Sequence([shapes.SetPoint(START, 1.0), twice]), **LIMITS))


def test_sequence_starts_where_it_says():
    start = {"start": {"position": [0.3, 0, 0.4]}, "offset": {"translation": [0, 0, 0.1]}}
    built = build({"kind": "sequence", "references": [PAUSE, CIRCLE], **start})
    np.testing.assert_allclose(algebra.translation(built.samples([0.0])[0, :8]), [0.3, 0, 0.5], atol=1e-15)


def test_resolved_text_of_nested_files_runs_anywhere(folder):
    inner = {"kind": "sequence", "references": [{"kind": "drawing", "file": "line.txt"}]}
    data = spec_of({"kind": "sequence", "references": [PAUSE, inner], "corner_stops": 0.2})
    (folder / "my.yaml").write_text(yaml.safe_dump(data))
    setting = prepare(folder / "my.yaml")
    text = spec_text(setting.spec, setting.folder)
    part = yaml.safe_load(text)["reference"]["references"][1]["references"][0]
    assert part["file"] == str(folder / "line.txt")
    (folder / "sub").mkdir()
    (folder / "sub" / "spec.yaml").write_text(text)
    again = prepare(folder / "sub" / "spec.yaml")
    np.testing.assert_array_equal(again.scene.samples, setting.scene.samples)
    assert spec_text(again.spec, again.folder) == text


def sequence(*parts):
    return {"kind": "sequence", "references": list(parts)}


@pytest.mark.parametrize(
    ("reference", "text"),
    [
        (sequence(CIRCLE, {**CIRCLE, "kind": "circel"}),
         r"reference\.references\[1\]\.kind: unknown name 'circel'; did you mean 'circle'\? \(allowed: .*via-points"),
        (sequence(sequence({**CIRCLE, "radios": 1})),
         r"reference\.references\[0\]\.references\[0\]: unknown key 'radios'; did you mean 'radius'\? \("),
        (sequence(PAUSE, {**SQUARE, "side": -1}), r"reference\.references\[1\]\.side: expected a number > 0.0, got"),
        (sequence({"kind": "points"}), r"reference\.references\[0\]: missing key 'file'$"),
        (sequence({"radius": 1}), r"reference\.references\[0\]: missing key 'kind' \(allowed"),
        (sequence(), r"reference\.references: expected a list of length >= 1, got \[\]$"),
        (sequence(3), r"reference\.references\[0\]: expected a mapping, got 3$"),
        ({"kind": "sequence"}, r"reference: missing key 'references'$"),
        ({"kind": "sequence", "references": {"a": CIRCLE}}, r"reference\.references: expected a list, got a mapping$"),
        ({**CIRCLE, "repeat": 0}, r"reference\.repeat: expected a whole number >= 1, got 0$"),
        ({**CIRCLE, "ramp": 0}, r"reference\.ramp: expected a number > 0.0, got 0$"),
        ({**CIRCLE, "jerk_limits": {"velocity": 1}}, r"reference\.jerk_limits: missing key 'acceleration'$"),
        ({**CIRCLE, "jerk_limits": {**LIMITS, "jrk": 1}}, r"reference\.jerk_limits: unknown key 'jrk'; did you mean '"),
        ({**CIRCLE, "jerk_limits": {**LIMITS, "jerk": 0}}, r"reference\.jerk_limits\.jerk: expected a number > 0.0"),
        (sequence({**CIRCLE, "transform": {"position": [1, 2]}}),
         r"reference\.references\[0\]\.transform\.position: expected a list of length 3, got 2"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_named(tmp_path, reference, text):
    path = tmp_path / "my.yaml"
    path.write_text(yaml.safe_dump(spec_of(reference)))
    with pytest.raises(FileFormatError, match=f"^{path}: {text}"):
        read_spec(path)


RANGE = ValueRangeError
POINTS = {"kind": "points", "file": "places.csv"}
POSES = {"kind": "points", "file": "poses.csv", "duration": 2}
PLACED = {"kind": "drawing", "file": "placed.txt"}
SPIRAL = {"kind": "spiral", "radius": 0.1, "length": 0.1, "duration": 6}


@pytest.mark.parametrize(
    ("reference", "kind", "text"),
    [
        ({**CIRCLE, "ramp": 1, "corner_stops": 1}, RANGE, r"^reference: give only one of ramp, corner_stops$"),
        ({**SPIRAL, "repeat": 2}, RANGE,
         r"^reference\.repeat: references\[1\]: must start where references\[0\] ends, but starts 0\.1 m and 0 deg"),
        ({**sequence({**SQUARE, "repeat": 10_000}), "repeat": 10_000}, RANGE,
         r"^reference\.repeat: makes 400000000 corners, at most 1000000 are allowed$"),
        ({**CIRCLE, "ramp": 9}, RANGE, r"^reference\.ramp: seconds: must be ≤ 8, twice the reference, got 9$"),
        ({"kind": "set-point", "ramp": 1}, RANGE, r"^reference\.ramp: reference: never ends"),
        ({"kind": "set-point", "corner_stops": 1}, RANGE, r"^reference\.corner_stops: reference: never ends"),
        ({**PAUSE, "jerk_limits": LIMITS}, RANGE, r"^reference\.jerk_limits: reference: never moves"),
        ({**CIRCLE, "jerk_limits": {**LIMITS, "angular_jerk": 1}}, ShapeError,
         r"^reference\.jerk_limits: angular_velocity: missing"),
        ({**CIRCLE, "transform": {"quaternion": [1, 1, 0, 0]}}, RANGE,
         r"^reference\.transform\.quaternion: must have norm 1 within 0.001, got 1\.41421356; normalised it is "),
        ({**CIRCLE, "plane": [[1, 0, 0], [1, 1, 0]]}, RANGE, r"^reference\.plane: must have perpendicular"),
        (sequence(PAUSE, {**CIRCLE, "plane": [[1, 0, 0], [1, 1, 0]]}), RANGE,
         r"^reference\.references\[1\]\.plane: must have perpendicular axes, got 45 degrees"),
        (sequence(PAUSE, {**CIRCLE, "start": {"quaternion": [2, 0, 0, 0]}}), RANGE,
         r"^reference\.references\[1\]\.start\.quaternion: must have norm 1 within 0.001, got 2; normalised it is "),
        (sequence(CIRCLE, {**SQUARE, "offset": {"translation": [0, 0, 0.1]}}), RANGE,
         r"^reference\.references\[1\]: must start where references\[0\] ends, but starts 0\.1 m and 0 degrees"),
        (sequence(PAUSE, sequence(CIRCLE, {**SPIRAL, "repeat": 2})), RANGE,
         r"^reference\.references\[1\]\.references\[1\]\.repeat: references\[1\]: must start"),
        (sequence({"kind": "set-point"}, CIRCLE), RANGE,
         r"^reference\.references\[0\]: never ends, so nothing can follow it: give its duration$"),
        (POINTS | {"duration": 2}, RANGE, r"^reference\.duration: places\.csv has its own column 'time', got 2"),
        ({"kind": "points", "file": "poses.csv"}, RANGE, r"^reference\.duration: poses\.csv has no column"),
        (POINTS | {"start": {"position": [0, 0, 0]}}, RANGE,
         r"^reference\.start\.position: places\.csv says itself where it starts: leave it out, or use 'transform'$"),
        (POINTS | {"offset": {"translation": [0, 0, 1]}}, RANGE, r"^reference\.offset\.translation: places"),
        (POSES | {"start": {"quaternion": [1, 0, 0, 0]}}, RANGE,
         r"^reference\.start\.quaternion: poses\.csv says itself how the hand is turned"),
        (POSES | {"offset": {"rotation": [1, 0, 0]}}, RANGE, r"^reference\.offset\.rotation: poses\.csv says"),
        (PLACED | {"start": {"position": [0, 0, 0]}}, RANGE, r"^reference\.start\.position: placed\.txt says"),
        (PLACED | {"offset": {"rotation": [1, 0, 0]}}, RANGE, r"^reference\.offset\.rotation: placed\.txt says"),
        ({"kind": "points", "file": "place.csv"}, FileFormatError, r"^place\.csv: no such file; did you mea"),
        (sequence({"kind": "drawing", "file": "lin.txt"}), FileFormatError, r"^lin\.txt: no such file; did you mean"),
    ],
)  # fmt: skip
def test_what_does_not_fit_together(folder, monkeypatch, reference, kind, text):
    monkeypatch.chdir(folder)
    with pytest.raises(kind, match=text):
        build(reference)


def test_sequences_nested_without_end_are_refused(tmp_path):
    path = tmp_path / "deep.yaml"
    text = "{kind: set-point, duration: 1}"
    for _ in range(2000):
        text = "{kind: sequence, references: [" + text + "]}"
    path.write_text(yaml.safe_dump(spec_of(CIRCLE)) + "\n")
    content = path.read_text().partition("reference:")[0]
    path.write_text(content + "reference: " + text + "\n")
    with pytest.raises(Error, match=r"deep\.yaml: "):
        prepare(path)


@pytest.mark.parametrize("name", ["via-points", "composed"])
def test_examples_fit_their_robot_and_keep_their_limits(name):
    setting = prepare(Path(__file__).parents[2] / "examples" / f"{name}.yaml")
    limits = setting.spec.reference.jerk_limits
    assert limits
    _, v, a = point_motion(setting.scene.samples)
    speed = np.linalg.norm(v, axis=1)
    assert limits.velocity * 0.99 < speed.max() <= limits.velocity * (1 + 1e-9)
    along = np.sum(v * a, axis=1) / np.maximum(speed, 1e-12)
    assert np.abs(along).max() <= limits.acceleration * (1 + 1e-9)
