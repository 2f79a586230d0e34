import re
from pathlib import Path

import msgspec
import pytest

import dqcontrol as dqc
from dqcontrol.files.yaml_file import convert, parse_yaml
from dqcontrol.plants import CompliantPlant

pytest.importorskip("mujoco")

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/physics.md").read_text()


def test_plant_on_the_page_is_a_plant():
    (text,) = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    plant = convert("page", parse_yaml("page", text)["plant"], CompliantPlant)
    q = [0, 0.63, 0, 1.57, 0, 0.63, 0]
    plant.start(dqc.load_robot("meka-a2"), q, 0.008, 0, 0)


def test_keys_of_the_plant_are_listed_with_the_others():
    rows = (ROOT / "docs/experiments.md").read_text().splitlines()
    (row,) = (row for row in rows if row.startswith("| `compliant`"))
    for field in msgspec.structs.fields(CompliantPlant):
        assert f"`{field.name}`" in row


def test_the_example_follows_its_circle():
    run = dqc.run(ROOT / "examples/compliant.yaml")
    assert run.record.stopped == "duration"
    assert run.metrics.position.peak < 16  # mm
