"""What a person who plays meets: the time to a page that moves and from drag to motion, pictures a second, memory.

    python benchmarks/play.py

Needs Chromium and Playwright. Without a graphics card Chromium draws in software: beside the pictures a second of two
Pandas stand those of an empty scene on the same machine.
"""

from __future__ import annotations

import argparse
import io
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

OPTIONS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
WINDOW = {"width": 1280, "height": 720}
SCENE = {"x": 100, "y": 60, "width": 600, "height": 600}  # px; what lies beside the dock
CIRCLE = """
name: play
robot: panda
start: [0, -0.3, 0, -2.0, 0, 1.8, 0.7]
period: 0.01
reference: {kind: circle, radius: 0.15, duration: 600, turns: 300, plane: yz}
law: {kind: proportional-feedforward, gain: 5}
plant: {kind: servo}
"""


def picture(tab: Page) -> Any:
    """Return the scene as it is seen, (H, W, 3)."""
    return np.asarray(Image.open(io.BytesIO(tab.screenshot(clip=SCENE))).convert("RGB"), dtype=int)


@contextmanager
def playing(source: str, port: int) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Start `dqcontrol play`; give its process and the address that it says."""
    command = [sys.executable, "-m", "dqcontrol", "play", source, "--port", str(port)]
    with tempfile.TemporaryDirectory() as folder:
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, text=True, cwd=folder, env={**os.environ, "BROWSER": "true"}
        )
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            yield process, line.split()[1]
        finally:
            process.terminate()
            process.wait()


COMPUTED = """
import os, sys, time
from dqcontrol.browser import served_page

def tell(page):
    page.tick()
    print("computed", time.process_time())
    sys.stdout.flush()
    os._exit(0)

served_page.ServedPage.serve = tell
from dqcontrol.cli import main

sys.argv = ["dqcontrol", "play", sys.argv[1], "--port", "18650"]
main()
"""


def computed(source: str) -> float:
    """Return the processor's time from the start of the interpreter until the robot moves and is drawn, s."""
    said = subprocess.run(
        [sys.executable, "-c", COMPUTED, source],
        check=True,
        capture_output=True,
        text=True,
        env={**os.environ, "BROWSER": "true"},
    )
    return float(said.stdout.split()[-1])


def start(browser: Browser, source: str) -> tuple[float, float]:
    """Return the time from the command to its address, and to a page that moves, s."""
    begin = time.monotonic()
    with playing(source, 18600) as (_, url):
        said = time.monotonic() - begin
        tab = browser.new_page(viewport=WINDOW, device_scale_factor=0.5)
        tab.goto(f"{url}/?fixedDpr=0.5")
        before = picture(tab)
        while True:
            after = picture(tab)
            if (np.ptp(after, axis=2) > 100).mean() > 1e-3 and (np.abs(after - before) > 60).sum() > 100:
                break  # the gizmo's arrows have colours, and something moves
            before = after
        moves = time.monotonic() - begin
        tab.close()
    return said, moves


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    rounds = parser.parse_args().rounds
    with sync_playwright() as driver, tempfile.TemporaryDirectory() as folder:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=OPTIONS)
        spec = Path(folder) / "circle.yaml"
        spec.write_text(CIRCLE, encoding="utf-8")
        for _ in range(rounds):
            load = os.getloadavg()[0]
            busy = computed(str(spec))
            said, moves = start(browser, str(spec))
            print(
                f"start: {busy:.2f} s of a processor until the robot moves; the address comes after {said:.1f} s,"
            )
            print(f"       and the page moves after {moves:.1f} s, under a load of {load:.1f}")
        browser.close()


if __name__ == "__main__":
    main()
