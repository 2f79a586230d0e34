"""Folders of results: complete or absent, never overwritten unasked."""

import signal
import subprocess
import sys
import textwrap

import pytest

from dqcontrol.errors import Error, ExistsError
from dqcontrol.experiments.results_folder import check_new, folder_names, new_folder


def fill(folder, text="new", force=False):
    with new_folder(folder, force=force) as draft:
        assert draft.parent == folder.parent
        (draft / "spec.yaml").write_text("name: a")
        (draft / "new.txt").write_text(text)


def files(folder):
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*"))


def test_written_at_once_with_parents(tmp_path):
    fill(tmp_path / "results" / "deep" / "run")
    assert files(tmp_path) == [
        "results",
        "results/deep",
        "results/deep/run",
        "results/deep/run/.dqcontrol-results",
        "results/deep/run/new.txt",
        "results/deep/run/spec.yaml",
    ]
    assert (tmp_path / "results/deep/run").stat().st_mode & 0o777 == 0o755


@pytest.mark.parametrize("kind", ["results", "other folder", "empty folder", "file", "dangling link"])
def test_what_exists_is_not_replaced(tmp_path, kind):
    target = tmp_path / "run"
    if kind == "results":
        fill(target, "old")
    elif kind == "other folder":
        target.mkdir()
        (target / "thesis.tex").write_text("three years")
    elif kind == "empty folder":
        target.mkdir()
    elif kind == "file":
        target.write_text("a file")
    else:
        target.symlink_to(tmp_path / "nowhere")
    before = files(tmp_path)
    with pytest.raises(ExistsError, match=r"run: exists; choose another folder, or replace it with --force"):
        fill(target)
    if kind == "results":
        fill(target, force=True)
        assert (target / "new.txt").read_text() == "new"
    else:
        with pytest.raises(
            ExistsError, match=r"run: exists and holds no results of a run; it is never replaced"
        ):
            fill(target, force=True)
    assert files(tmp_path) == before


def test_a_folder_whose_list_of_files_is_no_text_is_not_replaced(tmp_path):
    target = tmp_path / "run"
    fill(target)
    (target / ".dqcontrol-results").write_bytes(b"\xff\xfe\x00")
    before = files(tmp_path)
    with pytest.raises(
        ExistsError, match=r"what a run wrote is not known, as \.dqcontrol-results is no text"
    ):
        fill(target, force=True)
    assert files(tmp_path) == before


def test_results_with_a_file_of_the_user_are_not_replaced(tmp_path):
    """Also not a folder in which a user keeps a spec.yaml of their own."""
    target = tmp_path / "run"
    fill(target)
    (target / "notes.txt").write_text("mine")
    with pytest.raises(ExistsError, match=r"run: holds 'notes.txt', which no run wrote; it is not replaced"):
        fill(target, force=True)
    thesis = tmp_path / "thesis"
    thesis.mkdir()
    (thesis / "spec.yaml").write_text("name: a")
    with pytest.raises(ExistsError, match=r"thesis: exists and holds no results of a run"):
        fill(thesis, force=True)
    assert (thesis / "spec.yaml").exists()


def test_folder_names_of_labels_differ():
    assert folder_names(["K · servo", "K+FF · servo"]) == {
        "K · servo": "K-servo",
        "K+FF · servo": "K+FF-servo",
    }
    with pytest.raises(Error, match=r"'K 1' and 'K-1': both would be written to the folder 'K-1'"):
        folder_names(["K 1", "K-1"])
    with pytest.raises(Error, match=r"'\? · !': give labels with letters or digits"):
        folder_names(["? · !"])


def test_a_link_to_results_is_not_replaced(tmp_path):
    fill(tmp_path / "run", "old")
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "run")
    with pytest.raises(ExistsError, match=r"link: is a link; it is never replaced$"):
        fill(link, force=True)
    assert (tmp_path / "run" / "new.txt").read_text() == "old"


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt, Error])
@pytest.mark.parametrize("old", [False, True])
def test_a_failure_while_writing_leaves_all_as_it_was(tmp_path, failure, old):
    target = tmp_path / "run"
    if old:
        fill(target, "old")
    before = files(tmp_path)

    def write():
        with new_folder(target, force=old) as draft:
            (draft / "half.txt").write_text("half")
            raise failure

    with pytest.raises(failure):
        write()
    assert files(tmp_path) == before
    if old:
        assert (target / "new.txt").read_text() == "old"


def test_a_folder_that_appears_meanwhile_is_kept(tmp_path):
    target = tmp_path / "run"

    def write():
        with new_folder(target, force=False) as draft:
            (draft / "spec.yaml").write_text("mine")
            target.mkdir()
            (target / "theirs.txt").write_text("theirs")

    with pytest.raises(ExistsError):
        write()
    assert files(tmp_path) == ["run", "run/theirs.txt"]


def test_the_old_results_survive_when_the_new_cannot_be_moved(tmp_path, monkeypatch):
    target = tmp_path / "run"
    fill(target, "old")
    rename = type(target).rename

    def failing(self, other):
        if (self / "new.txt").read_text() == "new":
            raise OSError("disk trouble")
        return rename(self, other)

    monkeypatch.setattr(type(target), "rename", failing)
    with pytest.raises(Error, match="cannot be written: disk trouble"):
        fill(target, force=True)
    assert files(tmp_path) == ["run", "run/.dqcontrol-results", "run/new.txt", "run/spec.yaml"]
    assert (target / "new.txt").read_text() == "old"


def test_where_nothing_can_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(Error, match=r"run: cannot be written: .*file: Not a directory$"):
        check_new(tmp_path / "file" / "run", force=False)
    check_new(tmp_path / "new", force=False)
    assert files(tmp_path) == ["file"]
    if sys.platform == "linux":  # there root may write, by its rights
        with pytest.raises(Error, match=r"x: cannot be written: /proc: .*$"):
            check_new("/proc/x", force=False)


def killed(code, *arguments):
    """Run a program that kills itself."""
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)], check=False)
    assert done.returncode == -signal.SIGKILL


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="nobody is killed so")
def test_what_a_killed_process_left_is_cleared_up(tmp_path):
    fill(tmp_path / "run", "old")
    (tmp_path / ".run-notadraft").mkdir()
    code = """
        import os, signal, sys
        from dqcontrol.experiments import results_folder as output
        with output.new_folder(sys.argv[1], force=True) as draft:
            (draft / "half.txt").write_text("half")
            if sys.argv[2] == "between":  # the two renames that replace the old folder by the new one
                os.rename(sys.argv[1], f"{draft}-old")
            os.kill(os.getpid(), signal.SIGKILL)
    """
    killed(code, tmp_path / "run", "writing")
    killed(code, tmp_path / "run", "between")
    assert not (tmp_path / "run").exists()
    with new_folder(tmp_path / "other", force=False):
        left = list(tmp_path.glob(".run-*"))
        assert (
            len(left) == 4
        )  # a draft, the old folder, their lock, and what is not ours: nobody asked for that folder
    with pytest.raises(ExistsError, match="exists; choose another folder"):
        fill(tmp_path / "run")  # the old one is back
    assert (tmp_path / "run/new.txt").read_text() == "old"
    assert [path.name for path in tmp_path.glob(".run-*")] == [".run-notadraft"]


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="nobody is killed so")
@pytest.mark.parametrize("moment", ["writing", "moving"])
def test_a_folder_to_which_a_killed_process_added_files_may_be_replaced(tmp_path, moment):
    fill(tmp_path / "run", "old")
    code = """
        import os, pathlib, signal, sys
        from dqcontrol.experiments import results_folder as output
        with output.added_files(pathlib.Path(sys.argv[1])) as draft:
            (draft / "new.txt").write_text("more")
            (draft / "plot.png").write_text("half")
            if sys.argv[2] == "writing":
                os.kill(os.getpid(), signal.SIGKILL)
            pathlib.Path.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
    """
    killed(code, tmp_path / "run", moment)
    assert (tmp_path / "run/new.txt").read_text() == "old"
    fill(tmp_path / "run", "newer", force=True)
    assert files(tmp_path / "run") == [".dqcontrol-results", "new.txt", "spec.yaml"]
