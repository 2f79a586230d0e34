"""Flat memory by name: a layout is declared once, and takes arrays apart in Python and in kernels."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cached_property, lru_cache
from math import prod
from typing import Annotated, Any, Generic, TypeVar, get_type_hints  # noqa: F401 — Annotated for the example

import numpy as np
from numba import types
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import written_by
from dqcontrol.compiled.intrinsics import as_matrix, as_row

Fields = TypeVar("Fields", bound=tuple[Any, ...])

_Size = int | tuple[Any, ...]  # a number, or a tuple whose fields sizes are
_REST = "rest"  # in place of ``...``


class MemoryLayout(Generic[Fields]):
    """Where the numbers of a flat array stand, in the order of a named tuple's fields.

    Called with an array and the sizes that the layout depends on, it returns the tuple of its parts. Kernels call it
    too, and have the machine code of slices that are written out.

    Parameters
    ----------
    fields
        A `typing.NamedTuple` whose fields are declared as ``float`` or ``int``, a number that is read at once, as
        ``Annotated[Array, size]``, numbers in a row, or as ``Annotated[Array, rows, columns]``. What is written to is
        an array, also if it is one number. Sizes are whole numbers, or expressions in the names below; the last field
        may have ``...`` as size or number of rows, and is then what is left.
    sizes
        Names of the sizes that are not known before, or of a tuple that has them as fields: ``"given.n"`` is a size if
        ``"given"`` stands here.
    unchecked
        Kernels take the parts without a comparison with the array's size, which costs a dozen instructions for each.
        LLVM may then take sums over parts in another order: compare results when a layout gets it.

    Examples
    --------
    >>> from typing import Annotated, NamedTuple
    >>> class Spring(NamedTuple):
    ...     stiffness: float
    ...     rest: Annotated[Array, "n"]
    ...     rows: Annotated[Array, 2, "n + 1"]
    >>> spring = MemoryLayout(Spring, "n")
    >>> memory = spring.pack(stiffness=5.0, rest=[1.0, 2.0], rows=np.zeros((2, 3)))
    >>> memory.size == spring.size(2)
    True
    >>> spring(memory, 2).rest
    array([1., 2.])
    """

    def __init__(self, fields: type[Fields], *sizes: str, unchecked: bool = False) -> None:
        self.fields = fields
        self.sizes: tuple[str, ...] = sizes
        self.__name__: str = fields.__name__
        self._unchecked = unchecked
        # asked for again and again with the same sizes
        self._places, self._size_of = lru_cache(self._parts_of), lru_cache(self._size)
        self._place_of = lru_cache(self._place)
        written_by(self, lambda: self._taken_apart)

    @cached_property
    def _shapes(self) -> dict[str, tuple[int | str, ...]]:
        """Of the fields by name; found on first use, as all else of a layout: most programs need few of them."""
        hints = get_type_hints(self.fields, include_extras=True)
        return {
            name: tuple(_REST if size is ... else size for size in getattr(hint, "__metadata__", ()))
            for name, hint in hints.items()
        }

    @cached_property
    def _whole(self) -> set[int]:
        """Places of the fields that are whole numbers."""
        return {k for k, hint in enumerate(get_type_hints(self.fields).values()) if hint is int}

    @cached_property
    def _has_rest(self) -> bool:
        return any(_REST in shape for shape in self._shapes.values())

    @cached_property
    def _known_shapes(self) -> Callable[..., tuple[tuple[int, ...], ...]]:
        listed = ", ".join(f"({''.join(f'{size}, ' for size in shape)})" for shape in self._shapes.values())
        return eval(f"lambda {', '.join([*self.sizes, _REST])}: ({listed},)")

    @cached_property
    def _ranks(self) -> list[int]:
        return [len(shape) for shape in self._shapes.values()]

    def __call__(self, memory: Array, *sizes: _Size) -> Fields:
        """Return the parts of an array by name; of rows of such arrays, columns, shape (…, size)."""
        lead, parts = memory.shape[:-1], []
        for place, shape in self._places(memory.shape[-1] if self._has_rest else 0, *sizes):
            part = memory[..., place] if lead else memory[place]
            parts.append(part.reshape(*lead, *shape) if len(shape) > 1 else part)
        for k in () if lead else self._whole:
            parts[k] = int(parts[k])
        return self.fields(*parts)

    def _parts_of(self, length: int, *sizes: _Size) -> list[tuple[int | slice, tuple[int, ...]]]:
        """Return where each part of an array of this length is, and its shape."""
        *before, last = self._known_shapes(*sizes, 1)
        if self._has_rest:
            left = (length - sum(map(prod, before))) // max(prod(last), 1)
            *before, last = self._known_shapes(*sizes, left)
        found, place = [], 0
        for shape in (*before, last):
            size = prod(shape)
            found.append((slice(place, place + size) if shape else place, shape))
            place += size
        return found

    def _size(self, *sizes: _Size) -> int:
        return sum(prod(shape) for shape in self._known_shapes(*sizes, 0))

    def size(self, *sizes: _Size) -> int:
        """Return how many numbers it has, without a field that is what is left."""
        return self._size_of(*sizes)

    def sized(self, *sizes: str) -> str:
        """Return its size as an expression in these sizes, for a layout that has it as a part."""
        given = dict(zip(self.sizes, sizes, strict=True))
        whole = " + ".join(_product(shape) for shape in self._shapes.values())
        return re.sub(r"(?<![\w.])[a-z_]\w*", lambda found: f"({given[found[0]]})", whole)

    def place(self, name: str, *sizes: _Size) -> int:
        """Return where the numbers of a field begin."""
        return self._place_of(name, *sizes)

    def _place(self, name: str, *sizes: _Size) -> int:
        before = list(self._shapes).index(name)
        return sum(prod(shape) for shape in self._known_shapes(*sizes, 0)[:before])

    def pack(self, **values: ArrayLike) -> Array:
        """Return an array, or rows of arrays, shape (…, size), that have these values by name."""
        if values.keys() != self._shapes.keys():
            raise TypeError(f"{self.__name__}: expected {', '.join(self._shapes)}, got {', '.join(values)}")
        arrays = [np.asarray(values[name], dtype=np.float64) for name in self._shapes]
        leads = [array.ndim - rank for array, rank in zip(arrays, self._ranks, strict=True)]
        if not any(leads):
            return np.concatenate(arrays, axis=None)
        parts = [
            array.reshape(*array.shape[:lead], prod(array.shape[lead:]))
            for array, lead in zip(arrays, leads, strict=True)
        ]
        given = {part.shape[:-1] for part in parts} - {()}
        rows = given.pop() if len(given) == 1 else np.broadcast_shapes(*given)
        whole, place = np.empty((*rows, sum(part.shape[-1] for part in parts))), 0
        for part in parts:
            whole[..., place : place + part.shape[-1]] = part
            place += part.shape[-1]
        return whole

    @cached_property
    def _taken_apart(self) -> Any:
        """Write the function that takes an array apart in kernels, which cannot loop over fields."""
        lines, parts, place = [f"def taken_apart({', '.join(['memory', *self.sizes])}):"], [], "0"
        for k, shape in enumerate(self._shapes.values()):
            if _REST in shape:
                _, *columns = shape
                lines.append(f"    {_REST} = (memory.shape[0] - {place}) // {_product(tuple(columns))}")
            if not shape:
                parts.append(f"int(memory[{place}])" if k in self._whole else f"memory[{place}]")
            else:
                size = _product(shape)
                row = (
                    f"as_row(memory, {place}, {size})"
                    if self._unchecked
                    else f"memory[{place} : {place} + {size}]"
                )
                parts.append(row if len(shape) == 1 else f"as_matrix({row}, {', '.join(map(str, shape))})")
            lines.append(f"    place{k} = {place} + {_product(shape)}")
            place = f"place{k}"
        lines.append(f"    return fields({', '.join(parts)})")
        names = {"fields": self.fields, "as_matrix": as_matrix, "as_row": as_row}
        exec("\n".join(lines), names)
        return names["taken_apart"]


def _product(shape: tuple[int | str, ...]) -> str:
    return " * ".join(f"({size})" for size in shape) or "1"


class Bundle(Generic[Fields]):
    """A named tuple that kernels take as one argument; from Python that costs some µs, so once a run, not a step.

    Called with values by name it returns the tuple. Numba converts nothing within tuples, so arrays that kernels only
    read are marked as such first.

    Parameters
    ----------
    fields
        A `typing.NamedTuple` whose fields are declared as ``Annotated[Array, READ]`` and the like, with their type in
        kernels.

    Attributes
    ----------
    type
        Its type, for signatures.
    """

    def __init__(self, fields: type[Fields]) -> None:
        hints = get_type_hints(fields, include_extras=True)
        of_each = tuple(hint.__metadata__[0] for hint in hints.values())
        self._only_read = [
            name
            for name, kind in zip(hints, of_each, strict=True)
            if isinstance(kind, types.Array) and not kind.mutable
        ]
        is_uniform = len(set(of_each)) == 1
        self.type: Any = (
            types.NamedUniTuple(of_each[0], len(of_each), fields)
            if is_uniform
            else types.NamedTuple(of_each, fields)
        )
        self._fields = fields

    def __call__(self, **values: Any) -> Fields:
        """Return the tuple of these values."""
        for name in self._only_read:
            values[name] = _only_read(values[name])
        return self._fields(**values)


def _only_read(value: Any) -> Any:
    view = np.ascontiguousarray(value).view()
    view.flags.writeable = False
    return view
