"""Parameter studies on a Dask cluster: a scheduler and two workers as processes on loopback."""

import os
import signal
import socket
import subprocess
import sys

import pytest
from test_sweep import study

from dqcontrol.errors import Error
from dqcontrol.experiments import processes, run_sweep_to, sweep

pytest.importorskip("pyarrow")
pytest.importorskip("distributed")

NANNY = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1")


def dask(*arguments):
    return subprocess.Popen(
        [sys.executable, "-m", "distributed.cli.dask_" + arguments[0], *arguments[1:]],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


@pytest.fixture(scope="module")
def cluster():
    """Give an address and two workers' processes; all end with the tests."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    scheduler = dask("scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
    workers = [dask("worker", address, *NANNY) for _ in range(2)]
    yield address, workers
    for process in (*workers, scheduler):
        process.kill()
        process.wait()


@pytest.mark.slow
def test_a_worker_that_is_killed_changes_no_number(tmp_path, cluster, monkeypatch):
    address, workers = cluster
    monkeypatch.setattr(sweep, "_MOST_IN_PART", 20)
    data, gone = study(sweep={"points": 100}), []

    def kill_one(done, total):
        if done and not gone:
            gone.append(done)
            os.kill(workers[0].pid, signal.SIGKILL)

    run_sweep_to(data, tmp_path / "here", jobs=1)
    run_sweep_to(data, tmp_path / "there", scheduler=address, progress=kill_one)
    assert 0 < gone[0] < 400
    assert workers[0].wait(10) == -signal.SIGKILL
    assert (tmp_path / "there/runs.parquet").read_bytes() == (tmp_path / "here/runs.parquet").read_bytes()


@pytest.mark.slow
def test_workers_of_another_version_are_refused(tmp_path, cluster, monkeypatch):
    monkeypatch.setattr("dqcontrol.experiments.sweep.program", lambda: "of other sources")
    with pytest.raises(
        Error, match="a worker has another version of dqcontrol, NumPy or MuJoCo; give all the same"
    ):
        run_sweep_to(study(), tmp_path / "s", scheduler=cluster[0])


@pytest.mark.slow
def test_addresses_without_a_scheduler_are_one_line(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(processes, "_PATIENCE", 0.5)
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{closed.getsockname()[1]}"
        with pytest.raises(
            Error, match=f"^scheduler: nobody answers at '{address}'; start one with: dask scheduler$"
        ):
            run_sweep_to(study(), tmp_path / "s", scheduler=address)
    for malformed in ("nowhere://x", "tcp://127.0.0.1:port", "127.0.0.1"):
        with pytest.raises(Error, match=r"^scheduler: "):
            run_sweep_to(study(), tmp_path / "s", scheduler=malformed)
    assert capfd.readouterr().err == ""
    with pytest.raises(Error, match="jobs: is for processes on this machine"):
        run_sweep_to(study(), tmp_path / "s", scheduler=address, jobs=2)
