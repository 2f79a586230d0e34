"""What libyaml finds in a text is what PyYAML's own parser finds, which reads where libyaml is missing."""

from pathlib import Path

import pytest

from dqcontrol.errors import FileFormatError
from dqcontrol.files import yaml_file
from dqcontrol.files.yaml_file import parse_yaml

ROOT = Path(__file__).parents[2]
FILES = [*ROOT.glob("examples/**/*.yaml"), *ROOT.glob("src/dqcontrol/**/*.yaml")]
TEXTS = {
    "numbers": "{a: 1e-3, b: 1_000, c: 0x1F, d: -.5, e: 017, f: 1.0e+2}",
    "words": "{a: OFF, b: no, c: True, d: ~, e: 2026-11-23}",
    "texts": "a: 'it''s'\nb: |\n  two\n  lines\nc: \"\\u00e9\"\n",
    "nothing": "",
    "an alias": "a: &x [1]\nb: *x\n",
    "a key twice": "a: 1\na: 2\n",
    "a tab": "a:\n\t- 1\n",
    "an open list": "a: [1, 2\nb: 3\n",
    "a colon too many": "a: b: c\n",
    "two documents": "a: 1\n---\nb: 2\n",
    "a tag": "a: !!python/object:os.system x\n",
    "a date that is none": "a: 2026-13-45\n",
    "an infinite number": "a: .inf\n",
    "deep nesting": "[" * 5000,
}


def read(text):
    try:
        return parse_yaml("file", text)
    except FileFormatError as error:
        return str(error)


@pytest.mark.skipif(yaml_file.CParser is None, reason="PyYAML was built without libyaml")
@pytest.mark.parametrize(
    "text",
    [
        pytest.param(text, id=name, marks=pytest.mark.slow if name.startswith("deep") else ())
        for name, text in TEXTS.items()
    ],
)
def test_any_text_means_the_same_without_libyaml(text, monkeypatch):
    fast = read(text)
    monkeypatch.setattr(yaml_file, "CParser", None)
    assert repr(fast) == repr(read(text))


@pytest.mark.skipif(yaml_file.CParser is None, reason="PyYAML was built without libyaml")
def test_our_files_mean_the_same_without_libyaml(monkeypatch):
    texts = [path.read_text(encoding="utf-8") for path in FILES]
    assert len(texts) > 40
    fast = [read(text) for text in texts]
    assert not any(isinstance(each, str) for each in fast)
    monkeypatch.setattr(yaml_file, "CParser", None)
    assert repr(fast) == repr([read(text) for text in texts])
