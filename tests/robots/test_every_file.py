"""Robot files that other wheels bring: each loads as a tree, or is refused in one line that says why."""

import importlib.metadata
import importlib.util
from collections import Counter
from pathlib import Path

import pytest

import dqcontrol as dqc
from dqcontrol.robots.files.load import example_urdfs

WHEELS = (
    "rtbdata",
    "mujoco",
    "mujoco_mjx",
    "dm_control",
    "gymnasium",
    "gymnasium_robotics",
    "robosuite",
    "roboticstoolbox",
    "mujoco_menagerie",
    "metaworld",
)


def files_of_wheels():
    """Return the robot files of all installed packages that bring some."""
    found = list(example_urdfs().values())
    for name in WHEELS:
        where = importlib.util.find_spec(name)
        for folder in (where.submodule_search_locations or ()) if where else ():
            every = sorted(Path(folder).rglob("*"))
            found += [path for path in every if path.suffix in (".urdf", ".xacro")]
            found += [path for path in every if path.suffix == ".xml" and is_mjcf(path)]
    return found


def is_mjcf(path):
    head = path.read_text(encoding="utf-8", errors="replace")
    return "<mujoco" in head and "<worldbody" in head


@pytest.mark.slow
def test_every_file_of_every_wheel_loads_or_is_refused_with_a_reason():
    counts, refused = Counter(), []
    for path in files_of_wheels():
        kind = {".xml": "MJCF", ".xacro": "xacro"}.get(path.suffix, "URDF")
        try:
            robot = dqc.load_tree(path)
        except dqc.Error as error:
            counts[kind, "refused"] += 1
            refused.append(str(error))
            continue
        assert robot.frames([0.0] * robot.configuration_size).shape[-1] == 8
        counts[kind, "loaded"] += 1
    assert all("/" in reason and "\n" not in reason for reason in refused)
    print(dict(counts), *(reason[-200:] for reason in refused), sep="\n")
    assert counts["URDF", "loaded"] > 50
