"""The site: it builds without a warning, holds all public names and commands, and needs no network."""

import importlib
import inspect
import re
import subprocess
import sys
from html.parser import HTMLParser
from types import ModuleType

import pytest
from page_blocks import PAGES, ROOT

import dqcontrol
from dqcontrol import cli

pytest.importorskip("sphinx", reason="needs dqcontrol[docs]")
PACKAGES = tuple(name for name in dqcontrol.__all__ if isinstance(getattr(dqcontrol, name), ModuleType))


@pytest.mark.slow
def test_the_site(tmp_path):
    """Build it as `make docs` does, once for all that is to be seen of it."""
    site = tmp_path / "html"
    options = ["-W", "--keep-going", "-q", "-d", str(tmp_path / "doctrees")]
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", *options, str(ROOT / "docs"), str(site)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    pages_show_without_a_network(site)
    every_page_is_in_the_navigation(site)
    every_public_name_is_described(site)
    every_command_is_described(site)
    docstrings_keep_formulas_and_links(site)


class Resources(HTMLParser):
    """What a browser fetches to show a page."""

    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        if tag in ("script", "img", "iframe", "source"):
            self.found += [attributes[key] for key in ("src", "srcset") if key in attributes]
        elif tag == "link" and attributes.get("rel") in ("stylesheet", "icon", "preload"):
            self.found.append(attributes["href"])


def pages_show_without_a_network(site):
    for page in site.rglob("*.html"):
        reader = Resources()
        reader.feed(page.read_text(encoding="utf-8"))
        assert reader.found
        for resource in reader.found:
            if resource.startswith("data:"):  # in the page itself, as the icon of a replay
                continue
            assert "//" not in resource, f"{page.name}: {resource}"
            assert (page.parent / resource.partition("?")[0]).exists(), f"{page.name}: {resource}"
    for sheet in site.rglob("*.css"):
        assert not re.search(r"url\([\"']?(https?:)?//", sheet.read_text(encoding="utf-8")), sheet.name


def every_page_is_in_the_navigation(site):
    home = (site / "index.html").read_text(encoding="utf-8")
    for page in PAGES:
        if page not in ("README.md", "index.md"):
            assert f'href="{page.removesuffix(".md")}.html"' in home, page


def every_public_name_is_described(site):
    for package in PACKAGES:
        text = (site / "api" / f"{package}.html").read_text(encoding="utf-8")
        module = importlib.import_module(f"dqcontrol.{package}")
        classes = (
            name
            for name, value in vars(module).items()
            if getattr(value, "__module__", "") == module.__name__
            and inspect.isclass(value)
            and not name.startswith("_")
        )
        for name in getattr(module, "__all__", classes):
            kind = "module-" if inspect.ismodule(getattr(module, name)) else ""
            assert f'id="{kind}dqcontrol.{package}.{name}"' in text, f"{package}.{name}"
    text = (site / "api" / "index.html").read_text(encoding="utf-8")
    for name in set(dqcontrol.__all__) - set(PACKAGES):
        assert f"dqc.{name}<" in text, name


def every_command_is_described(site):
    text = (site / "command-line.html").read_text(encoding="utf-8")
    for command in (*cli.COMMANDS, "reproduce"):
        assert f'id="dqcontrol-{command}"' in text, command
    assert "--real-time" in text


def docstrings_keep_formulas_and_links(site):
    text = (site / "api" / "laws.html").read_text(encoding="utf-8")
    assert "K vec8(1 − x*x_d) − vec8(x*ẋ_d)" in text
    assert 'href="#dqcontrol.laws.Proportional"' in text
    text = (site / "api" / "algebra.html").read_text(encoding="utf-8")
    assert "√(xx*) = |P| + ε⟨P, D⟩/|P|" in text
