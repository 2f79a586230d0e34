"""What `check` says of specs, and the warnings before runs."""

import copy
import math
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import FileFormatError, StabilityWarning, UnknownNameError
from dqcontrol.experiments import check
from dqcontrol.experiments.check import Checks, Loop, LoopCheck
from dqcontrol.experiments.prepared_experiment import Names
from dqcontrol.measures.stability import LoopGain, gain_limits
from dqcontrol.plants import Integrator

ROOT = Path(__file__).parents[2]
BASE = {
    "name": "rest",
    "robot": "iiwa7",
    "start": [0.2, 0.6, 0.1, 1.6, -0.3, 0.9, 0.4],
    "period": 0.01,
    "reference": {"kind": "set-point", "duration": 3, "offset": {"translation": [0, 0, 1e-3]}},
    "law": {"kind": "proportional", "gain": 10},
    "plant": {"kind": "servo"},
}


def spec(**changes):
    """Return the base spec with other keys; None takes one out."""
    data = copy.deepcopy(BASE) | changes
    return {key: value for key, value in data.items() if value is not None}


def only(**changes):
    (row,) = check(spec(**changes))
    return row


def test_one_row_a_law_set_and_plant():
    checks = check(
        spec(
            law=None,
            laws={"K": {"kind": "proportional", "gain": 10}, "open": {"kind": "open-loop"}},
            parameter_sets={"slow": {"K": {"gain": 1}}, "fast": {"K": {}, "open": {}}},
            plant=None,
            plants={"ideal": {"kind": "integrator"}, "late": {"kind": "servo", "delay": 0.03}},
        )
    )
    assert [row.names.label for row in checks] == [
        f"{law} · {plant}" for plant in ("ideal", "late") for law in ("K · slow", "K · fast", "open · fast")
    ]
    table = checks.table()
    assert [column.heading for column in table.columns] == [
        "law",
        "set",
        "plant",
        "verdict",
        "margin",
        "largest recommended k [1/s]",
        "limit [1/s]",
        "k position [1/s]",
        "k orientation [1/s]",
        "T [ms]",
        "overshoot [%]",
        "time constant [s]",
    ]
    assert table.texts()[1] == [
        *("K", "fast", "ideal", "good", "20", "100", "200", "10", "10", "10", "0"),
        f"{-0.01 / math.log(0.9):.3g}",
    ]
    assert table.texts()[2][3:] == ["drifts", "–", "100", "200", "0", "0", "10", "–", "–"]
    assert len(checks) == 6
    assert not checks.unstable


@pytest.mark.parametrize(
    ("law", "position", "orientation"),
    [
        ({"kind": "h-infinity", "translation_gain": 3, "orientation_gain": 8}, 3, 4),
        ({"kind": "partial-proportional", "part": "axis", "gain": 5}, None, 5),
        ({"kind": "linear-quadratic-dq", "error_weight": 16, "control_weight": 1}, 4, 4),
        ({"kind": "decoupled-proportional", "gain": [1, 2, 3, 4, 5, 6, 7, 9]}, 4, 9),
    ],
    ids=["HIR", "axis", "LQR-DQ", "decoupled"],
)
def test_gains_of_position_and_orientation(law, position, orientation):
    row = only(law=law)
    gains = {loop.gain.loop: loop.gain.value.real for loop in row.loops}
    assert gains.get("position") == pytest.approx(position)
    assert gains.get("orientation") == pytest.approx(orientation)
    assert row.worst.product == pytest.approx(0.01 * max(filter(None, (position, orientation))))


@pytest.mark.parametrize(
    "plant",
    [
        {"kind": "integrator"},
        {"kind": "servo", "time_constant": 0.02},
        {"kind": "servo", "delay": 0.05},
        {"kind": "servo", "command_mode": "measured"},
        {"kind": "mujoco"},
    ],
    ids=str,
)
def test_time_constant_is_that_of_the_run(plant):
    if plant["kind"] == "mujoco":
        pytest.importorskip("mujoco")
    law = {"kind": "proportional", "gain": 3}
    row = only(law=law, plant=plant)
    error = dqc.run(spec(law=law, plant=plant)).error
    late, later = 150, 250
    assert row.verdict == "good"
    assert row.time_constant == pytest.approx(
        0.01 * (later - late) / np.log(error[late] / error[later]), rel=0.02
    )


def test_verdicts_and_what_to_do():
    cases = [
        ({"gain": 3}, "good", None),
        ({"gain": 9}, "good", None),  # damped well
        (
            {"gain": 20},
            "oscillatory",
            r"^proportional · servo: position oscillatory: k = 20 1/s, limit 2007 1/s, overshoot 16 %; "
            r"largest recommended k = 10.2 1/s$",
        ),
        (
            {"gain": 2100},
            "unstable",
            r"^proportional · servo: position unstable: k = 2100 1/s, limit 2007 1/s; "
            r"largest recommended k = 10.2 1/s$",
        ),
    ]
    for change, verdict, remark in cases:
        checks = check(spec(law=BASE["law"] | change))
        assert checks[0].verdict == verdict
        assert checks.unstable == (verdict == "unstable")
        if remark is None:
            assert not list(checks.remarks())
        else:
            assert re.match(remark, next(checks.remarks()))
        assert (checks[0].time_constant == math.inf) == (verdict == "unstable")


def test_a_schedule_is_judged_where_it_is_largest():
    gain = {"times": [0.5, 1.5, 2.5], "values": [10, 300, 20]}
    row = only(law={"kind": "proportional", "gain": gain}, plant={"kind": "integrator"})
    assert row.worst.gain.time == pytest.approx(1.5)
    assert row.worst.gain.value == pytest.approx(300)
    assert "k = 300 1/s at 1.5 s, limit 200 1/s;" in row.remark
    later = {"kind": "linear-quadratic-dq", "error_weight": 1, "control_weight": 1, "final_weight": 250}
    row = only(law=later | {"horizon_time": 2.0}, plant={"kind": "integrator"})
    assert row.worst.gain.time == pytest.approx(2.0), "a gain of s/r at the end"
    assert row.verdict == "unstable"


def test_posture_is_a_loop_of_its_own():
    law = {"kind": "proportional", "gain": 5, "null_space": {"kind": "posture", "gain": 210}}
    row = only(law=law, plant={"kind": "integrator"})
    assert row.remark.startswith(
        "proportional · integrator: null space unstable: k = 210 1/s, limit 200 1/s;"
    )
    six = {"robot": "ur5", "start": [0, -1.2, 1.5, -0.5, 1.5, 0.3]}
    assert only(law=law, plant={"kind": "integrator"}, **six).verdict == "good", "nothing is left free"
    partial = {"kind": "partial-proportional", "part": "position", "gain": 5}
    partial["null_space"] = law["null_space"]
    assert only(law=partial, plant={"kind": "integrator"}, **six).verdict == "unstable"
    law["null_space"] = {"kind": "joint-centring", "gain": 300}
    row = only(law=law, plant={"kind": "integrator"})
    half = dqc.load_robot("iiwa7").limits.upper.min()
    assert row.worst.gain.value == pytest.approx(2 * 300 / (7 * half**2))
    law["null_space"] = {"kind": "manipulability", "gain": 1000}
    assert only(law=law, plant={"kind": "integrator"}).verdict == "good", "not judged"


def test_laws_of_accelerations():
    """k = k̄/(4 k_v): limits of the stiffness and of the damping, advice with ζ = k_v/√k̄ = 0.7, a mobile robot."""
    law = {"kind": "feedback-linearization", "stiffness": 4.0, "damping": 2.0}
    fine = only(law=law, plant={"kind": "integrator"})
    assert (fine.worst.gain.value, fine.remark) == (0.5, "")
    assert fine.verdict == "good"
    limit = (4 - 2 * 2 * 0.01) * 4 / 0.01**2
    stiff = only(law=law | {"stiffness": 1.1 * limit}, plant={"kind": "integrator"})
    assert stiff.verdict == "unstable"
    advised = re.search(r"k = 2178\d 1/s, limit 19800 1/s; choose k̄ ≤ (.*) 1/s²$", stiff.remark)
    assert advised
    assert float(advised[1]) == pytest.approx((2 / 0.7) ** 2, rel=0.02)
    hard = only(law=law | {"damping": 250}, plant={"kind": "integrator"})
    assert hard.verdict == "unstable"
    assert hard.remark.endswith("unstable: k_v = 250 1/s, limit 200 1/s")
    body = {"robot": "little-john", "start": [0, 0, 0, 0, -0.9, 0.9, 0.9, 0]}
    assert only(law=law, plant={"kind": "integrator"}, **body).verdict == "good"


def test_what_cannot_be_decided():
    row = only(plant={"kind": "servo", "delay": "2 s"})
    assert row.verdict == "cannot be decided"
    assert row.remark.endswith("plant and supervisor have a model of 202 states; 200 at most are judged")
    checks = check(spec(plant={"kind": "servo", "delay": "2 s"}))
    assert not checks.unstable
    assert checks.table().texts()[0][2:] == ["cannot be decided", *"–––––", "10", *"––"]


def test_rates_that_turn_have_a_limit_of_their_own():
    """Weights far from diagonal may turn errors; the check finds each direction's own limit."""
    rng = np.random.default_rng(20260801)
    root = rng.normal(size=(8, 8))
    law = {
        "kind": "linear-quadratic-r8",
        "error_weight": (root @ root.T + 0.1 * np.eye(8)).tolist(),
        "control_weight": np.exp(rng.normal(size=8)).tolist(),
    }
    row = only(law=law, plant={"kind": "integrator"})
    for loop in row.loops:
        way = loop.gain.value / abs(loop.gain.value)
        assert loop.limits.stable == pytest.approx(2 * way.real, rel=1e-6)


@pytest.mark.parametrize("call", [dqc.run, dqc.run_study], ids=["run", "run_study"])
def test_runs_warn_before_they_are_unstable(call):
    fast = spec(law={"kind": "proportional", "gain": 210}, plant={"kind": "integrator"}, duration=0.1)
    with pytest.warns(
        StabilityWarning, match=r"^proportional · integrator: position unstable: k = 210 1/s, "
    ) as seen:
        call(fast)
    assert Path(seen[0].filename).name == Path(__file__).name, "it points at who called"
    assert len([warning for warning in seen if warning.category is StabilityWarning]) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error", StabilityWarning)
        call(spec(plant={"kind": "integrator"}, duration=0.1))
        check(fast)


def test_a_study_warns_once():
    many = spec(law=None, plant={"kind": "integrator"}, duration=0.1)
    many["laws"] = {f"K{gain}": {"kind": "proportional", "gain": gain} for gain in (10, 210, 220, 230)}
    with pytest.warns(
        StabilityWarning, match=r"^K210 · .*\(and 2 more: dqcontrol check lists them\)$"
    ) as seen:
        dqc.run_study(many)
    assert len([warning for warning in seen if warning.category is StabilityWarning]) == 1


def test_everything_else_is_checked_as_before_a_run(tmp_path):
    with pytest.raises(UnknownNameError, match="iiwa8"):
        check(spec(robot="iiwa8"))
    with pytest.raises(FileFormatError, match="missing"):
        check(spec(period=None))
    with pytest.raises(dqc.Error, match="out of reach"):
        check(spec(reference={"kind": "circle", "radius": 3.0, "duration": 2}))
    with pytest.raises(FileFormatError, match=r"nowhere.yaml"):
        check(tmp_path / "nowhere.yaml")


def test_table_in_the_document_is_the_example_s():
    pytest.importorskip("mujoco")
    text = (ROOT / "docs/sampling-limits.md").read_text(encoding="utf-8")
    shown = text.partition("<!-- limits table: begin -->")[2].partition("<!--")[0].strip().splitlines()
    table = check(ROOT / "examples/sampling-limits.yaml").table()
    for line, cells in zip(shown[2:], table.texts(), strict=True):
        for written, cell in zip(line.strip("| ").split("|"), cells, strict=True):
            if re.fullmatch(r"[\d.e+]+", cell):
                assert float(written) == pytest.approx(float(cell), rel=0.02)
            else:
                assert written.strip() == cell


def test_no_advice_where_no_gain_is_good():
    """Errors of complex gains turn as they shrink: ``largest recommended k = 0`` would be no advice."""
    turning = LoopGain("position", 50 * np.exp(1.2j), None)
    limits = gain_limits(Integrator().linear_model(dqc.load_robot("iiwa7"), None, 0.01), 0.01, np.exp(1.2j))
    assert limits.recommended == 0
    model = Integrator().linear_model(dqc.load_robot("iiwa7"), None, 0.01)
    row = LoopCheck(Names("", "LQR", "", "ideal"), 0.01, (Loop(turning, limits, model, 0.01),))
    assert row.verdict == "oscillatory"
    assert "≤ 0" not in row.remark
    assert "no gain makes it good" in row.remark
    assert Checks("turning", (row,)).table().texts()[0][-4] == "–"


def test_a_supervisor_is_part_of_the_loop_and_says_for_which_errors_it_holds():
    """The mean of 20 rates makes a stable loop unstable; the limit of acceleration one with large errors."""
    law = {"kind": "proportional", "gain": 20}
    assert only(law=law).verdict == "oscillatory"
    assert only(law=law, supervisor={"acceleration": 10, "jerk": 100}).verdict == "unstable"
    large = only(law={"kind": "proportional", "gain": 50}, supervisor={})
    assert large.verdict == "unstable for large errors"
    assert "beyond errors of about 0.004 rad" in large.remark
    fine = only(law={"kind": "proportional", "gain": 5}, supervisor={})
    assert fine.verdict == "good"
    assert "valid for errors up to about 0.4 rad" in fine.remark


@pytest.mark.slow
def test_the_first_command_is_held_against_the_velocity_limits():
    far = BASE["reference"] | {"offset": {"translation": [0, 0, -0.3]}}
    first = [text for text in check(spec(reference=far)).remarks() if "first command" in text]
    assert re.match(
        r"proportional · servo: its first command is \d+ % of joint_\d's velocity limit; commands are",
        first[0],
    )
    free = check(spec(reference=far, plant={"kind": "integrator"})).remarks()
    assert "limits: {velocity: true} scales commands to it" in list(free)[-1]


def test_how_far_a_base_rolls_without_measurements_is_said_where_somebody_lets_it():
    """0.5 m/s for 0.3 s, and 0.5²/(2 · 2.5) m while it brakes."""
    base = {"robot": "little-john", "start": [0, 0, 0, 0, -0.9, 0.9, 0.9, 0]}
    base |= {"reference": {"kind": "set-point", "duration": 1.0}, "plant": {"kind": "integrator"}}
    found = [
        check(spec(**base, supervisor={"acceleration": 2.5, **more})) for more in ({}, {"stale_after": 0.3})
    ]
    rolls = [[text for text in each.remarks() if "rolls" in text] for each in found]
    assert not rolls[0]
    assert rolls[1][0].startswith("proportional · integrator: the base rolls up to about 0.2 m before")


def test_a_spec_with_a_block_of_tune_or_learn_is_checked_without_it():
    plain = check(spec())
    for block in ({"tune": {"budget": 5}}, {"learn": {"repeats": 2}}):
        assert [repr(each) for each in check({**spec(), **block})] == [repr(each) for each in plain]
    with pytest.raises(FileFormatError, match="sweep: describes a parameter study; run it with"):
        check({**spec(), "sweep": {}})


def test_frequency_is_a_period():
    fast = spec(period="125 Hz")
    assert [each.period for each in check(fast)] == [0.008]
    with pytest.raises(FileFormatError, match=r"period: expected a number in s, got '0 Hz'"):
        check(spec(period="0 Hz"))
    with pytest.raises(FileFormatError, match=r"duration: expected a number in s, got '5 Hz'"):
        check(spec(duration="5 Hz"))
