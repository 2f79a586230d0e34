"""Put the demo's table and pictures into the README: `make demo`, then this."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
PICTURES = ROOT / "docs/pictures"
BEGIN, END = "<!-- demo table: begin -->", "<!-- demo table: end -->"


def main(results: Path) -> None:
    """Copy the picture and the error plot, and replace the table."""
    shutil.copy(results.with_suffix(".png"), PICTURES / "demo.png")
    shutil.copy(results / "errors.png", PICTURES / "demo-errors.png")
    readme = ROOT / "README.md"
    before, _, rest = readme.read_text(encoding="utf-8").partition(BEGIN)
    table = "".join((results / "table.md").read_text(encoding="utf-8").partition("|")[1:]).strip()
    readme.write_text(f"{before}{BEGIN}\n{table}\n{END}{rest.partition(END)[2]}", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "results/demo")
