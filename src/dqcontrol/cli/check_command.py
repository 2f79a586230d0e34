"""Check an experiment without running it."""

from __future__ import annotations

import sys
from pathlib import Path

from dqcontrol.cli.screen import print_table

UNSTABLE = 1


def check(spec: Path, /) -> None:
    """Check an experiment without running it, and say how near its loops are to instability.

    Ends with 1 if a loop is expected to be unstable, or a law fails at the start.

    Parameters
    ----------
    spec
        YAML file; its keys are described in docs/experiments.md.
    """
    from dqcontrol.experiments import check as checked

    checks = checked(spec)
    print_table(checks.table())
    if checks.contact is not None:
        print_table(checks.contact)
    for remark in checks.remarks():
        print(remark)
    if checks.unstable or any(one.fails for one in checks):
        sys.exit(UNSTABLE)
