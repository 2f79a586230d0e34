"""What the tests of studies share."""

import pytest

from dqcontrol.reports import study_reports


@pytest.fixture
def without_pictures(monkeypatch):
    """Save studies without their figures, which take a hundred times as long as a study of a few short runs."""
    monkeypatch.setattr(study_reports, "_figures", lambda *_: {})
