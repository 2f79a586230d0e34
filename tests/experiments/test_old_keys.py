"""Keys of specs under their old names: read with a warning, with the same results."""

import warnings

import numpy as np
import pytest
import yaml

import dqcontrol as dqc
from dqcontrol.errors import FileFormatError
from dqcontrol.experiments import read_spec
from dqcontrol.experiments.sweep import read_sweep

SPEC = {
    "name": "keys",
    "robot": "iiwa7",
    "start": [0, 0.5, 0, -1.2, 0, 0.8, 0],
    "period": 0.01,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 1.0},
    "duration": 0.3,
    "law": {"kind": "proportional", "gain": 5},
    "plant": {"kind": "servo", "encoder_noise": 1e-4},
}
NEW = SPEC | {"skip_initial": 0.1, "metrics_from": "measured"}
OLD = SPEC | {"settle": 0.1, "judged": "measured"}


def test_old_keys_give_the_same_run(tmp_path):
    (tmp_path / "old.yaml").write_text(yaml.safe_dump(OLD))
    with pytest.warns(FutureWarning, match=r"old.yaml: settle is now called skip_initial") as told:
        old = dqc.run(tmp_path / "old.yaml")
    renamed = [str(each.message).split(": ")[1] for each in told if each.category is FutureWarning]
    assert [text.partition(" is now")[0] for text in renamed] == ["judged", "settle"]
    with warnings.catch_warnings():
        warnings.simplefilter("error", FutureWarning)
        new = dqc.run(NEW)
    np.testing.assert_array_equal(old.record.measured, new.record.measured)
    assert old.metrics == new.metrics
    assert old.spec == new.spec
    assert "skip_initial: 0.1" in old.spec


def test_old_parameter_sets_and_drive_to():
    sets = {"slow": {"proportional": {"gain": 2}}, "fast": {"proportional": {}}}
    with pytest.warns(FutureWarning, match="sets is now called parameter_sets"):
        old = read_spec(SPEC | {"sets": sets})[0]
    assert old == read_spec(SPEC | {"parameter_sets": sets})[0]
    drive = {"kind": "drive-to", "offset": {"translation": [1, 0, 0]}}
    with pytest.warns(FutureWarning, match=r"reference\.share is now called reference\.speed_fraction"):
        old = read_spec(SPEC | {"reference": drive | {"share": 0.4}})[0]
    assert old == read_spec(SPEC | {"reference": drive | {"speed_fraction": 0.4}})[0]


def test_old_keys_that_a_study_varies():
    with pytest.warns(FutureWarning, match=r"sweep\.over\.settle is now called sweep\.over\.skip_initial"):
        sweep = read_sweep(NEW | {"sweep": {"over": {"settle": [0.0, 0.1]}}})
    assert list(sweep.sampling.over) == ["skip_initial"]


def test_a_key_under_both_names():
    with pytest.raises(
        FileFormatError, match="settle: is the old name of 'skip_initial', which stands there too"
    ):
        read_spec(NEW | {"settle": 0.2})


def test_data_of_the_caller_stays_as_it_is():
    given = dict(OLD)
    with pytest.warns(FutureWarning):
        read_spec(given)
    assert given == OLD
