"""Reports in a real Chromium, without a network: on the screen and on paper."""

import re
import shutil

import pytest
from gallery import figures

from dqcontrol.reports import write_report
from dqcontrol.tables.tables import Column, Table, VerdictCell

playwright = pytest.importorskip("playwright.sync_api", reason="the browser test needs playwright")
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium: apt-get install chromium")

SHOWN = ("path", "errors", "joints", "motion")
A4 = (210 - 2 * 14, 297 - 2 * 16)  # mm, within the margins that the page sets
MM = 96 / 25.4  # CSS pixels


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    wide = Table(
        [Column(f"peak speed {i}", "rad/√s") for i in range(12)], [[0.123456] * 12] * 60, "Many runs"
    )
    verdicts = Table([Column("Question"), Column("Verdict")], [["End", VerdictCell("failed", False)]])
    draw = figures()
    return write_report(
        tmp_path_factory.mktemp("report"),
        "All of it",
        notice="The run diverged at 1 s",
        command="dqcontrol run spec.yaml --out again",
        verdicts=[verdicts],
        tables=[wide],
        figures={name: draw[name]() for name in SHOWN},
        spec="name: long\n" + "word: " + "x" * 300 + "\n" + "a: 1\n" * 100,
    )


@pytest.fixture(scope="module")
def tab(report):
    """Return the page in a tab, with all that it complained of and asked for."""
    with playwright.sync_playwright() as driver:
        window = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        context = window.new_context(offline=True, viewport={"width": 1000, "height": 800})
        tab = context.new_page()
        tab.complaints, tab.asked = [], []
        tab.on("pageerror", lambda error: tab.complaints.append(str(error)))
        tab.on("console", lambda line: tab.complaints.append(line.text))
        tab.on("request", lambda request: tab.asked.append(request.url))
        tab.goto(report.as_uri())
        yield tab
        window.close()


def test_it_opens_from_a_file_without_a_word_or_a_request(tab, report):
    sizes = tab.eval_on_selector_all(
        "img", "all => all.map(i => [i.complete, i.naturalWidth, i.clientWidth])"
    )
    assert len(sizes) == len(SHOWN)
    assert all(complete and natural > 300 and shown > 300 for complete, natural, shown in sizes)
    assert tab.complaints == []
    assert [url for url in tab.asked if not url.startswith("data:")] == [report.as_uri()]


@pytest.mark.slow
def test_nothing_is_wider_than_a_phone_can_scroll(tab):
    tab.set_viewport_size({"width": 400, "height": 800})
    assert tab.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    tab.set_viewport_size({"width": 1000, "height": 800})


@pytest.mark.slow
def test_everything_fits_the_paper(tab):
    tab.emulate_media(media="print")
    width, height = (round(size * MM) for size in A4)
    tab.set_viewport_size({"width": width, "height": 800})
    boxes = tab.eval_on_selector_all(
        "img, table, pre, figure, div.short",
        "all => all.map(e => [e.tagName, e.getBoundingClientRect().right, e.scrollWidth, e.clientWidth,"
        " e.getBoundingClientRect().height, getComputedStyle(e).breakInside])",
    )
    for name, right, scroll, shown, tall, breaks in boxes:
        assert right <= width + 1, name
        if name == "PRE":
            assert scroll <= shown, "lines are wrapped"
        if name == "DIV":
            assert breaks == "avoid", "a short table is never cut"
        if name == "FIGURE":
            assert tall <= height, "fits on a page"
            assert breaks == "avoid"
    assert tab.evaluate("getComputedStyle(document.querySelector('thead')).display") == "table-header-group"
    assert tab.evaluate("getComputedStyle(document.body).color") == "rgb(0, 0, 0)"
    tab.emulate_media(media="screen")


@pytest.mark.slow
def test_it_prints_to_vectors_on_a4(tab, tmp_path):
    pdf = tab.pdf(prefer_css_page_size=True, print_background=False)
    sizes = {
        tuple(round(float(x)) for x in box)
        for box in re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", pdf)
    }
    assert sizes == {(595, 842)}  # points
    pages = len(re.findall(rb"/Type /Page\b", pdf))
    assert 4 <= pages <= 10
    assert b"/Subtype /Image" not in pdf
