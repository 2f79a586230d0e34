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
        self._types = {name: hint.__metadata__[0] for name, hint in hints.items()}
        of_each = tuple(self._types.values())
        is_uniform = len(set(of_each)) == 1
        self.type: Any = (
            types.NamedUniTuple(of_each[0], len(of_each), fields)
            if is_uniform
            else types.NamedTuple(of_each, fields)
        )
        self._fields = fields

    def __call__(self, **values: Any) -> Fields:
        """Return the tuple of these values."""
        return self._fields(**{name: _marked(value, self._types[name]) for name, value in values.items()})


def _marked(value: Any, kind: Any) -> Any:
    if not isinstance(kind, types.Array) or kind.mutable:
        return value
    view = np.ascontiguousarray(value).view()
    view.flags.writeable = False
    return view
