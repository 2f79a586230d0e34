"""A search by the workers of a Dask cluster finds what it finds here."""

import pytest

import dqcontrol as dqc

distributed = pytest.importorskip("distributed")


@pytest.mark.slow
def test_a_cluster_finds_the_same_winners(problem):
    here = dqc.tune(problem, jobs=1)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        there = dqc.tune(problem, scheduler=cluster.scheduler_address)
    assert there.winners() == here.winners()
    with pytest.raises(dqc.errors.Error, match="jobs: is for processes on this machine; leave it out"):
        dqc.tune(problem, scheduler="tcp://127.0.0.1:1", jobs=2)
