import math
import re
from html.parser import HTMLParser

import pytest
from gallery import run

from dqcontrol.errors import ExistsError
from dqcontrol.figures import errors, path_3d, save
from dqcontrol.reports import write_report
from dqcontrol.tables.tables import Column, Ratio, Table, VerdictCell


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


def written(folder, *arguments, **options):
    text = write_report(folder, *arguments, **options).read_text(encoding="utf-8")
    return Page(text), text


def test_a_report_holds_everything_and_asks_the_network_for_nothing(tmp_path):
    table = Table([Column("Joint"), Column("Speed", "rad/s")], [["a", 1.5]], "Peaks")
    verdicts = Table([Column("Question"), Column("Verdict")], [["End", VerdictCell("succeeded", True)]])
    page, text = written(
        tmp_path,
        "Circle",
        facts="6 s",
        command="dqcontrol run spec.yaml --out again",
        verdicts=[verdicts],
        tables=[table],
        figures={"errors": errors(run()), "odd <name>": path_3d(run())},
        files={"K · servo": "K-servo/report.html"},
        spec="law: K\n",
        origins=Table([Column("what"), Column("value")], [["seed", "7"]]),
    )
    assert page.texts["h1"] == ["Circle"]
    assert page.texts["h2"] == [
        "Verdicts",
        "The same again",
        "Tables",
        "Figures",
        "Files beside this page",
        "Experiment",
        "Versions and seeds",
    ]
    assert page.texts["pre"] == ["dqcontrol run spec.yaml --out again", "law: K\n"]
    assert {"✓ succeeded", "a", "1.5", "seed", "7"} <= set(page.texts["td"])
    assert page.texts["caption"] == ["Peaks"]
    assert page.texts["figcaption"][1] == "odd <name>"
    assert [link.partition(",")[0] for link in page.links] == [
        "data:image/svg+xml;base64",
        "data:image/svg+xml;base64",
        "K-servo/report.html",
    ]
    assert "script" not in page.tags
    assert not re.search(r"https?://|@import|url\(", text)
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]


def test_texts_are_escaped(tmp_path):
    evil = "</pre><script>alert('{metrics}')</script>&amp;"
    table = Table([Column(evil)], [[evil]], evil)
    options = {"facts": evil, "notice": evil, "command": evil, "spec": evil, "files": {evil: '"><b>'}}
    page, _ = written(tmp_path, evil, tables=[table], **options)
    assert not {"script", "b"} & set(page.tags)
    for place in ("title", "h1", "pre", "th", "td", "caption", "p", "a"):
        assert evil in page.texts[place], place


def test_verdicts_have_marks_and_words_beside_their_colours(tmp_path):
    words = [
        VerdictCell("kept", True),
        VerdictCell("failed", False),
        VerdictCell("intervened", None),
        Ratio(1.05),
        Ratio(0.5),
    ]
    table = Table([Column("a")], [[word] for word in [*words[:3], "plain"]])
    ratios = Table([Column("Ratio", "", ".3g")], [[Ratio(1.05)], [Ratio(0.5)], [Ratio(math.nan)]])
    page, text = written(tmp_path, "Verdicts", verdicts=[table], tables=[ratios])
    assert page.texts["td"] == [
        *("✓ kept", "✗ failed", "• intervened", "plain"),
        *("✓ agrees: 1.05", "✗ differs: 0.5", "–"),
    ]
    assert text.count("<td class=bad>") == 1
    assert text.count('<td class="number bad">') == 1


@pytest.mark.slow
def test_a_figure_of_too_many_strokes_is_shown_in_pixels(tmp_path, monkeypatch):
    monkeypatch.setattr(save, "_LARGEST_SVG", 10_000)
    page, _ = written(tmp_path, "Large", figures={"errors": errors(run())})
    assert page.links[0].startswith("data:image/png;base64,")


def test_an_existing_report_is_kept(tmp_path):
    (tmp_path / "report.html").write_text("precious")
    with pytest.raises(ExistsError, match="exists already"):
        write_report(tmp_path, "Circle")
    assert (tmp_path / "report.html").read_text() == "precious"
