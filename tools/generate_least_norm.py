"""Write src/dqcontrol/laws/least_norm.py: a 6 × 6 Cholesky solution as straight lines, twice as fast as loops."""

from __future__ import annotations

import sys
from pathlib import Path

TARGET = Path(__file__).parent.parent / "src/dqcontrol/laws/least_norm.py"
SIZE = 6

HEADER = '''"""The smallest inputs that give the hand a twist. Written by tools/generate_least_norm.py."""

from __future__ import annotations

from dqcontrol.compiled.compile import inline
from dqcontrol.laws.growth import curvature, square_bound


@inline
def least_norm(
    twist_jacobian, px, py, pz, y, z, error, growth, square_length, linear_limit, linear_damping, out
):
    """Write u = z + J_hᵀ G⁻¹ (y − J_h z), G = J_h J_hᵀ + W, and return 0; −1 where tr L G⁻¹ > 1: then u is not written.

    Where the error's curvature asks for damping, that is returned, and u is not written either.

    J_h is the Jacobian of [ω ; ṗ]: the twist Jacobian moved from the inertial origin to the hand's position p. W and L
    are diagonal, one number for ṗ, and for ω that by ℓ². The trace bounds from above what L⁻¹ᐟ² J_h has as 1/σ²min;
    G = L D Lᵀ, with 1/D in place of D.
    """
    n = twist_jacobian.shape[1]
    angular_limit, angular_damping = linear_limit / square_length, linear_damping / square_length
'''


def lines() -> list[str]:
    """Return the body of the function."""
    text: list[str] = []
    text += damping_lines()
    text.append("y0, y1, y2, y3, y4, y5 = y[0], y[1], y[2], y[3], y[4], y[5]")
    text.append("for c in range(n):")
    text.append("    a0, a1, a2 = twist_jacobian[0, c], twist_jacobian[1, c], twist_jacobian[2, c]")
    text.append("    a3 = twist_jacobian[3, c] - py * a2 + pz * a1")
    text.append("    a4 = twist_jacobian[4, c] - pz * a0 + px * a2")
    text.append("    a5 = twist_jacobian[5, c] - px * a1 + py * a0")
    for i in range(SIZE):
        text.append(f"    y{i} -= z[c] * a{i}")
        text += [f"    g{i}{j} += a{i} * a{j}" for j in range(i + 1)]
    for name, first in (("turning", 0), ("moving", 3)):
        text.append(f"{name} = " + " + ".join(f"g{i}{i}" for i in range(first, first + 3)))
    for j in range(SIZE):  # L D Lᵀ: row j of L in its place, 1/D on the diagonal
        text += [f"c{k} = g{j}{k}" for k in range(j)]
        text += [f"g{j}{k} = c{k} * g{k}{k}" for k in range(j)]
        text.append(f"pivot = g{j}{j}" + "".join(f" - c{k} * g{j}{k}" for k in range(j)))
        text += ["if not pivot > 1e-14:", "    return -1.0", f"g{j}{j} = 1.0 / pivot"]
        for i in range(j + 1, SIZE):
            terms = "".join(f" - g{i}{k} * g{j}{k}" for k in range(j))
            text += [f"g{i}{j} = g{i}{j}{terms}"] if j else []
    text += ["if linear_limit > 0.0:", *(f"    {line}" for line in trace_test())]
    for i in range(1, SIZE):
        text.append(f"y{i} = y{i}" + "".join(f" - g{i}{k} * y{k}" for k in range(i)))
    for i in reversed(range(SIZE)):
        text.append(f"y{i} = y{i} * g{i}{i}" + "".join(f" - g{k}{i} * y{k}" for k in range(i + 1, SIZE)))
    text += ["y0 += py * y5 - pz * y4", "y1 += pz * y3 - px * y5", "y2 += px * y4 - py * y3"]
    text.append("for c in range(n):")
    text += ["    out[c] = (", "        z[c]"]
    text += [f"        + twist_jacobian[{i}, c] * y{i}" for i in range(SIZE)]
    text += ["    )", "return 0.0"]
    return text


def damping_lines() -> list[str]:
    """Return the start of the sums: the lower triangle of W."""
    diagonal = ["angular_damping"] * 3 + ["linear_damping"] * 3
    return [f"g{i}{j} = {diagonal[i] if i == j else 0.0}" for i in range(SIZE) for j in range(i + 1)]


def trace_test() -> list[str]:
    """Return what compares tr L (L D Lᵀ)⁻¹ with 1, and 1/tr G⁻¹ with the damping that the curvature asks for."""
    names = ["angular"] * 3 + ["linear"] * 3
    text = [
        f"{name} = " + " + ".join(f"g{j}{j}" for j in range(first, first + 3))
        for name, first in (("angular", 0), ("linear", 3))
    ]
    for j in range(SIZE):  # column j of L⁻¹
        for i in range(j + 1, SIZE):
            terms = "".join(f" - g{i}{k} * h{k}{j}" for k in range(j + 1, i))
            text.append(f"h{i}{j} = -g{i}{j}{terms}")
        if j < SIZE - 1:
            terms = " + ".join(f"h{i}{j} * h{i}{j} * g{i}{i}" for i in range(j + 1, SIZE))
            text.append(f"{names[j]} += {terms}")
    return [
        *text,
        "if not angular * angular_limit + linear * linear_limit <= 1.0:",
        "    return -1.0",
        "trace = growth * (angular / square_length + linear)",
        "if square_bound(error, square_length, turning, moving) * trace * trace > 1.0:",
        "    missing = growth * (curvature(twist_jacobian, px, py, pz, error, square_length) - 1.0 / trace)",
        "    if missing > 0.0:",
        "        return missing",
    ]


def generate() -> str:
    """Return the module's text."""
    return HEADER + "".join(f"    {line}\n" for line in lines())


if __name__ == "__main__":
    TARGET.write_text(generate(), encoding="utf-8")
    print(TARGET, file=sys.stderr)
