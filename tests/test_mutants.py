"""The tool that makes slips sees which a test sees, in functions, within them and in constants."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

TOOLS = Path(__file__).parents[1] / "tools/mutants"

PACKAGE = {
    "src/pack/__init__.py": "",
    "src/pack/numbers.py": "LIMIT = 3\nTWICE = 2 * LIMIT\nFREE = 5\n",
    "src/pack/functions.py": """\
from pack.numbers import LIMIT, TWICE


def most(x):
    return min(x, LIMIT) + 0


def counter():
    def after(x):
        return x + 1

    return after


def until(x):
    while x > 0:
        x = x - 1
    return x


def never():
    return 1


class Kept:
    size = 4
""",
    "test_pack.py": """\
from pack.functions import TWICE, Kept, counter, most, until


def test_most():
    assert most(5) == 3
    assert most(2) == 2


def test_twice():
    assert TWICE < 9
    assert Kept.size == 4


def test_counter():
    assert counter()(1) == 2


def test_until():
    assert until(2) == 0
""",
}

# file, line, what stands there after the slip, what becomes of it
SLIPS = [
    ("functions.py", 5, "    return max(x, LIMIT) + 0", "seen"),
    ("functions.py", 5, "    return min(x, LIMIT) - 0", "unseen"),
    ("functions.py", 10, "        return x - 1", "seen"),
    ("functions.py", 17, "        x = x + 1", "seen"),
    ("functions.py", 22, "    return 2", "unreached"),
    ("functions.py", 26, "    size = 5", "not tried"),
    ("numbers.py", 1, "LIMIT = 4", "seen"),
    ("numbers.py", 2, "TWICE = 3 * LIMIT", "seen"),
    ("numbers.py", 2, "TWICE = 2 + LIMIT", "unseen"),
]


@pytest.mark.slow
def test_each_slip_is_made_alone_and_only_what_tests_run_is_called_seen(tmp_path):
    for name, text in PACKAGE.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    slips = [
        {"path": f"src/pack/{file}", "first": line - 1, "last": line, "lines": [text]}
        for file, line, text, _ in SLIPS
    ]
    (tmp_path / "slips.json").write_text(json.dumps(slips))
    tools = ["-p", "mutants", "--slips", "slips.json", "-c", "/dev/null", "--rootdir", "."]
    subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-s", "-p", "no:cacheprovider", *tools, "test_pack.py"],
        cwd=tmp_path,
        env={"PYTHONPATH": f"src:{TOOLS}", "PATH": ""},
        check=True,
        capture_output=True,
    )
    found = [json.loads(line) for line in (tmp_path / "seen.jsonl").read_text().splitlines()]
    outcomes = {(slip["path"][9:], slip["first"] + 1, *slip["lines"], slip["outcome"]) for slip in found}
    assert outcomes == set(SLIPS)
