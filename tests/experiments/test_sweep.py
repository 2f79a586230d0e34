"""Parameter studies: the same rows wherever they run, none lost and none twice, and mistakes named beforehand."""

import resource

import pytest
import yaml
from killed_study import run_and_kill
from study_specs import AT_ONCE, FAR, spec

import dqcontrol as dqc
from dqcontrol import cli
from dqcontrol.errors import (
    Error,
    ExistsError,
    FileFormatError,
    ShapeError,
    UnknownNameError,
    ValueRangeError,
)
from dqcontrol.experiments import load_study, rank, run_sweep_to, sweep
from dqcontrol.experiments.results_folder import working_folder
from dqcontrol.experiments.spec import as_spec
from dqcontrol.experiments.sweep import REFUSED, read_sweep
from dqcontrol.experiments.trials import Batch
from dqcontrol.figures import sweep_figure

pytest.importorskip("pyarrow")
pytest.importorskip("scipy")

GAIN = {"low": 2, "high": 20, "scale": "log"}
DELAY = {"low": 0.01, "high": 0.1}
OVER = {"laws.*.gain": GAIN, "plant.time_constant": DELAY}


def study(**changes):
    """Return a spec of eleven Sobol points, two laws and two repeats, with changes."""
    keys = {"method": "sobol", "points": 11, "seed": 2, "over": OVER} | changes.pop("sweep", {})
    return spec(repeats=2, duration=0.2, sweep=keys, **changes)


@pytest.fixture
def small_parts(monkeypatch):
    """Let parts hold three runs."""
    monkeypatch.setattr(sweep, "_MOST_IN_PART", 6)


def test_what_does_not_fit_at_the_first_point_names_file_and_point():
    short = read_sweep(study(sweep={"over": OVER | {"start": [[0, 1]]}}))
    with pytest.raises(
        ShapeError, match=r"^spec: start: .*, got shape \(2,\) \(at the point .*, start = \[0, 1\]\)$"
    ):
        _ = short.first


@pytest.mark.slow
def test_rows_are_those_of_single_studies(tmp_path, small_parts):
    data = study()
    run_sweep_to(data, tmp_path / "s", jobs=1)
    rows = load_study(tmp_path / "s").rows
    assert [row["point"] for row in rows] == [point for point in range(11) for _ in range(4)]
    assert {row["seed"] for row in rows} == {5, 6}
    for row in rows[::5]:
        gain, lag = row["parameter.laws.*.gain"], row["parameter.plant.time_constant"]
        law = data["laws"][row["law"]] | {"gain": gain}
        plant = {**data["plant"], "time_constant": lag}
        one = dqc.run(spec(laws=None, law=law, plant=plant, repeats=None, seed=row["seed"], duration=0.2))
        assert {key: row[key] for key in one.metrics.flat()} == one.metrics.flat()


def test_points_of_numbers_are_read_as_if_afresh():
    """Beside keys that say their unit, a key that the spec leaves out, and one that asks for its unit."""
    over = OVER | {"plant.delay": {"low": "1 ms", "high": "20 ms"}, "start.1": {"low": -7.0, "high": 7.0}}
    data = study(sweep={"over": over | {"seed": [1, 2]}})
    data["plant"] = data["plant"] | {"base_time_constant": "30 ms"}
    found = read_sweep(data)
    for point in [*found.sampling.points_between(3, 6), *found.sampling.ends()]:
        read = as_spec("spec", found._data_at(point), found.folder)
        assert found._spec_at(point) == read
        assert read.seed == point["seed"]


def test_points_that_take_over_what_the_first_follows_give_the_rows_of_their_own():
    found = read_sweep(study())
    assert found._keeps_scenes
    rows = list(found.rows(range(2, 8)))
    for number, point in enumerate(found.sampling.points_between(1, 4), 1):
        setting = found.setting(point)
        alone = [list(Batch(setting, case, (0, 1), None).outcomes()) for case in setting.cases]
        together = [row for row in rows if row["point"] == number]
        assert len(together) == 2 * len(alone)
        for row in together:
            own = alone[list(setting.cases).index(case_of(setting, row))][row["repeat"]].row
            assert own == {key: row[key] for key in own}


def case_of(setting, row):
    return next(case for case in setting.cases if case.names.law == row["law"])


def test_a_run_starts_its_plant_once(monkeypatch):
    found, starts = read_sweep(study()), []
    assert found.first.scene.start.size
    start = dqc.plants.Servo.start
    monkeypatch.setattr(dqc.plants.Servo, "start", lambda *given: starts.append(given) or start(*given))
    assert len(list(found.rows(range(2, 6)))) == len(starts) == 8


@pytest.mark.slow
def test_files_are_the_same_however_many_processes(tmp_path, small_parts):
    for jobs in (1, 2):
        run_sweep_to(study(), tmp_path / str(jobs), jobs=jobs)
    for name in ("runs.parquet", "best.csv", "spec.yaml"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("method", ["grid", "random", "halton"])
def test_other_methods(tmp_path, method):
    keys = {"method": method, "points": 4}
    if method == "grid":
        keys = {"method": "grid", "points": None, "over": {"seed": [3, 9], "law.gain": [2, 5]}}
    else:
        keys["over"] = {"law.gain": GAIN}
    data = study(sweep=keys, laws=None, law={"kind": "proportional", "gain": 1})
    ranking = run_sweep_to(data, tmp_path / "s")
    assert (ranking.placed, len(ranking.groups)) == (4, 4)
    if method == "grid":
        assert [row["seed"] for row in load_study(tmp_path / "s").rows] == [3, 4, 3, 4, 9, 10, 9, 10]


def interrupt(data, target, after):
    def stop(done, total):
        if done >= after:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_sweep_to(data, target, jobs=1, progress=stop)


@pytest.mark.slow
def test_an_interrupted_sweep_goes_on(tmp_path, small_parts, monkeypatch):
    run_sweep_to(study(), tmp_path / "whole")
    interrupt(study(), tmp_path / "s", 20)
    ran, told, run = [], [], sweep.Task.run
    monkeypatch.setattr(sweep.Task, "run", lambda task: ran.append(task.part) or run(task))
    run_sweep_to(study(), tmp_path / "s", progress=lambda *done: told.append(done))
    assert told[0] == (24, 44)
    assert told[-1] == (44, 44)
    assert ran == [4, 5, 6, 7]
    assert (tmp_path / "s/runs.parquet").read_bytes() == (tmp_path / "whole/runs.parquet").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["s", "whole"]


@pytest.mark.slow
def test_trials_of_another_sweep_are_not_mixed(tmp_path, small_parts):
    interrupt(study(), tmp_path / "s", 20)
    with pytest.raises(ExistsError, match="finished trials of another spec"):
        run_sweep_to(study(sweep={"seed": 3}), tmp_path / "s")
    run_sweep_to(study(sweep={"seed": 3}), tmp_path / "s", force=True)


@pytest.mark.slow
def test_a_damaged_part_is_named(tmp_path, small_parts):
    interrupt(study(), tmp_path / "s", 40)
    part = working_folder(tmp_path / "s") / "part-00000002.parquet"
    part.write_bytes(part.read_bytes()[:-20])
    with pytest.raises(FileFormatError, match=r"part-00000002\.parquet: is damaged .*; remove it"):
        run_sweep_to(study(), tmp_path / "s")
    part.unlink()
    run_sweep_to(study(), tmp_path / "s")


KILLED = """
from dqcontrol.experiments import run_sweep_to, sweep
sweep._MOST_IN_PART = 40
run_sweep_to(sys.argv[1], sys.argv[2], jobs=2, progress=wait_once_trials_are_kept)
"""


@pytest.mark.slow
def test_a_killed_sweep_goes_on(tmp_path, monkeypatch):
    """With kill -9, in the middle of the sweep; its processes are wherever they are then."""
    monkeypatch.setattr(sweep, "_MOST_IN_PART", 40)
    data = study(sweep={"points": 400})
    (tmp_path / "spec.yaml").write_text(yaml.safe_dump(data))
    target, told = tmp_path / "s", []
    run_and_kill(KILLED, tmp_path / "spec.yaml", target)
    run_sweep_to(tmp_path / "spec.yaml", target, jobs=1, progress=lambda *done: told.append(done))
    assert 0 < told[0][0] < 1600
    run_sweep_to(data, tmp_path / "whole", jobs=1)
    assert load_study(target).rows == load_study(tmp_path / "whole").rows


@pytest.mark.slow
def test_memory_does_not_grow_with_the_number_of_runs(tmp_path):
    def peak():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # MiB

    one = {"laws": None, "law": {"kind": "proportional", "gain": 1}, "plant": {"kind": "integrator"}}
    over = {"law.gain": GAIN}
    run_sweep_to(study(sweep={"points": 100, "over": over}, **one), tmp_path / "warm", jobs=1)
    before = peak()
    run_sweep_to(study(sweep={"points": 1500, "over": over}, **one), tmp_path / "long", jobs=1)
    assert peak() - before < 60  # 3000 rows as dictionaries are 20 MiB, their records 1 GiB


def test_points_that_fail_are_rows_and_have_no_place(tmp_path):
    keys = {"method": "grid", "points": None, "over": {"law.gain": [1, 1.7e308]}}
    data = study(laws=None, law={**AT_ONCE, "gain": 1}, reference=FAR, sweep=keys)
    ranking = run_sweep_to(data, tmp_path / "s")
    assert ranking.placed == 1
    assert "1 left out, whose runs hit something, left their limits or ended early" in ranking.table().title
    bad = [row for row in load_study(tmp_path / "s").rows if row["point"] == 1]
    assert all(str(row["stopped"]).startswith("diverged") for row in bad)


def test_points_that_hit_something_have_no_place(tmp_path):
    """A ball stands where the hand is, or far away."""
    ball = {"sphere": 0.05, "position": [9.0, 0.0, 1.0]}
    over = {"world.ball.position.0": [-0.16, 9.0]}  # m
    law = {"kind": "proportional", "gain": 1}
    data = study(
        laws=None, law=law, world={"ball": ball}, sweep={"method": "grid", "points": None, "over": over}
    )
    ranking = run_sweep_to(data, tmp_path / "s", jobs=1)
    assert ranking.column("point").tolist() == [1]
    assert (
        ranking.table().title
        == "best 1 of 2 by error.integral; 1 left out, whose runs hit something, left their limits or ended early"
    )
    failures = [row["failure"] for row in load_study(tmp_path / "s").rows]
    assert failures == ["contact", "contact", "task", "task"]


@pytest.mark.slow
def test_points_that_cannot_run_are_rows_that_say_why(tmp_path):
    """Both keys can have all their values, but not both together."""
    over = {"skip_initial": [0, 0.15], "duration": [0.2, 0.1]}
    run_sweep_to(study(sweep={"method": "grid", "points": None, "over": over}), tmp_path / "s")
    rows = load_study(tmp_path / "s").rows
    assert len(rows) == 16
    bad = [row for row in rows if str(row["stopped"]).startswith(REFUSED)]
    assert {row["point"] for row in bad} == {3}
    assert len(bad) == 4
    assert all("skip_initial: must be ≤ the run's 0.1 s" in row["stopped"] for row in bad)
    assert all(row["error.integral"] is None for row in bad)


@pytest.mark.parametrize(
    ("over", "message"),
    [
        ({"laws.K.gian": [1]}, r"laws\.K\.gain|unknown key 'gian'"),
        ({"laws.KK.gain": [1]}, r"sweep\.over\.laws\.KK\.gain: the spec has no 'laws\.KK' to vary"),
        ({"start.9": [1]}, r"sweep\.over\.start\.9: the spec has no 'start\.9' to vary"),
        ({"laws.K.gain": [1, -1]}, r"-1.*\(at the point laws\.K\.gain = -1\.0\)"),
        ({"repeats": [1, 2]}, r"sweep\.over\.repeats: cannot vary"),
        ({"grids.K.gain": [1, 2]}, "cannot vary"),
        ({"laws.K.gain": []}, r"sweep\.over\.laws\.K\.gain"),
        ({"laws.K.gain": {"low": 1, "hihg": 2}}, "hihg"),
    ],
)
def test_mistakes_are_named_before_anything_moves(tmp_path, over, message):
    with pytest.raises(Error, match=message):
        run_sweep_to(study(sweep={"method": "grid", "points": None, "over": over}), tmp_path / "s")
    assert not list(tmp_path.iterdir())


def test_specs_of_the_other_command_are_refused(tmp_path):
    with pytest.raises(
        FileFormatError, match="missing key 'sweep'; a study without it is run with 'dqcontrol run'"
    ):
        read_sweep(spec())
    with pytest.raises(
        FileFormatError, match="sweep: describes a parameter study; run it with 'dqcontrol sweep'"
    ):
        dqc.run_study(study())
    with pytest.raises(UnknownNameError, match=r"did you mean 'position\.rms'"):
        run_sweep_to(study(), tmp_path / "s", by="position.rsm")


@pytest.mark.slow
def test_the_saved_spec_repeats_the_study(tmp_path, small_parts):
    (tmp_path / "line.txt").write_text("speed 0.1\nline 0.05 0\n")
    (tmp_path / "far.txt").write_text("speed 0.1\nline 0.06 0\n")
    over = {"reference.file": ["line.txt", "far.txt"]}
    data = study(
        reference={"kind": "drawing", "file": "line.txt"},
        sweep={"method": "grid", "points": None, "over": over},
    )
    (tmp_path / "spec.yaml").write_text(yaml.safe_dump(data))
    run_sweep_to(tmp_path / "spec.yaml", tmp_path / "one")
    run_sweep_to(tmp_path / "one/spec.yaml", tmp_path / "two")
    one, two = (load_study(tmp_path / name).rows for name in ("one", "two"))
    numbers = [[row["error.integral"] for row in rows] for rows in (one, two)]
    assert numbers[0] == numbers[1]
    assert len({row["parameter.reference.file"] for row in one}) == 2


@pytest.mark.slow
def test_ranks_are_those_of_the_means(tmp_path):
    ranking = run_sweep_to(study(), tmp_path / "s", by="position.rms")
    means = {}
    for row in load_study(tmp_path / "s").rows:
        means.setdefault((row["point"], row["law"]), []).append(row["position.rms"] / 2)
    best = sorted(means, key=lambda key: sum(means[key]))
    found = list(zip(ranking.column("point"), ranking.column("law"), strict=True))
    assert found == best
    assert ranking.column("position.rms")[0] == pytest.approx(sum(means[best[0]]), rel=1e-12)
    margins = rank([tmp_path / "s"], "limit_margin").column("limit_margin")
    assert list(margins) == sorted(margins, reverse=True)
    assert len(rank([tmp_path / "s"], "position.rms").table(5).rows) == 5


@pytest.fixture(scope="module")
def grid(tmp_path_factory):
    """A study of three gains and two time constants, saved."""
    over = {"law.gain": [4, 8, 16], "plant.time_constant": ["16 ms", 0.032]}
    folder = tmp_path_factory.mktemp("grid") / "s"
    law = {"kind": "proportional", "gain": 4}
    run_sweep_to(spec(laws=None, law=law, repeats=None, duration=0.2, sweep={"over": over}), folder, jobs=1)
    return folder


@pytest.mark.slow
def test_points_with_one_value_of_a_parameter(grid, capsys, monkeypatch):
    every, some = rank([grid]), rank([grid], where={"plant.time_constant": 0.032})
    assert (every.placed, some.placed) == (6, 3)
    assert set(some.column("parameter.plant.time_constant")) == {0.032}
    gains = [g for g, t in zip(every.column("parameter.law.gain"), every.column("parameter.plant.time_constant"),
                               strict=True) if t == 0.032]  # fmt: skip
    assert list(some.column("parameter.law.gain")) == gains
    with pytest.raises(
        ValueRangeError, match=r"no run has plant.time_constant = 0.5 \(there are: 0.016, 0.032\)"
    ):
        rank([grid], where={"plant.time_constant": 0.5})
    with pytest.raises(
        UnknownNameError, match=r"where: unknown name 'plant.lag'.* \(allowed: .*plant.time_constant"
    ):
        rank([grid], where={"plant.lag": 0.5})
    monkeypatch.setattr(
        "sys.argv", ["dqcontrol", "compare", str(grid), "--where", "plant.time_constant=32ms"]
    )
    cli.main()
    assert "best 3 of 3 by error.integral" in capsys.readouterr().out


@pytest.mark.slow
def test_the_best_gain_for_each_time_constant(grid, capsys, monkeypatch):
    every = rank([grid])
    best = every.best_of_each("plant.time_constant")
    lags, gains = (every.column(f"parameter.{key}").tolist() for key in ("plant.time_constant", "law.gain"))
    assert best.column("parameter.plant.time_constant").tolist() == [0.016, 0.032]
    assert best.column("parameter.law.gain").tolist() == [gains[lags.index(lag)] for lag in (0.016, 0.032)]
    assert [column.title for column in best.table().columns][:3] == [
        "plant.time_constant",
        "Point",
        "law.gain",
    ]
    monkeypatch.setattr("sys.argv", ["dqcontrol", "compare", str(grid), "--best-per", "plant.time_constant"])
    cli.main()
    assert "best by error.integral for each plant.time_constant" in capsys.readouterr().out


def test_the_figure_has_a_line_for_each_value(grid):
    figure = sweep_figure(rank([grid]))
    lines = [
        [line for line in axes.lines if line.get_linestyle() == "-" and len(line.get_xdata())]
        for axes in figure.axes
    ]
    assert [len(each) for each in lines] == [2, 3]
    assert list(lines[0][0].get_xdata()) == [4, 8, 16]
    found = [axes.get_legend() for axes in figure.axes]
    legends = [[text.get_text() for text in legend.get_texts()] for legend in found if legend]
    assert legends == [
        ["time_constant 0.016 s", "time_constant 0.032 s", "best"],
        ["gain 4 1/s", "gain 8 1/s", "gain 16 1/s", "best"],
    ]
