"""The map on which a way was planned is what figures draw around the robot, whatever the law keeps clear of."""

import pytest

import dqcontrol as dqc
from dqcontrol.figures.robots import base_path


@pytest.mark.slow
def test_the_map_of_a_planned_way_is_drawn(tmp_path):
    hall = tmp_path / "hall.yaml"
    hall.write_text("polygons: [[[0.9, -0.2], [1.2, -0.2], [1.2, 0.2], [0.9, 0.2]]]\nheight: 0.5\n")
    spec = {
        "name": "hall",
        "robot": "little-john",
        "start": [0, 0, 0, 0, -0.9, 0.9, 0.9, 0],
        "period": 0.05,
        "reference": {"kind": "drive-to", "offset": {"translation": [2.2, 0.1, 0]}, "clear_of": "all"},
        "world": {"hall": {"map": str(hall)}},
        "law": {"kind": "guided-proportional", "gain": 1},
        "plant": {"kind": "integrator"},
    }
    run = dqc.run(spec)
    assert run.surroundings is not None
    assert run.surroundings.world.bodies["hall"].map == str(hall)
    figure = base_path(run.robot, {"": run.record}, run.surroundings)
    assert "obstacle" in [text.get_text() for text in figure.legends[0].get_texts()]
