"""Files of the kernel cache that a disk or a copy has damaged: their machine code never runs."""

import numpy as np
import pytest

from dqcontrol.compiled import kernel_cache, numba_internals
from dqcontrol.compiled.compile import FAST
from dqcontrol.loop.rollout import settled


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """Return an empty cache."""
    monkeypatch.setattr(kernel_cache, "root", lambda: tmp_path)
    return tmp_path


def loaded():
    """Return a dispatcher as a new process has it: from the cache if it is there."""
    dispatcher = numba_internals.jit(settled.function, FAST, ours=True)
    dispatcher.compile(settled.signature)
    return dispatcher


def is_from_cache(dispatcher):
    return bool(dispatcher.stats.cache_hits)


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
def test_a_flipped_bit_is_seen_and_mended(cache, suffix):
    assert not is_from_cache(loaded())
    assert is_from_cache(loaded())
    (file,) = cache.glob(f"*/*/*.{suffix}")
    whole = file.read_bytes()
    pose = np.array([1.0, 0, 0, 0, 0, 0, 0, 0])
    for place in np.linspace(0, len(whole) - 1, 3).astype(int):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << (place % 8)
        file.write_bytes(damaged)
        dispatcher = loaded()
        assert not is_from_cache(dispatcher), f"{suffix}: byte {place}"
        assert dispatcher(pose, pose, np.array([1e-9, 2.0]), np.zeros(9)) == 0
        assert is_from_cache(loaded()), "written anew"


@pytest.mark.parametrize("kept", [b"", b"short", b"\0" * 100])
def test_files_without_their_digest_are_none(tmp_path, kept):
    path = tmp_path / "kept"
    assert kernel_cache.unsealed(path) is None
    path.write_bytes(kept)
    assert kernel_cache.unsealed(path) is None
    path.write_bytes(kernel_cache.sealed(kept))
    assert kernel_cache.unsealed(path) == kept
