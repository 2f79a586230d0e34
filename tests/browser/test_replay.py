"""Runs as one page: it holds all it needs, and plays in a browser from the file system."""

import shutil

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.browser import Track, replay_page
from dqcontrol.cli import main

pytest.importorskip("viser", reason="the browser view needs viser: pip install 'dqcontrol[view]'")
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
SPEC = {
    "name": "circle",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, -1.6, 0, 0.9, 0],
    "period": 0.01,
    "reference": {"kind": "circle", "radius": 0.05, "duration": 2.0, "plane": "yz"},
    "law": {"kind": "proportional-feedforward", "gain": 5.0},
    "plant": {"kind": "integrator"},
    "world": {"floor": True, "ball": {"sphere": 0.05, "position": [0.3, 0.4, 0.5]}},
    "constraints": {"clear_of": "all", "margin": 0.01},
}


@pytest.fixture(scope="module")
def run():
    return dqc.run(SPEC)


def test_a_run_becomes_a_page_of_at_most_three_megabytes(run, tmp_path, monkeypatch, capsys, few_figures):
    run.save(tmp_path / "circle")
    monkeypatch.setattr(
        "sys.argv", ["dqcontrol", "view", str(tmp_path / "circle"), "--save", str(tmp_path / "a.html")]
    )
    main()
    page = (tmp_path / "a.html").read_text()
    assert "a.html (" in capsys.readouterr().out
    assert len(page.encode()) < 3e6
    assert "<title>" in page
    with pytest.raises(SystemExit):
        main()  # it exists
    assert "exists already" in capsys.readouterr().err
    monkeypatch.setattr("sys.argv", ["dqcontrol", "view", str(tmp_path / "circle"), "--save", "a.pdf"])
    with pytest.raises(SystemExit):
        main()
    assert "expected the name of a page, .html" in capsys.readouterr().err


def test_a_notebook_shows_it_in_a_cell(run):
    shown = run.view(height=300)
    assert "__VISER_EMBED_DATA__" in shown.html
    cell = shown._repr_html_()
    assert cell.startswith("<iframe srcdoc=")
    assert 'height="300"' in cell
    assert "<html" not in cell  # escaped


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium: apt-get install chromium")
def test_it_plays_from_the_file_system_and_asks_for_nothing(run, tmp_path):
    playwright = pytest.importorskip("playwright.sync_api", reason="the browser test needs playwright")
    page = replay_page([Track("one", run.robot, run.record), Track("two", run.robot, run.record)], "both")
    (tmp_path / "both.html").write_text(page, encoding="utf-8")
    options = ["--no-sandbox", "--enable-unsafe-swiftshader"]
    with playwright.sync_playwright() as driver:
        window = driver.chromium.launch(executable_path=CHROMIUM, args=options)
        tab = window.new_page(viewport={"width": 600, "height": 400}, device_scale_factor=0.5)
        tab.set_default_timeout(120_000)  # ms; machines may be busy
        asked, complaints = [], []
        tab.on("request", lambda request: asked.append(request.url.partition(":")[0]))
        tab.on("pageerror", lambda error: complaints.append(str(error)))
        tab.on("console", lambda line: line.type == "error" and complaints.append(line.text))
        tab.goto(f"file://{tmp_path / 'both.html'}")
        time = tab.locator("input").first
        time.wait_for()
        values = set()
        for _ in range(200):
            values.add(time.input_value())
            if len(values) > 3:
                break
            tab.wait_for_timeout(100)
        assert len(values) > 3  # it plays
        assert tab.title() == "both"
        assert set(asked) <= {"file", "data", "blob"}
        assert complaints == []
        window.close()


def test_numbers_are_those_of_the_sample(run):
    from dqcontrol.browser.replay import _numbers

    track = Track("mine", run.robot, run.record, constraints=run.surroundings)
    lines = _numbers(track, 100).splitlines()
    assert lines[:2] == ["mine", "t = 1.00 s"]
    assert lines[2] == f"error {1e3 * run.record.position_error[100]:.2f} mm"
    share = np.nanmax(np.abs(run.record.command[100]) / run.robot.limits.velocity)
    assert lines[3] == f"speed {100 * share:.0f} % of limit"
    assert lines[4].endswith("mm to spare")
