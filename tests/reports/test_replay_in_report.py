"""Reports that `dqcontrol report` writes move, in one file that asks for nothing."""

import html
import re
import shutil

import pytest

import dqcontrol as dqc
from dqcontrol.reports import rewrite_reports, run_report

pytest.importorskip("viser", reason="replays need viser: pip install 'dqcontrol[view]'")
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
SPEC = {
    "name": "circle",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.02,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 1.0},
    "law": {"kind": "proportional", "gain": 5},
    "plant": {"kind": "integrator"},
}


@pytest.mark.slow
def test_a_report_holds_its_replay_and_says_how_large_it_is(tmp_path, monkeypatch):
    dqc.run(SPEC).save(tmp_path / "run")
    page = tmp_path / "run/report.html"
    assert "<iframe" not in page.read_text(encoding="utf-8")  # runs write theirs at once, without
    rewrite_reports([tmp_path / "run"])
    text = page.read_text(encoding="utf-8")
    (replay,) = re.findall(r'<iframe srcdoc="(.*?)"', text, re.DOTALL)
    replay = html.unescape(replay)
    assert "__VISER_EMBED_DATA__" in replay
    assert len(replay.encode()) < 3e6
    assert f"part of this page ({len(replay.encode()) / 1e6:.1f} MB)" in text
    assert 'alt="The robot at its start' in text  # for paper

    monkeypatch.setattr(run_report, "_MOST_BYTES", 1000)
    rewrite_reports([tmp_path / "run"])
    assert "<iframe" not in page.read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium: apt-get install chromium")
def test_the_replay_plays_within_its_report(tmp_path):
    playwright = pytest.importorskip("playwright.sync_api", reason="the browser test needs playwright")
    dqc.run(SPEC).save(tmp_path / "run")
    rewrite_reports([tmp_path / "run"])
    with playwright.sync_playwright() as driver:
        window = driver.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--enable-unsafe-swiftshader"]
        )
        tab = window.new_page(viewport={"width": 600, "height": 400}, device_scale_factor=0.5)
        asked, complaints = [], []
        tab.on("request", lambda request: asked.append(request.url.partition(":")[0]))
        tab.on("pageerror", lambda error: complaints.append(str(error)))
        tab.on("console", lambda line: line.type == "error" and complaints.append(line.text))
        tab.goto(f"file://{tmp_path / 'run/report.html'}")
        time = tab.frame_locator("iframe").locator("input").first
        time.wait_for(timeout=120_000)  # ms; machines may be busy
        before = time.input_value()
        for _ in range(200):
            if time.input_value() != before:
                break
            tab.wait_for_timeout(100)
        assert time.input_value() != before
        assert set(asked) <= {"file", "data", "blob"}
        assert complaints == []
        window.close()
