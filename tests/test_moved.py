"""Old public names still work, and say where the thing is now."""

import importlib
import subprocess
import sys

import pytest

import dqcontrol
from dqcontrol import moved

NAMES = [
    (module, name, new)
    for module, places in moved._NAMES.items()
    for new in places
    for name in moved.names_at(module, new)
]


@pytest.mark.parametrize(("module", "name", "new"), NAMES)
def test_names_that_left_a_module(module, name, new):
    old = importlib.import_module(module)
    with pytest.warns(DeprecationWarning, match=f"{module}.{name} is now {new}.{name}"):
        found = getattr(old, name)
    assert found is getattr(importlib.import_module(new), name)


RENAMES = [(module, *names) for module, renamed in moved._RENAMED.items() for names in renamed.items()]


@pytest.mark.parametrize(("module", "old", "new"), RENAMES)
def test_names_that_changed_in_their_module(module, old, new):
    home = importlib.import_module(moved._MODULES.get(module, module))
    with pytest.warns(DeprecationWarning, match=f"{module}.{old} is now {home.__name__}.{new}"):
        assert getattr(importlib.import_module(module), old) is getattr(home, new)


@pytest.mark.parametrize(("old", "new"), moved._MODULES.items())
def test_modules_that_are_gone(old, new):
    pytest.importorskip("rclpy" if "ros2" in old else "numpy")
    home = importlib.import_module(new)
    name = next(
        name
        for name in getattr(home, "__all__", vars(home))
        if getattr(getattr(home, name), "__module__", "").startswith("dqcontrol")
    )
    with pytest.warns(DeprecationWarning, match=f"{old}.{name} is now {new}.{name}"):
        assert getattr(importlib.import_module(old), name) is getattr(home, name)


@pytest.mark.slow
def test_statements_of_old_programs():
    """In a fresh process: nothing of the new rooms is loaded when the old names are asked for."""
    code = """
import dqcontrol as dqc
import dqcontrol.films.clip
from dqcontrol import figures as view
from dqcontrol.reproductions.silva2017.pick_and_drop_task import pick_and_drop
from dqcontrol.recording import load_record
from dqcontrol.films.light_painting import light_painting
print(dqc.figures.path_3d is view.path_3d, dqcontrol.films.clip.render_clip.__module__)
"""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["True", "dqcontrol.films.clip"]


def test_names_that_never_were():
    for module in (dqcontrol, dqcontrol.experiments, dqcontrol.loop):
        with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
            _ = module.nothing
    with pytest.raises(AttributeError, match="nothing"):
        _ = importlib.import_module("dqcontrol.figures").nothing
