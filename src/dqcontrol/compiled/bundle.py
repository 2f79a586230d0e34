"""Arrays by name as one argument of a kernel."""

from __future__ import annotations

from typing import Any, Generic, TypeVar, get_type_hints

import numpy as np
from numba import types

Fields = TypeVar("Fields", bound=tuple[Any, ...])


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
