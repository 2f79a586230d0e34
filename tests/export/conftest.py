import pytest
from exported import SPEC

from dqcontrol.export import export_controller


@pytest.fixture(scope="session")
def exported_folder(tmp_path_factory):
    """Return the folder of a controller with supervisor, for this processor."""
    return export_controller(SPEC, tmp_path_factory.mktemp("export") / "c").folder
