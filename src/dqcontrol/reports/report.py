"""A run or a study as one page: what was run, what came of it, and how to get it again."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from dqcontrol.errors import ExistsError
from dqcontrol.figures.save import for_page
from dqcontrol.files.output_file import whole_file
from dqcontrol.tables.tables import Cell, Ratio, Table, VerdictCell

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_MARKS = {True: ("good", "✓"), False: ("bad", "✗"), None: ("open", "•")}
_SHORT = 30  # rows; such a table is never cut
_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 60rem;
  margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: 0.2rem; }
h2 { font-size: 1.15rem; margin-top: 2.2rem; border-bottom: 1px solid #ddd; break-after: avoid; }
p.facts { color: #555; margin-top: 0; }
p.notice { background: #fdecea; border-left: 4px solid #b2182b; padding: 0.5rem 0.8rem; }
table { border-collapse: collapse; font-size: 0.92rem; font-variant-numeric: tabular-nums; margin: 1rem 0; }
caption { text-align: left; font-weight: 600; padding: 0.2rem 0.8rem; break-after: avoid; }
th, td { padding: 0.18rem 0.8rem; border-bottom: 1px solid #eee; text-align: left; vertical-align: top; }
th { border-bottom-color: #999; }
th.number, td.number { text-align: right; }
td:first-child { min-width: 4em; }
td.number { white-space: nowrap; }
td.good, td.bad, td.open { font-weight: 600; white-space: nowrap; }
td.good { color: #00664a; }
td.bad { color: #b2182b; }
td.open { color: #7a5200; }
div.wide { overflow-x: auto; max-width: 100%; }
div.tables { display: flex; flex-wrap: wrap; gap: 0 2rem; align-items: flex-start; }
div.about { display: flex; flex-wrap: wrap; gap: 0.5rem 1.5rem; align-items: center; margin: 1rem 0; }
div.about table { flex: 1 1 22rem; margin: 0; }
div.moving iframe { width: 100%; height: 26rem; border: 1px solid #ddd; }
div.moving p { margin: 0.2rem 0 0; font-size: 0.85rem; color: #555; }
@media screen { div.moving + div.about > div { display: none; } }
div.about th { border-bottom-color: #eee; font-weight: 400; color: #555; white-space: nowrap; padding-left: 0; }
div.about td { overflow-wrap: anywhere; }
div.about td.good, div.about td.bad, div.about td.open { white-space: normal; }
figure { margin: 1.4rem 0; }
figure img { max-width: 100%; height: auto; }
figcaption { color: #555; font-size: 0.9rem; }
pre { background: #f6f6f6; padding: 0.8rem; overflow-x: auto; font-size: 0.85rem; }
pre.command, pre.later { border-left: 4px solid #0072b2; white-space: pre-wrap; overflow-wrap: anywhere; }
@page { size: A4; margin: 16mm 14mm; }
@media print {
  body { font-size: 10pt; max-width: none; margin: 0; padding: 0; color: #000; }
  h1 { font-size: 16pt; }
  h2 { font-size: 12pt; margin-top: 1.4rem; }
  p.facts, figcaption { color: #333; }
  div.wide { overflow: visible; }
  table { font-size: 8pt; }
  th, td { padding: 0.1rem 0.3rem; overflow-wrap: break-word; }
  table { margin: 0.6rem 0; }
  div.tables { gap: 0 1rem; }
  thead { display: table-header-group; }
  tbody tr:nth-child(-n+2) { break-before: avoid; }
  div.short, tr, figure, p.notice, pre.command { break-inside: avoid; }
  figure { margin: 0.8rem 0; }
  figure img { max-height: 110mm; max-width: 100%; width: auto; }
  div.about { break-inside: avoid; }
  div.moving { display: none; }
  div.about table { flex-basis: 80mm; font-size: 8.5pt; }
  div.about img { width: 62mm; }
  pre { white-space: pre-wrap; overflow-wrap: anywhere; font-size: 7.5pt; border: 1px solid #ccc; }
  pre.spec { columns: 2; }
  a { color: inherit; text-decoration: none; }
}
"""
_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy"
  content="{policy}">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
<h1>{title}</h1>
{body}
</body>
</html>
"""

_STILL = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
# A replay has scripts, and the policy of the page around it holds for it, too; nothing comes from a network either way.
_MOVING = "default-src 'unsafe-inline' 'unsafe-eval' data: blob:"


def page(title: str, parts: Iterable[str], *, moves: bool = False) -> str:
    """Return a page of these parts, which are HTML, under a title, which is text; a replay moves in it."""
    policy, body = _MOVING if moves else _STILL, "\n".join(parts)
    return _PAGE.format(title=escape(title), style=_STYLE, policy=policy, body=body)


def heading(text: str) -> str:
    """Return the heading of a section."""
    return f"<h2>{escape(text)}</h2>"


def paragraph(text: str, kind: str = "") -> str:
    """Return a paragraph, perhaps of a kind that the style knows."""
    return f'<p class="{kind}">{escape(text)}</p>' if kind else f"<p>{escape(text)}</p>"


def code(text: str, kind: str = "") -> str:
    """Return text as it stands."""
    return f'<pre class="{kind}">{escape(text)}</pre>' if kind else f"<pre>{escape(text)}</pre>"


def links(places: Mapping[str, str]) -> str:
    """Return a list of links to files beside the page, by what they are called."""
    items = (f'<li><a href="{escape(place)}">{escape(name)}</a></li>' for name, place in places.items())
    return f"<ul>{''.join(items)}</ul>"


def head(facts: Sequence[tuple[str, Cell]], picture: Figure | None, moving: str = "") -> str:
    """Return what a page is about: names with texts, and a picture beside them; on screens the page that moves."""
    rows = "".join(
        f"<tr><th>{escape(name) if name != before else ''}</th>{_cell(cell, str(cell), '')}</tr>"
        for (name, cell), before in zip(facts, ["", *(name for name, _ in facts)], strict=False)
    )
    words = "The robot at its start, with the path of its end effector"
    drawn = f"<div>{_image(picture, words)}</div>" if picture else ""
    return f'{_replay(moving)}<div class="about">{drawn}<table>{rows}</table></div>'


def _replay(page: str) -> str:
    """Return a page within this one."""
    if not page:
        return ""
    size = f"{len(page.encode()) / 1e6:.1f} MB"
    return (
        f'<div class="moving"><iframe srcdoc="{escape(page, quote=True)}" title="The run as it moves"></iframe>'
        f"<p>Drag to look around. The replay is part of this page ({size}) and needs no network.</p></div>"
    )


def tables_beside(tables: Iterable[Table]) -> str:
    """Return tables, narrow ones side by side where there is room."""
    return f'<div class="tables">{"".join(map(html_table, tables))}</div>'


def html_table(table: Table) -> str:
    """Return a table; verdicts in it have a colour and a mark."""
    numeric = table.numeric()
    classes = [" class=number" if right else "" for right in numeric]
    headings = zip(table.columns, classes, strict=True)
    head = "".join(f"<th{kind}>{escape(column.heading)}</th>" for column, kind in headings)
    rows = [
        "".join(map(_cell, cells, texts, classes))
        for cells, texts in zip(table.rows, table.texts(), strict=True)
    ]
    caption = f"<caption>{escape(table.title)}</caption>" if table.title else ""
    body = "\n".join(f"<tr>{row}</tr>" for row in rows)
    size = "" if len(rows) > _SHORT else " short"
    return (
        f'<div class="wide{size}"><table>{caption}\n<thead><tr>{head}</tr></thead>\n'
        f"<tbody>\n{body}\n</tbody></table></div>"
    )


def html_figure(name: str, figure: Figure, caption: str) -> str:
    """Return a figure with its caption, to which ``#name`` leads; an image of its own, so that no two ids clash."""
    words = f"<figcaption>{escape(caption)}</figcaption>"
    return f'<figure id="{escape(name)}">{_image(figure, caption)}{words}</figure>'


def _image(figure: Figure, caption: str) -> str:
    kind, content = for_page(figure)
    width = round(96 * figure.get_figwidth())  # CSS pixels: on paper it has the size that it was drawn in
    source = f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
    return f'<img src="{source}" width="{width}" alt="{escape(caption)}">'


def _cell(cell: Cell, text: str, kind: str) -> str:
    if isinstance(cell, VerdictCell):
        name, mark = _MARKS[cell.good]
        return f"<td class={name}>{mark} {escape(text)}</td>"
    if isinstance(cell, Ratio) and math.isfinite(cell):
        name, mark = _MARKS[cell.good]
        return f'<td class="number {name}">{mark} {cell.words}: {escape(text)}</td>'
    return f"<td{kind}>{escape(text)}</td>"


_CAPTIONS = {
    "servos": "Each joint where it is liveliest; and what is left all along, by the fit and where a fit of the first "
    "part foresees the rest; dashed: twice the floor that noise and encoder leave.",
    "path": "Path of the end effector over the desired one.",
    "paths": "Paths of the end effectors over the desired one.",
    "base": "Where the base went, seen from above; arrows are its headings at equal times.",
    "motion": "The robot at several times, later ones stronger.",
    "errors": "Error norm, distance and angle between the end effector and its desired pose.",
    "criteria": "Norms of error, control signal, joint step, speed and acceleration of the end effector, and its pose.",
    "pose": "Coefficients of the end pose.",
    "joints": "Configuration; limits in the titles, dashed where they are near.",
    "margins": "Distance of each joint from its nearest limit, as a share of half its range.",
    "inputs": "Commanded inputs and their norm.",
    "disturbance": "Twist that the disturbance gave the end effector, inertial axes.",
    "timing": "How often periods, computation and idle times of the loop occurred; counts are logarithmic.",
    "readings": "Forces that the plant sensed.",
    "tasks": "Distance and angle of each further task from its pose.",
    "range": "The twist that leads to the goal, and what of it the robot cannot give its end effector.",
    "lyapunov": "The Lyapunov function V with its parts and rate, and how near the robot is to what it cannot do.",
    "repeats": "Error integral of every repeat, with mean and confidence interval.",
    "sweep": "The number that points are ranked by against each parameter; the best point is ringed.",
}
_WHERE = "In the folder of this page, or with the experiment below saved as spec.yaml."


def write_report(
    folder: str | Path,
    title: str,
    *,
    facts: str = "",
    notice: str = "",
    about: Sequence[tuple[str, Cell]] = (),
    picture: Figure | None = None,
    moving: str = "",
    command: str = "",
    verdicts: Sequence[Table] = (),
    tables: Sequence[Table] = (),
    figures: Mapping[str, Figure] | None = None,
    files: Mapping[str, str] | None = None,
    later: str = "",
    spec: str = "",
    origins: Table | None = None,
) -> Path:
    """Write ``report.html`` into a folder: everything in one file, for screens and for paper.

    Parameters
    ----------
    folder
        Made if missing; must not hold a ``report.html``.
    title
        Heading.
    facts
        A line below it.
    notice
        What a reader must not miss, as why a run failed.
    about
        What it is about, as names and texts.
    picture
        Beside them.
    moving
        A page that plays what happened, in place of the picture on screens; paper keeps that.
    command
        The line that gives the results again.
    verdicts
        Tables whose cells of ``dqcontrol.tables.tables.Verdict`` have colours and marks.
    tables
        In this order.
    figures
        By name; known names have captions, others are their own.
    later
        The line that draws figures which are left out.
    files
        Pages of single runs and others, relative to the folder, by label.
    spec
        Text of the resolved experiment.
    origins
        Versions and seeds.

    Returns
    -------
    The file.

    Raises
    ------
    ExistsError
        If the folder holds a report.

    Examples
    --------
    >>> write_report("out", "Circle", figures={"errors": errors(run.record)})  # doctest: +SKIP
    """
    target = Path(folder) / "report.html"
    if target.exists():
        raise ExistsError(f"{target}: exists already; choose another folder or remove it")
    parts = [paragraph(facts, "facts")] if facts else []
    parts += [paragraph(notice, "notice")] if notice else []
    parts += [head(about, picture, moving)] if about else []
    if verdicts:
        parts += [heading("Verdicts"), *map(html_table, verdicts)]
    if command:
        parts += [heading("The same again"), code(command, "command")]
        parts += [paragraph(_WHERE)] if spec else []
    if tables:
        parts += [heading("Tables"), tables_beside(tables)]
    if figures:
        drawn = (html_figure(name, figure, _CAPTIONS.get(name, name)) for name, figure in figures.items())
        parts += [heading("Figures"), *drawn]
    if later:
        demand = paragraph("Drawn on demand, in the folder of this page:")
        parts += [heading("Figures"), demand, code(later, "later")]
    if files:
        parts += [heading("Files beside this page"), links(files)]
    if spec:
        parts += [heading("Experiment"), code(spec, "spec")]
    if origins is not None:
        parts += [heading("Versions and seeds"), html_table(origins)]
    target.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(target) as draft:
        draft.write_text(page(title, parts, moves=bool(moving)), encoding="utf-8", newline="\n")
    return target
