import math
import re
from pathlib import Path

import msgspec
import pytest

import dqcontrol as dqc
from dqcontrol.files.yaml_file import convert, parse_yaml
from dqcontrol.plants import Gripper, MobilePlant, WheeledBase
from dqcontrol.plants.mobile.mobile_plant import SLIDES_FOR, SLIDING, TOPPLED

pytest.importorskip("mujoco")

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/mobile-physics.md").read_text()


def test_plant_on_the_page_is_a_plant():
    (text,) = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    plant = convert("page", parse_yaml("page", text)["plant"], MobilePlant)
    plant.start(dqc.load_robot("little-john"), [0, 0, 0, 0, -0.5, 1.4, 0, 0], 0.02, 0, 0)


def test_what_is_assumed_is_listed_as_it_is():
    chassis = dqc.load_robot("little-john").parts[0].chassis
    for struct in (WheeledBase, Gripper):
        for field in msgspec.structs.fields(struct):
            if isinstance(field.default, float | None):
                assert re.search(rf"`[a-z]*\.?{field.name}`", PAGE), field.name
    for key, value in (
        ("wheel_torque", "0.3 N·m"),
        ("friction", "0.8"),
        ("mass", "3 kg"),
        ("ticks", "508.8"),
    ):
        assumed = getattr(WheeledBase(), key)
        assert f"{getattr(chassis, key) if assumed is None else assumed:g}" == value.split()[0]
        assert value in PAGE


def test_thresholds_are_on_the_page():
    for text in (f"{math.degrees(TOPPLED):g}°", f"{SLIDING:g} m/s for {SLIDES_FOR:g} s"):
        assert text in PAGE


def test_keys_of_the_plant_are_listed_with_the_others():
    rows = (ROOT / "docs/experiments.md").read_text().splitlines()
    (shared,) = (row for row in rows if row.startswith("| `mujoco`"))
    (row,) = (row for row in rows if row.startswith("| `mobile`"))
    for field in msgspec.structs.fields(MobilePlant):
        assert f"`{field.name}`" in shared + row
