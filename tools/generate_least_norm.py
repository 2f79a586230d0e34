"""Write src/dqcontrol/laws/least_norm.py: a 6 × 6 Cholesky solution as straight lines, twice as fast as loops."""

from __future__ import annotations

import sys
from pathlib import Path

TARGET = Path(__file__).parent.parent / "src/dqcontrol/laws/least_norm.py"
SIZE = 6

HEADER = '''"""The smallest inputs that give the end effector a twist. Written by tools/generate_least_norm.py."""

from __future__ import annotations

from dqcontrol.compiled.compile import inline
from dqcontrol.laws.growth import curvature, square_bound


@inline
def least_norm(
    twist_jacobian,
    px,
    py,
    pz,
    y,
    z,
    error,
    growth,
    square_length,
    linear_limit,
    vanishing,
    linear_damping,
    out,
):
    """Write u = z + J_hᵀ G⁻¹ (y − J_h z), G = J_h J_hᵀ + W, and return True; return False where tr L G⁻¹ > 1.

    J_h is the Jacobian of [ω ; ṗ]: the twist Jacobian moved from the inertial origin to the end effector's position p.
    W and L are diagonal, one number for ṗ, and for ω that by ℓ². The trace bounds from above what L⁻¹ᐟ² J_h has as
    1/σ²min; G = F D Fᵀ, with 1/D in place of D. With L, G is factored once more where the curvature of the error asks
    for damping, also where tr L G⁻¹ > 1 if that is more than the damping of vanishing singular values.
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
    text += ["added = 0.0", "while True:"]
    text += [f"    {line}" for line in factor()]
    text += ["    if added > 0.0 or linear_limit == 0.0:", "        break"]
    text += [f"    {line}" for line in trace_test()]
    for i in range(1, SIZE):
        text.append(f"y{i} = y{i}" + "".join(f" - f{i}{k} * y{k}" for k in range(i)))
    for i in reversed(range(SIZE)):
        text.append(f"y{i} = y{i} * f{i}{i}" + "".join(f" - f{k}{i} * y{k}" for k in range(i + 1, SIZE)))
    text += ["y0 += py * y5 - pz * y4", "y1 += pz * y3 - px * y5", "y2 += px * y4 - py * y3"]
    text.append("for c in range(n):")
    text += ["    out[c] = (", "        z[c]"]
    text += [f"        + twist_jacobian[{i}, c] * y{i}" for i in range(SIZE)]
    text += ["    )", "return True"]
    return text


def factor() -> list[str]:
    """Return F and 1/D of G and what is added: row j of F in its place, 1/D on the diagonal."""
    text = ["angular_added = added / square_length"]
    for j in range(SIZE):
        more = "angular_added" if j < 3 else "added"
        text += [f"c{k} = f{j}{k}" for k in range(j)]
        text += [f"f{j}{k} = c{k} * f{k}{k}" for k in range(j)]
        text.append(f"pivot = g{j}{j} + {more}" + "".join(f" - c{k} * f{j}{k}" for k in range(j)))
        text += ["if not pivot > 1e-14:", "    return False", f"f{j}{j} = 1.0 / pivot"]
        for i in range(j + 1, SIZE):
            terms = "".join(f" - f{i}{k} * f{j}{k}" for k in range(j))
            text.append(f"f{i}{j} = g{i}{j}{terms}")
    return text


def damping_lines() -> list[str]:
    """Return the start of the sums: the lower triangle of W."""
    diagonal = ["angular_damping"] * 3 + ["linear_damping"] * 3
    return [f"g{i}{j} = {diagonal[i] if i == j else 0.0}" for i in range(SIZE) for j in range(i + 1)]


def trace_test() -> list[str]:
    """Return what compares tr L G⁻¹ with 1, and 1/tr G⁻¹ with the damping that the curvature asks for."""
    names = ["angular"] * 3 + ["linear"] * 3
    text = [
        f"{name} = " + " + ".join(f"f{j}{j}" for j in range(first, first + 3))
        for name, first in (("angular", 0), ("linear", 3))
    ]
    for j in range(SIZE):  # column j of F⁻¹
        for i in range(j + 1, SIZE):
            terms = "".join(f" - f{i}{k} * h{k}{j}" for k in range(j + 1, i))
            text.append(f"h{i}{j} = -f{i}{j}{terms}")
        if j < SIZE - 1:
            terms = " + ".join(f"h{i}{j} * h{i}{j} * f{i}{i}" for i in range(j + 1, SIZE))
            text.append(f"{names[j]} += {terms}")
    return [
        *text,
        "regular = angular * angular_limit + linear * linear_limit <= 1.0",
        "trace = growth * (angular / square_length + linear)",
        "turning = g00 + g11 + g22",
        "columns = square_length * turning + g33 + g44 + g55",
        "if square_bound(error, square_length, turning, columns) * trace * trace > 1.0:",
        "    added = growth * (curvature(twist_jacobian, px, py, pz, error, square_length) - 1.0 / trace)",
        "if not regular and not added >= vanishing:",
        "    return False",
        "if not added > 0.0:",
        "    break",
    ]


def generate() -> str:
    """Return the module's text."""
    return HEADER + "".join(f"    {line}\n" for line in lines())


if __name__ == "__main__":
    TARGET.write_text(generate(), encoding="utf-8")
    print(TARGET, file=sys.stderr)
