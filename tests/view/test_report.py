import re
from html.parser import HTMLParser

import numpy as np
import pytest

from dqcontrol.errors import ExistsError, FileFormatError
from dqcontrol.experiments.metrics import evaluate
from dqcontrol.experiments.tables import Column, Table
from dqcontrol.loop.record import Record
from dqcontrol.view.report import write_report

PIXEL = bytes.fromhex(
    "89504e470d0a1a0a0000000d49484452000000010000000108060000001f15c4890000000d49444154789c63f8ffff3f0005fe02fe"
    "a735811b0000000049454e44ae426082"
)


def make(stopped="duration"):
    pose = np.tile([1.0, 0, 0, 0, 0, 0.05, 0, 0], (3, 1))
    desired = np.hstack([np.tile([1.0, 0, 0, 0, 0, 0, 0, 0], (3, 1)), np.zeros((3, 13))])
    q = np.zeros((3, 1))
    return Record(np.array([0.0, 0.5, 1.0]), q, q, q, pose, desired, ("a",), stopped=stopped)


RECORD = make()
METRICS = evaluate(RECORD)


class Page(HTMLParser):
    """Checks that elements close in order; collects texts and addresses."""

    def __init__(self, text):
        super().__init__()
        self.open, self.texts, self.links, self.tags = [], {}, [], []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for name, value in attrs if name in ("src", "href", "srcset", "data")]
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open:
            self.texts.setdefault(self.open[-1], []).append(data)


def test_a_report_holds_everything_and_asks_the_network_for_nothing(tmp_path):
    plot = tmp_path / "path.png"
    plot.write_bytes(PIXEL)
    table = Table([Column("Joint"), Column("Speed", "rad/s")], [["a", 1.5]], "Peaks")
    path = write_report(
        tmp_path, RECORD, METRICS, title="Circle", spec="law: K\n", plots=[plot], tables=[table]
    )
    assert path == tmp_path / "report.html"
    text = path.read_text(encoding="utf-8")
    page = Page(text)
    assert page.texts["h1"] == ["Circle"]
    assert page.texts["pre"] == ["law: K\n"]
    assert "ended: duration" in "".join(page.texts["p"])
    assert {"Position error mean", "100", "mm", "1.5"} <= set(page.texts["td"])
    assert page.texts["caption"] == ["Peaks"]
    assert [link[:22] for link in page.links] == ["data:image/png;base64,"]
    assert "script" not in page.tags
    assert not re.search(r"https?://|@import|url\(", text)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["path.png", "report.html"]


def test_texts_are_escaped(tmp_path):
    evil = "</pre><script>alert('{metrics}')</script>&amp;"
    table = Table([Column(evil)], [[evil]], evil)
    path = write_report(tmp_path, make(f"diverged: {evil}"), METRICS, title=evil, spec=evil, tables=[table])
    page = Page(path.read_text(encoding="utf-8"))
    assert "script" not in page.tags
    for place in ("title", "h1", "pre", "th", "td", "caption"):
        assert evil in page.texts[place], place
    assert f"The run diverged: {evil}" in page.texts["p"]


def test_one_format_of_each_figure_is_shown(tmp_path):
    names = ["path.pdf", "path.png", "path.svg", "errors.svg", "odd <name>.png"]
    for name in names:
        (tmp_path / name).write_bytes(PIXEL)
    page = Page(
        write_report(tmp_path, RECORD, METRICS, plots=[tmp_path / name for name in names]).read_text(
            encoding="utf-8"
        )
    )
    assert [link.partition(";")[0] for link in page.links] == [
        "data:image/png",
        "data:image/svg+xml",
        "data:image/png",
    ]
    assert page.texts["figcaption"][-1] == "odd <name>"


def test_an_existing_report_is_kept(tmp_path):
    (tmp_path / "report.html").write_text("precious")
    with pytest.raises(ExistsError, match="exists already"):
        write_report(tmp_path, RECORD, METRICS)
    assert (tmp_path / "report.html").read_text() == "precious"


def test_a_missing_figure_is_named_and_nothing_is_written(tmp_path):
    with pytest.raises(FileFormatError, match=r"gone\.png: cannot be read"):
        write_report(tmp_path / "new", RECORD, METRICS, plots=[tmp_path / "gone.png"])
    assert not list(tmp_path.iterdir())


def test_the_figures_in_the_folder_are_found(tmp_path):
    for name in ("inputs.png", "path.svg", "path.png", "other.png"):
        (tmp_path / name).write_bytes(PIXEL)
    page = Page(write_report(tmp_path, RECORD, METRICS).read_text(encoding="utf-8"))
    assert [link.partition(";")[0] for link in page.links] == ["data:image/png"] * 2
    assert [text.split()[0] for text in page.texts["figcaption"]] == ["Path", "Commanded"]
