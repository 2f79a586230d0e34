"""Controllers in C that press and touch: as Python does to the last bit, also while the sensor is silent."""

import numpy as np
import pytest
from exported import make, needs_c

from dqcontrol.errors import Error
from dqcontrol.export import export_controller
from dqcontrol.export.compiled_run import run_compiled_in_real_time
from dqcontrol.export.controller_parts import controller_parts
from dqcontrol.export.expected_answers import vector_rows

DOWN = {"kind": "straight", "way": [0, 0, -0.02], "duration": 0.5, "steady": True, "until": {"force": 1.0}}
SPEC = {
    "name": "press",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, -1.6, 0, 0.9, 0],
    "period": 0.004,
    "reference": {
        "kind": "sequence",
        "references": [DOWN, {"kind": "circle", "plane": "xy", "radius": 0.02, "duration": 1.5}],
    },
    "law": {"kind": "proportional-feedforward", "gain": 1},
    "contact": {
        "axes": "base",
        "translation": {"damping": 100, "stiffness": ["rigid", "rigid", 0]},
        "rotation": {"damping": 5, "stiffness": 20},
        "force": {"z": 2},
        "sensor": {"filter": 0.005, "tool": {"mass": 0.3, "center": [0, 0, 0.04]}},
    },
    "world": {
        "board": {
            "box": [0.4, 0.4, 0.04],
            "position": [0.55, 0, 0.284],
            "rpy": [0.05, 0, 0],
            "stiffness": 2000,
        }
    },
    "plant": {
        "kind": "servo",
        "time_constant": 0.04,
        "delay": 0.012,
        "wrist": {"filter": 0.005, "force_noise": 0.1, "mass": 0.3, "center": [0, 0, 0.04]},
    },
}


@needs_c
@pytest.mark.parametrize(
    "supervisor", [pytest.param(None, marks=pytest.mark.slow), {"acceleration": 10.0, "contact_force": 30.0}]
)
def test_the_library_gives_way_as_python_does(tmp_path, supervisor):
    spec = SPEC if supervisor is None else SPEC | {"supervisor": supervisor}
    folder = export_controller(spec, tmp_path / "c").folder
    said = make(folder, "test")
    assert "largest difference to Python 0 (bits compared)" in said
    assert "#define DQC_HAS_CONTACT 1" in (folder / "dqc_controller.h").read_text()
    make(folder, "run")  # its plant has a wrench


def test_its_vector_touches_and_is_silent_for_a_while():
    wrenches = np.array([row.wrench for row in vector_rows(controller_parts(SPEC))])
    silent = np.isnan(wrenches).any(axis=1)
    assert silent.sum() == 15
    shown = wrenches[~silent][:, 2]
    assert shown[0] > 2.5  # the tool's weight
    assert shown.min() < 1.5  # less what the board carries


def test_loops_that_hand_no_wrench_refuse_it(tmp_path):
    with pytest.raises(Error, match="loops in C hand the law no wrench"):
        run_compiled_in_real_time(SPEC, tmp_path / "run")
