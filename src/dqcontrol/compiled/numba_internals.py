"""All that this package uses of Numba beyond what Numba documents: it is what makes kernels fast.

A release of Numba may change any of it, so pyproject.toml bounds Numba from above; `make test-newest` tries the next
one. Where it breaks, ``DQCONTROL_NUMBA=plain`` takes `numba_public` in place of this file: the same functions of what
is documented alone. Both files define the same names.
"""

from __future__ import annotations

import functools
import io
import operator
import pickle
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from inspect import Parameter, Signature
from types import BuiltinFunctionType, FunctionType, ModuleType
from typing import Any

import llvmlite.binding
import numba
import numpy as np
from numba import types
from numba.core import event as numba_event, ir
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, _CacheLocator
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.cpu import CPUContext
from numba.core.errors import termcolor
from numba.core.targetconfig import TargetConfig
from numba.core.types.functions import BaseFunction
from numba.core.typing.context import BaseContext
from numba.core.typing.templates import infer, infer_global, make_intrinsic_template

from dqcontrol.compiled import kernel_cache


@contextmanager
def quick_compilation() -> Iterator[None]:
    """Let Numba look up once what it looks up over and over in what is compiled meanwhile: 0.6 of the time.

    Numba's lock keeps other threads from compiling under these methods; afterwards Numba's own are back.
    """
    with global_compiler_lock:
        before = [(owner, name, getattr(owner, name)) for owner, name, _ in _QUICKER]
        try:
            for owner, name, made in _QUICKER:
                setattr(owner, name, made(getattr(owner, name)))
            yield
        finally:
            for owner, name, method in before:
                setattr(owner, name, method)


def _values(_: Any) -> Callable[..., dict[str, Any]]:
    """Return what gives all options of a function; Numba asks for them thousands of times for each kernel."""
    return lambda flags: _default_values(type(flags)) | flags._values


@functools.cache
def _default_values(kind: type[TargetConfig]) -> dict[str, Any]:
    return {name: option.default for name, option in kind.options.items()}


def _call_type(search: Callable[..., Any]) -> Callable[..., Any]:
    """Return a search for what a call is typed as that finds each operator with the same types once."""
    found: dict[Any, Any] = {}

    def call_type(function: Any, context: Any, arguments: Any, named: Any) -> Any:
        if named or function.typing_key not in _OPERATORS:
            return search(function, context, arguments, named)
        key = function, context, tuple(arguments)
        if key not in found:
            found[key] = search(function, context, arguments, named)
        return found[key]

    return call_type


_OPERATORS = {each for each in vars(operator).values() if callable(each)}


def _value_type(search: Callable[..., Any]) -> Callable[..., Any]:
    """Return a search for the type of a constant that finds each function, class and module once."""
    found: dict[Any, Any] = {}

    def value_type(context: Any, value: Any) -> Any:
        if not isinstance(value, _CONSTANT):
            return search(context, value)
        if (context, value) not in found:
            found[context, value] = search(context, value)
        return found[context, value]

    return value_type


_CONSTANT = FunctionType, BuiltinFunctionType, ModuleType, type


def _variables(_: Any) -> Callable[..., list[Any]]:
    """Return what lists the variables of an instruction, which Numba does a dozen times."""
    return lambda instruction, value: _add_variables([value], [])


def _add_variables(values: Iterable[Any], found: list[Any]) -> list[Any]:
    for value in values:
        kind = type(value)
        if kind is ir.Var:
            found.append(value)
        elif kind is dict:
            _add_variables(value.values(), found)
        elif kind is list or kind is tuple:
            _add_variables(value, found)
        elif kind is not ir.Loc and isinstance(value, ir.Inst):
            found += value.list_vars()
    return found


def _unmarked(_: Any) -> Callable[..., str]:
    """Return what leaves texts of errors, most of which Numba catches itself, without the terminal's marks."""
    return lambda scheme, text, *_: text


_QUICKER: list[tuple[Any, str, Callable[..., Any]]] = [
    (TargetConfig, "values", _values),
    (BaseFunction, "get_call_type", _call_type),
    (BaseContext, "resolve_value_type", _value_type),
    (ir.Inst, "_rec_list_vars", _variables),
    (CPUContext, "load_additional_registries", functools.cache),  # imports, to no avail but the first time
    (numba_event, "broadcast", lambda _: lambda event: None),  # to timers whose times nobody reads
    *([(type(termcolor()), "_markup", _unmarked)] if hasattr(termcolor(), "_markup") else []),
]


def jit(
    function: Callable[..., Any],
    fastmath: set[str] | bool,
    *,
    ours: bool,
    kept: bool = True,
    located: bool = False,
) -> Any:
    """Return a function's dispatcher; ``ours`` allocate nothing and are ``kept`` in the cache.

    What allocates nothing does without Numba's reference counts (`_nrt=False`), which would cost a third of the time.
    """
    dispatcher = numba.njit(  # type: ignore[call-overload] — the stubs lack `_nrt`
        fastmath=fastmath,
        nogil=True,
        error_model="numpy",
        _nrt=not ours,
        no_cfunc_wrapper=True,
        debug=located,  # so that its code knows the lines that it comes from
    )(function)
    if ours and kept and kernel_cache.root() is not None:
        dispatcher._cache = KernelCache(function)
    return dispatcher


def address_of(function: Callable[..., Any], dispatcher: Any, signature: Any) -> int:
    """Return where the machine code of a dispatcher lies."""
    result = dispatcher.get_compile_result(signature)
    return result.library.get_pointer_to_function(result.fndesc.llvm_func_name)


def bitcode_of(dispatcher: Any, signature: Any) -> tuple[bytes, str]:
    """Return LLVM's code of a dispatcher with all that it calls, also of one from the cache, and its name there."""
    result = dispatcher.get_compile_result(signature)
    return result.library._get_module_for_linking().as_bitcode(), result.fndesc.llvm_func_name


@contextmanager
def scalar_code() -> Iterator[None]:
    """Compile meanwhile for no processor in particular: without vectors, which each target makes for itself."""
    config: Any = numba.config  # type: ignore[attr-defined]
    with global_compiler_lock:
        before = config.LOOP_VECTORIZE, config.SLP_VECTORIZE
        config.LOOP_VECTORIZE = config.SLP_VECTORIZE = 0
        try:
            yield
        finally:
            config.LOOP_VECTORIZE, config.SLP_VECTORIZE = before


class _KernelPart(JITCodeLibrary):
    """Code that becomes part of kernels: by itself it is neither optimised nor made into machine code."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        """Hand the engine no code, only the variable that Numba sets for each function."""
        code = self._final_module
        names = (variable.name for variable in code.global_variables)
        variables = [f'@"{name}" = common global i8* null' for name in names if "NumbaEnv" in name]
        self._final_module = llvmlite.binding.parse_assembly("\n".join(variables))
        super()._finalize_final_module()
        self._final_module = code


class _KernelPartApart(_KernelPart):
    """The same of a function that stays one."""

    def add_ir_module(self, ir_module: Any) -> None:
        for function in ir_module.functions:
            if not function.is_declaration:
                function.attributes.add("noinline")
        super().add_ir_module(ir_module)


class _PartCompiler(Compiler):
    """Compile a function into a `_KernelPart`; otherwise every caller would optimise all below it again."""

    part = _KernelPart

    def define_pipelines(self) -> list[Any]:
        self.state.library = self.part(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        return super().define_pipelines()


class _ApartCompiler(_PartCompiler):
    part = _KernelPartApart


def part_options(*, everywhere: bool, apart: bool = False, ours: bool = True) -> dict[str, Any]:
    """Return the options of a function that becomes part of kernels, of each call of it if ``everywhere``."""
    return {
        "_nrt": not ours,
        "pipeline_class": _ApartCompiler if apart else _PartCompiler,
        "no_cfunc_wrapper": True,
        "no_cpython_wrapper": True,
        "forceinline": everywhere,  # between functions every array is seven numbers on the stack
    }


def _known_as(function: Callable[..., Any], definition: Callable[..., Any]) -> None:
    """Do what `intrinsic` does, for a function that Python can call too."""
    infer_global(function, types.Function(infer(make_intrinsic_template(function, definition, "call"))))


def _caller(signature: Any, emit: Callable[..., Any]) -> Callable[..., Any]:
    def call(function: Callable[..., Any], *arguments: Any) -> Any:
        return function(*arguments)

    def at(typing_context, address, *arguments):
        def generate(context, builder, call, arguments):
            return emit(context, builder, signature.return_type, signature.args, arguments[0], arguments[1:])

        return signature.return_type(types.intp, *signature.args), generate

    names = ["typing_context", "address", *(f"argument{i}" for i in range(len(signature.args)))]
    parameters = [Parameter(name, Parameter.POSITIONAL_ONLY) for name in names]
    at.__signature__ = Signature(parameters)
    _known_as(call, at)
    return call


def caller(signature: Any) -> Callable[..., Any]:
    """Return what calls, in a kernel, the kernel of this signature at an address, and in Python the kernel itself.

    The call goes to the machine code, not to a wrapper that stores all arguments anew.
    """

    def emit(context, builder, result, taken, address, arguments):
        function = context.call_conv.get_function_type(result, taken).as_pointer()
        pointer = builder.inttoptr(address, function)
        # The status is not looked at: no kernel raises.
        _, value = context.call_conv.call_function(builder, pointer, result, taken, arguments)
        return value

    return _caller(signature, emit)


def c_caller(signature: Any) -> Callable[..., Any]:
    """Return what calls, in a kernel, the C function at an address that takes these numbers and returns nothing."""

    def emit(context, builder, result, taken, address, arguments):
        from llvmlite.ir import FunctionType, VoidType

        function = FunctionType(VoidType(), [context.get_value_type(each) for each in taken]).as_pointer()
        builder.call(builder.inttoptr(address, function), arguments)
        return context.get_dummy_value()

    return _caller(signature, emit)


def _moved(builder, source, start):
    """Return the address of a number by arithmetic, of which LLVM does not know where it leads.

    What it knows to lie apart it adds up in another order, and the last digits change.
    """
    address = builder.ptrtoint(source.data, start.type)
    return builder.inttoptr(builder.add(address, builder.mul(start, source.itemsize)), source.data.type)


def _part(context, builder, call, source, start, shape):
    """Return the numbers of a contiguous array from a place on, in C order, without a look at their count."""
    from numba.core.imputils import impl_ret_borrowed  # neither before the first compilation
    from numba.np.arrayobj import make_array, populate_array

    source = make_array(call.args[0])(context, builder, source)
    found = make_array(call.return_type)(context, builder)
    strides = [source.itemsize]
    for size in reversed(shape[1:]):
        strides.insert(0, builder.mul(size, strides[0]))
    populate_array(
        found,
        data=source.data if start is None else _moved(builder, source, start),
        shape=shape,
        strides=strides,
        itemsize=source.itemsize,
        meminfo=source.meminfo,
        parent=source.parent,
    )
    return impl_ret_borrowed(context, builder, call.return_type, found._getvalue())


def _matrix(typing_context, array, rows, columns):
    def generate(context, builder, call, arguments):
        source, *shape = arguments
        return _part(context, builder, call, source, None, shape)

    return array.copy(ndim=2)(array, types.intp, types.intp), generate


def _row(typing_context, array, start, count):
    def generate(context, builder, call, arguments):
        source, start, count = arguments
        return _part(context, builder, call, source, start, [count])

    return array.copy(ndim=1)(array, types.intp, types.intp), generate


def stack_array(count: int) -> Callable[[], Any]:
    """Return what makes, in a kernel, an array of so many numbers on the stack, and in Python a new one."""

    def make() -> Any:
        return np.empty(count)

    def on_stack(typing_context):
        def generate(context, builder, call, arguments):
            from numba.core import cgutils
            from numba.np.arrayobj import make_array, populate_array

            size = context.get_constant(types.intp, count)
            width = context.get_constant(types.intp, 8)
            numbers = cgutils.alloca_once(builder, context.get_value_type(types.float64), size=size)
            found = make_array(call.return_type)(context, builder)
            populate_array(
                found, data=numbers, shape=[size], strides=[width], itemsize=width, meminfo=None, parent=None
            )
            return found._getvalue()

        return types.Array(types.float64, 1, "C")(), generate

    _known_as(make, on_stack)
    return make


def define_as_matrix(as_matrix: Callable[..., Any]) -> None:
    """Let kernels call this function; ``reshape``, which checks, takes 10 ns more."""
    _known_as(as_matrix, _matrix)


def define_as_row(as_row: Callable[..., Any]) -> None:
    """Let kernels call this function; a slice, which compares with the array's size, takes a dozen instructions."""
    _known_as(as_row, _row)


class _Locator(_CacheLocator):  # Numba's methods, being abstract, are taken to return None
    def __init__(self, function: Callable[..., Any]) -> None:
        self._module, self._line = function.__module__, function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> _Locator:
        return cls(py_func)

    def get_cache_path(self) -> str:  # type: ignore[override]
        return str(kernel_cache.module_folder(self._module))

    def get_source_stamp(self) -> str:  # type: ignore[override]
        return kernel_cache.source_hash(self._module)

    def get_disambiguator(self) -> str:  # type: ignore[override]
        return str(self._line)


class _Implementation(CompileResultCacheImpl):
    _locator_classes = [_Locator]


class _SealedFiles(IndexDataCacheFile):
    """Numba's files of one function with a digest each: one that does not fit counts as none, and is written anew."""

    def _load_index(self) -> dict[Any, str]:
        content = io.BytesIO(kernel_cache.unsealed(self._index_path) or b"")
        if not content.getbuffer().nbytes or pickle.load(content) != self._version:
            return {}
        stamp, overloads = pickle.load(content)
        return overloads if stamp == self._source_stamp else {}

    def _load_data(self, name: str) -> Any:
        content = kernel_cache.unsealed(self._data_path(name))
        if content is None:
            raise OSError(f"{name}: damaged")  # as a file that is not there
        return pickle.loads(content)

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[io.BytesIO]:  # type: ignore[override]
        content = io.BytesIO()
        yield content
        with super()._open_for_write(filepath) as file:
            file.write(kernel_cache.sealed(content.getvalue()))


class KernelCache(FunctionCache):
    """Numba's cache of one function, in the folder of the function's module."""

    _impl_class = _Implementation

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        stamp = self._impl.locator.get_source_stamp()
        self._cache_file = _SealedFiles(self._cache_path, self._impl.filename_base, stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load a kernel's machine code alone: what Numba loads beside it is for compiling, and takes 0.4 s."""
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a kernel; one that a full disk cannot keep is compiled anew in the next process."""
        try:
            super().save_overload(sig, data)
        except OSError:
            kernel_cache.warn_unwritable()
