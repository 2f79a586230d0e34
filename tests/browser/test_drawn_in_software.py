"""Where no graphics card draws it, the viewer's page draws no smooth edges; else it is the viewer's own."""

import shutil
import urllib.error
import urllib.request

import pytest

import dqcontrol as dqc
from dqcontrol.browser import RobotPage

pytest.importorskip("viser", reason="the browser view needs viser: pip install 'dqcontrol[view]'")
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
SMOOTH = """() => document.querySelector('canvas[data-engine]').getContext('webgl2').getContextAttributes().antialias"""
CARD = """() => {
    const own = WebGL2RenderingContext.prototype.getParameter;
    WebGL2RenderingContext.prototype.getParameter = function (key) {
        const found = own.call(this, key);
        return typeof found === "string" ? found.replace(/SwiftShader/g, "a card") : found;
    };
}"""


@pytest.fixture(scope="module")
def page():
    page = RobotPage(dqc.load_robot("iiwa7"), 18395)
    yield page
    page.server.stop()


def test_the_page_is_served_whole(page):
    """Its length is that of what is told and what the viewer says; other answers stay as they are."""
    with urllib.request.urlopen(page.url) as answer:
        text = answer.read().decode()
    assert int(answer.headers["Content-Length"]) == len(text.encode())
    assert text.index("antialias: false") < text.index("<title>Viser")
    assert text.rstrip().endswith("</html>")
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(f"{page.url}/nothing")


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium: apt-get install chromium")
@pytest.mark.parametrize("has_card", [False, True])
def test_edges_are_smooth_where_a_card_draws(page, has_card):
    playwright = pytest.importorskip("playwright.sync_api", reason="the browser test needs playwright")
    with playwright.sync_playwright() as driver:
        options = ["--no-sandbox", "--enable-unsafe-swiftshader"]
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=options)
        tab = browser.new_page()
        if has_card:
            tab.add_init_script(f"({CARD})()")
        tab.goto(page.url)
        tab.wait_for_selector("canvas[data-engine]", timeout=60_000)
        assert tab.evaluate(SMOOTH) is has_card
        browser.close()
