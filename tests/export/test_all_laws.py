"""Every built-in law, null space, inverse and limit is exported, and answers in C as in Python."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from exported import SPEC, make, needs_c, undefined_symbols

import dqcontrol
from dqcontrol.compiled.object_code import OF_C, target_named
from dqcontrol.export import export_controller
from dqcontrol.export.controller_folder import vector_header
from dqcontrol.export.controller_parts import controller_parts
from dqcontrol.extensions.registry import by_tag
from dqcontrol.laws import Law
from dqcontrol.laws.null_space import NullSpace
from dqcontrol.limits.position_limit import PositionLimit

H_INFINITY = {"orientation_gain": 4.0, "translation_gain": 3.0}
WEIGHTS = {"error_weight": 16.0, "control_weight": 1.0}
SECOND_ORDER = {"stiffness": 16.0, "damping": 4.0}
SCHEDULE = {"times": [0, 2], "values": [2, 5]}
K = {"kind": "proportional", "gain": 4}
WIDE = {  # bounds that P16's runs keep, which leave the robot's limits: u also holds the arm against gravity
    "velocity": 100.0,
    "acceleration": 1e4,
    "tracking_error": "100 rad",
    "overspeed": 100.0,
    "jump": 2.0,
    "measured_tolerance": "100 rad",
    "slow_below": 0.0,
    "hold_below": 0.0,
    "ramp": 0.0,
}
MOBILE = {
    "robot": "little-john",
    "start": [0, 0, 0, 0, -0.9, 0.9, 0.9, 0],
    "period": 0.05,
    "plant": {"kind": "integrator"},
    "supervisor": {"tracking_error": 3.0},
}
SET_POINT = {"kind": "set-point", "offset": {"translation": [0.1, 0.05, 0.0]}}
FAR = {"kind": "set-point", "offset": {"translation": [0, 0, -0.1], "rotation": [0, 0, 2.0]}}
DRIVE_TO = {"kind": "drive-to", "offset": {"translation": [0.5, 0.2, 0], "rotation": [0, 0, 0.5]}}
LAWS = {
    "proportional": K,
    "gain over time": {"kind": "proportional", "gain": SCHEDULE},
    "damped": K | {"inverse": {"kind": "damped", "damping": 0.05}},
    "filtered": K | {"inverse": {"kind": "filtered"}},
    "reduced-gradient": {"kind": "reduced-gradient", "gain": 4},
    "proportional-feedforward": {"kind": "proportional-feedforward", "gain": 4, "integral_gain": 1},
    "classic-proportional": {"kind": "classic-proportional", "gain": 4},
    "decoupled-proportional": {"kind": "decoupled-proportional", "gain": 4},
    "partial-proportional": {"kind": "partial-proportional", "gain": 4, "part": "axis"},
    "h-infinity": {"kind": "h-infinity", **H_INFINITY},
    "h-infinity, left": {"kind": "h-infinity", "form": "left", **H_INFINITY},
    "h-infinity-tracking": {"kind": "h-infinity-tracking", **H_INFINITY},
    "linear-quadratic-r8": {"kind": "linear-quadratic-r8", **WEIGHTS},
    "linear-quadratic-r8-euler": {"kind": "linear-quadratic-r8-euler", **WEIGHTS},
    "linear-quadratic-dq": {"kind": "linear-quadratic-dq", **WEIGHTS},
    "feedback-linearization": {"kind": "feedback-linearization", **SECOND_ORDER},
    "published-linearization": {"kind": "published-linearization", **SECOND_ORDER},
    "open-loop": {"kind": "open-loop"},
    "joint-motion": {"kind": "joint-motion", "file": "motion.csv", "gain": 2},
}
NULL_SPACES = {
    "posture": {"kind": "posture", "gain": 2, "rest": SPEC["start"]},
    "joint-centring": {"kind": "joint-centring", "gain": 2},
    "limit-avoidance": {"kind": "limit-avoidance", "gain": 2},
    "manipulability": {"kind": "manipulability", "gain": 2},
}
LIMITS = {
    "modified-clamping": {"velocity": True, "position": {"kind": "modified-clamping"}},
    "original-clamping": {"position": {"kind": "original-clamping"}},
    "weighted-least-norm": {"position": {"kind": "weighted-least-norm"}},
}
OF_BODIES = {
    "cascade": {"law": {"kind": "cascade", **SECOND_ORDER}, "reference": SET_POINT},
    "classic-whole-body": {"law": {"kind": "classic-whole-body", "gain": 2}, "reference": SET_POINT},
    "classic-cascade": {"law": {"kind": "classic-cascade", "gain": 2}, "reference": SET_POINT},
    "guided-proportional": {"law": {"kind": "guided-proportional", "gain": 1}, "reference": DRIVE_TO},
    "best-heading": {"law": K | {"null_space": {"kind": "best-heading"}}, "reference": SET_POINT},
}
EXAMPLES = Path(__file__).parents[2] / "examples"
KEEP_OUT = EXAMPLES / "keep-out.yaml"
SPECS = (
    {name: SPEC | {"law": law, "supervisor": False} for name, law in LAWS.items()}
    | {
        name: SPEC | {"law": K | {"null_space": one}, "supervisor": False}
        for name, one in NULL_SPACES.items()
    }
    | {name: SPEC | {"law": K, "limits": one, "supervisor": False} for name, one in LIMITS.items()}
    | {name: SPEC | MOBILE | {"duration": 4} | one for name, one in OF_BODIES.items()}
    | {
        f"{name}, far away": SPEC | {"law": LAWS[name], "reference": FAR, "supervisor": False}
        for name in ("proportional-feedforward", "h-infinity-tracking", "feedback-linearization")
    }
    | {"constraints": KEEP_OUT}
    | {"integrated clamping": SPEC | {"law": K, "limits": LIMITS["modified-clamping"]}}
)


def test_all_kinds_are_here():
    kinds = {**by_tag(Law), **by_tag(NullSpace), **by_tag(PositionLimit)}
    ours = {
        tag for tag, kind in kinds.items() if kind.__module__.startswith("dqcontrol")
    }  # not those of other tests
    assert ours - set(SPECS) <= {"own"}


@needs_c
@pytest.mark.slow
@pytest.mark.parametrize("name", SPECS)
def test_it_answers_as_in_python(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    q = np.array(SPEC["start"]) + np.linspace(0, 0.5, 50)[:, None]
    header = "time," + ",".join(f"q{i + 1}" for i in range(7))
    table = np.column_stack([0.02 * np.arange(50), q])
    np.savetxt("motion.csv", table, delimiter=",", header=header, comments="")
    done = export_controller(SPECS[name], tmp_path / "c")
    assert "largest difference to Python 0 (bits compared)" in make(done.folder, "test")
    assert undefined_symbols(done.folder / "dqc_code.o") <= OF_C


@needs_c
@pytest.mark.slow
@pytest.mark.parametrize("name", ["talos", "tray"])
def test_a_tree_answers_as_in_python(name, tmp_path):
    """Both hands of Talos and its posture behind a supervisor; two Pandas with a tray."""
    spec = EXAMPLES / f"{name}.yaml"
    data = yaml.safe_load(spec.read_text(encoding="utf-8")) | {"duration": 1, "supervisor": WIDE}
    data["plant"] = data.pop("plants", {}).get("servo", {"kind": "servo"})
    done = export_controller(data, tmp_path / "c")
    assert "largest difference to Python 0 (bits compared)" in make(done.folder, "test")


@needs_c
@pytest.mark.slow
def test_constraints_hold_in_c_as_in_python_with_a_supervisor_behind_them(tmp_path):
    """A ball comes onto the way of a Panda, after a start with faults, an emergency stop and a new start."""
    data = yaml.safe_load(KEEP_OUT.read_text(encoding="utf-8")) | {"supervisor": WIDE}
    done, parts = export_controller(data, tmp_path / "c"), controller_parts(data)
    text = vector_header(parts, target_named("native"), whole=True)
    (done.folder / "test_vector.h").write_text(text, encoding="utf-8")
    said = make(done.folder, "test")
    assert "largest difference to Python 0 (bits compared)" in said
    steps = re.search(r"(\d+) steps", said)
    assert steps
    assert int(steps[1]) > len(parts.samples)
    unconstrained = {key: value for key, value in data.items() if key != "constraints"}
    assert text != vector_header(controller_parts(unconstrained), target_named("native"), whole=True)


@needs_c
@pytest.mark.slow
@pytest.mark.parametrize("law", ["K", "K+FF", "LQR-R8", "LQR-DQ", "HIR", "HIRT"])
def test_a_published_study_with_faults_and_stops(law, tmp_path):
    """P16's spiral, 3000 steps after a start with faults, an emergency stop and a new start."""
    spec = Path(dqcontrol.__file__).parents[1] / "dqcontrol_theses/pereira2016/specs/spiral.yaml"
    data = yaml.safe_load(spec.read_text(encoding="utf-8")) | {"repeats": 1, "supervisor": WIDE}
    done, parts = (
        export_controller(data, tmp_path / "c", law=f"{law} · best"),
        controller_parts(data, f"{law} · best"),
    )
    (done.folder / "test_vector.h").write_text(
        vector_header(parts, target_named("native"), whole=True), encoding="utf-8"
    )
    said = make(done.folder, "test")
    assert "largest difference to Python 0 (bits compared)" in said
    steps = re.search(r"(\d+) steps", said)
    assert steps
    assert int(steps[1]) > 3000
