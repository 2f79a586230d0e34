"""docs/errors.md: every class that a user can meet is there, and its message is what its example really says."""

import inspect
import re
import sys
import warnings
from pathlib import Path

import pytest

from dqcontrol import errors
from dqcontrol.compiled import kernel_cache

PAGE = (Path(__file__).parents[2] / "docs/errors.md").read_text(encoding="utf-8")
SECTIONS = dict(re.findall(r"^##+ (\w+(?:Error|Warning))\n(.*?)(?=^##|\Z)", PAGE, re.DOTALL | re.MULTILINE))
PHYSICS = ("SafetyWarning",)


def fenced(language, text):
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def met(code):
    """Run code after that which all examples start with; return what it raised, or else what it warned of."""
    names = {}
    exec(fenced("python", PAGE)[0], names)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            exec(code, names)
        except errors.Error as error:
            return [error]
    return [warning.message for warning in caught]


def test_every_class_is_on_the_page():
    classes = {
        name: kind
        for name, kind in inspect.getmembers(errors, inspect.isclass)
        if issubclass(kind, (errors.Error, UserWarning)) and kind not in (errors.Error, UserWarning)
    }
    assert set(SECTIONS) == set(classes)
    for name, body in SECTIONS.items():
        assert "\nCause: " in body, name
        assert "\nCure: " in body, name
    for name, builtin in re.findall(r"^\| \[`(\w+)`\]\(#\w+\) \| `(\w+)`", PAGE, re.MULTILINE):
        assert builtin in [base.__name__ for base in classes[name].__bases__]
        assert f"(#{name.lower()})" in PAGE


@pytest.mark.parametrize("name", [name for name, body in SECTIONS.items() if fenced("python", body)])
def test_the_message_is_what_the_example_says(name, tmp_path, monkeypatch):
    if name in PHYSICS:
        pytest.importorskip("mujoco")
    if name == "MissingExtraError":
        monkeypatch.setitem(sys.modules, "mujoco", None)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "flag.txt").write_text("speed 0.1\nlin 0 0.2\n")
    (code,) = fenced("python", SECTIONS[name])
    (promised,) = fenced("text", SECTIONS[name])
    pattern = re.escape(promised.strip()).replace("…", ".*")
    said = [str(one) for one in met(code) if type(one) is getattr(errors, name)]
    assert any(re.fullmatch(pattern, text) for text in said), said


def test_the_cache_that_cannot_be_written(monkeypatch):
    monkeypatch.setattr(kernel_cache, "root", lambda: None)
    monkeypatch.setattr(kernel_cache, "_warned", False)
    monkeypatch.setenv("DQCONTROL_CACHE", "/read-only")
    (promised,) = fenced("text", SECTIONS["CacheWarning"])
    with pytest.warns(errors.CacheWarning) as caught:
        kernel_cache.announce(kernel_cache.state)
    assert str(caught[0].message) == promised.strip()
