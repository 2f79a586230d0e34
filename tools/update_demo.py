"""Put the demo's table, pictures and clip into the documentation: `make demo`, then this.

The clip is drawn by ``dqcontrol clip results/demo/K-physics results/demo.webp --faster 3 --rate 12 --size 560x480
--azimuth=-65deg --elevation=-10deg``, the plot by ``dqcontrol figures results/demo --format png --out
results/demo-figures``.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
PICTURES = ROOT / "docs/pictures"
BEGIN, END = "<!-- demo table: begin -->", "<!-- demo table: end -->"


def main(results: Path) -> None:
    """Copy picture, clip and error plot, and replace the table."""
    for suffix in (".png", ".webp"):
        shutil.copy(results.with_suffix(suffix), PICTURES / f"demo{suffix}")
    (errors,) = results.with_name(f"{results.name}-figures").rglob("errors.png")
    shutil.copy(errors, PICTURES / "demo-errors.png")
    page = ROOT / "docs/demo.md"
    before, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    table = "".join((results / "table.md").read_text(encoding="utf-8").partition("|")[1:]).strip()
    page.write_text(f"{before}{BEGIN}\n{table}\n{END}{rest.partition(END)[2]}", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "results/demo")
