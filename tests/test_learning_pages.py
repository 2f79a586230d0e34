"""The tutorial and the how-to pages, done as a reader does them: from top to bottom, in one folder."""

import re
import shlex
import sys
from pathlib import Path

import pytest

import dqcontrol as dqc
from dqcontrol import cli

ROOT = Path(__file__).parents[1]
PAGES = (
    "tutorial.md",
    "own-robot.md",
    "own-law.md",
    "own-plant.md",
    "choose-gains.md",
    "theory.md",
    "painting.md",
)
BLOCK = re.compile(r"(?:<!-- (\S+) -->\n)?^ *```(\w+)\n(.*?)^ *```", re.DOTALL | re.MULTILINE)
LONG = ("tutorial.md", "painting.md")  # writes many plots
INSTALLING = ("git ", "python3 -m venv", "pip ")


def commands(text):
    """Return the lines of a console that are ours."""
    lines = [line.strip()[2:] for line in text.splitlines() if line.strip().startswith("$ ")]
    ours = [line for line in lines if line.startswith("dqcontrol ")]
    assert all(line in ours or line.startswith(INSTALLING) for line in lines), lines
    return ours


def promised(code):
    return re.findall(r"print\(.*\) +# (.+)$", code, re.MULTILINE)


@pytest.mark.parametrize(
    "page", [pytest.param(page, marks=[pytest.mark.slow] if page in LONG else []) for page in PAGES]
)
def test_page_does_what_it_says(page, tmp_path, monkeypatch, capsys):
    if page == "painting.md":
        pytest.importorskip("svgelements")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    text, names, done = (ROOT / "docs" / page).read_text(encoding="utf-8"), {"__name__": "page"}, 0
    for name, language, body in BLOCK.findall(text):
        if name:
            (tmp_path / name).write_text(body, encoding="utf-8")
        elif language == "python":
            exec(compile(body, page, "exec"), names)
            printed = capsys.readouterr().out
            for promise in promised(body):
                assert promise in printed
        elif language == "console":
            for command in commands(body):
                monkeypatch.setattr(sys, "argv", shlex.split(command))
                cli.main()  # a mistake would raise SystemExit
                assert capsys.readouterr().out, command
        elif language != "text":  # messages, tested with what gives them
            pytest.fail(f"{page}: nobody tests a block of {language}")
        done += 1
    assert done


def test_table_of_the_tutorial(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    text = (ROOT / "docs/tutorial.md").read_text(encoding="utf-8")
    (spec,) = [body for name, _, body in BLOCK.findall(text) if name == "mine.yaml"]
    (tmp_path / "mine.yaml").write_text(spec, encoding="utf-8")
    shown = text.partition("<!-- tutorial table: begin -->")[2].partition("<!-- tutorial")[0]
    table = dqc.run_study("mine.yaml").table().markdown()
    for cell, own in zip(cells(shown), cells(table), strict=True):
        assert cell == own or float(cell) == pytest.approx(float(own), rel=0.02, abs=1e-3)


def cells(table):
    return [cell.strip() for row in table.splitlines() if row.startswith("| ") for cell in row.split("|")]


def test_links_lead_somewhere():
    """Links of all pages: files that exist, headings that are there."""
    pages = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "docs").glob("*.md")}
    headings = {
        name: {
            re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in re.findall(r"^#+ (.*)$", text, re.M)
        }
        for name, text in pages.items()
    }
    for name in [*PAGES, "errors.md"]:
        for target in re.findall(r"\]\(([^)\s]+)\)", pages[name]):
            file, _, heading = target.partition("#")
            if file.startswith("http"):
                continue
            assert not file or (ROOT / "docs" / file).exists(), f"{name}: {target}"
            if heading and (not file or file in headings):
                assert heading in headings[file or name], f"{name}: {target}"
