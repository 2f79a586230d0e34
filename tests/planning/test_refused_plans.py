"""What a person gets wrong in a spec that plans: one line, exit status 2, and nothing has moved."""

import re
import sys

import pytest
import yaml
from test_plan_to import SPEC

from dqcontrol import cli

INSIDE = {"box": [0.3, 1.0, 0.02], "position": [0.5, 0, 0.4]}
ZONES = {
    name: {"box": [0.1, 0.1, 0.1], "position": [x, 0, 0.4]} for name, x in (("left", 0.5), ("right", -0.5))
}
KEPT = SPEC["constraints"]


def goal(**given):
    return {"reference": SPEC["reference"] | {"goal": given}}


@pytest.mark.parametrize(
    ("changes", "missing", "line"),
    [
        (
            {"world": SPEC["world"] | {"lower": INSIDE}},
            None,
            r"start: lower: panda_link6: \S+ mm deep, 10 mm of",
        ),
        (
            goal(position=[2, 0, 0.5]),
            None,
            r"goal: unreachable: .* beyond the reach of panda; the nearest found",
        ),
        (
            goal(position=[0.65, 0, 0.6]),
            None,
            r"goal: the best of \d+ configurations there is not clear: upper: ",
        ),
        (
            {"reference": SPEC["reference"] | {"effort": 3}},
            None,
            r"plan: no way within \d+ edges; it came within \S+ rad of a goal, its hand within \S+ mm",
        ),
        ({}, "ompl.base", r"ompl: ways around .* pip install 'dqcontrol\[plan\]'"),
        ({}, "toppra", r"toppra: timings of plans need it .* pip install 'dqcontrol\[plan\]'"),
        ({"constraints": KEPT | {"zones": ZONES}}, None, r"start: (left|right): wall \d: \S+ mm deep"),
        (goal(position=[0.5, 0.2, 0.78]) | {"robot": "free"}, None, r"free has no velocity limit of j1"),
        (
            goal(position=[0.5, 0.2, 0.78]) | {"robot": "slides"},
            None,
            r"slides has no limits of j3, which slides",
        ),
    ],
)
@pytest.mark.parametrize("command", ["plan", "run"])
def test_mistakes_get_one_line(command, changes, missing, line, tmp_path, monkeypatch, capsys):
    spec = SPEC | changes
    if spec["robot"] != "panda":
        (tmp_path / "arm.urdf").write_text(urdf(spec["robot"]))
        spec |= {"robot": {"source": "arm.urdf"}, "start": [0.1, 0.2, 0.3]}
        spec["constraints"] = {"clear_of": {"lower": {"links": ["hand"]}}}
    (tmp_path / "spec.yaml").write_text(yaml.safe_dump(spec))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["dqcontrol", command, "spec.yaml"])
    if missing:
        monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(SystemExit) as end:
        cli.main()
    out, err = capsys.readouterr()
    told = [each for each in err.splitlines() if not each.startswith("dqcontrol: compiling")]
    assert (end.value.code, out, len(told)) == (2, "", 1), err
    assert re.search(f"^dqcontrol: spec.yaml: .*{line}", told[0])
    assert not (tmp_path / "results").exists()


def urdf(name):
    """Return an arm whose last joint turns without limits, or slides so."""
    joints = ""
    for i, kind in enumerate(("continuous", "continuous", "continuous" if name == "free" else "prismatic")):
        limit = "" if name == "free" else '<limit lower="-inf" upper="inf" velocity="2" effort="9"/>'
        joints += (
            f'<joint name="j{i + 1}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/>'
            f'<axis xyz="0 {i % 2} {1 - i % 2}"/><origin xyz="0.4 0 0"/>{limit}</joint>'
        )
    links = "".join(f'<link name="l{i}"/>' for i in range(4))
    return f'<robot name="{name}">{links}{joints}</robot>'
