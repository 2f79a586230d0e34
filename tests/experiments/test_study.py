"""Studies: every trial is the run that its seed gives, whatever runs beside it; what is saved is what there was."""

import json
import re
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from study_specs import AT_ONCE, FAR, LATER, spec

import dqcontrol as dqc
from dqcontrol.errors import ExistsError, FileFormatError, LimitWarning, ValueRangeError
from dqcontrol.experiments import load_rows, load_run, load_runs, load_study, run_study_to
from dqcontrol.experiments.failure_hints import beyond_limits
from dqcontrol.experiments.run import Run
from dqcontrol.laws import LinearQuadraticR8

LABELS = ("robot", "law", "set", "plant", "repeat")


def labels(study):
    return [tuple(row[key] for key in LABELS) for row in study.rows]


def test_each_trial_is_the_run_of_its_seed():
    study = dqc.run_study(spec())
    assert labels(study) == [("", law, "", "servo", k) for law in ("K", "K+FF") for k in range(3)]
    assert [row["seed"] for row in study.rows] == [5, 6, 7] * 2
    assert not study.runs
    for row in study.rows:
        alone = dqc.run(spec(laws=None, law=spec()["laws"][row["law"]], repeats=None, seed=row["seed"]))
        flat = alone.metrics.flat()
        assert {key: row[key] for key in flat} == flat
        assert row["stopped"] == alone.record.stopped
    assert len({row["error.integral"] for row in study.rows}) == 6


def test_without_noise_repeats_are_equal():
    first, second = dqc.run_study(
        spec(plant={"kind": "servo"}, laws={"K": spec()["laws"]["K"]}, repeats=2)
    ).rows
    assert {**first, "repeat": 1, "seed": 6} == second


def test_sets_and_grids_run_with_their_parameters():
    study = dqc.run_study(
        spec(
            parameter_sets={"fast": {"K": {}}, "slow": {"K": {"gain": 4}}},
            grids={"K+FF": {"gain": [4, 10]}},
            repeats=2,
        )
    )
    assert labels(study)[::2] == [
        ("", "K", "fast", "servo", 0),
        ("", "K", "slow", "servo", 0),
        ("", "K+FF", "gain=4", "servo", 0),
        ("", "K+FF", "gain=10", "servo", 0),
    ]
    assert [row["parameter.gain"] for row in study.rows[::2]] == [None, None, 4.0, 10.0]
    for row, kind, gain in zip(study.rows[::2], ["proportional"] * 2 + ["proportional-feedforward"] * 2, [10, 4, 4, 10],
                               strict=True):  # fmt: skip
        alone = dqc.run(spec(laws=None, law={"kind": kind, "gain": gain}, repeats=None))
        assert row["error.integral"] == alone.metrics.error.integral


def test_each_robot_follows_the_reference_from_its_own_start():
    robots = {
        "iiwa": {"source": "iiwa7", "start": [0, 0.6, 0, 1.6, 0, 0.6, 0]},
        "bent": {"source": "iiwa7", "start": [0.3, 0.6, 0, 1.2, 0, 0.6, 0]},
    }
    laws = {"K": spec()["laws"]["K"]}
    study = dqc.run_study(spec(robot=None, start=None, robots=robots, laws=laws, repeats=1))
    assert [row["robot"] for row in study.rows] == ["iiwa", "bent"]
    for label, run in study.runs.items():
        start = robots[label.split(" · ")[0]]["start"]
        assert run.q[0] == pytest.approx(start, abs=0)
        assert run.desired[0] == pytest.approx(dqc.load_robot("iiwa7").fkm(np.array(start)), abs=1e-14)
        assert dqc.run(yaml.safe_load(run.spec)).metrics == run.metrics


def test_rows_do_not_depend_on_the_number_of_processes():
    data = spec(
        plants={"servo": spec()["plant"], "coarse": {"kind": "servo", "encoder_resolution": 1e-3}}, plant=None
    )
    one, two = (dqc.run_study(data, jobs=jobs) for jobs in (1, 2))
    assert one.rows == two.rows
    assert len(one.rows) == 12


def test_records_are_equal_and_locked_whatever_the_number_of_processes():
    one, two = (dqc.run_study(spec(repeats=1), jobs=jobs) for jobs in (1, 2))
    assert list(one.runs) == list(two.runs) == ["K · servo", "K+FF · servo"]
    for mine, its in zip(one.runs.values(), two.runs.values(), strict=True):
        assert np.array_equal(mine.record.measured, its.record.measured)
        assert not its.record.q.flags.writeable


def test_sums_of_many_samples_do_not_depend_on_the_threads_of_blas():
    long = spec(reference={**spec()["reference"], "duration": 150}, repeats=1, record="metrics")
    assert dqc.run_study(long, jobs=1).rows == dqc.run_study(long, jobs=2).rows


def test_physics_repeats():
    pytest.importorskip("mujoco")
    data = spec(plant={"kind": "mujoco", "encoder_noise": 1e-4}, repeats=2)
    one, two = (dqc.run_study(data, jobs=jobs) for jobs in (1, 2))
    assert one.rows == two.rows
    assert len({row["error.integral"] for row in one.rows}) == 4


def test_a_law_is_prepared_once_for_all_its_repeats(monkeypatch):
    prepared, rows = [], LinearQuadraticR8.rows
    monkeypatch.setattr(LinearQuadraticR8, "rows", lambda *given: prepared.append(1) or rows(*given))
    law = {"kind": "linear-quadratic-r8", "error_weight": 1, "control_weight": 0.01}
    dqc.run_study(
        spec(laws={"LQR": law}, plants={"a": {"kind": "integrator"}, "b": {"kind": "servo"}}, plant=None)
    )
    assert len(prepared) == 1


@pytest.mark.parametrize(("law", "when"), [(AT_ONCE, "0 s"), (LATER, "0.5")])
def test_a_trial_that_diverges_is_a_row_and_the_others_go_on(law, when):
    data = spec(
        laws={"bad": law, "good": {"kind": "proportional", "gain": 5}},
        reference=FAR,
        plant={"kind": "integrator"},
    )
    study = dqc.run_study(data)
    bad, good = study.rows[:3], study.rows[3:]
    assert all(str(row["stopped"]).startswith(f"diverged at {when}") for row in bad)
    assert all(row["stopped"] == "duration" and row["samples"] == 101 for row in good)
    if law is AT_ONCE:
        assert all(row["samples"] is None and row["error.integral"] is None for row in bad)
    else:
        assert all(51 <= row["samples"] <= 53 and row["error.integral"] > 0 for row in bad)
    assert set(bad[0]) == set(good[0])
    (line,) = study.failures()
    assert line.startswith(f"bad · integrator: 3 of 3 repeats diverged at {when}")
    assert line.endswith("the command is not finite (seed 5)")


def test_a_study_of_which_every_run_fails_at_once_is_an_error(tmp_path):
    data = spec(laws=None, law=AT_ONCE, reference=FAR, repeats=1)
    with pytest.raises(dqc.Error, match=r"^diverged at 0 s: the command is not finite$"):
        run_study_to(data, tmp_path / "bad")
    assert not list(tmp_path.iterdir())


def test_limits_are_warned_of_once_a_law_with_a_count():
    start = [0, 0.6, 0, 2.09, 0, 0.6, 0]  # the fourth joint may go to 2.0944 rad
    laws = {"open": {"kind": "open-loop"}, "K": {"kind": "proportional", "gain": 50}}
    creeping = {"kind": "integrator", "bias": 0.05}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        dqc.run_study(
            spec(start=start, laws=laws, plant=creeping, reference={"kind": "set-point"}, duration=1), jobs=1
        )
    beyond = np.degrees(2.09 + 0.05) - 120  # no feedback: the bias goes on for a second; K rests 1 mrad off
    assert [str(warning.message) for warning in caught if warning.category is LimitWarning] == [
        f"open · integrator: joint_4 went {beyond:.2g}° beyond its limits, in 3 of 3 repeats"
    ]
    trials = [
        {"limit_margin": margin, "limit_joint": f"joint_{i}"}
        for i, margin in enumerate([-0.1, None, 0.1, -0.2])
    ]
    case = SimpleNamespace(
        names=SimpleNamespace(label="K"), scene=SimpleNamespace(robot=dqc.load_robot("iiwa7"))
    )
    assert beyond_limits(case, trials) == "K: joint_3 went 11° beyond its limits, in 2 of 4 repeats"


def test_progress_counts_trials_to_the_end():
    told = []
    dqc.run_study(spec(), progress=lambda done, total: told.append((done, total)))
    assert told[0] == (0, 6)
    assert told[-1] == (6, 6)
    assert [done for done, _ in told] == sorted(done for done, _ in told)


@pytest.mark.parametrize("jobs", [0, -1, 1.5, "two", True])
def test_wrong_numbers_of_processes(jobs):
    with pytest.raises(ValueRangeError, match=r"^jobs: expected an integer ≥ 1, got "):
        dqc.run_study(spec(), jobs=jobs)


@pytest.mark.slow
def test_a_saved_study_is_read_back_and_repeats_itself(tmp_path):
    arrow = pytest.importorskip("pyarrow.parquet")
    data = spec(parameter_sets={"fast": {"K": {}, "K+FF": {}}, "slow": {"K": {"gain": 4}}})
    study = run_study_to(data, tmp_path / "noise")
    assert [path.name for path in tmp_path.iterdir()] == ["noise"]
    names = {path.name for path in (tmp_path / "noise").iterdir()}
    tables = ("table", "confidence", "differences", "repeatability")
    assert names == {
        *(f"{name}.{suffix}" for name in tables for suffix in ("md", "csv", "tex")),
        "spec.yaml", "report.html", "runs.parquet",
        ".dqcontrol-results",
    }  # fmt: skip
    page = (tmp_path / "noise/report.html").read_text(encoding="utf-8")
    assert re.findall('<figure id="(.*?)">', page) == ["paths", "errors", "criteria", "repeats"]
    made = (tmp_path / "noise" / "repeatability.md").read_text(encoding="utf-8")
    assert "white encoder noise of" in made
    again = load_study(tmp_path / "noise")
    assert again.rows == study.rows == run_study_to(tmp_path / "noise/spec.yaml", tmp_path / "again").rows
    assert (again.name, again.spec) == ("noise", study.spec)
    assert again.table() == study.table()
    schema = arrow.read_schema(tmp_path / "noise/runs.parquet")
    assert schema.metadata[b"spec"].decode() == study.spec
    assert schema.field("position.rms").metadata == {b"unit": b"mm"}
    with pytest.raises(ExistsError, match="noise: exists"):
        run_study_to(data, tmp_path / "noise")


@pytest.mark.slow
def test_records_of_all_repeats(tmp_path):
    pytest.importorskip("pyarrow")
    study = run_study_to(spec(record="all", repeats=2), tmp_path / "noise")
    for row in study.rows:
        folder = tmp_path / "noise/runs" / f"{row['law']}-servo" / str(row["repeat"])
        assert {path.name for path in folder.iterdir()} == {"spec.yaml", "record.mcap", "metrics.json"}
        saved = load_run(folder)
        assert saved.metrics.error.integral == row["error.integral"]
        assert json.loads((folder / "metrics.json").read_text())["effort"] == row["effort"]
        assert dqc.run(folder / "spec.yaml").metrics == saved.metrics
    assert list(load_runs([tmp_path / "noise/runs/K-servo"])) == ["K-servo · 0", "K-servo · 1"]
    in_memory = dqc.run_study(spec(record="all", repeats=2))
    assert list(in_memory.runs) == ["K · servo · 0", "K · servo · 1", "K+FF · servo · 0", "K+FF · servo · 1"]
    in_memory.save(tmp_path / "memory")
    mine, its = (
        sorted(p.relative_to(f) for p in f.rglob("*")) for f in (tmp_path / "noise", tmp_path / "memory")
    )
    assert mine == its


@pytest.mark.slow
def test_rows_of_several_studies_and_runs_are_joined(tmp_path):
    pytest.importorskip("pyarrow")
    one, two = dqc.run_study(spec()), dqc.run_study(spec(seed=50))
    for study, name in ((one, "one"), (two, "two")):
        study.save(tmp_path / name)
    dqc.run(spec(laws=None, law=spec()["laws"]["K"], repeats=1)).save(tmp_path / "single")
    rows = load_rows([tmp_path / "one", tmp_path / "two", tmp_path / "single"])
    assert rows[:12] == [{"study": "one", **row} for row in one.rows] + [
        {"study": "two", **row} for row in two.rows
    ]
    assert (rows[12]["law"], rows[12]["error.integral"]) == ("single", one.rows[0]["error.integral"])
    with pytest.raises(dqc.Error, match="one: given twice"):
        load_rows([tmp_path / "one", tmp_path / "one"])
    with pytest.raises(
        FileFormatError, match=r"single: is not the folder of a study with metrics \(runs.parquet is"
    ):
        load_study(tmp_path / "single")


def test_studies_of_single_runs_do_without_pyarrow(tmp_path, monkeypatch):
    monkeypatch.setattr(
        Run, "write", lambda run, folder, *_, **__: run.write_data(folder)
    )  # without pictures
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    run_study_to(
        spec(
            repeats=1,
            laws={"K": spec()["laws"]["K"]},
        ),
        tmp_path / "runs",
    )
    assert (tmp_path / "runs/record.mcap").is_file()
    with pytest.raises(dqc.Error, match=r"^pyarrow: .*; pip install 'dqcontrol\[data\]'$"):
        run_study_to(spec(), tmp_path / "repeats")
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]


def test_labels_name_the_study_where_there_are_two(tmp_path, monkeypatch, without_pictures):
    monkeypatch.setattr(Run, "write", lambda run, folder, *_, **__: run.write_data(folder))
    one = spec(laws=None, law={"kind": "proportional", "gain": 4}, repeats=None, duration=0.05)
    two = spec(repeats=None, duration=0.05)
    for name in ("slow", "fast"):
        run_study_to(two, tmp_path / name)
        run_study_to(one, tmp_path / "alone" / name)
    laws = list(load_runs([tmp_path / "slow"]))
    assert list(load_runs([tmp_path / "slow", tmp_path / "fast"])) == [
        f"{study} · {law}" for study in ("slow", "fast") for law in laws
    ]
    assert list(load_runs([tmp_path / "slow" / laws[0], tmp_path / "alone/fast"])) == [laws[0], "fast"]
    assert list(load_runs([tmp_path / "slow" / laws[0], tmp_path / "fast" / laws[0]])) == [
        f"slow · {laws[0]}", f"fast · {laws[0]}"
    ]  # fmt: skip
