"""Controllers in C answer as Python does, to the last bit, know nothing of Python, and say what is wrong."""

import os
import shutil

import numpy as np
import pytest
from exported import HERE, SPEC, LibraryController, Target, make, needs_c, shell, undefined_symbols

import dqcontrol as dqc
from dqcontrol.compiled import object_code
from dqcontrol.compiled.object_code import OF_C, TARGETS, TargetProcessor
from dqcontrol.errors import Error, NoteWarning, ShapeError, UnknownNameError, ValueRangeError
from dqcontrol.export import export_controller
from dqcontrol.export.controller_parts import controller_parts
from dqcontrol.export.expected_answers import vector_rows
from dqcontrol.loop.control import Control
from dqcontrol.loop.targets import PoseTarget, Speeds, TwistTarget
from dqcontrol.robots.kinematics.driving import RIM_LEVER
from dqcontrol.supervisor.interventions import KEEP_OUT

START = np.array(SPEC["start"])
WALL = {"box": [0.2, 4, 1], "position": [0.6, 0, 0.5]}
WALLED = {
    "name": "walled",
    "robot": "little-john",
    "start": [0, 0, 0, 0, -0.9, 0.9, 0.9, 0],
    "period": 0.02,
    "reference": {"kind": "set-point", "offset": {"translation": [1.5, 0.0, 0.0]}},
    "duration": 6,
    "law": {"kind": "proportional", "gain": 2},
    "plant": {"kind": "integrator"},
    "supervisor": {"acceleration": 1.0, "keep_out": {"footprint": 0.15}},
    "world": {"wall": WALL},
}
OUTSIDE_LIMITS = -5
POSE, TWIST = 1, 2  # sources of targets, as dqc_controller.h has them


@pytest.fixture(scope="module")
def walled_folder(tmp_path_factory):
    """What the spec of a base before a wall was exported to."""
    return export_controller(WALLED, tmp_path_factory.mktemp("walled") / "c").folder


@needs_c
def test_the_library_answers_as_python_does_to_the_last_bit(exported_folder):
    said = make(exported_folder, "test")
    assert "largest difference to Python 0 (bits compared)" in said
    assert "passed" in said


@needs_c
def test_it_asks_only_for_what_c_has(exported_folder):
    make(exported_folder)
    code = undefined_symbols(exported_folder / "dqc_code.o")
    assert code <= OF_C
    whole = undefined_symbols(exported_folder / "libdqc_controller.a")
    assert {name for name in whole if not name.startswith("dqc_")} <= OF_C | {
        "_GLOBAL_OFFSET_TABLE_",
        "strcmp",
    }


@needs_c
@pytest.mark.parametrize("source", [POSE, TWIST])
def test_streamed_targets_move_as_those_of_ros_2(exported_folder, source):
    make(exported_folder)
    parts = controller_parts(SPEC)
    assert parts.supervisor
    arm, period = parts.robot, parts.period
    target = PoseTarget(Speeds()) if source == POSE else TwistTarget(Speeds())
    control = Control(parts.law, target, parts.supervisor[1])
    library, q = LibraryController(exported_folder, source), START.copy()
    control.activate(q)
    goal = arm.fkm(START + 0.2)
    asked = Target()
    asked.position[:] = dqc.algebra.translation(goal)
    asked.rotation[:] = goal[:4]
    asked.linear[:], asked.angular[:], asked.of_hand = [0.1, 0.05, -0.3], [0.2, 0.1, 0.4], 1
    far = 0.0
    for k in range(150):
        new = k in (2, 10, 60)
        if new and source == POSE:
            target.goal = goal
        u = library.step(q, k * period, asked if new else None)
        if new and source == TWIST:  # the time of the reference is that of the step before
            target.ask(control.time, np.array(asked.linear), np.array(asked.angular), of_hand=True)
        control.step(k * period, q, 0.0, 0.0)
        far = max(far, np.abs(u - control.command).max())
        q += period * u
    assert library.status == 0
    assert far < 1e-12
    assert np.abs(q - START).max() > 0.01
    asked.rotation[:], asked.linear[0] = [2, 0, 0, 0], np.nan
    library.step(q, 150 * period, asked)
    assert library.status == -7  # wrong target, ignored


STOPPED, WRONG_TARGET, MOVING = 2, -7, -10


@needs_c
def test_a_refused_target_does_not_hide_a_stop(exported_folder):
    make(exported_folder)
    library, q, refused = LibraryController(exported_folder, POSE), START.copy(), Target()
    library.step(q, 0.0, refused)
    assert library.status == WRONG_TARGET  # no rotation has the norm 0
    library.stop()
    for k in range(1, 100):
        q += 0.01 * library.step(q, 0.01 * k, refused)
        if library.status == STOPPED:
            break
    assert library.status == STOPPED
    library.step(q, 0.01 * (k + 1), refused)
    assert library.status == STOPPED


@needs_c
def test_one_that_moves_is_not_made_ready_again(exported_folder):
    """Else its next command would be that of a robot at rest: a step."""
    make(exported_folder)
    library, q = LibraryController(exported_folder), START.copy()
    assert library.init() == 0  # before it moves
    for k in range(60):
        u = library.step(q, 0.01 * k)
        q += 0.01 * u
    assert np.abs(u).max() > 0.01
    assert library.init() == MOVING
    after = library.step(q, 0.6)
    assert np.abs(after - u).max() < 0.01
    library.stop()
    for k in range(61, 200):
        q += 0.01 * library.step(q, 0.01 * k)
    assert library.status == STOPPED
    assert library.init() == 0


@needs_c
@pytest.mark.parametrize("stuck_at", [0, 30])
def test_a_clock_that_stands_still_stops_with_a_name(exported_folder, stuck_at):
    make(exported_folder)
    parts = controller_parts(SPEC)
    assert parts.supervisor
    control = Control(parts.law, parts.target(), parts.supervisor[1])
    library, q, before = LibraryController(exported_folder), START.copy(), np.zeros(7)
    control.activate(q)
    for k in range(80):
        time = parts.period * min(k, stuck_at)
        u = library.step(q, time)
        control.step(time, q, 0.0, 0.0)
        np.testing.assert_array_equal(u, control.command)
        assert np.abs(u - before).max() <= 0.1 + 1e-9  # it brakes as any stop does: 10 rad/s²
        q, before = q + parts.period * u, u
        if library.status == STOPPED:
            break
    assert library.status == STOPPED
    assert control.stop == "stop category 2: clock stands still"
    assert k < stuck_at + 15  # 50 ms, and what it takes to brake


@pytest.mark.slow
@needs_c
def test_a_base_keeps_out_of_zones_in_c_and_starts_in_none(walled_folder):
    """It brakes before a wall as in Python; a start in the wall is refused by both, and one beside it is not."""
    parts = controller_parts(WALLED)
    rows = list(vector_rows(parts))
    assert any(row.interventions & KEEP_OUT for row in rows)
    assert "largest difference to Python 0 (bits compared)" in make(walled_folder, "test")
    assert parts.supervisor
    library, supervisor = LibraryController(walled_folder), parts.supervisor[1]
    for x in (0.36, 0.6):  # the wall begins at 0.5 m, the footprint is 0.15 m
        inside = np.array([x, *WALLED["start"][1:]])
        u = library.step(inside, 0.0)
        assert library.status == OUTSIDE_LIMITS
        assert not u.any()
        with pytest.raises(ValueRangeError, match="the base starts at"):
            supervisor.start(inside)
    beside = np.array([0.34, *WALLED["start"][1:]])
    supervisor.start(beside)
    library.step(beside, 0.0)
    assert library.status == 0


@needs_c
def test_parameters_change_what_the_spec_would_change(exported_folder):
    make(exported_folder)
    changed = {"law": SPEC["law"] | {"gain": 2.5}, "supervisor": {"acceleration": 3.0}}
    parts = controller_parts(SPEC | changed)
    assert parts.supervisor
    control = Control(parts.law, parts.target(), parts.supervisor[1])
    library, q = LibraryController(exported_folder), START.copy()
    assert library.set("law.gain", 2.5) == 0
    for joint in parts.robot.joint_names:
        assert library.set(f"supervisor.acceleration.{joint}", 3.0) == 0
    control.activate(q)
    for k in range(50):
        u = library.step(q, k * parts.period)
        control.step(k * parts.period, q, 0.0, 0.0)
        np.testing.assert_array_equal(u, control.command)
        q += parts.period * u
    assert library.set("supervisor.acceleration.joint_1", 2.0) == -10  # while it moves
    assert library.set("law.gain", 3.0) == 0
    assert library.set("law.gain", 101.0) == -9  # beyond 1/T
    assert library.reset() == -10


@needs_c
@pytest.mark.slow
def test_hosts_compile_against_doubles_of_their_headers(exported_folder, tmp_path):
    make(exported_folder, "all", "hosts")
    library, doubles = exported_folder / "libdqc_controller.a", HERE / "doubles"
    flags = ["-std=c++17", "-Wall", "-Wextra", f"-I{exported_folder}", f"-I{doubles}"]
    hosts = exported_folder / "hosts"
    controller = hosts / "ros2_control/dqc_ros2_controller.cpp"
    shell("g++", *flags, controller, HERE / "ros2_control_main.cpp", library, "-lm", "-o", tmp_path / "ros2")
    assert "at the end" in shell(tmp_path / "ros2")
    shell("g++", *flags, "-fsyntax-only", hosts / "libfranka/franka_velocity.cpp")


@needs_c
@pytest.mark.parametrize("steps", [20_000, pytest.param(1_000_000, marks=pytest.mark.slow)])
def test_whatever_comes_in_the_limits_are_kept(exported_folder, tmp_path, steps):
    make(exported_folder)
    library = exported_folder / "libdqc_controller.a"
    shell(
        "cc", "-std=gnu99", f"-I{exported_folder}", HERE / "fuzz.c", library, "-lm", "-o", tmp_path / "fuzz"
    )
    assert " 0 outside the limits or not finite" in shell(tmp_path / "fuzz", steps, 20261122)


@needs_c
@pytest.mark.slow
def test_whatever_comes_in_a_base_keeps_its_limits_its_rims_and_out_of_its_zone(walled_folder, tmp_path):
    """Bad measurements of the base do not bring its footprint (0.15 m) into the wall at 0.5 m."""
    make(walled_folder, "all", "dqc_plant.o")
    supervisor = controller_parts(WALLED).supervisor
    assert supervisor
    bounds = supervisor[1].bounds
    rows = {"VELOCITY": bounds.velocity, "ACCELERATION": bounds.acceleration}
    flags = [f"-D{name}={{{','.join(map(repr, row.tolist()))}}}" for name, row in rows.items()]
    flags += [f"-DLEVER={bounds.drives[0, RIM_LEVER]}", f"-DWALL={0.5 - 0.15 + 1e-6}", f"-I{walled_folder}"]
    sources = HERE / "fuzz.c", *walled_folder.glob("dqc_plant*.o"), walled_folder / "libdqc_controller.a"
    shell("cc", "-std=gnu99", *flags, *sources, "-lm", "-o", tmp_path / "fuzz")
    said = shell(tmp_path / "fuzz", 200_000, 20261124)
    print(said)  # the seed
    assert " 0 outside the limits or not finite" in said


@needs_c
@pytest.mark.slow
def test_sanitizers_find_nothing(exported_folder, tmp_path):
    folder = tmp_path / "c"
    shutil.copytree(exported_folder, folder)
    make(folder, "clean")
    said = make(folder, "test", "SANITIZE=-g -fsanitize=address,undefined -fno-sanitize-recover=all")
    assert "passed" in said


@pytest.mark.slow
@pytest.mark.parametrize("target", [name for name in TARGETS if name != "native"])
def test_other_processors_answer_nearly_so(target, tmp_path):
    processor = TARGETS[target]
    done = export_controller(SPEC, tmp_path / "c", target=target)
    assert (done.folder / "dqc_code.o").read_bytes()[:4] == b"\x7fELF"
    if not shutil.which(processor.compiler):
        pytest.skip(f"exported; to build it: apt-get install {processor.compiler}")
    runner = processor.runner.split()[:1]
    if runner and not shutil.which(runner[0]):
        pytest.skip("exported; to run it: apt-get install qemu-user")
    if target == "x86-64-v3" and "avx2" not in _flags_of_processor():
        pytest.skip("exported; this processor does not run it")
    said = make(done.folder, "test")
    assert ("nothing here runs" in said) if processor.is_bare else ("passed" in said)


def _flags_of_processor():
    path = "/proc/cpuinfo"
    return open(path).read() if os.path.exists(path) else ""


OWN_LAWS = """
import numpy as np


def transpose(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    for i in range(out.shape[0]):
        out[i] = 0.0
        for k in range(8):
            out[i] += parameters[0] * pose_jacobian[k, i] * (sample[k] - pose[k])


def with_arrays(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    error = np.zeros(8)
    for k in range(8):
        error[k] = sample[k] - pose[k]
    for i in range(out.shape[0]):
        out[i] = error[1]
"""
RAISING_LAW = """

def raising(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    out[:] = 0.1
    if sample[20] > 0.5:
        raise ValueError("stop")
"""
OWN = SPEC | {
    "law": {"kind": "own", "function": "laws.py:transpose", "parameters": [2.0], "scratch": 16},
    "supervisor": False,
}


@pytest.fixture
def own_laws(tmp_path, monkeypatch):
    (tmp_path / "laws.py").write_text(OWN_LAWS, encoding="utf-8")
    monkeypatch.chdir(tmp_path)


@needs_c
@pytest.mark.slow
def test_own_laws_are_exported(own_laws, tmp_path):
    said = make(export_controller(OWN, tmp_path / "c").folder, "test")
    assert "largest difference to Python 0 (bits compared)" in said


@pytest.mark.slow  # compiles the law three times
def test_own_laws_that_need_python_are_refused_with_the_line(own_laws, tmp_path):
    spec = OWN | {"law": OWN["law"] | {"function": "laws.py:with_arrays"}}
    message = r"laws.py:13: 'error = np.zeros\(8\)' needs NRT_\w+, which only Python has: write loops"
    with pytest.raises(Error, match=message):
        export_controller(spec, tmp_path / "c")
    assert not (tmp_path / "c").exists()


def test_own_laws_that_raise_are_refused_with_the_line(own_laws, tmp_path):
    """C knows no exceptions: such a law would drive on with what it wrote before."""
    (tmp_path / "laws.py").write_text(RAISING_LAW, encoding="utf-8")
    spec = OWN | {"law": OWN["law"] | {"function": "laws.py:raising"}}
    message = r"laws.py:6: 'raise ValueError\(\"stop\"\)' raises, which C does not; write NaN into 'out'"
    with pytest.raises(Error, match=message):
        export_controller(spec, tmp_path / "c")
    assert not (tmp_path / "c").exists()


LAWS = {"K": {"kind": "proportional", "gain": 4}, "K+FF": SPEC["law"]}


@pytest.mark.parametrize(
    ("change", "options", "error", "message"),  # messages hold regular expressions
    [
        (
            {"law": ..., "laws": LAWS},
            {},
            ShapeError,
            "circle describes 2 controllers; choose one with --law: 'K', 'K",
        ),
        (
            {"law": ..., "laws": LAWS},
            {"law": "KFF"},
            UnknownNameError,
            r"law: unknown name 'KFF'; did you mean 'K\+FF'",
        ),
        (
            {},
            {"target": "cortex-m5"},
            UnknownNameError,
            "target: unknown name 'cortex-m5'; did you mean 'cortex-m7'",
        ),
        (
            {},
            {"target": "xtensa"},
            Error,
            "target: xtensa: LLVM [0-9.]+ as llvmlite brings it makes no code for it",
        ),
    ],
)
def test_what_cannot_be_exported_is_said_in_a_line(change, options, error, message, tmp_path, monkeypatch):
    monkeypatch.setitem(TARGETS, "xtensa", TargetProcessor("xtensa", "xtensa"))
    spec = {key: value for key, value in (SPEC | change).items() if value is not ...}
    with pytest.raises(error, match=message):
        export_controller(spec, tmp_path / "c", **options)
    assert not (tmp_path / "c").exists()


def test_a_table_too_large_for_a_microcontroller_is_refused(tmp_path, monkeypatch):
    empty = object_code.constants_object({}, TARGETS["cortex-m7"])
    monkeypatch.setattr("dqcontrol.export.controller_folder.code_object", lambda *_: empty)
    slow = SPEC["reference"] | {
        "jerk_limits": {"velocity": 0.01, "acceleration": 0.1, "jerk": 1.0},
        "repeat": 3,
    }
    message = "^target: cortex-m7: code and constants: .* kB, at most 1,024 kB; the reference alone takes"
    with pytest.raises(Error, match=message):
        export_controller(SPEC | {"reference": slow, "duration": 90}, tmp_path / "c", target="cortex-m7")


def test_what_belongs_to_simulation_is_left_out_with_a_note():
    with pytest.warns(
        NoteWarning, match="^stop: belongs to simulation; the controller is exported without it"
    ):
        controller_parts(SPEC | {"stop": {"error": 1e-3, "samples": 5}})
