"""Interrupted studies go on: what was finished is taken over, what was half-written is not, and nothing is mixed."""

import os

import pytest
import yaml
from killed_study import run_and_kill
from study_specs import spec

import dqcontrol as dqc
from dqcontrol.errors import Error, ExistsError, FileFormatError
from dqcontrol.experiments import load_study, run_study, run_study_to, trials
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.experiments.results_folder import working_folder
from dqcontrol.experiments.study import Journal

pytest.importorskip("pyarrow")
pytestmark = pytest.mark.usefixtures("without_pictures")

IMPATIENT = """
from dqcontrol.experiments import run_study, run_study_to, trials
run_study.__globals__["_EVERY"], trials._CHUNK = 0.0, 0.01  # s between parts, s of work at once
run_study_to(sys.argv[1], sys.argv[2], jobs=int(sys.argv[3]), progress=wait_once_trials_are_kept)
"""


class Interrupted(KeyboardInterrupt):
    """What a test raises in the place of Ctrl-C."""


def interrupt(data, target, after, **options):
    """Run a study until so many trials are done."""

    def stop(done, total):
        if done >= after:
            raise Interrupted

    with pytest.raises(Interrupted):
        run_study_to(data, target, progress=stop, jobs=1, **options)


def count_trials(monkeypatch):
    """Return a list that grows with every trial that runs."""
    ran, execute = [], trials.execute
    monkeypatch.setattr(
        trials, "execute", lambda *given, **options: ran.append(given) or execute(*given, **options)
    )
    return ran


def test_an_interrupted_study_goes_on_where_it_was(tmp_path, monkeypatch):
    whole = dqc.run_study(spec())
    target = tmp_path / "noise"
    interrupt(spec(), target, 4)
    assert not target.exists()
    ran, told = count_trials(monkeypatch), []
    study = run_study_to(spec(), target, progress=lambda done, total: told.append((done, total)))
    assert len(ran) == 2
    assert told[0] == (4, 6)
    assert study.taken_over == 4
    assert study.rows == whole.rows == load_study(target).rows
    assert [path.name for path in tmp_path.iterdir()] == ["noise"]


def test_records_are_taken_over_too(tmp_path, monkeypatch):
    data = spec(record="all")
    interrupt(data, tmp_path / "noise", 2)
    part = working_folder(tmp_path / "noise")
    (part / "runs/K-servo/.half").mkdir()
    ran = count_trials(monkeypatch)
    run_study_to(data, tmp_path / "noise")
    assert len(ran) == 4
    found = {path.parent.relative_to(tmp_path) for path in tmp_path.rglob("record.mcap")}
    assert len(found) == 6
    assert not list((tmp_path / "noise").rglob(".half"))


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_killed_study_goes_on(tmp_path, jobs):
    """With kill -9, in the middle of the study; processes of their own are wherever they are then."""
    data = spec(repeats=30)
    (tmp_path / "spec.yaml").write_text(yaml.safe_dump(data))
    target, part = tmp_path / "noise", working_folder(tmp_path / "noise")
    run_and_kill(IMPATIENT, tmp_path / "spec.yaml", target, str(jobs))
    (part / ".part-00000099.parquet.tmp").write_bytes(b"PAR1 half a part")
    study = run_study_to(tmp_path / "spec.yaml", target)
    assert 0 < study.taken_over < 60
    assert study.rows == dqc.run_study(data).rows
    assert sorted(path.name for path in tmp_path.iterdir()) == ["noise", "spec.yaml"]


def test_trials_of_another_spec_or_version_are_not_mixed(tmp_path, monkeypatch):
    target = tmp_path / "noise"
    interrupt(spec(), target, 4)
    other = spec(seed=6)
    with pytest.raises(
        ExistsError, match=r"\.noise\.part: holds finished trials of another spec; run that .*--force"
    ):
        run_study_to(other, target)
    with monkeypatch.context() as patch:
        patch.setattr("dqcontrol.experiments.prepared_experiment.sources", lambda: "of other sources")
        with pytest.raises(
            ExistsError, match=r"holds finished trials of another version of dqcontrol, or of a file"
        ):
            run_study_to(spec(), target)
    study = run_study_to(other, target, force=True)
    assert study.taken_over == 0
    assert study.rows == dqc.run_study(other).rows


def test_force_goes_on_with_the_same_study(tmp_path):
    target = tmp_path / "noise"
    run_study_to(spec(seed=1), target)
    interrupt(spec(), target, 4, force=True)
    assert run_study_to(spec(), target, force=True).taken_over == 4


def test_a_changed_file_is_another_study(tmp_path):
    (tmp_path / "spec.yaml").write_text(
        yaml.safe_dump(spec(reference={"kind": "drawing", "file": "line.txt"}))
    )
    (tmp_path / "line.txt").write_text("speed 0.1\nline 0.05 0\n")
    interrupt(tmp_path / "spec.yaml", tmp_path / "noise", 4)
    (tmp_path / "line.txt").write_text("speed 0.1\nline 0.06 0\n")
    with pytest.raises(ExistsError, match="or of a file that the spec names; run that"):
        run_study_to(tmp_path / "spec.yaml", tmp_path / "noise")


def test_two_at_once_do_not_disturb_each_other(tmp_path):
    with (
        Journal(tmp_path / ".a.part", prepare(spec())),
        pytest.raises(Error, match=r"\.a\.part: another process is at work on this study$"),
    ):
        Journal(tmp_path / ".a.part", prepare(spec()))
    Journal(tmp_path / ".a.part", prepare(spec())).close()


def test_folders_of_others_are_left_alone(tmp_path):
    part = working_folder(tmp_path / "noise")
    part.mkdir()
    (part / "thesis.tex").write_text("three years")
    for force in (False, True):
        with pytest.raises(ExistsError, match=r"holds 'thesis.tex' and no unfinished study; move it away$"):
            run_study_to(spec(), tmp_path / "noise", force=force)
    assert [path.name for path in part.iterdir()] == ["thesis.tex"]


@pytest.mark.skipif(
    os.geteuid() == 0 if hasattr(os, "geteuid") else False, reason="root may write everywhere"
)
def test_a_folder_that_cannot_be_written(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(Error, match="cannot be written"):
        run_study_to(spec(), tmp_path / "noise")


def test_a_start_that_was_cut_short_starts_again(tmp_path):
    part = working_folder(tmp_path / "noise")
    part.mkdir()
    for name in ("lock", "spec.yaml", ".fingerprint.tmp"):
        (part / name).write_text("half")
    assert run_study_to(spec(), tmp_path / "noise").taken_over == 0


def test_a_damaged_part_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(
        run_study.__globals__, "_EVERY", float("inf")
    )  # one part, however slow the machine is
    interrupt(spec(), tmp_path / "noise", 4)
    (path,) = working_folder(tmp_path / "noise").glob("part-*.parquet")
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(
        FileFormatError, match=r"part-00000000\.parquet: is damaged .*; remove it to repeat its trials$"
    ):
        run_study_to(spec(), tmp_path / "noise")
    path.unlink()
    assert run_study_to(spec(), tmp_path / "noise").taken_over == 0


def test_a_journal_of_ones_own_stays_and_answers_at_once(tmp_path, monkeypatch):
    first = dqc.run_study(spec(), journal=tmp_path / "kept")
    ran = count_trials(monkeypatch)
    again = dqc.run_study(spec(), journal=tmp_path / "kept")
    assert not ran
    assert (first.taken_over, again.taken_over) == (0, 6)
    assert first.rows == again.rows


def test_parts_are_written_while_the_study_runs(tmp_path, monkeypatch):
    monkeypatch.setitem(run_study.__globals__, "_EVERY", 0.0)
    interrupt(spec(), tmp_path / "noise", 4)
    assert len(list(working_folder(tmp_path / "noise").glob("part-*.parquet"))) == 4
    assert run_study_to(spec(), tmp_path / "noise").taken_over == 4


@pytest.mark.slow
def test_processes_that_began_elsewhere_write_into_this_folder(tmp_path, monkeypatch):
    """Processes are used again by later studies and stay in the folder that they began in."""
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        study = run_study_to(spec(record="all"), "noise", jobs=2)
        assert study.taken_over == 0
        saved = sorted((tmp_path / name).glob("noise/**/record.mcap"))
        assert len(saved) == len(study.rows) == 6
