"""Draw the tiles of the README: `python tools/update_tiles.py`, which takes minutes and OpenGL."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import yaml
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

import dqcontrol as dqc

ROOT = Path(__file__).parent.parent
TILES, RESULTS = ROOT / "docs/pictures/tiles", ROOT / "results/tiles"
WIDTH, HEIGHT = 540, 360  # pixels; pages show half of that


def main() -> None:
    """Draw all of them."""
    RESULTS.mkdir(parents=True, exist_ok=True)
    laws()
    learn()
    deploy()
    rendered("keep-out", "constraints", panel=3)
    rendered("box", "two-arms", panel=3)
    rendered("pick-and-drop", "mobile", panel=4, at=(0.51, 0.64), zoom=1.8)


def rendered(
    example: str, tile: str, panel: int, at: tuple[float, float] = (0.5, 0.5), zoom: float = 1
) -> None:
    """Run an example, and take a part, about a point in shares of it, of one of the pictures that its clip shows."""
    folder, picture = RESULTS / example, RESULTS / f"{example}.png"
    command = [sys.executable, "-m", "dqcontrol"]
    run = [*command, "run", f"{example}.yaml", "--out", str(folder), "--force", "--no-figures"]
    subprocess.run(run, cwd=ROOT / "examples", check=False)  # its exit status says what came of it
    width, height = round(zoom * WIDTH), round(zoom * HEIGHT)
    look = ["--size", f"{width}x{height}", "--force"]
    subprocess.run([*command, "clip", str(folder), str(picture), *look], check=True)
    strip = Image.open(picture).convert("RGB")
    across = strip.width // width
    left = width * (panel % across) + round(at[0] * width) - WIDTH // 2
    top = height * (panel // across) + round(at[1] * height) - HEIGHT // 2
    strip.crop((left, top, left + WIDTH, top + HEIGHT)).save(TILES / f"{tile}.png", optimize=True)


def laws() -> None:
    """Plot errors of three laws over time."""
    spec = yaml.safe_load((ROOT / "examples/which-law.yaml").read_text(encoding="utf-8"))
    shown = ("K", "LQR-R8", "K+FF")
    spec |= {"laws": {label: spec["laws"][label] for label in shown}, "plant": spec.pop("plants")["servo"]}
    fig, axes = figure()
    for (label, run), colour in zip(dqc.run_study(spec).runs.items(), ("C3", "C1", "C0"), strict=True):
        axes.semilogy(run.time, np.maximum(1e3 * run.record.position_error, 1e-3), color=colour, lw=3)
        height = 1e3 * run.record.position_error[-50]
        axes.text(run.time[-1] * 1.02, height, label.partition(" · ")[0], color=colour, va="center")
    axes.set(xlim=(0, 8), ylim=(1e-3, 50), xlabel="time [s]", ylabel="error [mm]")
    save(fig, "laws")


def learn() -> None:
    """Plot errors of `examples/learn.yaml` from repeat to repeat."""
    errors = [each.position for each in dqc.learn(ROOT / "examples/learn.yaml").repeats]  # mm
    fig, axes = figure()
    axes.bar(range(len(errors)), errors, color="C0")
    axes.set(xlabel="repeat", ylabel="RMS error [mm]", yscale="log")
    save(fig, "learn")


def deploy() -> None:
    """Write one line of C and one command of ROS 2."""
    fig, axes = figure()
    axes.set_axis_off()
    lines = (("C", "dqc_step(&controller, q, t, 0, u);"), ("ROS 2", "dqcontrol ros2 controller reach.yaml"))
    for height, (name, line) in zip((0.72, 0.28), lines, strict=True):
        axes.text(0.02, height + 0.12, name, weight="bold", fontsize=22, color="C0", va="center")
        axes.text(0.02, height - 0.06, line, family="monospace", fontsize=15, va="center")
    save(fig, "export")


def figure() -> tuple[Figure, Axes]:
    """Return an empty plot whose letters can be read in a tile."""
    plt.rcParams.update({"font.size": 18, "axes.spines.top": False, "axes.spines.right": False})
    return plt.subplots(figsize=(WIDTH / 100, HEIGHT / 100), dpi=100, layout="constrained")


def save(fig: Figure, tile: str) -> None:
    """Write a tile."""
    fig.savefig(TILES / f"{tile}.png")
    plt.close(fig)


if __name__ == "__main__":
    main()
