"""A target dragged by a real pointer in Chromium: the arm follows, laws and joints change, nothing complains."""

import io
import shutil
import threading
import time

import numpy as np
import pytest
from played_spec import PRESS, SPEC

from dqcontrol import algebra
from dqcontrol.browser.play import SCENES, PlayPage, PlaySession
from dqcontrol.experiments.driven import driven_spec

pytest.importorskip("viser", reason="the browser view needs viser: pip install 'dqcontrol[view]'")
playwright = pytest.importorskip("playwright.sync_api", reason="the browser test needs playwright")
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium: apt-get install chromium")

OPTIONS = [
    "--no-sandbox",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
]
WIDTH, HEIGHT = 1000, 640


class Playing:
    """A session and its page, which ticks in a thread, and a tab of Chromium that looks at it."""

    def __init__(self, browser, folder, spec=SPEC):
        self.session = PlaySession(dict(spec))
        self.page = PlayPage(self.session, folder, 18480)
        scene = self.page.server.scene
        scene.configure_environment_map(None)  # half a minute of drawing in software
        scene.configure_default_lights(cast_shadow=False)
        self.session.__enter__()
        self.end, self.failures = threading.Event(), []
        self.thread = threading.Thread(target=self.work)
        self.thread.start()
        self.tab = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}, device_scale_factor=0.5)
        self.tab.set_default_timeout(120_000)  # ms; machines may be busy
        self.complaints = []
        self.tab.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.tab.on("console", lambda line: line.type == "error" and self.complaints.append(line.text))
        self.tab.goto(f"{self.page.url}/?fixedDpr=0.5")
        self.until(lambda: self.camera is not None and self.is_drawn())

    def work(self):
        while not self.end.wait(0.03):
            try:
                self.page.tick()
            except Exception as failure:
                self.failures.append(failure)
                return

    def is_drawn(self):
        """Tell whether the scene holds a gizmo: its arrows have colours, unlike floor and robot."""
        from PIL import Image

        window = Image.open(io.BytesIO(self.tab.screenshot(animations="disabled"))).convert("RGB")
        scene = np.asarray(window, dtype=int)[:, : int(0.25 * WIDTH)]
        return (np.ptp(scene, axis=2) > 100).mean() > 1e-3

    @property
    def camera(self):
        clients = list(self.page.server.get_clients().values())
        return clients[-1].camera if clients and clients[-1].camera.update_timestamp else None

    def until(self, condition, seconds=120):
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, "the page never came to it"
            self.tab.wait_for_timeout(50)

    def pixel(self, point):
        """Return where a point in the room is seen, px."""
        camera = self.camera
        turn = algebra.matrix_from_rotation(np.asarray(camera.wxyz))
        x, y, z = turn.T @ (np.asarray(point) - np.asarray(camera.position))
        focal = 0.5 * camera.image_height / np.tan(camera.fov / 2)
        box = self.tab.locator("canvas").first.bounding_box()
        scale = box["width"] / camera.image_width
        return (
            box["x"] + scale * (0.5 * camera.image_width + focal * x / z),
            box["y"] + scale * (0.5 * camera.image_height + focal * y / z),
        )

    def handle(self, axis, name=""):
        """Return where an arrow of a gizmo is seen, px, and which way it points."""
        gizmo = self.page._gizmos[name]
        pose = algebra.pose(np.asarray(gizmo.wxyz), np.asarray(gizmo.position))
        turn = algebra.matrix_from_rotation(algebra.rotation(pose))
        middle, along = algebra.translation(pose), turn[:, axis]
        near, far = (np.array(self.pixel(middle + share * gizmo.scale * along)) for share in (0.6, 0.8))
        return near, (far - near) / np.linalg.norm(far - near)

    def drag(self, axis, way, name="", pieces=12):
        """Take an arrow of a gizmo by the pointer and draw it along, px."""
        at, along = self.handle(axis, name)
        mouse = self.tab.mouse
        mouse.move(*at)
        self.tab.wait_for_timeout(300)
        mouse.down()
        for k in range(1, pieces + 1):
            mouse.move(*(at + way * k / pieces * along))
            self.tab.wait_for_timeout(30)
        mouse.up()

    def close(self):
        self.end.set()
        self.thread.join()
        self.page.server.stop()
        self.session.__exit__(None, None, None)
        self.tab.close()
        assert self.failures == []
        assert self.complaints == []


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as driver:
        window = driver.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        yield window
        window.close()


@pytest.mark.slow
def test_a_pointer_drags_the_target_and_the_arm_follows(browser, tmp_path):
    playing = Playing(browser, tmp_path)
    session, tab = playing.session, playing.tab
    try:
        numbers = (
            "Object.values(__viserTestpoints.uplots).map(each => each.chart.axes[0]._values?.length ?? 0)"
        )
        playing.until(
            lambda: min(tab.evaluate(numbers)) >= 2
        )  # on the time axis of each chart, before anything moves
        start, axis = session.live.state.pose, 1
        target = session.live.target.copy()
        while np.abs(session.live.target - target).max() < 0.01:  # a machine that is busy may miss the arrow
            playing.drag(axis, 50)
        playing.until(lambda: np.abs(session.live.target - target).max() > 0.01)
        moved = algebra.translation(session.live.target) - algebra.translation(target)
        turn = algebra.matrix_from_rotation(algebra.rotation(target))
        across = np.delete(turn.T @ moved, axis)
        assert np.abs(across).max() < 1e-3 < 0.02 < np.linalg.norm(moved)  # along the arrow
        playing.until(lambda: session.live.state.missing < 1e-3)
        assert (
            np.linalg.norm(algebra.translation(session.live.state.pose) - algebra.translation(start)) > 0.02
        )

        tab.get_by_role("tab", name="Record").click()
        tab.get_by_text("Save as YAML", exact=True).click()
        playing.until(lambda: (tmp_path / "played.yaml").exists())
        playing.until(lambda: "joints differ by at most" in tab.content())
        said = tab.get_by_text("joints differ by at most").first.inner_text()
        assert float(said.split("at most ")[1].split()[0]) < 1e-9

        tab.get_by_role("tab", name="Law").click()
        slider = tab.get_by_role("slider").first
        slider.focus()
        tab.keyboard.press("ArrowRight")
        playing.until(lambda: session.spec["law"]["gain"] > 5)
        assert session.live.law.gain == session.spec["law"]["gain"] < 6

        tab.get_by_role("tab", name="Target").click()
        tab.get_by_text("Circle", exact=True).click()
        playing.until(lambda: session.spec["reference"]["kind"] == "circle")
        tab.mouse.click(30, 600)
        tab.keyboard.press("h")  # hold here
        playing.until(lambda: session.spec["reference"]["kind"] == "set-point")
        assert session.live.target is None
        tab.keyboard.press("r")
        playing.until(lambda: np.abs(session.live.plant.q - SPEC["start"]).max() < 1e-6)
        target = session.live.target
        assert target is not None

        playing.page.alone = 120.0  # s that a busy machine may take to load a page
        tab.reload()  # what was set stays
        playing.until(lambda: "iiwa7" in tab.content())
        np.testing.assert_array_equal(session.live.target, target)
        assert session.spec["law"]["gain"] > 5
        playing.page.alone = 1.0
        tab.goto("about:blank")
        playing.until(lambda: session.live.target is None)  # nobody looks: the arm rests
    finally:
        playing.close()


def places(poses):
    return {name: algebra.translation(pose) for name, pose in poses.items()}


@pytest.mark.slow
def test_a_pointer_drags_either_of_two_arms(browser, tmp_path):
    playing = Playing(browser, tmp_path, driven_spec("two-pandas")[0])
    session = playing.session
    try:
        for name, other in (("left", "right"), ("right", "left")):
            begin = places(session.ends.handles)
            while np.abs(places(session.ends.handles)[name] - begin[name]).max() < 0.02:
                playing.drag(1, 40, name)
            playing.until(lambda: session.live.state.missing < 1e-3)
            hands = places({each: session.robot.fkm(session.live.plant.q, each) for each in begin})
            assert np.linalg.norm(hands[name] - begin[name]) > 0.02
            assert np.linalg.norm(hands[other] - begin[other]) < 1e-3
    finally:
        playing.close()


@pytest.mark.slow
def test_ten_scenes_have_three_sentences_and_run():
    assert len(SCENES) == 10
    for scene in SCENES:
        assert scene.look_for.count(". ") + scene.look_for.count("? ") + 1 == 3, scene.title
        session = PlaySession(dict(scene.spec))
        assert session.play(dict(scene.spec), scene.ghost), session.told
        for _ in range(60):
            session.step()
        assert session.live.condition.startswith("active"), scene.title
        assert (session.ghost is None) == (scene.ghost is None)


@pytest.mark.slow
def test_a_slider_presses_harder_and_the_limit_is_marked(browser, tmp_path):
    playing = Playing(browser, tmp_path, PRESS)
    session, tab = playing.session, playing.tab
    try:
        tab.get_by_role("tab", name="Robot").click()
        playing.until(lambda: "limit 6030" in tab.content())  # as `check` says it
        playing.until(lambda: "least 33.2" in tab.content())
        playing.until(lambda: abs(session.live.control.contact_wrench[5] - 2.0) < 0.05)
        slider = tab.get_by_role("slider").nth(1)  # damping, then force
        slider.focus()
        for _ in range(5):
            tab.keyboard.press("ArrowRight")
        playing.until(lambda: session.live.law.contact.force.z > 2.0)
        playing.until(
            lambda: abs(session.live.control.contact_wrench[5] - session.live.law.contact.force.z) < 0.02
        )
        playing.until(lambda: f"{session.live.law.contact.force.z:.2f} asked" in tab.content())
    finally:
        playing.close()
