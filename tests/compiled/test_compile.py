"""The cache of compiled code, each time in a process of its own."""

import errno
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from numba.core.caching import FunctionCache

import dqcontrol
from dqcontrol.compiled import kernel_cache, numba_internals
from dqcontrol.compiled.compile import Kernel
from dqcontrol.errors import CacheWarning
from dqcontrol.loop.rollout import settled

PACKAGE = Path(dqcontrol.__file__).parent
CALL = """
import warnings
import numpy as np
warnings.simplefilter("always")
with warnings.catch_warnings(record=True) as caught:
    from dqcontrol.loop.rollout import settled
    count = np.zeros(10)
    one = np.array([1.0, 0, 0, 0, 0, 0, 0, 0])
    settled(one, one, np.array([1.0, 1.0]), count)
    if {second}:
        from dqcontrol.plants.integrator import integrate
        q = np.zeros(1)
        integrate(np.ones(1), np.ones(1), q, q, q, q)
        assert q[0] == 1.0
print(count[5], sum(settled.compiled.stats.cache_hits.values()), [str(w.message) for w in caught])
"""
ANNOUNCED = "dqcontrol: compiling kernels for their first use (up to a minute) …\n"


def call(cache=None, source=PACKAGE.parent, second=False, **environment):
    """Return the number computed, whether the code came from the cache, the warnings and what stderr said."""
    keep = {
        k: v
        for k, v in os.environ.items()
        if k not in ("DQCONTROL_CACHE", "PYTHONWARNINGS", "NUMBA_CACHE_DIR")
    }
    chosen = {"DQCONTROL_CACHE": str(cache)} if cache else {}
    done = subprocess.run(
        [sys.executable, "-B", "-c", CALL.format(second=second)],
        env={**keep, "PYTHONPATH": str(source), **chosen, **environment},
        capture_output=True,
        text=True,
        check=False,
        encoding="utf-8",
    )
    assert done.returncode == 0, done.stderr
    number, hits, warned = done.stdout.split(maxsplit=2)
    return float(number), int(hits), warned.strip(), done.stderr


def indexes(cache):
    return sorted(Path(cache).rglob("*.nbi"))


@pytest.fixture(scope="module")
def filled(tmp_path_factory):
    """Return a cache that holds one kernel, and what the call that made it returned."""
    cache = tmp_path_factory.mktemp("cache")
    return cache, call(cache)


@pytest.mark.slow
def test_first_process_compiles_and_says_so_once_the_second_is_silent(filled):
    cache, first = filled
    assert first == (0.0, 0, "[]", ANNOUNCED)
    assert len(indexes(cache)) == 1
    before = indexes(cache)[0].stat().st_mtime_ns
    assert call(cache) == (0.0, 1, "[]", "")
    assert indexes(cache)[0].stat().st_mtime_ns == before


@pytest.mark.slow
def test_a_kept_kernel_is_loaded_without_what_compiles(filled, tmp_path):
    """What Numba knows of NumPy's functions takes longer to import than the kernel; a second one needs it."""
    cache = shutil.copytree(filled[0], tmp_path / "cache")
    script = CALL + "\nimport sys; print('numba.np.arraymath' in sys.modules)"
    for second in (False, True):
        done = subprocess.run(
            [sys.executable, "-B", "-c", script.format(second=second)],
            env={**os.environ, "PYTHONPATH": str(PACKAGE.parent), "DQCONTROL_CACHE": str(cache)},
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout == f"0.0 1 []\n{second}\n"


@pytest.mark.slow
def test_of_processes_that_begin_at_once_one_compiles(tmp_path):
    with ThreadPoolExecutor() as pool:
        calls = [pool.submit(call, tmp_path) for _ in range(3)]
    assert sorted(each.result()[1] for each in calls) == [0, 1, 1]


SINGULAR = """
import numpy as np, dqcontrol as dqc
from dqcontrol_theses import variants
body, law, rng = dqc.load_robot("little-john"), variants.ClassicWholeBody(gain=1.0), np.random.default_rng(1)
q = np.hstack([np.zeros((2000, 3)), rng.uniform(-2.6, 2.6, (2000, 5))])
smallest = np.linalg.svd(body.in_form("unconstrained").pose_jacobian(q), compute_uv=False)[:, 5]
for each in q[smallest < 0.02]:  # where the general inverse works, a function that kernels call
    goal = dqc.Sample(body.fkm(each + rng.uniform(-1, 1, 8)))
    print(*(value.hex() for value in law.command(body, each, goal, 0.05)))
"""


@pytest.mark.slow
def test_a_first_run_has_the_last_digits_of_all_others(tmp_path):
    """Code just compiled and code read from the cache: parts of kernels must be the same ones."""
    environment = {**os.environ, "PYTHONPATH": str(PACKAGE.parent), "DQCONTROL_CACHE": str(tmp_path)}
    first, second = (
        subprocess.run(
            [sys.executable, "-B", "-c", SINGULAR],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for _ in range(2)
    )
    assert first.count("\n") > 100
    assert first == second


@pytest.mark.slow
def test_an_edit_in_another_file_is_seen(tmp_path):
    """The kernel is in loop/, what it calls in algebra/: Numba alone would use the old machine code."""
    copy = tmp_path / "source" / "dqcontrol"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    cache = tmp_path / "cache"
    assert call(cache, copy.parent)[:2] == (0.0, 0)
    assert call(cache, copy.parent)[:2] == (0.0, 1)
    edited = copy / "algebra" / "dual_quaternion_kernels.py"
    text = edited.read_text(encoding="utf-8")
    old = "    out[4] += aw * bw - ax * bx - ay * by - az * bz\n"
    start = text.index("def conjugate_multiply(")
    assert old in text[start:]
    stamp = (copy / "loop" / "rollout.py").stat().st_mtime_ns
    changed = text[start:].replace(old, old[:-1] + " + 7.0\n", 1)
    edited.write_text(text[:start] + changed, encoding="utf-8")
    assert (copy / "loop" / "rollout.py").stat().st_mtime_ns == stamp
    assert call(cache, copy.parent)[:2] == (7.0, 0)
    assert call(cache, copy.parent)[:2] == (7.0, 1)
    edited.write_text(text, encoding="utf-8")
    assert call(cache, copy.parent)[:2] == (0.0, 1), "the old code is still cached beside the new"


@pytest.mark.slow
@pytest.mark.parametrize("where", ["DQCONTROL_CACHE", "HOME"])
def test_without_a_writable_cache_it_works_and_warns_once(tmp_path, where):
    file = tmp_path / "file"
    file.write_text("in the way")
    inside = file / "folder"  # cannot be made, not even by root
    if where == "HOME":
        result = call(None, second=True, HOME=str(inside), XDG_CACHE_HOME="", LOCALAPPDATA=str(inside))
    else:
        result = call(inside, second=True)
    number, hits, warned, said = result
    assert (number, hits, said) == (0.0, 0, "")
    assert warned.count("cannot write to") == 1
    assert "kernels are compiled anew in each process; set DQCONTROL_CACHE to a writable folder" in warned
    assert str(inside) in warned
    assert file.read_text() == "in the way"


def test_it_counts_what_is_compiled(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(kernel_cache, "root", lambda: tmp_path)
    monkeypatch.setattr(kernel_cache, "_announced", 0)
    monkeypatch.setattr(kernel_cache, "is_kept", lambda function: function is None)
    for function in (call, None, call, call, call, None, call):
        kernel_cache.announce(function)
    assert capsys.readouterr().err == ANNOUNCED + "dqcontrol: compiling: 5 kernels so far …\n"


def test_python_does_what_is_too_little_to_compile_for(monkeypatch):
    monkeypatch.setattr(kernel_cache, "is_kept", lambda function: False)
    seldom = Kernel(settled.function, settled.signature)
    one, stop, count = np.eye(8)[0], np.array([1.0, 1.0]), np.zeros(10)
    for work in (3, 2):
        assert seldom.worth_compiling(work, 5)(one, one, stop, count) == 1
    assert "compiled" not in vars(seldom)
    monkeypatch.setattr(Kernel, "compiled", "machine code")
    assert seldom.worth_compiling(1, 5) == "machine code"
    monkeypatch.setattr(kernel_cache, "is_kept", lambda function: True)
    assert Kernel(settled.function, settled.signature).worth_compiling(1, 5) == "machine code"


def test_a_kernel_that_a_full_disk_cannot_keep_is_no_failure(monkeypatch):
    def save(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(FunctionCache, "save_overload", save)
    monkeypatch.setattr(kernel_cache, "_warned", False)
    cache = object.__new__(numba_internals.KernelCache)
    with pytest.warns(CacheWarning, match="kernels are compiled anew in each process"):
        cache.save_overload(None, None)
    cache.save_overload(None, None)  # says no more


@pytest.mark.parametrize(
    ("suffix", "damage"),
    [
        pytest.param("nbi", lambda data: data[: len(data) // 2], marks=pytest.mark.slow),
        pytest.param("nbi", lambda data: b"", marks=pytest.mark.slow),
        pytest.param("nbi", lambda data: b"\x00garbage" * 20, marks=pytest.mark.slow),
        pytest.param("nbc", lambda data: data[: len(data) // 2], marks=pytest.mark.slow),
    ],
    ids=["index cut short", "index empty", "index garbage", "code cut short"],
)
def test_a_damaged_cache_is_made_anew_in_silence(filled, tmp_path, suffix, damage):
    cache = tmp_path / "cache"
    shutil.copytree(filled[0], cache)
    (path,) = cache.rglob(f"*.{suffix}")
    path.write_bytes(damage(path.read_bytes()))
    assert call(cache) == (0.0, 0, "[]", "")
    assert call(cache) == (0.0, 1, "[]", "")


@pytest.mark.slow
def test_old_versions_of_a_modules_kernels_are_removed_and_nothing_else(tmp_path):
    """Eight are kept; folders and files of other names are not touched."""
    module = tmp_path / "dqcontrol.loop.rollout"
    for age in range(10):
        folder = module / f"{age:016x}"
        folder.mkdir(parents=True)
        (folder / "code").write_text("old")
        os.utime(folder, (1e9 - age, 1e9 - age))
    mine = tmp_path / "my thesis"
    mine.mkdir()
    os.utime(mine, (0, 0))
    (module / ("f" * 16)).write_text("a file")
    assert call(tmp_path)[:2] == (0.0, 0)
    assert {path.name for path in tmp_path.iterdir()} == {"my thesis", module.name}
    left = {path.name for path in module.iterdir()}
    assert {name for name in left if name.startswith("000")} == {f"{age:016x}" for age in range(7)}
    assert len(left) == 1 + 8


@pytest.mark.slow
def test_an_edit_recompiles_only_what_it_can_change(tmp_path):
    """A figure's source is none of the kernel's business, nor another law's; what it imports by three detours is."""
    copy = tmp_path / "source" / "dqcontrol"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    cache = tmp_path / "cache"
    assert call(cache, copy.parent)[:2] == (0.0, 0)
    for path in (copy / "figures" / "style.py", copy / "laws" / "h_infinity.py", copy / "__init__.py"):
        path.write_text(path.read_text(encoding="utf-8") + "\n# a remark\n", encoding="utf-8")
    assert call(cache, copy.parent)[:2] == (0.0, 1)
    for path in (copy / "compiled" / "intrinsics.py", copy / "references" / "reference.py"):
        path.write_text(path.read_text(encoding="utf-8") + "\n# a remark\n", encoding="utf-8")
        assert call(cache, copy.parent)[:2] == (0.0, 0)


def test_import_compiles_nothing_and_loads_nothing_heavy(tmp_path):
    script = """
import sys
import numpy, numba
before = set(sys.modules)  # Numba looks at SciPy if it is there
import dqcontrol
names = {name.partition(".")[0] for name in set(sys.modules) - before}
heavy = {"mujoco", "matplotlib", "yourdfpy", "scipy", "mcap", "trimesh", "cyclopts", "rich", "PIL"}
missing = [name for name in dqcontrol.__all__ if name not in dir(dqcontrol)]
print(sorted(heavy & names), dqcontrol.__version__, missing)
"""
    environment = {**os.environ, "DQCONTROL_CACHE": str(tmp_path), "PYTHONPATH": str(PACKAGE.parent)}
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
    )
    assert (done.stdout, done.stderr) == (f"[] {dqcontrol.__version__} []\n", "")
    assert not list(tmp_path.iterdir())


def test_unknown_attribute_of_the_package():
    with pytest.raises(AttributeError, match="No dqcontrol attribute runn"):
        _ = dqcontrol.runn
