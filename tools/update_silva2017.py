"""Write the tables of all reproductions of [S17] and their pictures into docs: `python tools/update_silva2017.py`."""

from __future__ import annotations

from pathlib import Path

from dqcontrol.reproductions import names, reproduce

PAGE = Path(__file__).parents[1] / "docs" / "silva2017-tables.md"
PICTURED = {
    "comparison": ("figure-5.5", "figure-5.6", "figure-5.7"),
    "clamping": ("figure-5.10",),
    "baselines": ("inputs",),
}
HEAD = """# Silva 2017: published | ours, and verdicts

Written by `python tools/update_silva2017.py`, which runs `dqcontrol reproduce` for each heading. What the numbers mean:
[silva2017.md](silva2017.md).
"""


def main() -> None:
    """Run everything and write the page."""
    parts = [HEAD]
    for name in names("silva2017"):
        parts.append(f"## {name}\n")
        done = reproduce(name, jobs=1)
        parts += [table.markdown() for table in done.tables]
        short = name.partition("/")[2]
        for figure in PICTURED.get(short, ()):
            done.figures[figure]().savefig(PAGE.parent / "pictures" / f"silva2017-{short}-{figure}.png")
        for file, write in done.files.items():
            write(
                PAGE.parent / "pictures" / (file if file.startswith(short) else f"silva2017-{short}-{file}")
            )
        print(name)
    PAGE.write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()
