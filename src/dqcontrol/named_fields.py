"""A `msgspec.Struct` whose fields are given by name, and that says in plain words when they are not."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import msgspec

from dqcontrol.errors import suggest

if TYPE_CHECKING:
    from msgspec import Struct as NamedFields
else:

    class _NamedFieldsType(type(msgspec.Struct)):
        def __call__(cls, *positional: Any, **named: Any) -> Any:
            """Make an object; a wrong, missing or nameless field is a `TypeError` that lists those there are."""
            try:
                return super().__call__(*positional, **named)
            except TypeError:
                if fault := _fault(cls, positional, named):
                    raise TypeError(fault) from None
                raise

    def _fault(cls: Any, positional: tuple[Any, ...], named: dict[str, Any]) -> str:
        """Say what is wrong with how fields are given; nothing if that is not it."""
        required = [each.name for each in msgspec.structs.fields(cls) if each.required]
        names = sorted(cls.__struct_fields__, key=required.__contains__, reverse=True)
        listed = f" ({cls.__name__} has: {', '.join(names) or 'none'})"
        if positional:
            given = f"{cls.__name__}({names[0]}={positional[0]!r:.40})" if names else f"{cls.__name__}()"
            return f"{cls.__name__}({positional[0]!r:.40}): give parameters by name, as {given}{listed}"
        for name in named:
            if name not in names:
                return f"{cls.__name__}: unknown parameter '{name}'{suggest(name, names)}{listed}"
        missing = [name for name in required if name not in named]
        return f"{cls.__name__}: give {' and '.join(missing)}{listed}" if missing else ""

    class NamedFields(msgspec.Struct, metaclass=_NamedFieldsType):
        """Base of the public data classes whose fields have names only."""
