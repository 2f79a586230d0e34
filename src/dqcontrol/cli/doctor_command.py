"""Check the environment."""

from __future__ import annotations

import sys
from typing import Annotated

from cyclopts import Parameter

from dqcontrol.cli.screen import print_table

UNFIT = 1


def doctor(
    *,
    all: Annotated[bool, Parameter(negative=())] = False,
    compile: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """Check versions, extras, the compiler's cache, OpenGL, ROS 2 and ports, and say what to do about problems.

    Ends with 1 if there is a problem; something optional that is missing is none.

    Parameters
    ----------
    all
        Also what is well and what is missing but optional.
    compile
        Compile the kernels of usual runs first, so that later ones begin at once; it takes minutes, once.
    """
    if compile:
        from dqcontrol.cli.environment import CASES, compile_ahead

        new = compile_ahead()
        print(f"compiled kernels: {new} new, of {len(CASES)} usual cases")
    import dqcontrol
    from dqcontrol.cli.environment import OK, PROBLEM, examine
    from dqcontrol.tables.tables import Column, Table

    findings = examine()
    problems = [one for one in findings if one.verdict == PROBLEM]
    shown = findings if all else problems
    columns = (Column("what"), Column("found"), Column("verdict"), Column("what to do"))
    title = f"dqcontrol {dqcontrol.__version__}"
    if shown:
        print_table(
            Table(columns, [[one.what, one.found, one.verdict, one.cure or None] for one in shown], title)
        )
    else:
        print(title)
    optional = sum(one.verdict not in (OK, PROBLEM) for one in findings)
    said = f"{len(problems)} problem{'s' * (len(problems) != 1)}" if problems else "no problems"
    print(
        said if all else f"{said}; {len(findings)} things looked at, {optional} optional ones missing: --all"
    )
    if problems:
        sys.exit(UNFIT)
