"""The page in a real browser: Chromium without a window, drawing in software."""

import io
import shutil
import threading
import time

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.browser import Page, Track
from dqcontrol.loop import Record

pytest.importorskip("viser", reason="the browser view needs viser: pip install 'dqcontrol[view]'")
playwright = pytest.importorskip("playwright.sync_api", reason="the browser test needs playwright")
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium: apt-get install chromium")

OPTIONS = [
    "--no-sandbox",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
]
WIDTH, HEIGHT = 900, 500
SCENE, TOP = 480, 140  # the controls lie to the right of the scene, a notice at its top
SCALE = 0.5  # pixels of a picture to one of the window


def moved(robot, shift):
    q = np.linspace(0, 1, 101)[:, None] * np.array([1.5, 0.8, 0, 0.5, 0, 0.6, 0]) + shift
    desired = np.hstack([robot.fkm(q - shift), np.zeros((101, 13))])
    return Record(0.02 * np.arange(101), q, q, 0 * q, robot.fkm(q), desired, robot.joint_names)


class Serving:
    """A page that ticks in a thread."""

    def __init__(self, tracks, news=None):
        self.page = Page(tracks, 18080, news)
        self.page.server.scene.configure_environment_map(None)  # half a minute of drawing in software
        self.page.server.scene.configure_default_lights(cast_shadow=False)
        self.end = threading.Event()
        self.thread = threading.Thread(target=self.work)
        self.thread.start()

    def work(self):
        while not self.end.wait(0.03):
            self.page.tick()

    def close(self):
        self.end.set()
        self.thread.join()
        self.page.server.stop()


@pytest.fixture(scope="module")
def arm():
    return dqc.load_robot("iiwa7")


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as driver:
        window = driver.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        yield window
        window.close()


class Visit:
    """A look at a page, with all that it complains of and asks for."""

    def __init__(self, browser, url):
        self.tab = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}, device_scale_factor=SCALE)
        self.tab.set_default_timeout(120_000)  # ms; machines may be busy
        self.complaints, self.outside = [], []
        self.tab.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.tab.on("console", lambda line: line.type == "error" and self.complaints.append(line.text))
        self.tab.on("request", lambda request: self._look(request.url, url))
        self.tab.goto(f"{url}/?fixedDpr={SCALE}")  # else the page draws coarser while the machine is busy
        self.until_drawn()

    def _look(self, asked, url):
        if not asked.startswith((url, url.replace("http", "ws"), "data:", "blob:")):
            self.outside.append(asked)

    def scene(self):
        """Return the pixels of the scene."""
        from PIL import Image

        # Of the whole window: to take a part of it, the browser draws anew in another size, for a while.
        data = self.tab.screenshot(animations="disabled")
        window = np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), dtype=int)
        return window[int(SCALE * TOP) :, : int(SCALE * SCENE)]

    def until_drawn(self):
        """Wait until the scene holds a robot and stands still."""
        self.until(lambda: coloured(self.scene()) > 0.01)
        self.settled()

    def settled(self):
        """Return the pixels once they no longer change, several times in a row: a busy machine draws seldom."""
        last, still = self.scene(), 0
        for _ in range(100):
            self.tab.wait_for_timeout(300)
            now = self.scene()
            still = still + 1 if difference(now, last) < 1e-4 else 0
            if still == 4:
                return now
            last = now
        raise AssertionError("the picture never stood still")

    def until(self, condition, seconds=120):
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, "the page never came to it"
            self.tab.wait_for_timeout(100)

    def check(self):
        assert self.complaints == []
        assert self.outside == []
        self.tab.close()


def is_coloured(pixels):
    return np.ptp(pixels, axis=2) > 40


def coloured(pixels):
    """Return the share of pixels with a colour, unlike floor and sky."""
    return is_coloured(pixels).mean()


def robots_apart(one, other):
    """Return the share of pixels that show a robot in one picture only; the floor's lines depend on the resolution."""
    return (is_coloured(one) != is_coloured(other)).mean()


def difference(one, other):
    return (np.abs(one - other).max(axis=2) > 12).mean()


@pytest.mark.slow
def test_two_runs_in_a_browser(arm, browser):
    tracks = [Track("first run", arm, moved(arm, 0.0)), Track("second run", arm, moved(arm, 0.05))]
    serving = Serving(tracks)
    try:
        visit = Visit(browser, serving.page.url)
        tab = visit.tab
        start = visit.settled()

        tab.get_by_role("slider").first.press("End")
        visit.until(lambda: serving.page.time == 2.0)
        visit.until(lambda: ">Ended<" in tab.content())
        visit.until(lambda: difference(visit.scene(), start) > 0.02)  # the arms have moved
        end = visit.settled()

        checks = {
            name: tab.get_by_label(name, exact=True) for name in ("first run", "second run", "Side by side")
        }
        checks["second run"].uncheck()
        visit.until(lambda: tab.get_by_text("Position error").count() == 1)
        visit.until(lambda: difference(visit.scene(), end) > 0.005)
        checks["second run"].check()
        visit.until(lambda: tab.get_by_text("Position error").count() == 2)

        checks["Side by side"].check()
        visit.until(lambda: difference(visit.scene(), end) > 0.02)

        later = Visit(browser, serving.page.url)  # the same time, the same places
        later.until(lambda: robots_apart(later.scene(), visit.scene()) < 0.01)
        assert robots_apart(later.scene(), end) > 0.02

        tab.reload()
        visit.until(lambda: robots_apart(visit.scene(), later.scene()) < 0.01)
        assert serving.page.time == 2.0
        later.check()
        visit.check()
    finally:
        serving.close()


@pytest.mark.slow
def test_playing_and_a_run_that_goes_on(arm, browser):
    whole = moved(arm, 0.0)

    def until(count):
        names = ("time", "q", "measured", "command", "pose", "desired")
        return Record(*(getattr(whole, name)[:count] for name in names), arm.joint_names, stopped="")

    track, rows = Track("live run", arm, until(5)), [5]

    def news():
        rows[0] = min(rows[0] + 20, 101)
        track.take(until(rows[0]))
        return rows[0] < 101

    serving = Serving([track], news)
    try:
        visit = Visit(browser, serving.page.url)
        visit.until(lambda: serving.page.time == 2.0)
        ended = visit.settled()
        visit.tab.get_by_role("slider").first.press("Home")
        visit.until(lambda: serving.page.time == 0.0)
        visit.until(lambda: difference(visit.scene(), ended) > 0.02)
        start = visit.settled()
        visit.tab.get_by_text("Play", exact=True).click()
        visit.tab.get_by_text("Pause", exact=True).wait_for()
        visit.until(lambda: serving.page.time == 2.0)
        visit.tab.get_by_text("Play", exact=True).wait_for()
        visit.until(lambda: difference(visit.scene(), start) > 0.02)
        visit.check()
    finally:
        serving.close()
