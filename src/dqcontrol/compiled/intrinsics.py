"""What kernels need and Numba's language lacks: calls by address, matrices without checks."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from inspect import Parameter, Signature
from typing import Any

from numba import types
from numba.core.typing.templates import infer, infer_global, make_intrinsic_template

ADDRESS = types.intp  # of a kernel, as `Kernel.pointer` gives it


def _known_as(function: Callable[..., Any], definition: Callable[..., Any]) -> None:
    """Do what `intrinsic` does, for a function that Python can call too."""
    infer_global(function, types.Function(infer(make_intrinsic_template(function, definition, "call"))))


def _caller(signature: Any, emit: Callable[..., Any]) -> Callable[..., Any]:
    def call(function: Callable[..., Any], *arguments: Any) -> Any:
        return function(*arguments)

    def at(typing_context, address, *arguments):
        def generate(context, builder, call, arguments):
            return emit(context, builder, signature.return_type, signature.args, arguments[0], arguments[1:])

        return signature.return_type(ADDRESS, *signature.args), generate

    names = ["typing_context", "address", *(f"argument{i}" for i in range(len(signature.args)))]
    parameters = [Parameter(name, Parameter.POSITIONAL_ONLY) for name in names]
    at.__signature__ = Signature(parameters)
    _known_as(call, at)
    return call


@cache
def caller(signature: Any) -> Callable[..., Any]:
    """Return what calls, in a kernel, the kernel of this signature at an `ADDRESS`, and in Python the kernel itself.

    To hand over a number from Python takes next to nothing, a value of Numba's function type 12 µs. And the call goes
    to the machine code, not to a wrapper that stores all arguments anew.
    """

    def emit(context, builder, result, taken, address, arguments):
        function = context.call_conv.get_function_type(result, taken).as_pointer()
        pointer = builder.inttoptr(address, function)
        # The status is not looked at: no kernel raises.
        _, value = context.call_conv.call_function(builder, pointer, result, taken, arguments)
        return value

    return _caller(signature, emit)


@cache
def c_caller(signature: Any) -> Callable[..., Any]:
    """Return what calls, in a kernel, the C function at an `ADDRESS` that takes these numbers and returns nothing."""

    def emit(context, builder, result, taken, address, arguments):
        from llvmlite.ir import FunctionType, VoidType

        function = FunctionType(VoidType(), [context.get_value_type(each) for each in taken]).as_pointer()
        builder.call(builder.inttoptr(address, function), arguments)
        return context.get_dummy_value()

    return _caller(signature, emit)


def as_matrix(array: Any, rows: int, columns: int) -> Any:
    """Return the numbers of an array, in C order, as rows and columns; ``reshape``, which checks, takes 10 ns more."""
    return array.reshape(rows, columns)


def _unchecked(typing_context, array, rows, columns):
    from numba.core.imputils import impl_ret_borrowed  # neither before the first compilation
    from numba.np.arrayobj import make_array, populate_array

    result = array.copy(ndim=2)

    def generate(context, builder, call, arguments):
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


_known_as(as_matrix, _unchecked)
