"""Write what `dqcontrol reproduce` left of a thesis into docs: all tables as they are, and some of the pictures.

`dqcontrol reproduce pereira2016 --repeats 2 --out FOLDER`, then `python tools/update_theses.py pereira2016 FOLDER`;
likewise silva2017. Sections of experiments that FOLDER lacks stay as they are.
"""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path
from typing import NamedTuple

from dqcontrol.experiments.results_folder import SPEC_FILE
from dqcontrol_theses import names

DOCS = Path(__file__).parents[1] / "docs"


class Page(NamedTuple):
    """What stands above the tables of a thesis, and by experiment and file the pictures: name in docs, caption."""

    head: str
    pictures: dict[tuple[str, str], tuple[str, str]]


PAGES = {
    "pereira2016": Page(
        """# Pereira 2016: published | ours | ratio

Each heading's tables as its command prints them: the Meka in physics, but for the sampling times, which are about the
clock. What the numbers mean: [pereira2016.md](pereira2016.md). ± is the sample standard deviation over the repeats.
""",
        {
            ("spiral", "published-and-ours.png"): (
                "pereira2016-spiral.png",
                "Spiral in physics: each printed mean against ours",
            ),
            ("light-painting", "light-painting.png"): (
                "pereira2016-light-painting.png",
                "Six light paintings by LQR-DQ on the compliant arm",
            ),
            ("writing", "writing.png"): (
                "pereira2016-writing.png",
                "P16's house on its arm in physics, errors ten times as large",
            ),
        },
    ),
    "silva2017": Page(
        """# Silva 2017: published | ours, and verdicts

Each heading's tables as its command prints them. What the numbers mean: [silva2017.md](silva2017.md).
""",
        {
            ("comparison", "figure-5.4.png"): (
                "silva2017-comparison-figure-5.4.png",
                "Fig. 5.4: S17's law, as it is, and the classic law, blue, with the camera",
            ),
            ("comparison", "figure-5.5.png"): (
                "silva2017-comparison-figure-5.5.png",
                "Fig. 5.5: coefficients of the error as the camera shows them",
            ),
            ("comparison", "figure-5.6.png"): (
                "silva2017-comparison-figure-5.6.png",
                "Fig. 5.6: norm of the error as the camera shows it, with its spikes",
            ),
            ("comparison", "figure-5.7.png"): (
                "silva2017-comparison-figure-5.7.png",
                "Fig. 5.7: speeds of wheels and joints: the classic law starts with its largest command",
            ),
            ("baselines", "inputs.png"): (
                "silva2017-baselines-inputs.png",
                "Speeds of wheels and joints under three laws",
            ),
            ("clamping", "figure-5.10.png"): (
                "silva2017-clamping-figure-5.10.png",
                "Fig. 5.10: joint angles with and without clamping; the goal lies beyond the limits for a minute",
            ),
            ("clamping-robot", "figure-5.11.png"): (
                "silva2017-clamping-robot-figure-5.11.png",
                "Fig. 5.11: our law with clamping, as it is, and without, blue",
            ),
            ("pick-and-drop", "pick-and-drop-set-points.png"): (
                "silva2017-pick-and-drop-set-points.png",
                "By set-points: S17's law, as it is, and the classic law, blue",
            ),
            ("pick-and-drop", "pick-and-drop.png"): (
                "pick-and-drop.png",
                "Our law along a planned way; also [as a clip](pictures/pick-and-drop.webp)",
            ),
        },
    ),
}
CLIPS = {"pick-and-drop": "pick-and-drop.webp"}


def section(source: str, short: str, folder: Path) -> str:
    """Copy the pictures of an experiment, and return its part of the page."""
    command = (folder / SPEC_FILE).read_text(encoding="utf-8").removeprefix("# ").strip()
    parts = [f"## {source}/{short}\n", f"`{command}`\n", (folder / "tables.md").read_text(encoding="utf-8")]
    for (experiment, file), (name, caption) in PAGES[source].pictures.items():
        if experiment == short:
            shutil.copyfile(folder / file, DOCS / "pictures" / name)
            parts.append(f"![{caption}](pictures/{name})\n")
    if short in CLIPS:
        shutil.copyfile(folder / CLIPS[short], DOCS / "pictures" / CLIPS[short])
    return "\n".join(parts)


def main(source: str, folder: str) -> None:
    """Write the page of a thesis from the folder that its complete reproduction left."""
    page, parts = DOCS / f"{source}-tables.md", [PAGES[source].head]
    before = re.split("^## ", page.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    kept = {text.split("\n", 1)[0]: f"## {text}" for text in before}
    for name in names(source):
        short = name.partition("/")[2]
        results = Path(folder) / short
        part = section(source, short, results) if results.is_dir() else kept[name]
        parts.append(part.rstrip() + "\n")
    page.write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
