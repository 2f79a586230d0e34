"""Put the demo's table and pictures into the README: `make demo`, then this."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from dqcontrol.experiments import load_run
from dqcontrol.view.physics_picture import render_run

ROOT = Path(__file__).parent.parent
PICTURES = ROOT / "docs/pictures"
BEGIN, END = "<!-- demo table: begin -->", "<!-- demo table: end -->"


def main(results: Path) -> None:
    """Render the K+FF run in physics, copy the error plot and replace the table."""
    run = load_run(results / "K+FF-physics")
    picture = PICTURES / "demo.png"
    render_run(
        run.robot, run.q, run.pose, run.desired, picture, azimuth=-65, elevation=-10, ghosts=1, overwrite=True
    )
    shutil.copy(results / "errors.png", PICTURES / "demo-errors.png")
    shutil.copy(results / "paths.png", PICTURES / "demo-paths.png")
    readme = ROOT / "README.md"
    before, _, rest = readme.read_text(encoding="utf-8").partition(BEGIN)
    table = "".join((results / "table.md").read_text(encoding="utf-8").partition("|")[1:]).strip()
    readme.write_text(f"{before}{BEGIN}\n{table}\n{END}{rest.partition(END)[2]}", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "results/demo")
