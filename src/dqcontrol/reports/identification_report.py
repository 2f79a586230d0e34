"""The page of identified servos: numbers, remarks, and fit and residual of each joint."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from dqcontrol.reports.provenance import RERUN_FOLDER, command, origins
from dqcontrol.reports.report import write_report
from dqcontrol.tables.tables import Column, Table

if TYPE_CHECKING:
    from dqcontrol.logs import Identification


def write_identification_report(found: Identification, folder: str | Path) -> Path:
    """Write ``report.html`` beside the files of an identification, in place of an earlier one.

    Examples
    --------
    >>> write_identification_report(dqc.identify("log.csv", "iiwa7"), "results/servos")  # doctest: +SKIP
    """
    from dqcontrol.figures.servo_fits import servo_fits

    (Path(folder) / "report.html").unlink(missing_ok=True)
    tables = [found.table]
    if found.remarks:
        tables.append(Table([Column("what else should be known")], [[line] for line in found.remarks]))
    traces = {each.name: (each.trace, each.floor) for each in found.fitted if each.trace is not None}
    logs = [str(path.resolve()) for path in found.logs]
    return write_report(
        folder,
        f"Servos of {found.robot}",
        facts=f"{len(found.fitted)} of {len(found.joints)} joints · {', '.join(path.name for path in found.logs)}",
        command=command("identify", *logs, robot=found.robot, out=RERUN_FOLDER),
        tables=tables,
        figures={"servos": servo_fits(traces)} if traces else {},
        origins=origins({}),
    )
