"""Write src/dqcontrol/robots/singular_bound.py: tr (J Jᵀ)⁻¹ of six rows as straight lines, thrice as fast as loops."""

from __future__ import annotations

import sys
from pathlib import Path

TARGET = Path(__file__).parent.parent / "src/dqcontrol/robots/singular_bound.py"
SIZE = 6

HEADER = '''"""How singular a Jacobian may be at most. Written by tools/generate_singular_bound.py."""

from __future__ import annotations

import math

from dqcontrol.compiled.compile import inline

_DEFINITE = 1e-14


@inline
def singular_bound(jacobian):
    """Return 1/√tr (J Jᵀ)⁻¹ of a J of six rows, a lower bound of its smallest singular value; 0 without full rank.

    J Jᵀ = L D Lᵀ, with 1/D in place of D; the trace is that of L⁻ᵀ D⁻¹ L⁻¹.
    """
'''


def lines() -> list[str]:
    """Return the body of the function."""
    rows = range(SIZE)
    text = [
        f"{', '.join(f'g{i}{j}' for j in range(i + 1))} = {', '.join('0.0' for _ in range(i + 1))}"
        for i in rows
    ]
    text[0] = "g00 = 0.0"
    text += ["for c in range(jacobian.shape[1]):"]
    text += [f"    a{i} = jacobian[{i}, c]" for i in rows]
    text += [f"    g{i}{j} += a{i} * a{j}" for i in rows for j in range(i + 1)]
    for j in rows:
        text.append(f"d{j} = g{j}{j}" + "".join(f" - l{j}{k} * m{j}{k}" for k in range(j)))
        text.append(f"if not d{j} > _DEFINITE:")
        text.append("    return 0.0")
        text.append(f"d{j} = 1.0 / d{j}")
        for i in range(j + 1, SIZE):
            text.append(f"m{i}{j} = g{i}{j}" + "".join(f" - l{i}{k} * m{j}{k}" for k in range(j)))
            text.append(f"l{i}{j} = m{i}{j} * d{j}")
    text.append(f"total = {' + '.join(f'd{j}' for j in rows)}")
    for j in rows:
        for i in range(j + 1, SIZE):
            inner = "".join(f" - l{i}{k} * n{k}{j}" for k in range(j + 1, i))
            text.append(f"n{i}{j} = -l{i}{j}{inner}")
            text.append(f"total += n{i}{j} * n{i}{j} * d{i}")
    text.append("return 1.0 / math.sqrt(total)")
    return text


def source() -> str:
    """Return the whole file."""
    return HEADER + "".join(f"    {line}\n" for line in lines())


if __name__ == "__main__":
    TARGET.write_text(source(), encoding="utf-8")
    sys.exit(0)
