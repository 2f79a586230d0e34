"""Kernels as object files that C links, for this processor and others.

LLVM's code of each kernel is taken whole, all names in it but its own are made private, and what is then unused goes:
with it everything that Python needs to call it. So an object knows nothing of Python and Numba.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from numba import types

from dqcontrol.arrays import Array
from dqcontrol.compiled import kernel_cache
from dqcontrol.compiled.compile import Kernel
from dqcontrol.errors import Error, unknown_name
from dqcontrol.files.output_file import whole_file

# What compiled code may ask of the libraries of C.
OF_C = frozenset(
    "memcpy memmove memset acos asin atan atan2 cbrt ceil copysign cos exp expm1 fabs floor fma fmax fmin fmod "  # noqa: SIM905
    "hypot log log1p nearbyint pow rint round sin sincos sqrt tan tanh trunc".split()
)
_FASTEST = 3  # level of optimisation
_KEPT = 100  # objects


@dataclass(frozen=True)
class TargetProcessor:
    """A processor and the conventions of its programs.

    Attributes
    ----------
    name
        As users say it.
    triple, cpu, features, abi
        As LLVM says it; all empty for the processor that this runs on.
    has_vectors
        Whether loops become vectors.
    compiler
        C compiler, as Debian names it.
    flags
        Its flags for this processor.
    runner
        What runs its programs here; empty if nothing does.
    flash, memory
        Most bytes of code and constants, and of a controller, that such processors usually have; 0: no bound.
    """

    name: str
    triple: str = ""
    cpu: str = ""
    features: str = ""
    abi: str = ""
    has_vectors: bool = True
    compiler: str = "cc"
    flags: str = ""
    runner: str = ""
    flash: int = 0
    memory: int = 0

    @property
    def is_native(self) -> bool:
        """Whether it is the processor that this runs on, so that results are equal to the last bit."""
        return not self.triple

    @property
    def is_bare(self) -> bool:
        """Whether there is no operating system."""
        return self.triple.endswith("-none-eabihf")


_CORTEX = {
    "triple": "thumbv7em-none-eabihf",
    "has_vectors": False,
    "compiler": "arm-none-eabi-gcc",
    "flash": 1 << 20,
    "memory": 128 << 10,
}
TARGETS: dict[str, TargetProcessor] = {
    target.name: target
    for target in (
        TargetProcessor("native"),
        TargetProcessor("x86-64-v2", "x86_64-unknown-linux-gnu", "x86-64-v2", flags="-march=x86-64-v2"),
        TargetProcessor("x86-64-v3", "x86_64-unknown-linux-gnu", "x86-64-v3", flags="-march=x86-64-v3"),
        TargetProcessor(
            "aarch64",
            "aarch64-unknown-linux-gnu",
            "generic",
            compiler="aarch64-linux-gnu-gcc",
            runner="qemu-aarch64 -L /usr/aarch64-linux-gnu",
        ),
        TargetProcessor(
            "armv7",
            "armv7-unknown-linux-gnueabihf",
            "generic",
            "+v7,+vfp3",
            has_vectors=False,
            compiler="arm-linux-gnueabihf-gcc",
            runner="qemu-arm -L /usr/arm-linux-gnueabihf",
        ),
        TargetProcessor(
            "riscv64",
            "riscv64-unknown-linux-gnu",
            "generic-rv64",
            "+m,+a,+f,+d,+c",
            "lp64d",
            has_vectors=False,
            compiler="riscv64-linux-gnu-gcc",
            runner="qemu-riscv64 -L /usr/riscv64-linux-gnu",
        ),
        TargetProcessor(
            "cortex-m4f",
            cpu="cortex-m4",
            flags="-mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16",
            **_CORTEX,
        ),
        TargetProcessor(
            "cortex-m7",
            cpu="cortex-m7",
            flags="-mcpu=cortex-m7 -mthumb -mfloat-abi=hard -mfpu=fpv5-d16",
            **_CORTEX,
        ),
    )
}


def target_named(name: str) -> TargetProcessor:
    """Return a target.

    Raises
    ------
    UnknownNameError
        If there is none of that name.
    Error
        If LLVM as it is installed makes no code for it.
    """
    if name not in TARGETS:
        raise unknown_name("target", name, TARGETS)
    target = TARGETS[name]
    try:
        _llvm_target(target)
    except RuntimeError:
        missing = (
            f"LLVM {'.'.join(map(str, llvm.llvm_version_info))} as llvmlite brings it makes no code for it"
        )
        raise Error(f"target: {name}: {missing}; use another") from None
    return target


@functools.cache
def _initialise() -> None:
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()


def _llvm_target(target: TargetProcessor) -> Any:
    _initialise()
    return llvm.Target.from_triple(target.triple or llvm.get_process_triple())


@functools.cache
def _machine(target: TargetProcessor) -> Any:
    cpu, features = target.cpu, target.features
    if target.is_native:
        cpu, features = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
    return _llvm_target(target).create_target_machine(
        cpu=cpu,
        features=features,
        opt=_FASTEST,
        reloc="static" if target.is_bare else "pic",
        codemodel="default",
        abiname=target.abi,
    )


def isolated(kernel: Kernel, symbol: str, target: TargetProcessor) -> Any:
    """Return a kernel as a module of LLVM's that defines nothing for others but this symbol."""
    _initialise()
    code, name = kernel.bitcode(portable=not target.is_native)
    return isolated_code(code, name, symbol, target)


def isolated_code(code: bytes, name: str, symbol: str, target: TargetProcessor) -> Any:
    """Return LLVM's code of a function as `isolated` does."""
    module = llvm.parse_bitcode(code)
    for function in module.functions:
        if not function.is_declaration:
            function.linkage = "external" if function.name == name else "internal"
    for variable in module.global_variables:
        if not variable.is_declaration:
            variable.linkage = "internal"
    module.get_function(name).name = symbol
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.add_strip_dead_prototype_pass()
    passes.run(module, llvm.create_pass_builder(_machine(target), _options()))
    return module


def foreign_symbols(module: Any) -> list[str]:
    """Return the names that a module asks for and no library of C has."""
    declared = [function.name for function in module.functions if function.is_declaration]
    declared += [variable.name for variable in module.global_variables if variable.is_declaration]
    return sorted(name for name in declared if not name.startswith("llvm.") and name not in OF_C)


def code_object(kernels: Mapping[str, Kernel], target: TargetProcessor) -> bytes:
    """Return an object file with kernels under these names; kept, as it takes seconds, if they are all ours.

    Raises
    ------
    Error
        If a kernel needs something that no library of C has.
    """
    kept = _kept_object(kernels, target)
    if kept is not None and (found := kernel_cache.unsealed(kept)) is not None:
        return found
    _initialise()
    whole = llvm.parse_assembly("")
    for symbol, kernel in kernels.items():
        module = isolated(kernel, symbol, target)
        if foreign := foreign_symbols(module):
            raise Error(f"export: {kernel.__name__} needs {', '.join(foreign)}, which only Python has")
        whole.link_in(module)
    machine = _machine(target)
    if not target.is_native:  # what is native is optimised already, and changing it would change last bits
        whole.triple, whole.data_layout = target.triple, str(machine.target_data)
        passes = llvm.create_pass_builder(machine, _options(target.has_vectors))
        passes.getModulePassManager().run(whole, passes)
    code = machine.emit_object(whole)
    if kept is not None:
        _keep(code, kept)
    return code


def _kept_object(kernels: Mapping[str, Kernel], target: TargetProcessor) -> Path | None:
    """Return where the object of kernels is kept; None if they are not all ours, or nothing can be kept."""
    if kernel_cache.root() is None or not all(type(kernel) is Kernel for kernel in kernels.values()):
        return None
    digest = hashlib.sha256(f"{target!r} {llvm.llvm_version_info} {llvm.get_host_cpu_name()}".encode())
    digest.update(kernel_cache.source_hash(__name__).encode())
    for symbol, kernel in kernels.items():
        module = kernel.function.__module__
        digest.update(f"{symbol} {module} {kernel.__name__} {kernel_cache.source_hash(module)}".encode())
    return _objects() / f"{digest.hexdigest()[:16]}.o"


def _objects() -> Path:
    """Return the folder that keeps objects."""
    return (kernel_cache.root() or Path()) / "objects"


def _keep(code: bytes, path: Path) -> None:
    with suppress(OSError):
        path.parent.mkdir(exist_ok=True)
        for old in sorted(path.parent.glob("*.o"), key=lambda each: each.stat().st_mtime)[:-_KEPT]:
            old.unlink(missing_ok=True)
        with whole_file(path, overwrite=True) as draft:
            draft.write_bytes(kernel_cache.sealed(code))


def constants_object(data: Mapping[str, Array], target: TargetProcessor) -> bytes:
    """Return an object file with constant arrays under these names."""
    machine = _machine(target)
    module = llvm.parse_assembly("\n".join(_constant(name, array) for name, array in data.items()))
    module.triple, module.data_layout = target.triple or llvm.get_process_triple(), str(machine.target_data)
    return machine.emit_object(module)


def _options(has_vectors: bool = False) -> Any:
    options = llvm.create_pipeline_tuning_options(speed_level=_FASTEST)
    options.loop_vectorization = options.slp_vectorization = has_vectors
    return options


def _constant(name: str, array: Array) -> str:
    """Return numbers as a constant of LLVM's language: as bytes, which it reads ten times faster than numbers."""
    content = np.ascontiguousarray(array, dtype="<f8").tobytes()
    text = "\\" * bool(content) + content.hex("\\")
    return f'@{name} = constant [{len(content)} x i8] c"{text}", align 8'


def section_sizes(code: bytes) -> dict[str, int]:
    """Return the bytes of each section of an object file."""
    found = llvm.ObjectFileRef.from_data(code)
    return {(section.name() or b"").decode(): section.size() for section in found.sections()}


_C_TYPES = {types.float64: "double", types.int64: "int64_t"}


def prototype(symbol: str, signature: Any) -> str:
    """Return a kernel as C declares it: of arrays it takes seven words, nine if they have rows.

    It returns 0, or else what no kernel of ours does: that it raised; the result goes to where its first word points.
    """
    words = ["int64_t *result", "void **raised"]
    for kind in signature.args:
        if not isinstance(kind, types.Array):
            words.append(_C_TYPES[kind])
            continue
        const = "" if kind.mutable else "const "
        pointer = f"{const}{_C_TYPES[kind.dtype]} *"
        words += ["void *", "void *", "int64_t", "int64_t", pointer, *["int64_t"] * (2 * kind.ndim)]
    return f"int32_t {symbol}({', '.join(words)});"
