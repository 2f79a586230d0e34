"""The pages for users, and the fenced blocks and commands on them."""

import re
from dataclasses import dataclass
from pathlib import Path
from textwrap import dedent

ROOT = Path(__file__).parents[2]
PAGES = {path.name: path for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))}
_BLOCK = re.compile(
    r"(?:^<!-- (?P<name>\S+\.\w+) -->\n)?^(?P<indent> *)```(?P<language>\S*)[^\n]*\n(?P<text>.*?)^(?P=indent)```$",
    re.DOTALL | re.MULTILINE,
)


@dataclass(frozen=True)
class Block:
    """A fenced block; ``name`` is that of the file that a reader saves it as, and stands before it in a comment."""

    name: str | None
    language: str
    text: str
    line: int

    @property
    def commands(self) -> list[str]:
        """What is typed in a console, one line each, without comments behind it."""
        joined = self.text.replace("\\\n", " ")
        return [re.sub(r" {2,}#.*", "", line[2:]) for line in joined.splitlines() if line.startswith("$ ")]


def blocks(page: str) -> list[Block]:
    """Return the fenced blocks of a page from top to bottom."""
    text = PAGES[page].read_text(encoding="utf-8")
    found = [
        Block(
            match["name"],
            match["language"],
            dedent(match["text"]),
            text.count("\n", 0, match.start("language")) + 1,
        )
        for match in _BLOCK.finditer(text)
    ]
    assert len(found) == len(re.findall(r"^ *```", text, re.MULTILINE)) / 2, f"{page}: unpaired fences"
    return found


def inline_commands(page: str) -> list[str]:
    """Return the commands that stand in the prose and the tables of a page."""
    prose = _BLOCK.sub("", PAGES[page].read_text(encoding="utf-8"))
    return re.findall(r"`((?:dqcontrol|make|pip|python|pytest) [^`]+)`", prose)
