"""A run as one HTML page that needs nothing else: no network, no scripts, no files beside it."""

from __future__ import annotations

import base64
import os
import secrets
from collections.abc import Sequence
from html import escape
from pathlib import Path

from dqcontrol.errors import ExistsError, FileFormatError
from dqcontrol.experiments.metric_tables import summary_table
from dqcontrol.experiments.metrics import Metrics
from dqcontrol.experiments.tables import Column, Table
from dqcontrol.limits import list_interventions
from dqcontrol.loop.record import Record, has_failed
from dqcontrol.loop.supervision import INTERVENTIONS

_TYPES = {".png": "image/png", ".svg": "image/svg+xml", ".jpg": "image/jpeg"}
_CAPTIONS = {
    "path": "Path of the hand over the desired one.",
    "base": "Where the base went, seen from above; arrows are its headings at equal times.",
    "motion": "The robot at several times, later ones stronger.",
    "errors": "Error norm, distance and angle between the hand and its desired pose.",
    "pose": "Coefficients of the end pose.",
    "joints": "Configuration; limits in the titles, dashed where they are near.",
    "margins": "Distance of each joint from its nearest limit, as a share of half its range.",
    "inputs": "Commanded inputs and their norm.",
    "disturbance": "Twist that the disturbance gave the hand, inertial axes.",
    "timing": "How often periods, computation and idle times of the loop occurred; counts are logarithmic.",
    "readings": "Forces that the plant sensed.",
    "range": "The twist that leads to the goal, and what of it the robot cannot give its hand.",
}
_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy"
  content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<title>{title}</title>
<style>
body {{ font: 16px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 60rem;
  margin: 2rem auto; padding: 0 1rem; }}
h1 {{ font-size: 1.6rem; margin-bottom: 0.2rem; }}
h2 {{ font-size: 1.15rem; margin-top: 2.2rem; border-bottom: 1px solid #ddd; }}
p.facts {{ color: #555; margin-top: 0; }}
p.bad {{ background: #fdecea; border-left: 4px solid #b2182b; padding: 0.5rem 0.8rem; }}
table {{ border-collapse: collapse; font-size: 0.92rem; font-variant-numeric: tabular-nums; }}
th, td {{ padding: 0.18rem 0.8rem; border-bottom: 1px solid #eee; text-align: left; }}
th {{ border-bottom-color: #999; }}
td.number {{ text-align: right; }}
div.wide {{ overflow-x: auto; }}
figure {{ margin: 1.4rem 0; }}
figure img {{ max-width: 100%; height: auto; }}
figcaption {{ color: #555; font-size: 0.9rem; }}
pre {{ background: #f6f6f6; padding: 0.8rem; overflow-x: auto; font-size: 0.85rem; }}
@media print {{ pre {{ white-space: pre-wrap; }} figure, tr {{ break-inside: avoid; }} }}
</style>
</head>
<body>
<h1>{title}</h1>
<p class="facts">{facts}</p>
{notice}{body}</body>
</html>
"""


def write_report(
    folder: str | Path,
    record: Record,
    metrics: Metrics,
    *,
    title: str = "Run",
    spec: str = "",
    plots: Sequence[str | Path] | None = None,
    tables: Sequence[Table] = (),
) -> Path:
    """Write ``report.html`` into a folder: facts, metrics, figures and the experiment's text in one file.

    Parameters
    ----------
    folder
        Made if missing; must not hold a ``report.html``.
    record
        The run, for why it ended; a divergence is shown as a warning.
    metrics
        Of the run.
    title
        Heading.
    spec
        Text of the resolved experiment.
    plots
        PNG, SVG or JPEG files, put into the page in this order; one format of each is shown. If omitted,
        those that `save_plots` has written into the folder.
    tables
        More tables, shown after the metrics.

    Returns
    -------
    The file.

    Raises
    ------
    ExistsError
        If the folder holds a report.
    FileFormatError
        If a figure cannot be read.

    Examples
    --------
    >>> save_plots(run.record, "out")  # doctest: +SKIP
    >>> write_report("out", run.record, run.metrics, title="Circle")  # doctest: +SKIP
    """
    from dqcontrol import __version__

    target = Path(folder) / "report.html"
    if target.exists():
        raise ExistsError(f"{target}: exists already; choose another folder or remove it")
    stopped = record.stopped
    facts = [
        f"{record.duration:.4g} s",
        f"{len(record)} samples",
        f"ended: {stopped}",
        f"dqcontrol {__version__}",
    ]
    if plots is None:
        candidates = (target.with_name(name + kind) for name in _CAPTIONS for kind in _TYPES)
        plots = [path for path in candidates if path.exists()]
    parts = ["<h2>Metrics</h2>", _table(summary_table(metrics)), *map(_table, tables)]
    if INTERVENTIONS in record.readings:
        parts += ["<h2>Interventions of the supervisor</h2>", _interventions(record)]
    figures = _figures(plots)
    if figures:
        parts += ["<h2>Figures</h2>", *figures]
    if spec:
        parts += ["<h2>Experiment</h2>", f"<pre>{escape(spec)}</pre>"]
    page = _PAGE.format(
        title=escape(title),
        facts=escape(" · ".join(facts)),
        notice=f'<p class="bad">The run {escape(stopped)}</p>\n' if has_failed(stopped) else "",
        body="\n".join(parts) + "\n",
    )
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_name(f".report.{secrets.token_hex(4)}.part")
    try:
        temporary.write_text(page, encoding="utf-8", newline="\n")
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)
    return target


def _table(table: Table) -> str:
    """Return a table as HTML."""
    numeric = table.numeric()
    head = "".join(f"<th>{escape(column.heading)}</th>" for column in table.columns)
    rows = [
        "".join(
            f"<td{' class=number' if right else ''}>{escape(text)}</td>"
            for text, right in zip(row, numeric, strict=True)
        )
        for row in table.texts()
    ]
    caption = f"<caption>{escape(table.title)}</caption>" if table.title else ""
    body = "\n".join(f"<tr>{row}</tr>" for row in rows)
    return f'<div class="wide"><table>{caption}\n<tr>{head}</tr>\n{body}\n</table></div>'


def _interventions(record: Record) -> str:
    """Return when the supervisor intervened, and why."""
    found = list_interventions(record.time, record.readings[INTERVENTIONS].values)
    columns = [Column("from", "s", ".3f"), Column("to", "s", ".3f"), Column("reason")]
    return _table(Table(columns, [list(row) for row in found])) if found else "<p>None.</p>"


def _figures(plots: Sequence[str | Path]) -> list[str]:
    """Return the figures as HTML, each in the first format that a page can hold."""
    figures: dict[str, str] = {}
    for path in map(Path, plots):
        if path.suffix not in _TYPES or path.stem in figures:
            continue
        try:
            data = base64.b64encode(path.read_bytes()).decode("ascii")
        except OSError as error:
            raise FileFormatError(f"{path}: cannot be read: {error.strerror or error}") from None
        caption = escape(_CAPTIONS.get(path.stem, path.stem))
        source = f"data:{_TYPES[path.suffix]};base64,{data}"
        figures[path.stem] = (
            f'<figure><img src="{source}" alt="{caption}"><figcaption>{caption}</figcaption></figure>'
        )
    return list(figures.values())
