"""Robots by name and by source."""

import importlib.metadata
import shutil

import numpy as np
import pytest

from dqcontrol.errors import FileFormatError, MissingExtraError, ShapeError, UnknownNameError
from dqcontrol.robots import load_robot, robot_names
from dqcontrol.robots.files import load
from dqcontrol.robots.files.load import package_files

PANDA = "example-robot-data:panda_description/urdf/panda.urdf"


def test_presets():
    arms = {
        "ax18",
        "barrett-wam",
        "iiwa7",
        "kuka-lwr4",
        "meka-a2",
        "panda",
        "panda-hand",
        "ur5",
        "youbot-arm",
    }
    assert set(robot_names()) == arms | {
        "little-john",
        "little-john-wrist",
        "meka-a2-both",
        "two-pandas",
        "youbot",
    }
    for name in robot_names():
        assert load_robot(name).name == name


@pytest.mark.parametrize("suffix", [".yaml", ".yml", ".YAML"])
def test_a_path_is_the_same_as_a_name(tmp_path, suffix):
    path = tmp_path / f"mine{suffix}"
    shutil.copy(load.MODELS / "iiwa7.yaml", path)
    q = np.arange(7) / 7
    for source in (path, str(path)):
        np.testing.assert_array_equal(load_robot(source).fkm(q), load_robot("iiwa7").fkm(q))


def test_example_robot_data():
    arm = load_robot(PANDA, tip_link="panda_hand")
    path = package_files("example-robot-data")["panda_description/urdf/panda.urdf"]
    np.testing.assert_array_equal(
        arm.fkm(np.ones(7)), load_robot(path, "panda_link0", "panda_hand").fkm(np.ones(7))
    )


@pytest.mark.parametrize(
    ("source", "error", "text"),
    [
        (
            "iiwa",
            UnknownNameError,
            r"robot: unknown name 'iiwa'; did you mean 'iiwa7'\? .*path of a .yaml, .urdf, .xacro or .xml",
        ),
        ("", UnknownNameError, "robot: unknown name ''"),
        ("none.yaml", FileFormatError, "none.yaml: no such file"),
        ("none.urdf", FileFormatError, "none.urdf: no such file"),
        ("arm.urdf.xacro", FileFormatError, "arm.urdf.xacro: no such file"),
        (
            PANDA.replace("panda.urdf", "pandas.urdf"),
            UnknownNameError,
            "did you mean 'panda_description/urdf/panda",
        ),
        ("example-robot-data:panda", UnknownNameError, "did you mean 'panda_description/urdf/panda.urdf'"),
        ("example-robot-data:", UnknownNameError, r"unknown file '' \(allowed: a1_description"),
        ("example-robot-data:../../../etc/passwd", UnknownNameError, "unknown file"),
    ],
)
def test_bad_sources(source, error, text):
    with pytest.raises(error, match=text):
        load_robot(source)


def test_links_are_for_urdf_only():
    with pytest.raises(
        ShapeError, match="tip_link: only URDF and MJCF files have links to choose from; 'iiwa7' has none"
    ):
        load_robot("iiwa7", tip_link="flange")


def test_a_missing_extra_says_how_to_get_it(monkeypatch):
    def none(name):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "distribution", none)
    with pytest.raises(MissingExtraError, match=r"pip install 'dqcontrol\[robots\]'"):
        load_robot(PANDA)


@pytest.mark.slow
def test_every_example_is_loaded_or_refused_with_a_reason():
    reasons = (
        "must be given",
        "no joint moves",
        "lower 0 ≥ upper 0",
        "misses its attribute 'name'",
        "xacro cannot expand it: No such file",
    )
    refusals = []
    for name in package_files("example-robot-data"):
        try:
            load_robot(f"example-robot-data:{name}")
        except (UnknownNameError, FileFormatError) as error:
            refusals.append(str(error))
    assert [text for text in refusals if not any(reason in text for reason in reasons)] == []
    assert len(refusals) < len(package_files("example-robot-data")) - 10
