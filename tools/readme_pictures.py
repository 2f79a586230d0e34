"""Make docs/pictures/ from the demo's results: the arm in physics, and the comparison of its runs."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from dqcontrol.experiments import load_run
from dqcontrol.view.physics_picture import render_run

PICTURES = Path(__file__).parent.parent / "docs/pictures"


def main(results: Path) -> None:
    """Render the K+FF run in physics and copy the error plot."""
    run = load_run(results / "K+FF-physics")
    picture = PICTURES / "demo.png"
    render_run(run.robot, run.q, run.pose, run.desired, picture, azimuth=-65, elevation=-10, ghosts=1, overwrite=True)
    shutil.copy(results / "errors.png", PICTURES / "demo-errors.png")
    shutil.copy(results / "paths.png", PICTURES / "demo-paths.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("results/demo"))
