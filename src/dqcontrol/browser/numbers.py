"""The numbers beside the scene, as HTML."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Sequence

import numpy as np

from dqcontrol.browser.run_view_model import Reading
from dqcontrol.figures.style import LIMIT

_BAD = f"color:{LIMIT};font-weight:bold"


def numbers(readings: Sequence[tuple[str, str, Reading]]) -> str:
    """Return the read-outs of some runs, given by label, colour and numbers, as HTML."""
    return "".join(_block(*reading) for reading in readings)


def html_table(rows: Iterable[tuple[str, str, bool]]) -> str:
    """Return names, values, and whether they are beyond what is allowed, as a table of HTML."""
    cells = "".join(
        f"<tr><td>{html.escape(name)}</td>"
        f"<td style='text-align:right;white-space:nowrap;{_BAD if bad else ''}'>{html.escape(value)}</td></tr>"
        for name, value, bad in rows
    )
    return f"<table style='width:100%;font-variant-numeric:tabular-nums'>{cells}</table>"


def plain(name: str) -> str:
    """Return a joint's name in plain words: ``panda_joint4`` is joint 4.

    Examples
    --------
    >>> plain("panda_joint4"), plain("joint_6"), plain("elbow")
    ('joint 4', 'joint 6', 'elbow')
    """
    found = re.search(r"joint_?(\d+)$", name)
    return f"joint {found[1]}" if found else name.replace("_", " ")


def _block(label: str, css: str, reading: Reading) -> str:
    scale, unit = (180 / np.pi, "°") if reading.unit == "rad" else (1e3, " mm")
    rows = [
        ("Position error", f"{1e3 * reading.position_error:.3f} mm", False),
        ("Orientation error", f"{np.degrees(reading.orientation_error):.3f}°", False),
    ]
    if np.isfinite(reading.margin):
        rows.append(
            (
                f"Position, {plain(reading.joint)}: to its limit",
                f"{scale * reading.margin:.1f}{unit}",
                reading.margin < 0,
            )
        )
    if np.isfinite(reading.speed):
        rows.append(
            (f"Speed, {plain(reading.input)}", f"{100 * reading.speed:.0f} % of limit", reading.speed > 1)
        )
    if reading.nearest is not None:
        room = reading.nearest.room
        rows.append((f"Clearance above margin, {reading.nearest.label}", f"{1e3 * room:.1f} mm", room < 0))
    if reading.plan:
        rows.append(("Planned way", reading.plan, False))
    if reading.stopped:
        rows.append(("Ended", reading.stopped, False))
    return (
        f"<div style='border-left:4px solid {css};margin:8px 12px;padding-left:8px;font-size:0.85em'>"
        f"<b>{html.escape(label)}</b>{html_table(rows)}</div>"
    )
