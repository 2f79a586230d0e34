"""Check the environment."""

from __future__ import annotations

import sys
from typing import Annotated

from cyclopts import Parameter

from dqcontrol.cli.screen import print_table

UNFIT = 1


def doctor(*, compile: Annotated[bool, Parameter(negative=())] = False) -> None:
    """Check versions, extras, the compiler's cache, OpenGL, ROS 2 and ports, and say what to do.

    Ends with 1 if there is a problem; something optional that is missing is none.

    Parameters
    ----------
    compile
        Compile the kernels of usual runs first, so that later ones begin at once; it takes minutes, once.
    """
    if compile:
        from dqcontrol.cli.compile_ahead import CASES, compile_ahead

        new = compile_ahead()
        print(f"compiled kernels: {new} new, of {len(CASES)} usual cases")
    import dqcontrol
    from dqcontrol.cli.environment import PROBLEM, examine
    from dqcontrol.measures.tables import Column, Table

    findings = examine()
    rows = [[one.what, one.found, one.verdict, one.cure or None] for one in findings]
    columns = (Column("what"), Column("found"), Column("verdict"), Column("what to do"))
    print_table(Table(columns, rows, f"dqcontrol {dqcontrol.__version__}"))
    problems = sum(one.verdict == PROBLEM for one in findings)
    print(f"{problems} problem{'s' * (problems != 1)}" if problems else "no problems")
    if problems:
        sys.exit(UNFIT)
