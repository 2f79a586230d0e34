"""The README stays short, and what it links to is there."""

import re

from page_blocks import PAGES, ROOT

TEXT = PAGES["README.md"].read_text(encoding="utf-8")
MOST_WORDS, MOST_LETTERS, LARGEST = 700, 120, 2_000_000  # three screens; a line; bytes of a picture


def test_it_is_short():
    assert len(TEXT.split()) <= MOST_WORDS
    assert max(map(len, TEXT.splitlines())) <= MOST_LETTERS


def test_its_links_and_pictures_are_there():
    targets = re.findall(r'\]\(([^)#]+)|(?:href|src)="([^"#]+)', TEXT)
    assert len(targets) > 20
    for target in {"".join(each) for each in targets}:
        assert (ROOT / target).exists(), target
        assert (ROOT / target).suffix == ".md" or (ROOT / target).stat().st_size <= LARGEST
