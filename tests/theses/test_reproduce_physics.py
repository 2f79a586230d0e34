"""Published experiments on the compliant arm: which plant runs, the fit, predictions, faults."""

from pathlib import Path

import numpy as np
import pytest

import dqcontrol as dqc
import dqcontrol_theses as published
from dqcontrol.errors import SafetyWarning, UnknownNameError
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.experiments.run import execute, measure
from dqcontrol.plants import CompliantPlant
from dqcontrol_theses import pereira2016
from dqcontrol_theses.pereira2016.calibration import calibrate
from dqcontrol_theses.pereira2016.gain_x100 import with_gain_x100
from dqcontrol_theses.pereira2016.own_periods import late_record, stretch
from dqcontrol_theses.pereira2016.pereira2016_catalogue import (
    EXPERIMENTS,
    PHYSICS,
    SERVO,
    drawing_specs,
    drawings,
    published_spec,
)
from dqcontrol_theses.pereira2016.pereira2016_figures import lamp_on
from dqcontrol_theses.pereira2016.verdicts import Evidence, judge
from dqcontrol_theses.results import Results, command_table

pytest.importorskip("mujoco")

SPECS = sorted({name for each in EXPERIMENTS.values() for name in each.specs.values()})


@pytest.mark.parametrize("name", SPECS)
def test_the_meka_is_compliant_and_the_iiwa_stays_simulated(name):
    on_servos, in_physics = published_spec(name, SERVO), published_spec(name, PHYSICS)
    if name.startswith("iiwa"):
        assert in_physics == on_servos
        return
    plant = prepare(in_physics).cases[0].plant
    assert isinstance(plant, CompliantPlant)
    assert (plant.mode, plant.command_mode, plant.hand) == ("THETA_GC", "measured", True)
    assert (plant.exchange_period, plant.stiffness) == (0.01, 0.7 if name.startswith("meka-") else 1)
    del on_servos["plant"], in_physics["plant"]
    assert in_physics == on_servos


def test_a_law_runs_at_the_mean_period_that_was_printed_sample_by_sample():
    data = published_spec("spiral", PHYSICS)
    data["reference"]["duration"] = 1.0
    setting = prepare(data | {"laws": {"K": data["laws"]["K"]}, "parameter_sets": {"best": {"K": {}}}})
    (case,) = setting.cases
    usual, late = (late_record(setting, case, factor) for factor in (1.0, stretch("LQR-R8", 0.008)))
    np.testing.assert_array_equal(usual.measured, execute(setting, case).measured)
    assert len(late) == len(usual)
    assert set(np.rint(1e3 * np.diff(late.time))) == {8, 9}
    assert np.diff(late.time).mean() == pytest.approx(0.008239, rel=1e-3)
    assert np.abs(late.measured - usual.measured).max() > 1e-4  # out of step with the exchange at 100 Hz


def test_what_was_done_on_the_arm_runs_in_physics_unless_told():
    """All of it: the iiwa alone was simulated, and its specs keep their servos."""
    for name in EXPERIMENTS:
        assert published.chosen_plant(f"pereira2016/{name}", None) == PHYSICS
        assert published.chosen_plant(f"pereira2016/{name}", SERVO) == SERVO


@pytest.mark.parametrize(
    "name", ["house", *(pytest.param(each, marks=pytest.mark.slow) for each in drawings() if each != "house")]
)
def test_the_lamp_is_on_once_the_arm_has_stopped_swinging(name):
    setting = prepare(drawing_specs(PHYSICS)[name])
    record = execute(setting, setting.cases[0])
    assert measure(record, setting.scene.robot, 0.0, "true").limit_margin > 0.35
    lit = lamp_on(record)
    speed = np.linalg.norm(np.diff(record.position, axis=0), axis=1) / setting.spec.period
    first = int(lit.argmax())
    assert speed[:first].max() > 0.1  # the arm swings from its start
    assert speed[first : first + 100].max() < 0.04  # it shakes with its base
    assert lit[first:].all()
    assert record.position_error[lit].max() < 0.03
    assert np.std(record.position_error[lit]) < (
        0.004 if name == "house" else 0.006
    )  # no zigzag: the drawing as a whole hangs lower


def test_specs_of_other_plants_are_refused_and_files_found_from_anywhere():
    with pytest.raises(
        UnknownNameError, match=r"^plant: unknown name 'meka-physic'.*did you mean 'meka-physics'"
    ):
        published.reproduce("lqr", plant="meka-physic")
    assert Path(published_spec("light-painting", PHYSICS)["reference"]["file"]).is_absolute()


def test_further_runs_take_the_same_plant():
    chosen = published_spec("spiral", PHYSICS)["plant"]
    setting = Evidence(Results({}), {}, plant=PHYSICS).changed("circle", ("K",), period=0.008)
    assert setting.cases[0].plant.gravity_factor == chosen["gravity_factor"]
    assert Evidence(Results({}), {}, SERVO).changed("circle", ("K",)).cases[0].plant.sag == 0.69


def test_the_mean_of_t_u_is_the_printed_integral_over_the_duration_in_periods():
    cells = [cell for cell in pereira2016.published_cells("spiral") if (cell.law, cell.set) == ("K", "best")]
    rows = [{"law": "K", "set": "best", "stopped": "duration", "control.integral": 300.0}]
    setting = prepare(published_spec("spiral"))
    (row,) = command_table(cells, Results({"": rows}), {"": setting}).rows
    assert row[3:] == pytest.approx([0.008 * 342.94 / 23.992, 0.008 * 300.0 / 23.992])
    printed = [cell for cell in pereira2016.published_cells("circle-and-square") if cell.law == "K"]
    (cell,) = [each for each in printed if (each.experiment, each.metric) == ("meka circle", "control")]
    ours = Results({"meka circle": rows}, control_unit=0.025)  # here T u is what was printed
    (row,) = command_table([cell], ours, {"meka circle": prepare(published_spec("meka-circle"))}).rows
    assert row[3:] == pytest.approx([5.198 / 37.475, 0.025 * 300.0 / 37.475])


def run_of(name, law, label):
    spec = published_spec(name, PHYSICS)
    parameters = spec.pop("parameter_sets")[label][law]
    setting = prepare(spec | {"repeats": 1, "laws": {law: spec["laws"][law] | parameters}})
    return measure(execute(setting, setting.cases[0]), setting.scene.robot, 0.0, "measured")


def ratios_of(name, law, label, metrics):
    """Ours over what was printed for the robot."""
    found, short = run_of(name, law, label), law.removesuffix(" exact")
    printed = {
        cell.metric: cell.mean
        for cell in pereira2016.published_cells(name)
        if (cell.law, cell.set) == (short, "" if label == "fixed" else label)
    }
    return {metric: getattr(found, metric).integral / printed[metric] for metric in metrics}


ALL = ("error", "control", "hand_speed", "hand_acceleration")


@pytest.mark.slow
def test_one_run_of_each_predicts_the_other_cells():
    """K with the best gain is the cell that f was fitted on."""
    best = ratios_of("spiral", "K", "best", ALL)
    assert best["error"] == pytest.approx(1.0, abs=5e-3)
    assert max(abs(ratio - 1) for ratio in best.values()) < 0.2
    softest = ratios_of("spiral", "K", "ln2²", ALL)
    assert softest["error"] == pytest.approx(1.0, abs=0.06)
    assert 0.8 < ratios_of("spiral", "LQR-DQ", "best", ("error",))["error"] < 0.95


@pytest.mark.slow
def test_lqr_in_r8_by_euler_steps_has_the_printed_error_and_the_exact_one_a_lower():
    printed = ratios_of("spiral", "LQR-R8", "best", ALL)
    assert printed["error"] == pytest.approx(1.0, abs=0.05)
    assert max(abs(ratio - 1) for ratio in printed.values()) < 0.12
    assert ratios_of("spiral", "LQR-R8 exact", "best", ("error",))["error"] < 0.75


@pytest.mark.slow
def test_all_laws_predict_the_printed_cells():
    for name, label in [("spiral", each) for each in ("best", "ln2", "ln2²")] + [("circle", "fixed")]:
        laws = ("K", "K+FF") if name == "circle" else ("K", "K+FF", "LQR-R8", "LQR-DQ")
        for law in laws:
            ratios = ratios_of(name, law, label, ALL)
            assert ratios["error"] == pytest.approx(0.88 if law == "LQR-DQ" else 1.0, abs=0.06)
            assert ratios["control"] == pytest.approx(0.92, abs=0.1)
            assert ratios["hand_speed"] == pytest.approx(1.0, abs=0.1)
            assert ratios["hand_acceleration"] == pytest.approx(1.0, abs=0.25)


@pytest.mark.slow
def test_the_numbers_in_use_are_those_that_fit():
    rows = calibrate(PHYSICS).rows
    assert len(rows) == 3
    for line in rows:
        assert line[3] == pytest.approx(line[4], rel=0.02)


@pytest.mark.slow
def test_verdicts_are_given_on_all_claims_about_the_spiral():
    spec = published_spec("spiral", PHYSICS)
    study = dqc.run_study(with_gain_x100(spec | {"repeats": 2}))
    evidence = Evidence(Results({"": study.rows}), {"": study.setting()}, PHYSICS, "spiral")
    found = judge("spiral", evidence)
    assert found.keys() == {claim.id for claim in pereira2016.claims("spiral")}
    assert found["feedforward-changes-nothing"].holds
    assert found["h-infinity-best-everywhere"].why_not == "the law did not follow"
    assert found["duration-does-not-matter"].depends_on == "which period the program multiplies commands by"
    assert found["r8-not-exponential"].depends_on == "how (3.44) is solved"
    assert str(found["precision-of-a-centimetre"].verdict) == "not supported"


@pytest.mark.slow
def test_a_run_whose_motors_went_off_says_so_and_counts_as_failed():
    spec = {
        "name": "blind",
        "robot": "meka-a2",
        "start": [0, 0.63, 0, 1.57, 0, 0.63, 0],
        "period": 0.02,
        "reference": {"kind": "set-point", "duration": 0.6},
        "laws": {"K": {"kind": "proportional", "gain": 5}},
        "plants": {
            "well": {"kind": "compliant"},
            "blind": {
                "kind": "compliant",
                "encoder_losses": [{"joint": 4, "time": 0.2, "duration": 0.3}],
            },
        },
    }
    with pytest.warns(SafetyWarning, match="encoder lost"):
        study = dqc.run_study(spec)
    well, blind = study.rows
    assert well["stopped"] == "duration"
    assert str(blind["stopped"]).startswith("faulted at 0.3 s: right_arm_j")
    assert study.runs["K · blind"].record.time[-1] == pytest.approx(0.6)  # the run went on
    assert study.failures() == [f"K · blind: {blind['stopped']}"]
    rows = [row | {"law": row["plant"], "plant": "", "set": "", "robot": ""} for row in study.rows]
    assert len(Results({"": rows}).values("well")) == 1
    assert len(Results({"": rows}).values("blind")) == 0
