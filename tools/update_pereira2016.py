"""Write the tables of all reproductions of [P16] and a picture into docs: `python tools/update_pereira2016.py`."""

from __future__ import annotations

from pathlib import Path

from dqcontrol.experiments.published import names, reproduce

PAGE = Path(__file__).parents[1] / "docs" / "pereira2016-tables.md"
PICTURED, FIGURE = ("spiral",), "published-and-ours"
HEAD = """# Pereira 2016: published | ours | ratio

Written by `python tools/update_pereira2016.py`, which runs `dqcontrol reproduce` for each heading. What the numbers
mean: [pereira2016.md](pereira2016.md). ± is the sample standard deviation over the repeats.
"""


def main() -> None:
    """Run everything and write the page."""
    parts = [HEAD]
    for name in names("pereira2016"):
        parts.append(f"## {name}\n")
        done = reproduce(name)
        parts += [table.markdown() for table in done.tables]
        if (short := name.partition("/")[2]) in PICTURED:
            done.figures[FIGURE]().savefig(PAGE.parent / "pictures" / f"pereira2016-{short}.png")
        print(name)
    PAGE.write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()
