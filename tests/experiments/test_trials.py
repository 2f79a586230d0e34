"""How trials are shared out, and what processes do that are killed."""

import os

import joblib
import numpy as np
import pytest
from study_specs import spec

from dqcontrol.errors import Error
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.experiments.processes import sensible_jobs
from dqcontrol.experiments.trials import Batch, Trial, outcomes


def batches(repeats=3, **changes):
    setting = prepare(spec(repeats=repeats, **changes))
    return [Batch(setting, case, range(repeats), None) for case in setting.cases]


def seconds(some):
    return sum(batch.seconds for batch in some)


def test_parts_hold_every_repeat_once_and_take_about_a_second():
    for batch in batches(repeats=5000, reference={**spec()["reference"], "duration": 20}):
        parts = list(batch.split())
        assert [repeat for part in parts for repeat in part.repeats] == list(range(5000))
        assert len(parts) > 4
        assert all(0.5 < part.seconds <= 1.0 for part in parts[:-1])
        sizes = [len(part.repeats) for part in parts]
        assert max(sizes) - sizes[-1] < len(parts)


def test_a_few_short_trials_start_no_processes():
    assert sensible_jobs(seconds(batches())) == 1
    assert sensible_jobs(seconds([])) == 1
    assert sensible_jobs(seconds(batches(repeats=100_000))) == joblib.cpu_count()


def test_physics_and_records_are_longer():
    pytest.importorskip("mujoco")
    (compiled, _), (physics, _) = batches(), batches(plant={"kind": "mujoco"})
    assert physics.seconds > 10 * compiled.seconds


def test_a_compliant_arm_takes_as_long_as_it_has_ticks():
    pytest.importorskip("mujoco")

    def seconds(period, **plant):
        start = [0, 0.63, 0, 1.57, 0, 0.63, 0]
        changes = {
            "robot": "meka-a2",
            "start": start,
            "period": period,
            "plant": {"kind": "compliant", **plant},
        }
        (batch, *_) = batches(**changes)
        return batch.seconds / (len(batch.repeats) * len(batch.case.scene.samples))

    tick = (seconds(0.02) - seconds(0.008)) / 12
    assert seconds(0.008) > 8 * tick > 0
    assert seconds(0.008, accurate=True) > 1.3 * seconds(0.008)


def test_rows_name_their_trials():
    for jobs in (1, 2):
        found = list(outcomes(batches(), jobs))
        assert {outcome.trial for outcome in found} == {Trial.of(outcome.row) for outcome in found}
        assert len(found) == 6


def test_repeats_of_one_prepared_law_do_not_see_each_other():
    (batch, _), (fresh, _) = batches(), batches()
    forwards = list(batch.outcomes())
    (alone,) = Batch(fresh.setting, fresh.case, [2], None).outcomes()
    assert forwards[2].row == alone.row


@pytest.mark.slow
def test_a_process_that_is_killed_is_one_line(monkeypatch):
    class Deadly:
        def __reduce__(self):
            return os._exit, (9,)

    group = batches()
    monkeypatch.setattr("dqcontrol.experiments.trials._alone", lambda batch: Deadly())
    with pytest.raises(
        Error, match=r"^a process of the study was killed, possibly out of memory; try fewer jobs"
    ):
        list(outcomes(group, 2))


def test_records_of_trials_in_processes_are_those_of_this_one():
    data = {"record": "all", "repeats": 2}
    mine, its = (
        sorted(outcomes(batches(**data), jobs), key=lambda outcome: outcome.trial) for jobs in (1, 2)
    )
    for one, other in zip(mine, its, strict=True):
        assert one.run is not None
        assert other.run is not None
        assert np.array_equal(one.run.record.q, other.run.record.q)
        assert one.run.spec == other.run.spec
