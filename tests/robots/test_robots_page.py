"""The examples of docs/robots.md."""

import re
from pathlib import Path

import numpy as np

from dqcontrol.robots import load_robot, load_robot_file, robot_names

PAGE = (Path(__file__).parents[2] / "docs" / "robots.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


def test_python_examples_run(capsys):
    code = "\n".join(blocks("python"))
    names = {}
    exec(compile(code, "robots.md", "exec"), names)
    printed = capsys.readouterr().out
    promised = re.search(r"print\(too_far.reason\)  # (.*)", code)
    assert promised
    assert promised[1] in printed
    assert names["both"].configuration_size == 9
    np.testing.assert_allclose(names["elbow"].fkm([0.1] * 4), names["arm"].frames([0.1] * 7)[3], atol=1e-15)


def test_both_robot_files_are_the_same_chain(tmp_path):
    arms = []
    for i, text in enumerate(blocks("yaml")[:2]):
        path = tmp_path / f"{i}.yaml"
        path.write_text(text, encoding="utf-8")
        arms.append(load_robot_file(path))
    table, free = arms
    for q in np.random.default_rng(51).uniform(-1, 1, (5, 2)):
        np.testing.assert_allclose(table.fkm(q), free.fkm(q), atol=1e-15)
    np.testing.assert_allclose(table.limits.upper, [np.deg2rad(170), 0.3])
    assert table.inertia is not None


def test_the_whole_body_of_the_page(tmp_path, capsys):
    names = {}
    exec(compile("\n".join(blocks("python")), "robots.md", "exec"), names)
    assert "(8, 9)\n[0.0174, 0.0099, 0.54]" in capsys.readouterr().out
    path = tmp_path / "body.yaml"
    path.write_text(blocks("yaml")[2], encoding="utf-8")
    np.testing.assert_array_equal(load_robot(path).fkm(names["q"]), names["body"].fkm(names["q"]))


def test_the_table_of_presets():
    rows = re.findall(r"^\| `([\w-]+)` \| (\d+) \| (yes|no) \|", PAGE, re.MULTILINE)
    assert [name for name, _, _ in rows] == list(robot_names())
    for name, joints, inertia in rows:
        arm = load_robot(name)
        assert (arm.configuration_size, arm.inertia is not None) == (int(joints), inertia == "yes")


def test_methods_named_on_the_page_exist():
    arm = load_robot("iiwa7")
    section = PAGE.split("## Kinematics")[1].split("## Inverse")[0]
    for name in re.findall(r"`(\w+)\(", section):
        assert callable(getattr(arm, name)), name
    section = PAGE.split("## Whole bodies")[1].split("## Kinematics")[0]
    for name in re.findall(r"`(\w+)\((?:q|u\)|w\)|\")", section):
        assert callable(getattr(load_robot("little-john"), name)), name
