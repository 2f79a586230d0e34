"""Another user of Numba in the same process finds it as it was."""

import subprocess
import sys

import pytest

_PROGRAM = """
import sys
import numba, numba.core.caching, numba.core.codegen, numba.core.compiler, numba.extending, numba.np.arrayobj
import llvmlite.binding, llvmlite.ir

def ours(name):
    return name.partition(".")[0] in ("numba", "llvmlite")

def snapshot():
    found = {}
    for name, module in list(sys.modules.items()):
        if not ours(name):
            continue
        for key, value in list(vars(module).items()):
            if not callable(value) and not isinstance(value, (int, str, float, tuple)):
                continue
            found[name, key] = value
            if isinstance(value, type) and ours(value.__module__):
                found |= {(name, key, inner): part for inner, part in vars(value).items() if callable(part)
                          or isinstance(part, (property, classmethod, staticmethod))}
    return found

numba.njit("float64(float64)")(lambda x: x + 1.0)
before = snapshot()
import numpy as np
import dqcontrol as dqc
from dqcontrol.laws.proportional import proportional

def changed():
    after = snapshot()
    return sorted(".".join(key) for key, value in before.items() if after.get(key) is not value)

print("import", changed())
arm, q = dqc.load_robot("youbot-arm"), np.full(5, 0.3)
law, goal = dqc.laws.Proportional(gain=2.0), dqc.references.SetPoint(arm.fkm(q + 0.1))
dqc.simulate(arm, goal, law, dqc.plants.Integrator(), q, 0.01, 0.1)
print("run", changed())
proportional.bitcode(portable=True)
print("export", changed())
assert len(before) > 5000
"""


@pytest.mark.slow
@pytest.mark.parametrize("cache", ["cold", "warm"])
def test_every_attribute_of_numba_is_the_object_that_it_was(tmp_path, cache, monkeypatch):
    if cache == "cold":
        monkeypatch.setenv("DQCONTROL_CACHE", str(tmp_path))
    done = subprocess.run([sys.executable, "-c", _PROGRAM], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["import []", "run []", "export []"]


def test_numba_is_restored_when_a_compilation_fails():
    from numba.core.targetconfig import TargetConfig
    from numba.core.types.functions import BaseFunction

    from dqcontrol.compiled.numba_internals import quick_compilation

    before = TargetConfig.values, BaseFunction.get_call_type

    def fail():
        with quick_compilation():
            assert TargetConfig.values is not before[0]
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert (TargetConfig.values, BaseFunction.get_call_type) == before
