"""Write a first experiment."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal, get_args

from cyclopts import Parameter

from dqcontrol.cli.options import BaseLink, Force, TipLink

Motion = Literal["circle", "square", "spiral", "set-point"]
ChosenLaw = Literal["proportional", "proportional-feedforward", "both"]
ChosenPlant = Literal["servo", "integrator", "mujoco"]
MOTIONS, LAWS, PLANTS = map(get_args, (Motion, ChosenLaw, ChosenPlant))
QUESTIONS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "robot": (
        "Which robot (a name of 'dqcontrol list robots', or a .urdf, .xacro or .yaml file)?",
        "iiwa7",
        (),
    ),
    "motion": ("Which motion?", "circle", MOTIONS),
    "period": ("How long is a control period?", "8 ms", ()),
    "law": ("Which law?", "proportional-feedforward", LAWS),
    "plant": (
        "On what: joints that lag (servo), ideal ones (integrator), physics (mujoco)?",
        "servo",
        PLANTS,
    ),
}


def new(
    file: Path = Path("my.yaml"),
    /,
    *,
    robot: str | None = None,
    base_link: BaseLink = None,
    tip_link: TipLink = None,
    motion: Motion | None = None,
    period: str | None = None,
    law: ChosenLaw | None = None,
    plant: ChosenPlant | None = None,
    yes: Annotated[bool, Parameter(name=["--yes", "-y"], negative=())] = False,
    force: Force = False,
) -> None:
    """Write a first experiment: five questions make a file to run and to change.

    Its start, size and gain are chosen for the robot: within reach, and stable with that period and plant.

    Parameters
    ----------
    file
        New YAML file.
    robot
        Name, .urdf, .xacro or .yaml file; asked, as all that is not given.
    motion
        What the end effector does.
    period
        Of control, as 8 ms, or its rate, as 125 Hz.
    law
        One of these laws, or both to compare.
    plant
        Joints that lag, ideal ones, or physics.
    yes
        Ask nothing: take the defaults for what is not given.
    force
        Replace the file.
    """
    from dqcontrol.errors import ExistsError, writing

    if file.exists() and not force:
        raise ExistsError(f"{file}: exists already; choose another name, or replace it with --force")
    given = {"robot": robot, "motion": motion, "period": period, "law": law, "plant": plant}
    answers = {key: _answer(key, value, ask=not yes) for key, value in given.items()}
    from dqcontrol.experiments.new_spec import new_spec

    text, remark = new_spec(file.stem, **answers, base_link=base_link, tip_link=tip_link)
    with writing(file):
        file.write_text(text, encoding="utf-8")
    print(f"written: {file}{remark}")
    print(f"next: dqcontrol check {file}, then dqcontrol run {file}")


def _answer(key: str, given: str | None, *, ask: bool) -> str:
    """Return what was given, or what a person types, or the default."""
    from dqcontrol.errors import Error, suggest

    question, default, allowed = QUESTIONS[key]
    if given is None and ask:
        if not sys.stdin.isatty():
            raise Error(
                f"{key}: is not given, and there is no terminal to ask at; give --{key}, or --yes for defaults"
            )
        choice = f" ({', '.join(allowed)})" if allowed else ""
        given = input(f"{question}{choice} [{default}] ").strip()
    answer = given or default
    if allowed and answer not in allowed:
        raise Error(f"{key}: unknown '{answer}'{suggest(answer, allowed)} (allowed: {', '.join(allowed)})")
    return answer
