"""Laws, plants and references of users in specs: from a file or an installed package, in studies and processes."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import Error, FileFormatError, ShapeError, UnknownNameError, ValueRangeError
from dqcontrol.experiments import run_study_to
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.experiments.spec import read_spec
from dqcontrol.experiments.sweep import read_sweep
from dqcontrol.extensions import POLICY, REFUSED, user_code
from dqcontrol.reports import rewrite_reports

CODE = """
import dqcontrol as dqc

def transpose(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    for i in range(out.shape[0]):
        out[i] = 0.0
        for k in range(8):
            out[i] += parameters[0] * pose_jacobian[k, i] * (sample[k] - pose[k])

def ideal(command, parameters, noise, state, q, measured):
    for i in range(q.shape[0]):
        q[i] += parameters[0] * parameters[1] * command[i]
        measured[i] = q[i]

def wave(start, height, duration):
    place = dqc.algebra.translation(start)
    return dqc.references.Curve(lambda t: place + [0, 0, height * (t / duration) ** 2], duration, start)
"""
SPEC = """
name: own
robot: iiwa7
start: [0, 0.6, 0, 1.6, 0, 0.6, 0]
period: 0.01
reference: {kind: own, function: mine.py:wave, parameters: {height: 0.02, duration: 0.2}}
laws:
  mine: {kind: own, function: mine.py:transpose, parameters: {gain: 5.0}}
  K: {kind: proportional, gain: 10}
plants:
  ideal: {kind: own, function: mine.py:ideal, parameters: {share: 1.0}}
  integrator: {kind: integrator}
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.delenv(POLICY, raising=False)
    (tmp_path / "mine.py").write_text(CODE)
    (tmp_path / "spec.yaml").write_text(SPEC)
    return tmp_path


def test_own_parts_run_like_ours(folder):
    """The own plant integrates as the ideal one does, so runs on both are the same."""
    study = dqc.run_study(folder / "spec.yaml")
    ideal, integrator = study.runs["K · ideal"].record, study.runs["K · integrator"].record
    np.testing.assert_allclose(ideal.q, integrator.q, atol=1e-14)
    np.testing.assert_allclose(
        study.runs["mine · ideal"].record.q, study.runs["mine · integrator"].record.q, atol=1e-14
    )
    assert np.ptp(ideal.desired[:, 7]) > 0.005  # 2 cm, half of it in the dual part


@pytest.mark.slow
def test_grid_over_a_parameter_and_files_named_from_elsewhere(folder):
    text = SPEC + "grids:\n  mine: {parameters.gain: [2.0, 5.0]}\n  K: {gain: [5.0, 10.0]}\n"
    (folder / "spec.yaml").write_text(text)
    setting = prepare(folder / "spec.yaml")
    gains = [case.variant.law.parameters for case in setting.cases if case.names.law == "mine"]
    assert gains == [{"gain": 2.0}, {"gain": 5.0}] * 2
    again = folder / "elsewhere" / "again.yaml"  # all names of files are absolute in what a study keeps
    again.parent.mkdir()
    again.write_text(setting.text)
    assert len(prepare(again).cases) == len(setting.cases)


def test_a_key_of_a_grid_that_is_not_there(folder):
    (folder / "spec.yaml").write_text(SPEC + "grids:\n  mine: {parameters.gian: [2.0]}\n")
    with pytest.raises(
        FileFormatError, match=r"grids.mine: the law has no 'parameters.gian' to change; did you mean 'gain'?"
    ):
        prepare(folder / "spec.yaml")


def test_a_parameter_to_sweep_over_that_is_not_there(folder):
    """It would be one more number that no function reads, and all points of the sweep the same."""
    (folder / "spec.yaml").write_text(SPEC + "sweep:\n  over: {laws.mine.parameters.gian: [1.0, 2.0]}\n")
    with pytest.raises(
        FileFormatError, match=r"no 'laws\.mine\.parameters\.gian' to vary; did you mean 'gain'\?"
    ):
        list(read_sweep(folder / "spec.yaml").rows(range(2)))


def test_sweep_over_a_parameter(folder):
    (folder / "spec.yaml").write_text(SPEC + "sweep:\n  over: {laws.mine.parameters.gain: [1.0, 2.0, 4.0]}\n")
    rows = list(read_sweep(folder / "spec.yaml").rows(range(3)))
    errors = [row["position.rms"] for row in rows if row["law"] == "mine" and row["plant"] == "ideal"]
    assert len(errors) == 3
    assert sorted(errors, reverse=True) == errors


@pytest.mark.slow
def test_worker_processes_find_the_functions(folder):
    text = SPEC.replace("kind: integrator", "kind: servo, encoder_noise: 1.0e-4") + "repeats: 4\n"
    (folder / "spec.yaml").write_text(text)
    one, two = (dqc.run_study(folder / "spec.yaml", jobs=jobs) for jobs in (1, 2))
    assert one.rows == two.rows


@pytest.mark.slow
def test_unfinished_studies_see_that_the_code_changed(folder):
    before = prepare(folder / "spec.yaml").fingerprint()
    assert prepare(folder / "spec.yaml").fingerprint() == before
    (folder / "mine.py").write_text(CODE + "\n# changed\n")
    assert prepare(folder / "spec.yaml").fingerprint() != before


def test_functions_in_dictionaries(folder, monkeypatch):
    monkeypatch.syspath_prepend(str(folder))
    import mine  # type: ignore[import-not-found]

    data = {
        "name": "own",
        "robot": "iiwa7",
        "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
        "period": 0.01,
        "duration": 0.1,
        "reference": {"kind": "set-point"},
        "law": {"kind": "own", "function": mine.transpose, "parameters": [5.0]},
        "plant": {"kind": "integrator"},
    }
    assert dqc.run(data).record.stopped == "duration"
    data["law"]["function"] = lambda *_: None
    with pytest.raises(ShapeError, match="must stand in a file"):
        dqc.run(data)


@pytest.mark.parametrize(
    ("change", "error", "says"),
    [
        (("mine.py:transpose", "mine.py:transpos"), UnknownNameError, "did you mean 'transpose'"),
        (("mine.py:transpose", "nowhere.py:transpose"), FileFormatError, "nowhere.py: no such file"),
        (("mine.py:transpose", "no_such_package:law"), FileFormatError, "no_such_package cannot be imported"),
        (("mine.py:transpose", "transpose"), ShapeError, "FILE.py:NAME or MODULE:NAME, got 'transpose'"),
        (("mine.py:wave", "mine.py:transpose"), ValueRangeError, "raised TypeError"),
        (("height: 0.02", "hight: 0.02"), ValueRangeError, "unexpected keyword argument 'hight'"),
    ],
)
def test_wrong_places_and_parameters(folder, change, error, says):
    (folder / "spec.yaml").write_text(SPEC.replace(*change))
    with pytest.raises(error, match=says):
        prepare(folder / "spec.yaml")


def test_a_file_that_raises(folder):
    (folder / "mine.py").write_text("1 / 0\n")
    with pytest.raises(FileFormatError, match=r"mine\.py: cannot be imported: ZeroDivisionError"):
        prepare(folder / "spec.yaml")


def command(folder, *arguments):
    return subprocess.run(
        [sys.executable, "-m", "dqcontrol", *arguments],
        cwd=folder,
        env={k: v for k, v in os.environ.items() if k != POLICY},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
def test_the_command_line_says_first_that_it_runs_code_and_refuses_it_on_request(folder):
    done = command(folder, "check", "spec.yaml")
    assert done.returncode == 0, done.stderr
    assert done.stderr.splitlines()[0].startswith(f"dqcontrol: runs code of {folder / 'mine.py'}:wave")
    refused = command(folder, "check", "spec.yaml", "--no-code")
    assert refused.returncode == 2
    assert refused.stderr.count("\n") == 1
    assert "mine.py:transpose" in refused.stderr


def test_the_environment_can_refuse_code(folder, monkeypatch):
    monkeypatch.setenv(POLICY, REFUSED)
    with pytest.raises(Error, match=r"mine\.py:transpose"):
        read_spec(folder / "spec.yaml")


@pytest.mark.slow
def test_reports_in_processes_say_first_that_they_run_code_and_refuse_it_too(folder, monkeypatch, capsys):
    study = run_study_to(folder / "spec.yaml", folder / "out", figures=False)
    assert len(study.rows) == 4
    user_code._announced.clear()
    capsys.readouterr()
    rewrite_reports([folder / "out"], jobs=2)
    assert "dqcontrol: runs code of" in capsys.readouterr().err
    monkeypatch.setenv(POLICY, REFUSED)
    with pytest.raises(ValueRangeError, match="runs code of"):
        rewrite_reports([folder / "out"], jobs=2)


def test_every_spec_says_which_code_it_brings_and_says_it_again_of_changed_code(folder, capsys):
    (folder / "second.yaml").write_text(SPEC.replace("mine.py", "yours.py"))
    (folder / "yours.py").write_text(CODE)
    told = []
    for name, change in (("spec", ""), ("spec", ""), ("second", ""), ("second", "\n# changed\n")):
        (folder / "yours.py").write_text(CODE + change)
        read_spec(folder / f"{name}.yaml")
        told.append(capsys.readouterr().err.count("dqcontrol: runs code of"))
    assert told == [1, 0, 1, 1]


PACKAGE = '''
from dataclasses import dataclass, field
from typing import Annotated
import numpy as np
from msgspec import Meta
import dqcontrol as dqc
from dqcontrol.plants import Integrator
from dqcontrol.references import Reference, SetPoint

class Doubled(dqc.laws.Proportional, frozen=True, kw_only=True, tag="doubled"):
    """Another name for K."""

class Other(Integrator, frozen=True, kw_only=True, tag="other"):
    """Another name for the ideal plant."""

@dataclass(frozen=True, eq=False)
class Rest(Reference):
    """Rest for some seconds."""
    kind = "rest-for"
    start: object
    seconds: Annotated[float, Meta(gt=0)] = 1.0
    duration: float = field(init=False)
    corners: object = field(init=False)

    def __post_init__(self):
        object.__setattr__(self, "duration", self.seconds)
        object.__setattr__(self, "corners", np.zeros(0))

    def motion(self, times):
        return SetPoint(self.start).motion(times)

def greet(name: str, /):
    """Say hello."""
    print("hello", name)

class Pause(SetPoint):
    """Rest until a time that is given in minutes."""
    kind = "pause"

    @classmethod
    def from_spec(cls, start, *, minutes: Annotated[float, Meta(gt=0)] = 1.0):
        return cls(start.pose, 60.0 * minutes)
'''
POINTS = """
[dqcontrol.laws]
doubled = someones_package:Doubled
[dqcontrol.plants]
other = someones_package:Other
[dqcontrol.references]
rest = someones_package:Rest
pause = someones_package:Pause
[dqcontrol.commands]
greet = someones_package:greet
[dqcontrol.commands.ros2]
greet = someones_package:greet
"""
USES = """
import dqcontrol as dqc
spec = {"name": "a", "robot": "iiwa7", "start": [0, 0.6, 0, 1.6, 0, 0.6, 0], "period": 0.01,
        "reference": {"kind": "rest-for", "seconds": 0.2}, "law": {"kind": "doubled", "gain": 3.0},
        "plant": {"kind": "other"}}
print(len(dqc.run(spec).record.time))
print(len(dqc.run(spec | {"reference": {"kind": "pause", "minutes": 0.01}}).record.time))
from someones_package import Pause
start = dqc.load_robot("iiwa7").fkm(spec["start"])
print(len(dqc.run(spec | {"reference": Pause(start, 0.1)}).record.time))
spec["reference"]["seconds"] = -1
try:
    dqc.run(spec)
except dqc.Error as error:
    print(error)
import sys
from dqcontrol import cli
for words in (["greet", "you"], ["ros2", "greet", "them"]):
    sys.argv[1:] = words
    cli.main()
"""


@pytest.mark.slow
def test_an_installed_package_offers_a_law_a_plant_a_reference_and_commands(tmp_path):
    (tmp_path / "someones_package.py").write_text(PACKAGE)
    information = tmp_path / "someones_package-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: someones-package\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text(POINTS)
    path = os.pathsep.join([str(Path(dqc.__file__).parents[1]), str(tmp_path)])
    done = subprocess.run(
        [sys.executable, "-c", USES],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "21",
        "61",
        "11",
        "spec: reference.seconds: expected a number > 0.0, got -1",
        "hello you",
        "hello them",
    ]


def test_two_kinds_of_one_name_are_refused():
    from dqcontrol.extensions.registry import union_of

    class Base(dqc.laws.Law, frozen=True, kw_only=True, tag="Base"):
        pass

    class One(Base, frozen=True, kw_only=True, tag="same"):
        pass

    class Two(Base, frozen=True, kw_only=True, tag="same"):
        pass

    with pytest.raises(Error, match="kind 'same': offered by"):
        union_of(Base)
    assert One is not Two


@pytest.mark.parametrize(
    "command", [pytest.param(["run", "--out", "results"], marks=pytest.mark.slow), ["check"]]
)
def test_what_an_interpreted_function_raises_is_told_in_a_line(folder, command):
    """What does not compile is called from Python; there is no traceback for a mistake in it."""
    (folder / "wrong.py").write_text(
        "import statistics\n\n"
        "def law(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):\n"
        "    out[:] = statistics.fmean(q) / 0\n"
    )
    (folder / "spec.yaml").write_text(SPEC.replace("mine.py:transpose", "wrong.py:law"))
    words = [sys.executable, "-m", "dqcontrol", command[0], "spec.yaml", *command[1:]]
    ended = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert "Traceback" not in ended.stderr
    said = ended.stdout + ended.stderr
    assert "law raised ZeroDivisionError: float division by zero (wrong.py, line 4)" in said
