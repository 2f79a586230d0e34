"""The specs of [S17]'s experiments, and what its claims say."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dqcontrol.experiments import PreparedExperiment, prepare
from dqcontrol.files import read_yaml
from dqcontrol.tables import Table
from dqcontrol_theses.judgement import Judgement, verdict_table
from dqcontrol_theses.printed import PublishedCell, read_claims, read_table, with_printed_inverse

FOLDER = Path(__file__).parent
S17, OURS = "S17", "ours"  # labels of S17's law, and of what we take by default
GOOD_ENOUGH = 0.04  # error norm at which S17 ends its runs on the robot [S17 5.1]


def spec_data(name: str, **changes: Any) -> dict[str, Any]:
    """Return a spec as a dictionary that runs anywhere, with other values of some of its keys."""
    data: dict[str, Any] = read_yaml(FOLDER / "specs" / f"{name}.yaml", dict[str, Any])
    if (FOLDER / "specs" / str(data["robot"])).is_file():
        data["robot"] = str(FOLDER / "specs" / data["robot"])
    return with_printed_inverse(data | changes)


def setting_of(name: str, **changes: Any) -> PreparedExperiment:
    """Return a spec made ready, with other values of some of its keys."""
    return prepare(spec_data(name, **changes))


def printed(experiment: str, law: str, metric: str) -> float:
    """Return a printed number."""
    for cell in read_table(FOLDER / "tables.csv", PublishedCell):
        if (cell.reproduction, cell.law, cell.metric) == (experiment, law, metric):
            return cell.mean
    raise LookupError(f"{experiment}: {law}, {metric}")


def verdicts(
    experiment: str, judgements: Mapping[str, Judgement], ours: Mapping[str, Judgement] | None = None
) -> Table:
    """Return the table of verdicts on an experiment's claims, each of them judged.

    Parameters
    ----------
    experiment
        Its name.
    judgements
        On S17's law, with S17's stop.
    ours
        On our law, where it is another one.
    """
    claims = [claim for claim in read_claims(FOLDER / "claims.yaml") if claim.reproduction == experiment]
    if {claim.id for claim in claims} != set(judgements):
        raise LookupError(f"{experiment}: judged {sorted(judgements)}")
    return verdict_table(claims, judgements, "S17", f"Claims of S17: {experiment}", ours)
