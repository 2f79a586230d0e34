"""Texts and numbers for LaTeX, with signs that every compiler of it knows."""

from __future__ import annotations

import re
import unicodedata

_TEXT = {
    "\\": r"\textbackslash{}",
    **{sign: "\\" + sign for sign in "&%$#_{}"},
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "|": r"\textbar{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "–": "--",
    "—": "---",
    "…": r"\dots{}",
}
_MATHEMATICS = {
    "°": r"^\circ",
    "√": r"\surd",
    "∫": r"\int",
    "·": r"\cdot",
    "×": r"\times",
    "±": r"\pm",
    "−": "-",
    "≤": r"\leq",
    "≥": r"\geq",
    "≈": r"\approx",
    "≠": r"\neq",
    "∞": r"\infty",
    "→": r"\to",
    "ℝ": r"\mathbf{R}",
    "⁻": "^-",
    **{sign: f"^{digit}" for digit, sign in enumerate("⁰¹²³⁴⁵⁶⁷⁸⁹")},
    **{sign: f"_{digit}" for digit, sign in enumerate("₀₁₂₃₄₅₆₇₈₉")},
}
_DOT = "\u0307"  # above the letter before it, as in the control signal's θ̇
_SIGN = re.compile(f".{_DOT}?", re.DOTALL)
_GREEK = re.compile(r"GREEK (SMALL|CAPITAL) LETTER ([A-Z]+)")


def latex(text: str) -> str:
    r"""Return a text for LaTeX, in which nothing is a command.

    Examples
    --------
    >>> print(latex("50 % of m/s²"))
    50 \% of m/s$^2$
    """
    return _SIGN.sub(_latex_sign, " ".join(text.split()))


def latex_number(text: str) -> str:
    r"""Return a number, as Python writes it, for LaTeX.

    Examples
    --------
    >>> print(latex_number("-1.2e-05"))
    $-1.2 \times 10^{-5}$
    """
    mantissa, _, exponent = text.partition("e")
    if exponent:
        return rf"${mantissa} \times 10^{{{int(exponent)}}}$"
    return f"${text}$" if text.startswith("-") else latex(text)


def _latex_sign(match: re.Match[str]) -> str:
    sign = match.group()
    if sign.endswith(_DOT):
        return rf"$\dot{{{_greek(sign[0]) or sign[0]}}}$"
    mathematics = _MATHEMATICS.get(sign) or _greek(sign)
    return f"${mathematics}$" if mathematics else _TEXT.get(sign, sign)


def _greek(sign: str) -> str:
    """Return the command of a Greek letter, or nothing."""
    match = _GREEK.fullmatch(unicodedata.name(sign, ""))
    if not match:
        return ""
    name = match.group(2).replace("LAMDA", "LAMBDA").lower()  # Unicode's spelling
    return "\\" + (name if match.group(1) == "SMALL" else name.capitalize())
