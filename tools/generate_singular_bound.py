"""Write src/dqcontrol/robots/kinematics/singular_bound.py: elimination in J Jᵀ − s² of six rows, as straight lines."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

TARGET = Path(__file__).parent.parent / "src/dqcontrol/robots/kinematics/singular_bound.py"
SIZE = 6
HALF = 3  # rows of a block: the sums of one block fit into the registers of a processor

HEADER = '''"""Bound on how near a Jacobian is to singular. Written by tools/generate_singular_bound.py."""

from __future__ import annotations

from dqcontrol.compiled.compile import inline

_ROUNDING = 1e-12  # share of tr J Jᵀ that elimination may err by, and more


@inline
def exceeds(jacobian, least):
    """Return True only if all singular values of a J of six rows are greater than ``least``; False near it too.

    They are if J Jᵀ − s² is positive definite: if all pivots of its elimination are positive. Each row is multiplied by
    the pivot where others divide by it, which changes no sign; six divisions one after the other take as long as all.
    """
'''


def lines() -> Iterator[str]:
    """Yield the body of the function."""
    low, high = range(HALF), range(HALF, SIZE)
    for columns, rows in ((low, low), (low, high), (high, high)):
        first = [(i, j) for i in rows for j in columns if j <= i]
        yield f"{', '.join(f'g{i}{j}' for i, j in first)} = {', '.join('0.0' for _ in first)}"
        yield "for c in range(jacobian.shape[1]):"
        yield from (f"    a{i} = jacobian[{i}, c]" for i in sorted({i for pair in first for i in pair}))
        yield from (f"    g{i}{j} += a{i} * a{j}" for i, j in first)
    yield f"shift = max(least * least, _ROUNDING * ({' + '.join(f'g{i}{i}' for i in range(SIZE))}))"
    yield from (f"g{i}{i} -= shift" for i in range(SIZE))
    for k in range(SIZE - 1):
        yield f"if not g{k}{k} > 0.0:"
        yield "    return False"
        for i in range(k + 1, SIZE):
            yield from (f"g{i}{j} = g{k}{k} * g{i}{j} - g{i}{k} * g{j}{k}" for j in range(k + 1, i + 1))
    yield f"return g{SIZE - 1}{SIZE - 1} > 0.0"


def source() -> str:
    """Return the whole file."""
    return HEADER + "".join(f"    {line}\n" for line in lines())


if __name__ == "__main__":
    TARGET.write_text(source(), encoding="utf-8")
    sys.exit(0)
