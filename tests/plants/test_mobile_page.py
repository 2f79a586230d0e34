import re
from pathlib import Path

import msgspec
import pytest

import dqcontrol as dqc
from dqcontrol.files.yaml_file import convert, parse_yaml
from dqcontrol.plants import Cube, Gripper, MobilePlant, WheeledBase

pytest.importorskip("mujoco")

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/mobile-physics.md").read_text()


def test_plant_on_the_page_is_a_plant():
    (text,) = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    plant = convert("page", parse_yaml("page", text)["plant"], MobilePlant)
    plant.start(dqc.load_robot("little-john"), [0, 0, 0, 0, -0.5, 1.4, 0, 0], 0.02, 0, 0)


def test_what_is_assumed_is_listed_as_it_is():
    for struct in (WheeledBase, Gripper, Cube):
        for field in msgspec.structs.fields(struct):
            if isinstance(field.default, float) and field.name != "yaw":
                assert re.search(rf"`[a-z]*\.?{field.name}`", PAGE), field.name
    for key, value in (
        ("wheel_torque", "0.3 N·m"),
        ("friction", "0.8"),
        ("mass", "3 kg"),
        ("ticks", "508.8"),
    ):
        assert f"{getattr(WheeledBase(), key):g}" == value.split()[0]
        assert value in PAGE


def test_keys_of_the_plant_are_listed_with_the_others():
    rows = (ROOT / "docs/experiments.md").read_text().splitlines()
    (shared,) = (row for row in rows if row.startswith("| `mujoco`"))
    (row,) = (row for row in rows if row.startswith("| `mobile`"))
    for field in msgspec.structs.fields(MobilePlant):
        assert f"`{field.name}`" in shared + row
