"""What kernels need and Numba's language lacks: calls of a kernel by its address, matrices without checks."""

from __future__ import annotations

from functools import cache
from typing import Any

from numba import types
from numba.core import cgutils
from numba.core.typing.templates import infer, infer_global, make_intrinsic_template
from numba.extending import intrinsic, overload

ADDRESS = types.intp  # of a kernel, as `Kernel.pointer` gives it


@cache
def function_at(signature: Any) -> Any:
    """Return what makes, in a kernel, a function of this signature of an `ADDRESS`; in Python it returns what it gets.

    A call costs as much as that of an argument of Numba's function type; but to hand one over from Python takes 12 µs,
    a number next to nothing.
    """
    function = types.FunctionType(signature)

    @intrinsic
    def at(typing_context, address):  # type: ignore[no-untyped-def]
        def generate(context, builder, call, arguments):  # type: ignore[no-untyped-def]
            found = cgutils.create_struct_proxy(function)(context, builder)
            pointer = context.get_value_type(types.voidptr)
            found.c_addr = builder.inttoptr(arguments[0], pointer)
            found.py_addr = found.jit_addr = cgutils.get_null_value(pointer)
            return found._getvalue()

        return function(ADDRESS), generate

    def of(address):  # type: ignore[no-untyped-def]
        return address  # in Python: the kernel itself

    overload(of)(lambda address: lambda address: at(address))  # type: ignore[call-arg]
    return of


def as_matrix(array: Any, rows: int, columns: int) -> Any:
    """Return the numbers of an array, in C order, as rows and columns; ``reshape``, which checks, takes 10 ns more."""
    return array.reshape(rows, columns)


def _unchecked(typing_context, array, rows, columns):  # type: ignore[no-untyped-def]
    from numba.core.imputils import impl_ret_borrowed  # neither before the first compilation
    from numba.np.arrayobj import make_array, populate_array

    result = array.copy(ndim=2)

    def generate(context, builder, call, arguments):  # type: ignore[no-untyped-def]
        source = make_array(call.args[0])(context, builder, arguments[0])
        found = make_array(call.return_type)(context, builder)
        rows, columns = arguments[1:]
        populate_array(
            found,
            data=source.data,
            shape=[rows, columns],
            strides=[builder.mul(columns, source.itemsize), source.itemsize],
            itemsize=source.itemsize,
            meminfo=source.meminfo,
            parent=source.parent,
        )
        return impl_ret_borrowed(context, builder, call.return_type, found._getvalue())

    return result(array, types.intp, types.intp), generate


# What `intrinsic` does, for a function that Python can call too.
infer_global(as_matrix, types.Function(infer(make_intrinsic_template(as_matrix, _unchecked, "as_matrix"))))
