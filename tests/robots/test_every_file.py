"""Robot files that other wheels bring: each loads as a tree, or is refused in one line that says why."""

from collections import Counter

import pytest

import dqcontrol as dqc
from dqcontrol.robots.files.load import installed_robot_files


@pytest.mark.slow
def test_every_file_of_every_wheel_loads_or_is_refused_with_a_reason():
    counts, refused = Counter(), []
    for source, path in installed_robot_files():
        kind = {".xml": "MJCF", ".xacro": "xacro"}.get(path.suffix, "URDF")
        try:
            robot = dqc.load_robot(source, tips="all")
        except dqc.Error as error:
            counts[kind, "refused"] += 1
            refused.append(str(error))
            continue
        assert robot.frames([0.0] * robot.configuration_size).shape[-1] == 8
        counts[kind, "loaded"] += 1
    assert all("/" in reason and "\n" not in reason for reason in refused)
    print(dict(counts), *(reason[-200:] for reason in refused), sep="\n")
    assert counts["URDF", "loaded"] > 50
