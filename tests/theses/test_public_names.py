"""The theses import what any user may: names that a stub of `dqcontrol` lists."""

import ast
from pathlib import Path

import dqcontrol
import dqcontrol_theses

ROOT = Path(dqcontrol.__file__).parent
FILES = sorted(Path(dqcontrol_theses.__file__).parent.rglob("*.py"))
PLAIN = ("dqcontrol.arrays", "dqcontrol.errors")  # modules beside the packages


def listed(package):
    """Return the names that the stub of a package lists."""
    tree = ast.parse((ROOT.joinpath(*package.split(".")[1:]) / "__init__.pyi").read_text(encoding="utf-8"))
    return {
        alias.asname for node in tree.body if isinstance(node, ast.ImportFrom) for alias in node.names
    } | {"__version__"}


def refused(source):
    """Yield what a file imports of dqcontrol that is not public."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (
                each.name
                for each in node.names
                if each.name.startswith("dqcontrol.") and each.name.count(".") > 1
            )
        if not isinstance(node, ast.ImportFrom):
            continue
        module = node.module or ""
        package, _, inside = module.rpartition(".")
        if module.partition(".")[0] != "dqcontrol" or module in PLAIN:
            continue
        if module.count(".") > 1:  # a module that its package lists, as laws.parts
            if inside not in listed(package):
                yield module
            continue
        yield from (f"{module}.{each.name}" for each in node.names if each.name not in listed(module))


def test_only_public_names_are_imported():
    assert {
        path.name: found for path in FILES if (found := list(refused(path.read_text(encoding="utf-8"))))
    } == {}


def test_others_would_be_seen():
    assert list(refused("from dqcontrol.laws.law import Law")) == ["dqcontrol.laws.law"]
    assert list(refused("from dqcontrol.laws import Law, _hidden")) == ["dqcontrol.laws._hidden"]
    assert list(refused("import dqcontrol.laws.law")) == ["dqcontrol.laws.law"]
    assert not list(refused("import dqcontrol.figures\nfrom dqcontrol.laws.parts import pose_error"))
