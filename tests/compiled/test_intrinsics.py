"""Parts and matrices without checks and calls by address, against NumPy and against the call itself."""

import numpy as np

from dqcontrol.compiled.compile import OK, READ, STATUS, WRITE, WRITE2, Kernel
from dqcontrol.compiled.intrinsics import ADDRESS, as_matrix, as_row, caller

SCALE = STATUS(READ, WRITE)
_call_scale = caller(SCALE)


def doubled(values, out):
    for i in range(values.shape[0]):
        out[i] = 2.0 * values[i]
    return OK


def called(function, values, out):
    return _call_scale(function, values, out)


def corner(flat, square):
    rows = as_matrix(flat[2:], 2, 3)
    rows[1, 2] = -7.0
    square[0, 0] = as_matrix(square, 1, 4)[0, 3]
    return rows.shape[0] * 10 + rows.shape[1]


def middle(flat, square):
    row = as_row(flat, 2, 3)
    row[0] = -7.0
    square[0, 0] = as_row(row, 1, 2)[1]
    return row.shape[0]


def test_a_kernel_is_called_by_its_address():
    out = np.empty(3)
    kernel = Kernel(doubled, SCALE, cached=False)
    by_address = Kernel(called, STATUS(ADDRESS, READ, WRITE), cached=False)
    assert by_address(kernel.pointer, np.arange(3.0), out) == OK
    np.testing.assert_array_equal(out, [0, 2, 4])
    assert _call_scale(kernel, np.arange(3.0), out) == OK  # in Python


def test_a_matrix_shares_the_memory_of_the_array():
    flat, square = np.arange(8.0), np.arange(4.0).reshape(2, 2)
    assert Kernel(corner, STATUS(WRITE, WRITE2), cached=False)(flat, square) == 23
    np.testing.assert_array_equal(flat, [0, 1, 2, 3, 4, 5, 6, -7])
    np.testing.assert_array_equal(square, [[3, 1], [2, 3]])


def test_a_part_shares_the_memory_of_the_array():
    for function in (middle, Kernel(middle, STATUS(WRITE, WRITE2), cached=False)):
        flat, square = np.arange(8.0), np.zeros((2, 2))
        assert function(flat, square) == 3
        np.testing.assert_array_equal(flat, [0, 1, -7, 3, 4, 5, 6, 7])
        assert square[0, 0] == 4.0
