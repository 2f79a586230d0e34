"""What docs/pereira2016.md counts is what its tables hold."""

import re

import pytest
from page_blocks import ROOT

from dqcontrol_theses.pereira2016.tools.cells import NEAR, counted, readings

READINGS = readings(ROOT / "docs/pereira2016-tables.md")
PAGE = (ROOT / "docs/pereira2016.md").read_text(encoding="utf-8")
TABLES = (ROOT / "docs/pereira2016-tables.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("label", [label for label in READINGS if not label.startswith("over")])
def test_cells_near_the_printed_ones_are_those_of_the_tables(label):
    (line,) = (line for line in PAGE.splitlines() if line.startswith(f"| {label} |"))
    found = [text for metric in NEAR for text in counted(READINGS[label], metric)]
    assert [cell.strip() for cell in line.strip("| ").split(" | ")][1:] == found


def verdicts():
    """Return the verdicts of all tables of claims but that on tuned laws."""
    found, wanted = [], False
    for line in TABLES.splitlines():
        if line.startswith("**"):
            wanted = line.startswith("**Claims of P16")
        elif wanted and line.startswith("| ") and not line.startswith("| Where"):
            found.append([cell.strip() for cell in line.strip("| ").split(" | ")][2])
    return found


def test_verdicts_are_counted_as_they_stand_in_the_tables():
    said = re.search(
        r"Of (\d+) claims (\d+) are supported, (\d+) in part, (\d+) are not, (\d+) depend on .*?, and (\d+) cannot be",
        PAGE,
    )
    assert said
    kinds = ("supported", "partly supported", "not supported", "depends on", "cannot be decided")
    counts = [sum(each.startswith(kind) for each in verdicts()) for kind in kinds]
    assert [int(number) for number in said.groups()] == [len(verdicts()), *counts]
