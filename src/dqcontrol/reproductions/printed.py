"""What the sources print: cells of tables, and claims, as the files in their folders hold them."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, TypeVar

import msgspec

from dqcontrol.files.yaml_file import read_yaml

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class PublishedCell:
    """One cell of a printed table of means.

    Attributes
    ----------
    reproduction
        The experiment of the source.
    table
        Number of the table.
    experiment
        Robot and shape, where a table holds several; otherwise empty.
    law
        Its label, as ``K``.
    set
        Gain set or sampling time; empty for laws of which a table has one set only.
    metric
        ``error``, ``control`` (rad), ``joint_step`` (rad s), ``hand_speed`` (m), ``hand_acceleration`` (m/s) or
        ``period`` (s).
    mean, deviation
        As printed; deviation None where none is printed.
    """

    reproduction: str
    table: str
    experiment: str = ""
    law: str
    set: str = ""
    metric: str
    mean: float
    deviation: float | None = None


class Claim(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A sentence of a source about its results, and what would decide it.

    Attributes
    ----------
    id
        Unique name in kebab case.
    reproduction
        The experiment that can decide it.
    source
        Section or table.
    quotation
        The sentence, shortened to at most 25 words.
    measure
        Which number decides it, and the criterion.
    note
        What the source's own numbers say, where they contradict the claim or cannot decide it.
    """

    id: Annotated[str, msgspec.Meta(pattern="^[a-z0-9]+(-[a-z0-9]+)*$", description="a name in kebab case")]
    reproduction: str
    source: str
    quotation: str
    measure: str
    note: str = ""


@cache
def read_table(path: Path, kind: type[T]) -> tuple[T, ...]:
    """Read a table of text into dataclasses; an empty field takes its default."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = [{key: text for key, text in row.items() if text} for row in csv.DictReader(file)]
    return msgspec.convert(rows, tuple[kind, ...], strict=False)


@cache
def read_claims(path: Path) -> tuple[Claim, ...]:
    """Read a file of claims."""
    return read_yaml(path, tuple[Claim, ...])
