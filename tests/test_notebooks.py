"""What notebooks show: tables where there are tables, and pictures of runs."""

import base64
import re

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.tables.tables import Column, Table

SPEC = {
    "name": "shown",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.02,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 1},
    "law": {"kind": "proportional", "gain": 5},
    "plant": {"kind": "integrator"},
}


def test_a_pose_is_shown_as_position_and_turn():
    pose = dqc.DualQuaternion.from_axis_angle([0, 0, 1], np.pi / 2, [0.1, -0.25, 3])
    assert pose._repr_markdown_() == "pose: position (0.1, -0.25, 3) m, turned by 90° about (0, 0, 1)"
    assert (
        dqc.DualQuaternion([2, 0, 0, 0, 0, 0, 0, 0])._repr_markdown_() is None
    )  # no pose: its repr is shown
    assert dqc.DualQuaternion.identity((3,))._repr_markdown_() is None


@pytest.mark.parametrize("name", ["iiwa7", "little-john"])
def test_a_robot_is_shown_as_its_joints(name):
    robot = dqc.load_robot(name)
    shown = robot._repr_markdown_()
    assert shown.startswith(f"**{robot.name}**: reach ")
    rows = [line.split("|")[1].strip() for line in shown.splitlines()[4:]]
    assert rows == list(robot.joint_names)
    if name == "iiwa7":
        assert "| joint_1 | revolute | -170° | 170° |" in shown
    else:
        assert "| phi | revolute | – | – |" in shown  # may turn for ever


def test_tables_and_studies_are_shown_as_tables():
    table = Table([Column("law"), Column("error", "mm")], [["K", 1.5]])
    assert table._repr_markdown_() == table.markdown()
    study = dqc.run_study(SPEC)
    assert study._repr_markdown_() == study.table().markdown()


def test_a_run_is_shown_with_its_numbers_and_its_path():
    run = dqc.run(SPEC)
    shown = run._repr_mimebundle_()["text/markdown"]
    assert f"| {run.label} |" in shown
    (picture,) = re.findall(r"data:image/png;base64,([^\"]+)", shown)
    assert base64.b64decode(picture)[:8] == b"\x89PNG\r\n\x1a\n"


@pytest.mark.slow
def test_a_figure_is_shown_as_wide_as_on_paper_without_pyplot():
    picture, size = dqc.figures.errors(dqc.run(SPEC).record)._repr_png_()
    assert picture[:8] == b"\x89PNG\r\n\x1a\n"
    assert size == {"width": 687, "height": 480}
