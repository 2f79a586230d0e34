"""Pages that need nothing else: no network, no scripts, no files beside them; made for screens and for paper."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from dqcontrol.figures.figure_files import for_page
from dqcontrol.tables.table_cells import Cell, Ratio, VerdictCell
from dqcontrol.tables.tables import Table

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
  content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
<h1>{title}</h1>
{body}
</body>
</html>
"""


def page(title: str, parts: Iterable[str]) -> str:
    """Return a page of these parts, which are HTML, under a title, which is text."""
    return _PAGE.format(title=escape(title), style=_STYLE, body="\n".join(parts))


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
    drawn = (
        f"<div>{_image(picture, 'The robot at its start, with the path of its end effector')}</div>"
        if picture
        else ""
    )
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
