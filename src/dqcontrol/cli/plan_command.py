"""Plan the way of an experiment without running it."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from dqcontrol.cli.screen import print_table

if TYPE_CHECKING:
    from dqcontrol.planning import PlanTo
    from dqcontrol.tables import Table


def plan(spec: Path, /) -> None:
    """Plan the way of an experiment around what stands there, and say what is proved of it.

    Parameters
    ----------
    spec
        YAML file with a reference of kind plan-to; its keys are described in docs/planning.md.
    """
    from dqcontrol.errors import NoteWarning, ShapeError
    from dqcontrol.experiments import prepare
    from dqcontrol.planning.drive_and_plan import DriveAndPlan
    from dqcontrol.planning.plan_to import PlanTo
    from dqcontrol.references import DriveThrough

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NoteWarning)  # what it says is printed below
        setting = prepare(spec)
    for label, scene in setting.scenes.items():
        whole = scene.reference
        ways = whole.ways if isinstance(whole, DriveThrough) else [whole]
        planned = [way for way in ways if isinstance(way, PlanTo | DriveAndPlan)]
        if not planned:
            kind = setting.spec.reference.__struct_config__.tag
            raise ShapeError(
                f"{spec}: reference: expected kind plan-to, got {kind}, which has nothing to plan"
            )
        for way in planned:
            print_table(_points(way.arm if isinstance(way, DriveAndPlan) else way, label or scene.robot.name))
            print(way)


def _points(way: PlanTo, title: str) -> Table:
    """Return the points of a way, one row each."""
    from dqcontrol.tables import Column, Table

    turns = [kind == "revolute" for kind in way.robot.joint_types]
    columns = [
        Column(name, "°" if turn else "m", ".1f" if turn else ".4f")
        for name, turn in zip(way.robot.joint_names, turns, strict=True)
    ]
    rows = [
        [math.degrees(value) if turn else float(value) for value, turn in zip(q, turns, strict=True)]
        for q in way.plan.configurations
    ]
    return Table(columns, rows, f"{title}: {len(rows)} points")
