"""Flat memory by name: the same parts in Python and in kernels."""

from typing import Annotated, NamedTuple

import numpy as np
import pytest

from dqcontrol.arrays import Array
from dqcontrol.compiled import kernel_cache
from dqcontrol.compiled.compile import OK, READ, STATUS, WRITE, Kernel
from dqcontrol.compiled.memory_layout import Bundle, MemoryLayout


class Inner(NamedTuple):
    first: float
    rest: Annotated[Array, "k"]


class Outer(NamedTuple):
    sign: Annotated[Array, 1]
    gain: float
    inner: Annotated[Array, MemoryLayout(Inner, "k").sized("n + 1")]
    table: Annotated[Array, 2, "n"]
    drives: Annotated[Array, ..., 3]


class Given(NamedTuple):
    values: Annotated[Array, READ]
    out: Annotated[Array, WRITE]


inner, outer, given = MemoryLayout(Inner, "k"), MemoryLayout(Outer, "n"), Bundle(Given)
unchecked = MemoryLayout(Outer, "n", unchecked=True)
N = 2
MEMORY = np.arange(22.0)


def weighed(arrays, values):
    """Write a number that depends on where each part is."""
    parts = outer(values, 2)
    kept = inner(parts.inner, 3)
    parts.sign[0] = -1.0
    arrays.out[0] = arrays.values[0] + parts.gain
    arrays.out[1] = kept.first + 10.0 * kept.rest[2]
    arrays.out[2] = parts.table[1, 0]
    arrays.out[3] = parts.drives[parts.drives.shape[0] - 1, 2]
    same = unchecked(values, 2)
    arrays.out[4] = same.inner[3] + 10.0 * same.table[1, 0]
    arrays.out[5] = same.drives[same.drives.shape[0] - 1, 2]
    same.inner[0] = -2.0
    return OK


def test_kernels_and_python_see_the_same_parts_and_share_the_memory(monkeypatch):
    monkeypatch.setattr(kernel_cache, "root", lambda: None)  # keeps no kernels of tests
    monkeypatch.setattr(kernel_cache, "announce", lambda function: None)
    found = []
    for function in (weighed, Kernel(weighed, STATUS(given.type, WRITE))):
        memory, out = MEMORY.copy(), np.zeros(6)
        constant = np.array([100.0])
        constant.flags.writeable = False
        assert function(given(values=constant, out=out), memory) == OK
        assert memory[0] == -1.0
        assert memory[2] == -2.0
        found.append(out.tolist())
    assert found == 2 * [[101.0, 52.0, 8.0, 21.0, 85.0, 21.0]]


def test_sizes_places_and_rows_of_layouts():
    assert outer.size(N) == 2 + 4 + 4
    assert [outer.place(name, N) for name in Outer._fields] == [0, 1, 2, 6, 10]
    rows = outer.pack(
        sign=[1.0],
        gain=np.array([2.0, 3.0]),
        inner=np.zeros(4),
        table=np.eye(2),
        drives=np.full((2, 3), 7.0),
    )
    assert rows.shape == (2, 16)
    columns = outer(rows, N)
    np.testing.assert_array_equal(columns.gain, [2.0, 3.0])
    np.testing.assert_array_equal(columns.table, [np.eye(2)] * 2)
    assert columns.drives.shape == (2, 2, 3)


def test_a_value_that_is_missing_or_unknown_is_named():
    with pytest.raises(TypeError, match="Inner: expected first, rest, got first, rests"):
        inner.pack(first=1.0, rests=[1.0])


class Counts(NamedTuple):
    rows: int
    columns: int
    share: float


class Counted(NamedTuple):
    head: Annotated[Array, 3]
    table: Annotated[Array, "counts.rows", "counts.columns + n"]
    packed: Annotated[Array, "2 * n"]


counts_of, counted = MemoryLayout(Counts), MemoryLayout(Counted, "n", "counts")
around = MemoryLayout(NamedTuple("Around", [("own", Annotated[Array, counted.sized("2", "kept")])]), "kept")


def last_of_table(arrays, values):
    """Write where the table ends, whose sizes the memory itself says."""
    counts = counts_of(values[0:3])
    own = counted(around(values, counts).own, 2, counts)
    arrays.out[0] = own.table[counts.rows - 1, counts.columns + 1]
    arrays.out[1] = counts.share * own.packed[3]
    return OK


def test_sizes_may_be_fields_of_a_tuple(monkeypatch):
    monkeypatch.setattr(kernel_cache, "root", lambda: None)
    monkeypatch.setattr(kernel_cache, "announce", lambda function: None)
    memory = np.arange(22.0)
    memory[:3] = 3.0, 3.0, 0.5
    counts = counts_of(memory[:3])
    assert counts == Counts(3, 3, 0.5)
    assert [type(each) for each in counts[:2]] == [int, int]
    assert counted.size(2, counts) == around.size(counts) == memory.size
    for function in (last_of_table, Kernel(last_of_table, STATUS(given.type, WRITE))):
        out = np.zeros(2)
        assert function(given(values=np.zeros(1), out=out), memory) == OK
        assert out.tolist() == [17.0, 10.5]
