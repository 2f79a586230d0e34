"""docs/stable-names.md: what it promises exists, is not too much, and covers what the pages themselves use."""

import importlib
import re

from page_blocks import PAGES

MOST = 300  # names that users may rely on: more than a person can know
TEXT = PAGES["stable-names.md"].read_text(encoding="utf-8")
PROMISED = {
    "dqcontrol" if package == "dqcontrol" else f"dqcontrol.{package}": set(re.findall(r"`(\w+)`", names))
    for package, names in re.findall(r"^\| `(\w+)` \| (.*) \|$", TEXT, re.M)
}
HERE = {**PROMISED, "dqcontrol": PROMISED["dqcontrol"] | PROMISED["dqcontrol.robots"]}  # as the page says
USED = re.compile(r"\bdqc((?:\.[a-z_]+)?)\.([A-Za-z_]\w*)")


def test_what_is_promised_is_offered():
    missing = [
        f"{package}.{name}"
        for package, names in PROMISED.items()
        for name in names
        if not hasattr(importlib.import_module(package), name)
    ]
    assert missing == []
    assert sum(map(len, PROMISED.values())) <= MOST


def test_what_the_pages_use_is_promised():
    """In programs of the pages; modules and their functions that no package offers by itself apart."""
    unpromised = set()
    for name, page in PAGES.items():
        for program in re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.S):
            for module, used in USED.findall(program):
                package = f"dqcontrol{module}"
                if package in PROMISED and package != "dqcontrol.errors":
                    face = importlib.import_module(package)
                    is_module = getattr(getattr(face, used, None), "__file__", None) is not None
                    if used in dir(face) and not is_module and used not in HERE[package]:
                        unpromised.add(f"{name}: {package}.{used}")
    assert sorted(unpromised) == []
