"""Specs: what they say of bad input, before anything moves."""

import copy
import pickle
from pathlib import Path

import numpy as np
import pytest
import yaml

import dqcontrol as dqc
from dqcontrol.errors import Error, FileFormatError, ShapeError, UnknownNameError, ValueRangeError
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.experiments.spec import read_spec, spec_text
from dqcontrol.laws import Proportional

K = {"kind": "proportional", "gain": 10}
BASE = {
    "name": "circle",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.01,
    "reference": {"kind": "circle", "radius": 0.07, "duration": 2},
    "law": K,
    "plant": {"kind": "integrator"},
}
LQR = {"kind": "linear-quadratic-dq", "error_weight": 1, "control_weight": 0.01}
GONE = object()
EXAMPLES = Path(__file__).parents[2] / "examples"


def changed(**changes):
    data = copy.deepcopy(BASE)
    for name, value in changes.items():
        data[name] = value
        if value is GONE:
            del data[name]
    return data


def circle(**changes):
    return {**BASE["reference"], **changes}


def test_the_base_of_these_tests_is_right(tmp_path):
    path = tmp_path / "spec.yaml"
    path.write_text(yaml.safe_dump(BASE))
    from_file, from_dict = prepare(path), prepare(BASE)
    assert from_file.spec == from_dict.spec
    assert (from_file.folder, from_dict.folder) == (tmp_path, Path.cwd())
    assert len(from_file.scene.samples) == 201
    assert from_file.spec.is_single
    for several in (
        {"law": GONE, "laws": {"a": K, "b": K}},
        {"repeats": 2},
        {"grids": {"proportional": {"gain": [1, 2]}}},
        {"parameter_sets": {"a": {"proportional": {}}, "b": {"proportional": {}}}},
    ):
        assert not prepare(changed(**several)).spec.is_single


def test_records_are_kept_unless_runs_are_repeated():
    for changes, kept in (
        ({}, True),
        ({"repeats": 2}, False),
        ({"record": "metrics"}, False),
        ({"record": "all", "repeats": 2}, True),
    ):
        assert read_spec(changed(**changes))[0].keeps_records == kept


UNFIT = [
    (changed(lawz=K), r"unknown key 'lawz'; did you mean 'law'\? \(allowed: name, robot, start, robots, period, "),
    (changed(law={"kind": "proportional", "gian": 1}),
     r"law: unknown key 'gian'; did you mean 'gain'\? \(allowed: kind, [^()]*gain, [^()]*\)$"),
    (changed(plant={"kind": "servo", "time_konstant": 1}),
     r"plant: unknown key 'time_konstant'; did you mean 'time_constant'\? \(allowed: kind, command_mode, "
     r"time_constant, bandwidth, damping_ratio, friction, gain, sag, stiffness, delay, encoder_resolution, "
     r"encoder_noise, rate_limit, position_limit, gravity, base_time_constant, camera, wrist, world\)$"),
    (changed(plant={"kind": "integrator", "sag": 1}), r"plant: unknown key 'sag' \(allowed: kind, bias\)$"),
    (changed(reference=circle(length=1)),
     r"reference: unknown key 'length'.* \(allowed: kind, start, offset, repeat, [^()]*, plane, turns, clockwise\)$"),
    (changed(reference=circle(offset={"translatoin": [0, 0, 0]})),
     r"reference.offset: unknown key 'translatoin'; did you mean 'translation'\? \(allowed: translation, rotation\)$"),
    (changed(law=GONE, laws={"a": K, "b": {"kind": "proportional", "gian": 1}}),
     r"laws.b: unknown key 'gian'; did you mean 'gain'\? \(allowed: kind, [^()]*gain, [^()]*\)$"),
    (changed(law={**K, "inverse": {"kind": "damped", "dampin": 1}}),
     r"law.inverse: unknown key 'dampin'; did you mean 'damping'\? \(allowed: kind, damping, "),
    (changed(law={**K, "gain": {"times": [0], "value": [1]}}),
     r"law.gain: unknown key 'value'; did you mean 'values'\? \(allowed: times, values\)$"),
    (changed(robot={"sorce": "iiwa7"}), r"robot: unknown key 'sorce'; did you mean 'source'\?"),
    (changed(stop={"eror": 1}), r"stop: unknown key 'eror'; did you mean 'error'\? \(allowed: error, samples\)$"),
    (changed(law={"kind": "proportionl", "gain": 1}),
     r"law.kind: unknown name 'proportionl'; did you mean 'proportional'\? \(allowed: .*proportional-feedforward"),
    (changed(law=GONE, laws={"a": {"kind": "P", "gain": 1}}), r"laws.a.kind: unknown name 'P'.* \(allowed: "),
    (changed(plant={"kind": "sevro"}), r"plant.kind: unknown name 'sevro'; did you mean 'servo'\?"),
    (changed(reference=circle(kind="circel")), r"reference.kind: unknown name 'circel'; did you mean 'circle'\?"),
    (changed(reference=circle(plane="xq")), r"reference.plane: unknown name 'xq'.* \(allowed: xy, xz, yz\)$"),
    (changed(plant={"kind": "servo", "command_mode": "measurd"}),
     r"plant.command_mode: unknown name 'measurd'; did you mean 'measured'\? \(allowed: integrated, measured\)$"),
    (changed(law={"gain": 1}), r"law: missing key 'kind' \(allowed"),
    (changed(law={"kind": "proportional"}), r"law: missing key 'gain'$"),
    (changed(period=GONE), r"missing key 'period'$"),
    (changed(period="fast"), r"period: expected a number, got text '"),
    (changed(period=0), r"period: expected a number > 0.0, got 0$"),
    (changed(period=-0.01), r"period: expected a number > 0.0, got -0.01$"),
    (changed(start=[0, "a"]), r"start\[1\]: expected a number, got text '"),
    (changed(start=[]), r"start: expected a list of length >= 1, got \[\]$"),
    (changed(start=0.5), r"start: expected a mapping or a list or nothing, got 0\.5$"),
    (changed(robot=3), r"robot: expected text or a mapping, got 3$"),
    (changed(reference=3), r"reference: expected a mapping, got 3$"),
    (changed(reference=circle(radius=-0.1)), r"reference.radius: expected a number > 0.0, got -0.1$"),
    (changed(law=3), r"law: expected a mapping, got 3$"),
    (changed(law={**K, "hysteresis": 1}), r"law.hysteresis: expected a number < 1.0, got 1$"),
    (changed(law={**K, "inverse": {"kind": "damped", "damping": 0}}), r"law.inverse.damping: expected a number > 0"),
    (changed(plant={"kind": "servo", "time_constant": -1}), r"plant.time_constant: expected a number >= 0.0, got -1$"),
    (changed(seed=-1), r"seed: expected a whole number >= 0, got -1$"),
    (changed(seed=1.5), r"seed: expected a whole number, got 1\.5$"),
    (changed(skip_initial=-1), r"skip_initial: expected a number >= 0.0, got -1$"),
    (changed(stop={"error": 0}), r"stop.error: expected a number > 0.0, got 0$"),
    (changed(name="a/b"), r"name: expected at most 60 letters, digits, _ \. - and no dot first, got 'a/b'$"),
    (changed(name=".."), r"name: expected at most 60 letters, digits, _ \. - and no dot first, got '\.\.'$"),
    (changed(law=GONE, laws={"a/b": K}), r"laws: expected labels of at most 60 characters without /, .*, got 'a/b'$"),
    (changed(law=GONE, laws={"$_{5$": K}), r"laws: expected labels .*, \\ and \$, .*, got '\$_{5\$'$"),
    (changed(law=GONE, laws={"_K": K}), r"laws: expected labels .*not beginning with a dot or _, got '_K'$"),
    (changed(law=GONE, laws={"..": K}), r"laws: expected labels of .*not beginning with a dot or _, got '\.\.'$"),
    (changed(law=GONE, laws={}), r"laws: expected a mapping of length >= 1, got {}$"),
    (changed(laws={"a": K}), r"law: give either 'law' \(one\) or 'laws' \(several by label\)$"),
    (changed(law=GONE), r"law: give either 'law' \(one\) or 'laws' \(several by label\)$"),
    (changed(plants={"a": BASE["plant"]}), r"plant: give either 'plant' \(one\) or 'plants'"),
    (changed(plant=GONE), r"plant: give either 'plant' \(one\) or 'plants'"),
    (changed(repeats=0), r"repeats: expected a whole number >= 1, got 0$"),
    (changed(repeats=-3), r"repeats: expected a whole number >= 1, got -3$"),
    (changed(repeats=2.5), r"repeats: expected a whole number, got 2\.5$"),
    (changed(record="al"), r"record: unknown name 'al'; did you mean 'all'\? \(allowed: all, metrics\)$"),
    (changed(parameter_sets={}), r"parameter_sets: expected a mapping of length >= 1, got {}$"),
    (changed(parameter_sets={"best": {}}), r"parameter_sets.best: expected a mapping of length >= 1, got {}$"),
    (changed(parameter_sets={"a/b": {"proportional": {}}}),
     r"parameter_sets: expected labels of at most 60 characters without /"),
    (changed(law=GONE, laws={"K": K}, parameter_sets={"best": {"KK": {}}}),
     r"parameter_sets.best: unknown name 'KK'; did you mean 'K'\? \(allowed: K\)$"),
    (changed(parameter_sets={"best": {"proportional": {"error_weight": 3}}}),
     r"parameter_sets.best.proportional: unknown key 'error_weight' \(allowed: kind, "),
    (changed(parameter_sets={"best": {"proportional": 3}}),
     r"parameter_sets.best.proportional: expected a mapping, got 3$"),
    (changed(grids={"proportional": {"gain": []}}),
     r"grids.proportional.gain: expected a list of length >= 1, got \[\]$"),
    (changed(grids={"proportional": {}}), r"grids.proportional: expected a mapping of length >= 1, got {}$"),
    (changed(grids={"proportional": {"gain": 3}}), r"grids.proportional.gain: expected a list, got 3$"),
    (changed(grids={"propotional": {"gain": [3]}}), r"grids.propotional: unknown name .* did you mean 'proportional'"),
    (changed(robots={"a": {"source": "iiwa7", "start": [0] * 7}}),
     r"robot: give either 'robot' with 'start' \(one\) or 'robots' \(several by label\)$"),
    (changed(robot=GONE), r"robot: give either 'robot' with 'start' \(one\) or 'robots' \(several by label\)$"),
    (changed(robot=GONE, robots={"a": {"source": "iiwa7", "start": [0] * 7}}),
     r"start: each of 'robots' has its own; give it there$"),
    (changed(robot=GONE, start=GONE, robots={"a": {"source": "iiwa7"}}), r"robots.a: missing key 'start'$"),
    (changed(robot=GONE, start=GONE, robots={}), r"robots: expected a mapping of length >= 1, got {}$"),
    (changed(start=GONE), r"missing key 'start'$"),
    (changed(law=GONE, laws={1: K}), r"laws: names are text; put 1 in quotes$"),
    (changed(plant={"kind": "compliant", "duty": 3}), r"plant.duty: expected a number <= 1.0, got 3$"),
    (changed(plant={"kind": "compliant", "mode": "theta_gc"}),
     r"plant.mode: unknown name 'theta_gc'; did you mean 'THETA_GC'\? \(allowed: OFF, "),
    (changed(plant={"kind": "compliant", "accurate": "yes"}), r"plant.accurate: expected true or false, got 'yes'$"),
]  # fmt: skip


@pytest.mark.parametrize(("data", "text"), UNFIT, ids=[text[:40] for _, text in UNFIT])
def test_what_does_not_fit_is_named_with_file_and_field(tmp_path, data, text):
    path = tmp_path / "my.yaml"
    path.write_text(yaml.safe_dump(data))
    with pytest.raises(FileFormatError, match="^spec: " + text):
        read_spec(data)
    with pytest.raises(FileFormatError, match=f"^{path}: {text}"):
        read_spec(path)


def test_words_that_old_yaml_takes_for_true_and_false_are_text(tmp_path):
    path = tmp_path / "my.yaml"
    plants = "plants: {OFF: {kind: compliant, mode: OFF}, on: {kind: compliant, hand: true}}"
    path.write_text(yaml.safe_dump(changed(plant=GONE)) + plants)
    read = read_spec(path)[0].plants
    assert read is not None
    assert list(read) == ["OFF", "on"]
    assert read["OFF"].mode == "OFF"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name: a\nrobot: [iiwa7\nstart: 3\n", r":3: "),
        ("name: a\nname: b\n", r":2: key 'name' appears twice$"),
        ("name: a\n\tlaw: 3\n", r":2: "),
        ("a: &x 1\nb: *x\n", r":2: aliases are not read here; write the value out$"),
        ("period: .nan\n", r": period: must be finite, got nan$"),
        ("period: 1000000000001\n", r": period: must be at most 1e\+12, got 1000000000001$"),
        ("start: [0, -2e15 mm]\n", r": start\[1\]: must be at most 1e\+12, got -2000000000000$"),
        ("start: [0, .inf]\n", r": start\[1\]: must be finite, got inf$"),
        ("", r": is empty or no mapping; it needs name, robot, start, period, reference, law, plant$"),
        ("- a\n- b\n", r": is empty or no mapping; it needs"),
        ("just text", r": is empty or no mapping; it needs"),
        ("a: !!python/object:os.system {}\n", r":1: "),
    ],
)
def test_malformed_files(tmp_path, text, message):
    path = tmp_path / "my.yaml"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=f"^{path}{message}"):
        read_spec(path)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(FileFormatError, match=r"none\.yaml: no such file$"):
        read_spec(tmp_path / "none.yaml")
    with pytest.raises(FileFormatError, match=r": is a folder$"):
        read_spec(tmp_path)
    (tmp_path / "latin.yaml").write_bytes("name: é".encode("latin-1"))
    with pytest.raises(FileFormatError, match=r"latin\.yaml: not a text file"):
        read_spec(tmp_path / "latin.yaml")


@pytest.mark.parametrize(
    ("changes", "kind", "text"),
    [
        ({"robot": "iiwa"}, UnknownNameError, r"^robot: unknown name 'iiwa'; did you mean 'iiwa7'\?"),
        ({"start": [0] * 6}, ShapeError, r"^start: expected shape \(…, 7\), got shape \(6,\)$"),
        ({"start": [0, 0.6, 0, 2.5, 0, 0, 0]}, ValueRangeError,
         r"^start: joint_4 is 2.5, outside its limits -2.094 … 2.094$"),
        ({"start": [np.nan] * 7}, FileFormatError, r"^spec: start\[0\]: must be finite, got nan"),
        ({"law": {**K, "gain": 0}}, FileFormatError, r"^spec: law.gain: expected a number > 0.0, got 0$"),
        ({"law": {**K, "gain": -3}}, FileFormatError, r"^spec: law.gain: expected a number > 0.0, got -3$"),
        ({"law": {**K, "gain": np.nan}}, FileFormatError, r"^spec: law.gain: expected a number > 0.0, got nan$"),
        ({"law": {**K, "gain": [1] * 7}}, ShapeError,
         r"^law proportional: gain: expected one number or 8, got shape \(7,\)$"),
        ({"law": {**K, "gain": {"times": [1, 0], "values": [1, 2]}}}, FileFormatError,
         r"^spec: law.gain: schedule.times: must increase, got \[1.0, 0.0\]$"),
        ({"law": GONE, "laws": {"good": K, "bad": {**K, "gain": 0}}}, FileFormatError,
         r"^spec: laws.bad.gain: expected a number > 0.0, got 0$"),
        ({"plant": {"kind": "servo", "sag": 1, "stiffness": [1, 2]}}, ShapeError,
         r"^plant servo: plant.stiffness: expected one"),
        ({"reference": {"kind": "set-point"}}, ValueRangeError,
         r"^duration: a set-point has no duration; give 'duration'"),
        ({"duration": 0.001}, ValueRangeError, r"^duration: 0.001 s is shorter than one period of 0.01 s$"),
        ({"duration": 1e5, "period": 1e-4}, ValueRangeError, r"^duration: 100000 s are 1e\+09 periods; at most"),
        ({"reference": {"kind": "set-point", "duration": 1.7e308}}, ValueRangeError,
         r"^duration: 1\.7e\+308 s are inf periods; at most"),
        ({"reference": circle(start={"quaternion": [2, 0, 0, 0]})}, ValueRangeError,
         r"^reference.start.quaternion: must have norm 1 within 0.001, got 2; normalised it is \[1, 0, 0, 0\]$"),
        ({"reference": {"kind": "drawing", "file": "nowhere.txt"}}, FileFormatError, r"nowhere\.txt: "),
        ({"parameter_sets": {"good": {"proportional": {}}, "bad": {"proportional": {"gain": -3}}}}, FileFormatError,
         r"^spec: parameter_sets.bad.proportional: gain: expected a number > 0.0, got -3$"),
        ({"grids": {"proportional": {"gain": [1, 0]}}}, FileFormatError,
         r"^spec: grids.proportional: gain: expected a number > 0.0, got 0$"),
        ({"law": {**LQR, "horizon_time": 0.005}}, ValueRangeError,
         r"^law linear-quadratic-dq: horizon_time: must be at least one period of 0.01 s, got 0.005 s$"),
        ({"law": {**LQR, "error_weight": -1}}, ValueRangeError, r"^law linear-quadratic-dq: error_weight: must be"),
        ({"law": {**LQR, "error_weight": [[1, 2, 0, 0, 0, 0], *np.eye(6).tolist()[1:]]}}, ValueRangeError,
         r"^law linear-quadratic-dq: error_weight: must be symmetric"),
        ({"law": {**LQR, "control_weight": [1, 1, 1, 1, 1, 0]}}, ValueRangeError,
         r"^law linear-quadratic-dq: control_weight: must be "),
        ({"law": {"kind": "h-infinity", "orientation_gamma": 0, "translation_gamma": 1}}, Error,
         r"^spec: law.orientation_gamma: expected a number > 0.0, got 0$"),
        ({"law": {"kind": "h-infinity", "orientation_gamma": 1, "translation_gamma": -0.5}}, Error,
         r"^spec: law.translation_gamma: expected a number > 0.0, got -0.5$"),
        ({"law": {**K, "gain": {"times": [0, 1, 2], "values": [1, 2]}}}, FileFormatError,
         r"^spec: law.gain: schedule: expected as many values as times, got 2 and 3$"),
        ({"law": {**LQR, "error_weight": {"times": [0, 1, 2], "values": [1, 2]}}}, ShapeError,
         r"^law linear-quadratic-dq: error_weight: expected as many values as times, got 2 and 3$"),
        ({"law": GONE, "laws": {"K 1": K, "k-1": K}}, ValueRangeError,
         r"'K 1 · integrator' and 'k-1 · integrator': both would be written to the folder 'k-1-integrator'; rename"),
        ({"law": GONE, "laws": {"·": K}, "plant": GONE, "plants": {"·": BASE["plant"]}}, ValueRangeError,
         r"give labels with letters or digits"),
        ({"law": GONE, "laws": {"é" * 60: K}, "plant": GONE, "plants": {"é" * 60: BASE["plant"]}}, ValueRangeError,
         r"makes too long a name for a folder; give shorter labels$"),
        ({"robot": GONE, "start": GONE, "robots": {"a": {"source": "iiwa7", "start": [0] * 6}}}, ShapeError,
         r"^robots\.a: start: expected shape \(…, 7\), got shape \(6,\)$"),
        ({"repeats": 1_000_000, "grids": {"proportional": {"gain": list(range(1, 12))}}}, ShapeError,
         r"^spec: describes 11,000,000 trials; at most 10,000,000$"),
        ({"seed": object()}, FileFormatError, r"^spec: cannot hold <object"),
    ],
)  # fmt: skip
def test_what_does_not_fit_together(changes, kind, text):
    with pytest.raises(kind, match=text):
        prepare(changed(**changes))


@pytest.mark.parametrize("source", [None, ["spec.yaml"], 3, Proportional(gain=1.0)])
@pytest.mark.parametrize("function", [prepare, read_spec, dqc.run, dqc.run_study])
def test_what_is_neither_a_path_nor_a_dictionary(function, source):
    with pytest.raises(ShapeError, match=r"^spec: expected the path of a YAML file or a dictionary, got "):
        function(source)


def test_an_empty_drawing(tmp_path):
    (tmp_path / "empty.txt").write_text("# nothing\n")
    path = tmp_path / "my.yaml"
    path.write_text(yaml.safe_dump(changed(reference={"kind": "drawing", "file": "empty.txt"})))
    with pytest.raises(Error, match=r"empty\.txt: "):
        prepare(path)


def test_numpy_and_laws_as_values_of_a_dictionary():
    spec, _ = read_spec(
        changed(
            start=np.array(BASE["start"]),
            period=np.float64(0.01),
            seed=np.int64(4),
            law=Proportional(gain=10.0),
        )
    )
    assert spec == read_spec(changed(seed=4))[0]


@pytest.mark.parametrize("name", ["circle", "repeats", "mobile", "compliant", "keep-out", "lines-apart"])
def test_a_spec_is_the_same_in_another_process(name):
    spec, _ = read_spec(EXAMPLES / f"{name}.yaml")
    assert pickle.loads(pickle.dumps(spec)) == copy.deepcopy(spec) == spec


def test_resolved_text_has_all_defaults_and_absolute_files(tmp_path):
    (tmp_path / "line.txt").write_text("speed 0.1\nline 0.02 0\n")
    (tmp_path / "arm.yaml").write_text("")
    data = changed(reference={"kind": "drawing", "file": "line.txt"}, robot="arm.yaml")
    path = tmp_path / "my.yaml"
    path.write_text(yaml.safe_dump(data))
    spec, folder = read_spec(path)
    text = spec_text(spec, folder)
    resolved = yaml.safe_load(text)
    assert resolved["reference"]["file"] == str(tmp_path / "line.txt")
    assert resolved["robot"]["source"] == str(tmp_path / "arm.yaml")
    assert resolved["law"]["inverse"]["kind"] == "filtered"
    assert resolved["seed"] == 0
    assert not {"laws", "plants"} & set(resolved)
    again = tmp_path / "elsewhere" / "spec.yaml"
    again.parent.mkdir()
    again.write_text(text)
    same = yaml.safe_load(spec_text(*read_spec(again)))
    assert {**same, "robot": 0} == {**resolved, "robot": 0}
    assert same["robot"] == {"source": str(tmp_path / "arm.yaml")}
    assert not [key for key, value in resolved.items() if value is None]  # what says nothing is not written
