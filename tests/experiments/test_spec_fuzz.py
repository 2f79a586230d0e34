"""Specs changed at random: each is refused in a line, or runs; nothing else may come of it."""

import copy
import math
import os
import random
import signal
import warnings
from pathlib import Path

import pytest
import yaml

from dqcontrol.errors import Error
from dqcontrol.experiments import check
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.experiments.run import execute
from dqcontrol.files.yaml_file import parse_yaml

EXAMPLES = Path(__file__).parents[2] / "examples"
SPECS = sorted(path for path in EXAMPLES.glob("*.yaml") if "sweep:" not in path.read_text())
SAMPLES = 20  # of a run, to see it begin
SECONDS = 60  # a spec may take
EXTREME = (0, -1, 1, 5e-324, 1e-300, 1e-9, 1e9, 1e11, -1e11, 1e300, 1.7e308, -1e300, 2**31, 2**63, 10**30)
WRONG = (None, True, "", "x", "1e3", [], {}, [1, 2], {"kind": "circle"}, "ÿ", "../..", [[]], -0.0)


def places(data, at=()):
    """Yield the way to everything in plain data."""
    if isinstance(data, dict | list):
        for key in data if isinstance(data, dict) else range(len(data)):
            yield (*at, key)
            yield from places(data[key], (*at, key))


def within(data, at):
    for key in at:
        data = data[key]
    return data


def changed(data, rng):
    """Return plain data with one or two things in it dropped, renamed, doubled or replaced."""
    data = copy.deepcopy(data)
    for _ in range(rng.choice((1, 1, 1, 2))):
        at = rng.choice(list(places(data)) or [()])
        if not at:
            return data
        around, key = within(data, at[:-1]), at[-1]
        numeric = isinstance(around[key], int | float) and not isinstance(around[key], bool)
        kind = rng.choice(("drop", "rename", "double", "wrong", "swap", *["extreme"] * (6 if numeric else 1)))
        if kind == "drop":
            del around[key]
        elif kind == "rename" and isinstance(around, dict):
            around[f"{key}x"] = around.pop(key)
        elif kind == "double" and isinstance(around, list):
            around.insert(key, copy.deepcopy(around[key]))
        elif kind == "swap":
            around[key] = copy.deepcopy(within(data, rng.choice(list(places(data)))))
        elif kind == "extreme":
            around[key] = rng.choice(EXTREME)
        else:
            around[key] = copy.deepcopy(rng.choice(WRONG))
    return data


def outcome(text, folder):
    """Return what `check`, and the begin of each run, say of a spec in one line; nothing if all is well."""
    path = folder / "spec.yaml"
    path.write_text(text)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            check(path)
            setting = prepare(path)
            for case in setting.cases[:2]:
                object.__setattr__(case.scene, "samples", case.scene.samples[:SAMPLES])
                execute(setting, case)
    except Error as error:
        return str(error) or "nothing said"
    return ""


def fuzz(count, seed, folder):
    """Try so many changed specs; return how many were refused."""

    def late(*_):
        raise TimeoutError(f"longer than {SECONDS} s")

    refused, previous = 0, signal.signal(signal.SIGALRM, late)
    for name in ("drawings", "points", "robots"):
        os.symlink(EXAMPLES / name, folder / name)
    try:
        for k in range(count):
            rng = random.Random(f"{seed} {k}")
            source = SPECS[k % len(SPECS)]
            text = yaml.safe_dump(changed(parse_yaml(source, source.read_text()), rng), sort_keys=False)
            signal.alarm(SECONDS)
            try:
                said = outcome(text, folder)
            except Exception as error:
                raise AssertionError(f"seed {seed} {k}, {source.name}: {error!r}\n{text}") from error
            finally:
                signal.alarm(0)
            refused += bool(said)
    finally:
        signal.signal(signal.SIGALRM, previous)
    return refused


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="no alarm to end what hangs")
def test_five_thousand_changed_specs_are_refused_in_a_line_or_run(tmp_path):
    seed = random.randrange(10**6)
    print(f"seed {seed}")
    refused = fuzz(5000, seed, tmp_path)
    assert 0.3 * 5000 < refused < 5000
    assert math.isfinite(refused)
