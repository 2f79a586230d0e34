"""Write the tables of all reproductions of [S17] and their pictures into docs: `python tools/update_silva2017.py`."""

from __future__ import annotations

from pathlib import Path

from dqcontrol.reproductions import names, reproduce

PAGE = Path(__file__).parents[1] / "docs" / "silva2017-tables.md"
PICTURES = PAGE.parent / "pictures"
PICTURED = {  # by experiment: what is drawn of it, and what it shows
    "comparison": {
        "figure-5.4": "Fig. 5.4: S17's law, as it is, and the classic law, blue, with the camera",
        "figure-5.5": "Fig. 5.5: coefficients of the error as the camera shows them",
        "figure-5.6": "Fig. 5.6: norm of the error as the camera shows it, with its spikes",
        "figure-5.7": "Fig. 5.7: speeds of wheels and joints: the classic law starts with its largest command",
    },
    "baselines": {"inputs": "Speeds of wheels and joints under three laws"},
    "clamping": {
        "figure-5.10": "Fig. 5.10: joint angles with and without clamping; the goal lies beyond the limits for a minute"
    },
    "clamping-robot": {"figure-5.11": "Fig. 5.11: our law with clamping, as it is, and without, blue"},
    "pick-and-drop": {"set-points": "By set-points: S17's law, as it is, and the classic law, blue"},
}
HEAD = """# Silva 2017: published | ours, and verdicts

Written by `python tools/update_silva2017.py`, which runs `dqcontrol reproduce` for each heading. What the numbers mean:
[silva2017.md](silva2017.md).
"""


def picture(short: str, drawn: str) -> str:
    """Return the name of the picture of an experiment."""
    return f"silva2017-{short}-{drawn}.png"


def shown(short: str) -> list[str]:
    """Return the lines that show an experiment's pictures."""
    return [
        f"![{text}](pictures/{picture(short, drawn)})\n" for drawn, text in PICTURED.get(short, {}).items()
    ]


def main() -> None:
    """Run everything and write the page."""
    parts = [HEAD]
    for name in names("silva2017"):
        parts.append(f"## {name}\n")
        done = reproduce(name, jobs=1)
        short = name.partition("/")[2]
        parts += [*(table.markdown() for table in done.tables), *shown(short)]
        for drawn in PICTURED.get(short, {}):
            if drawn in done.figures:
                done.figures[drawn]().savefig(PICTURES / picture(short, drawn))
        for file, write in done.files.items():
            drawn = Path(file).stem.removeprefix(f"{short}-")
            write(PICTURES / (picture(short, drawn) if drawn in PICTURED.get(short, {}) else file))
        print(name)
    PAGE.write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()
