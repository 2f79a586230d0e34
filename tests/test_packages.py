"""The order of the code base: one name for one thing, and no package that holds all the others."""

import ast
import re
from collections import Counter
from pathlib import Path

import dqcontrol

ROOT = Path(dqcontrol.__file__).parent
FILES = sorted(ROOT.rglob("*.py"))
MOST = 0.15  # of all lines, in one package
LOADERS = {"import_module", "__import__", "find_spec", "resolve_name"}


def test_no_two_classes_have_one_name():
    classes = Counter(
        name
        for path in FILES
        for name in re.findall(r"^class (\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
    )
    assert classes.total() > 500
    assert [name for name, count in classes.items() if count > 1] == []


def test_no_package_is_too_large():
    lines = Counter()
    for path in FILES:
        lines[path.relative_to(ROOT).parts[0]] += len(path.read_text(encoding="utf-8").splitlines())
    largest = {name: count / lines.total() for name, count in lines.most_common(3)}
    assert max(largest.values()) <= MOST, largest


def test_no_results_of_a_run_lie_in_the_repository():
    """Commands that write results into the folder where they run, as `figures`, must find them ignored here."""
    root = Path(__file__).parents[1]
    ignored = (root / ".gitignore").read_text(encoding="utf-8").split()
    found = {f"/{marker.parent.name}/" for marker in root.glob("*/.dqcontrol-results")}
    assert {"/results/", "/figures/"} <= set(ignored)
    assert found <= set(ignored), found - set(ignored)


def test_no_layer_is_reached_by_the_name_of_a_module():
    """What `import_module` loads, lint-imports does not see: it is for other packages, and for what users name."""
    found = []
    for path in FILES:
        text = path.read_text(encoding="utf-8")
        if not any(loader in text for loader in LOADERS):
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in LOADERS:
                name = "".join(
                    part.value
                    for argument in [*node.args, *(each.value for each in node.keywords)]
                    for part in ast.walk(argument)
                    if isinstance(part, ast.Constant) and isinstance(part.value, str)
                )
                if name.startswith(("..", "dqcontrol")):
                    found.append(f"{path.relative_to(ROOT)}:{node.lineno}: {ast.unparse(node)}")
    assert found == []
