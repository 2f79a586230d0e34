"""Unfinished studies see that a law of another package has changed."""

import pytest

from dqcontrol.compiled import kernel_cache
from dqcontrol.experiments import prepare

SPEC = {
    "name": "tiny",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.01,
    "reference": {"kind": "set-point", "duration": 0.1},
    "plant": {"kind": "integrator"},
}


@pytest.mark.parametrize(("kind", "seen"), [("reduced-gradient", True), ("proportional", False)])
def test_the_sources_of_another_package_count(kind, seen, monkeypatch):
    setting = prepare(SPEC | {"law": {"kind": kind, "gain": 1.0}})
    before = setting.fingerprint()
    own = kernel_cache.source_hash

    def edited(module, *, lazily=False):
        return "another" if module.startswith("dqcontrol_theses.") else own(module, lazily=lazily)

    monkeypatch.setattr("dqcontrol.experiments.prepared_experiment.source_hash", edited)
    assert (setting.fingerprint() != before) == seen
