"""Printed numbers of the sources: cells of tables, and claims, as the files in their folders hold them."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
from msgspec.structs import replace

from dqcontrol.files import read_yaml
from dqcontrol.laws import FeedbackLinearization, FilteredInverse

T = TypeVar("T")

PRINTED_INVERSE = FilteredInverse(growth=0.0)
"""What the sources' laws have: its damping depends on the Jacobian alone."""
PRINTED_IN_BODY_TWISTS = replace(FeedbackLinearization(stiffness=1.0, damping=1.0).inverse, growth=0.0)
"""The same of feedback linearisation, whose measure is that of its Lyapunov function."""
_PRINTED_OF_KIND = dict.fromkeys(
    ("feedback-linearization", "published-linearization", "cascade"), PRINTED_IN_BODY_TWISTS
)


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


def with_printed_inverse(data: dict[str, Any]) -> dict[str, Any]:
    """Return a spec as a dictionary whose laws have inverses as printed: the damping of none of them grows."""
    for law in data.get("laws", {"": data.get("law", {})}).values():
        default = _PRINTED_OF_KIND.get(law["kind"], PRINTED_INVERSE)
        inverse = law.setdefault("inverse", msgspec.to_builtins(default))
        if inverse["kind"] == "filtered":
            inverse.setdefault("growth", 0.0)
    return data


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
