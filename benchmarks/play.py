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
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from dqcontrol.browser.served_page import start_server, stop_server

# What Chromium does by itself without a graphics card: a processor paints the page, SwiftShader the scene, once it may.
OPTIONS = ["--no-sandbox", "--enable-unsafe-swiftshader"]
ENVIRONMENT = {**os.environ, "BROWSER": "true"}
ENVIRONMENT.pop("PYTHONDONTWRITEBYTECODE", None)  # installed modules have their bytecode
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
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=folder, env=ENVIRONMENT)
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            yield process, line.split()[1]
        finally:
            process.terminate()
            process.wait()


DRAWN = """() => new Promise(done => {
    let left = 10; const next = () => left-- ? requestAnimationFrame(next) : done(true);
    requestAnimationFrame(next);
})"""  # some pictures later
COUNTED = """(() => {
    window.drawn = 0; let isDrawn = false;
    for (const kind of ["drawElements", "drawArrays", "drawElementsInstanced"]) {
        const own = WebGL2RenderingContext.prototype[kind];
        WebGL2RenderingContext.prototype[kind] = function (...each) { isDrawn = true; return own.apply(this, each); };
    }
    const next = () => { window.drawn += isDrawn; isDrawn = false; requestAnimationFrame(next); };
    requestAnimationFrame(next);
})()"""
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
        env=ENVIRONMENT,
    )
    return float(said.stdout.split()[-1])


def empty_start(browser: Browser) -> float:
    """Return the time that an empty scene of viser takes to a first picture, s: nobody's page is there sooner."""
    server = start_server(18610)
    begin = time.monotonic()
    tab = browser.new_page(viewport=WINDOW, device_scale_factor=0.5)
    tab.add_init_script(COUNTED)
    tab.goto("http://127.0.0.1:18610/?fixedDpr=0.5")
    tab.wait_for_function("window.drawn > 0", timeout=60_000)
    taken = time.monotonic() - begin
    tab.close()
    stop_server(server)
    return taken


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


class Playing:
    """A session and its page in this process, and what its steps saw."""

    def __init__(self, spec: dict[str, Any], port: int, folder: Path) -> None:
        from dqcontrol.browser.play import PlayPage, PlaySession

        self.session = PlaySession(spec)
        self.page = PlayPage(self.session, folder, port)
        self.moves: list[float] = []  # moments at which a step went on to another target
        step, last = self.session.step, [self.session.live.target]

        def watched() -> None:
            step()
            if np.any(last[0] != self.session.live.target):
                self.moves.append(time.monotonic())
                last[0] = self.session.live.target

        self.session.step = watched  # type: ignore[method-assign]
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)

    def __enter__(self) -> Playing:
        self.session.__enter__()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closed.set()
        self._thread.join()
        self.page.server.stop()
        self.session.__exit__(None, None, None)

    def _work(self) -> None:
        while not self._closed.wait(1 / 30):
            self.page.tick()

    def drags(self, tab: Page, count: int, number: int = 0) -> Any:
        """Return the times from a pointer's move in a tab, by its number, to the first step that moves there, s."""
        viewer = list(self.page.server.get_clients().values())[number]
        return drags(tab, viewer, self.page._gizmos[""], lambda: self.moves, count)


def arrow(viewer: Any, gizmo: Any, tab: Page) -> tuple[Any, Any]:
    """Return where a viewer sees an arrow of a gizmo in its tab, px, and which way it points."""
    from dqcontrol import algebra

    camera = viewer.camera
    turn = algebra.matrix_from_rotation(np.asarray(camera.wxyz))
    focal = 0.5 * camera.image_height / np.tan(camera.fov / 2)
    box = tab.locator("canvas").first.bounding_box()
    assert box is not None
    scale = box["width"] / camera.image_width

    def pixel(point: Any) -> Any:
        x, y, z = turn.T @ (point - np.asarray(camera.position))
        middle = np.array([camera.image_width, camera.image_height]) / 2
        return np.array([box["x"], box["y"]]) + scale * (middle + focal * np.array([x, y]) / z)

    along = algebra.matrix_from_rotation(np.asarray(gizmo.wxyz))[:, 1] * gizmo.scale
    near, far = (pixel(np.asarray(gizmo.position) + share * along) for share in (0.7, 0.8))
    return near, (far - near) / np.linalg.norm(far - near)


def opened(browser: Browser, url: str, complaints: list[str]) -> Page:
    """Return a tab that shows a page, whose errors are kept."""
    tab = browser.new_page(viewport=WINDOW, device_scale_factor=0.5)
    tab.set_default_timeout(120_000)
    tab.on("pageerror", lambda error: complaints.append(str(error)))
    tab.on("console", lambda line: line.type == "error" and complaints.append(line.text))
    tab.add_init_script(COUNTED)
    tab.goto(f"{url}/?fixedDpr=0.5")
    while (np.ptp(picture(tab), axis=2) > 100).mean() < 1e-3:
        tab.wait_for_timeout(100)
    return tab


def frames(tab: Page, seconds: float = 5.0) -> float:
    """Return how many pictures of its scene a page draws a second; it draws none where nothing moves."""
    count = "window.drawn"
    begin, then = tab.evaluate(count), time.monotonic()
    tab.wait_for_timeout(1e3 * seconds)
    return float(tab.evaluate(count) - begin) / (time.monotonic() - then)


def empty_scene(browser: Browser, port: int, count: int) -> tuple[float, Any]:
    """Return the pictures a second of a scene with nothing but a floor, and the times of drags of a lone gizmo, s."""
    from dqcontrol.browser.served_page import address, start_server

    server, seen = start_server(port), list[float]()
    server.scene.add_grid("/floor", 4.0, 4.0, cell_size=0.1, section_size=0.5)
    server.initial_camera.position, server.initial_camera.look_at = (-2.0, 0.3, 1.1), (0.3, 0.0, 0.4)
    gizmo = server.scene.add_transform_controls(
        "/gizmo", scale=0.16, position=(0.4, 0.0, 0.5), depth_test=False
    )

    async def moved(_: Any) -> None:
        seen.append(time.monotonic())

    gizmo.on_update(moved)
    tab = browser.new_page(viewport=WINDOW, device_scale_factor=0.5)
    tab.add_init_script(COUNTED)
    tab.goto(f"{address(server)}/?fixedDpr=0.5")
    while not server.get_clients():
        tab.wait_for_timeout(100)
    tab.wait_for_timeout(4000)
    (viewer,) = server.get_clients().values()
    late = drags(tab, viewer, gizmo, lambda: seen, count)
    with moving(gizmo):
        drawn = frames(tab)
    tab.close()
    server.stop()
    return drawn, late


@contextmanager
def moving(node: Any) -> Iterator[None]:
    """Move a node of the scene 30 times a second, as play moves a robot."""
    ended = threading.Event()

    def move() -> None:
        k = 0
        while not ended.wait(1 / 30):
            k += 1
            node.position = (0.4, 0.1 * np.sin(k / 10), 0.5)

    thread = threading.Thread(target=move)
    thread.start()
    yield
    ended.set()
    thread.join()


def drags(tab: Page, viewer: Any, gizmo: Any, moves: Callable[[], list[float]], count: int) -> Any:
    """Return the times from a pointer's move to the first motion that comes of it, s; ``moves`` are their moments."""
    mouse, found = tab.mouse, []
    for _ in range(
        5
    ):  # a tab that was behind others has drawn nothing, and a press beside the arrow turns the view
        tab.bring_to_front()
        tab.evaluate(DRAWN)
        at, along = arrow(viewer, gizmo, tab)
        mouse.move(*at)
        tab.evaluate(DRAWN)
        mouse.down()
        begin = time.monotonic()
        mouse.move(*(at + 8 * along))
        tab.wait_for_timeout(500)
        if any(when > begin for when in moves()):
            break
        mouse.up()
    for k in range(count):
        begin = time.monotonic()
        mouse.move(*(at + (16 if k % 2 else 30) * along))
        tab.wait_for_timeout(400)
        if steps := [when for when in moves() if when > begin]:
            found.append(steps[0] - begin)
    mouse.up()
    return np.array(found)


def memory(minutes: float) -> tuple[float, float]:
    """Return how much a process grows in minutes of dragging, simulated fast: MB after ten at most, and after all."""
    import psutil

    from dqcontrol import algebra
    from dqcontrol.experiments.driven import driven_spec

    spec, folder = driven_spec("panda")
    playing, process = Playing(spec, 18680, folder), psutil.Process()
    session, page = playing.session, playing.page
    start = session.live.state.pose
    page.tick()
    time.sleep(3.0)  # what check expects comes in the background
    begin, after, steps = process.memory_info().rss, 0, int(6000 * minutes)
    for k in range(steps):
        if k % 3 == 0:
            shift = [0.03 * np.sin(k / 40), 0.1 * np.sin(k / 60), 0.05 * (1 - np.cos(k / 50))]
            session.drag(algebra.multiply(algebra.pose([1, 0, 0, 0], shift), start))
        session.step()
        if k % 30 == 0:
            page._charted = 0.0
            page.tick()
        if k == min(60_000, steps - 1):
            after = process.memory_info().rss - begin
    page.server.stop()
    return after / 1e6, (process.memory_info().rss - begin) / 1e6


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3, help="of starts")
    parser.add_argument("--drags", type=int, default=40)
    parser.add_argument("--minutes", type=float, default=60.0, help="of the look at the memory, simulated")
    chosen = parser.parse_args()
    with sync_playwright() as driver, tempfile.TemporaryDirectory() as name:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=OPTIONS)
        folder = Path(name)
        spec = folder / "circle.yaml"
        spec.write_text(CIRCLE, encoding="utf-8")
        for _ in range(chosen.rounds):
            busy = computed(str(spec))
            said, moves = start(browser, str(spec))
            print(
                f"start: {busy:.2f} s of a processor until the robot moves; the address comes after {said:.1f} s,"
            )
            empty, load = empty_start(browser), os.getloadavg()[0]
            print(
                f"       and the page moves after {moves:.1f} s; an empty page of viser draws after {empty:.1f} s"
            )
            print(f"       under a load of {load:.1f}", flush=True)

        from dqcontrol.experiments.driven import driven_spec

        complaints: list[str] = []
        empty, floor = empty_scene(browser, 18610, chosen.drags)
        print(f"pictures a second: {empty:.1f} of an empty scene,", end=" ", flush=True)
        with Playing(driven_spec("panda")[0], 18620, folder) as playing:
            session = playing.session
            tab = opened(browser, playing.page.url, complaints)
            session.follow({"kind": "circle", "radius": 0.1, "duration": 600, "turns": 200, "plane": "yz"})
            alone = frames(tab)
            session.set_ghost({"kind": "proportional", "gain": 5.0})
            tab.wait_for_timeout(2000)
            print(f"{alone:.1f} of a Panda that moves, with its charts, {frames(tab):.1f} of two", flush=True)
            session.set_ghost(None)
            session.hold()  # an arrow that goes round cannot be pressed where it was
            tab.wait_for_timeout(1000)
            late = playing.drags(tab, chosen.drags)
            for what, times in (("drag to motion", late), ("to a message of an empty scene", floor)):
                if not len(times):
                    print(f"{what}: none of {chosen.drags} moves arrived within 0.4 s", flush=True)
                    continue
                middle, most = 1e3 * np.quantile(times, [0.5, 0.95])
                load = f"load {os.getloadavg()[0]:.1f}"
                print(f"{what}: median {middle:.0f} ms, 95 % below {most:.0f} ms", end=" ")
                print(f"({len(times)} of {chosen.drags} moves, {load})", flush=True)
            second = opened(browser, playing.page.url, complaints)
            pairs = [playing.drags(each, 4, k) for k, each in enumerate((tab, second))]
            kept = session.live.target
            tab.reload()
            tab.wait_for_timeout(5000)
            same = np.array_equal(kept, session.live.target)
            print(
                f"two pages at once: {' and '.join(str(len(each)) for each in pairs)} of 4 drags each arrive;",
                end=" ",
            )
            print(f"a reload keeps the target: {same}; errors of the pages: {complaints}", flush=True)
        browser.close()
    ten, all_ = memory(chosen.minutes)
    first = min(10.0, chosen.minutes)
    print(
        f"memory: +{ten:.1f} MB in {first:g} minutes, +{all_:.1f} MB in {chosen.minutes:g}, simulated fast, "
        f"load {os.getloadavg()[0]:.1f}"
    )


if __name__ == "__main__":
    main()
