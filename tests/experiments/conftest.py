"""What the tests of studies share."""

import pytest

from dqcontrol.experiments import study


@pytest.fixture
def without_pictures(monkeypatch):
    """Save studies without their figures, which take a hundred times as long as a study of a few short runs."""
    monkeypatch.setattr(study, "write_comparison", lambda table, records, folder: {})
    monkeypatch.setattr(study.Study, "_write_repeats", lambda self, folder: {})
    monkeypatch.setattr(study.Study, "_first_repeats", lambda self: {})
