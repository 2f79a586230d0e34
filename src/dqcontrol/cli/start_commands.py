"""Begin: what is here, a first experiment, what it may name, and completion in the shell."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import msgspec
from cyclopts import App, Parameter
from cyclopts.completion.install import create_install_completion_command

import dqcontrol
from dqcontrol.cli import whole_app
from dqcontrol.cli.options import BaseLink, Force, TipLink
from dqcontrol.cli.screen import print_table

_MOST = 8  # files and folders shown
_LOOKED_AT = 20_000  # bytes of a file
_KEY = re.compile(r"^(\w+):", re.MULTILINE)
_SPEC, _ROBOT = {"robot", "robots", "reference"}, {"joints", "parts"}
_START = (
    ("dqcontrol play", "take a robot's target in the hand, in a browser"),
    ("dqcontrol new my.yaml", "five questions make an experiment to run and to change"),
    ("dqcontrol list robots", "bundled robots; any .urdf file will do as well"),
    ("dqcontrol list laws", "also references, plants: what an experiment may name"),
    ("dqcontrol doctor", "what is installed, what is missing"),
    ("dqcontrol --help", "all commands; COMMAND --help says more of one"),
)


def print_start_page() -> None:
    """Print which files and results are here and what to do with them, and how to start."""
    print(
        f"dqcontrol {dqcontrol.__version__}: pose control with dual quaternions: simulate, compare, deploy."
    )
    if found := list(_what_is_here(Path())):
        print("\nHere:")
        _print_pairs(found[:_MOST])
        if len(found) > _MOST:
            print(f"  … and {len(found) - _MOST} more")
    print("\nTo start:")
    _print_pairs(_START)


def _print_pairs(pairs: list[tuple[str, str]] | tuple[tuple[str, str], ...]) -> None:
    width = max(len(command) for command, _ in pairs)
    for command, meaning in pairs:
        sys.stdout.write(f"  {command:<{width}}   {meaning}\n")


def _what_is_here(folder: Path) -> Iterator[tuple[str, str]]:
    """Give a command for each file and folder of results here, and what it does."""
    for path in sorted(folder.glob("*.y*ml")):
        keys = set(_KEY.findall(_beginning(path)))
        if "tune" in keys:
            yield f"dqcontrol tune {path}", "find each law's best parameters"
        elif "learn" in keys:
            yield f"dqcontrol learn {path}", "learn this motion from repetition"
        elif "sweep" in keys:
            yield f"dqcontrol sweep {path}", "run this parameter study"
        elif len(keys & _SPEC) > 1:
            yield f"dqcontrol run {path}", "run this experiment (check: before it moves)"
        elif keys & _ROBOT:
            yield f"dqcontrol robots show {path}", "joints and limits of this robot"
    for path in sorted(folder.glob("*.urdf")):
        yield f"dqcontrol robots show {path}", "joints and limits of this robot"
    for path in sorted(folder.glob("*.svg")):
        yield f"dqcontrol paint {path}", "paint this drawing with light"
    marked = sorted(folder.glob("results/*/spec.yaml"), key=lambda path: -path.stat().st_mtime)
    for path in marked:
        yield f"dqcontrol view {path.parent}", "look at these results"


def _beginning(path: Path) -> str:
    from dqcontrol.errors import Error
    from dqcontrol.files.input_file import open_regular

    try:
        with open_regular(path) as stream:
            return stream.read(_LOOKED_AT).decode("utf-8", errors="ignore")
    except (OSError, Error):
        return ""


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


_SOURCE = re.compile(r"\.? \[(P16|S17|[^]]*\d{4})[^]]*\]")  # where a formula comes from
_SHARED = {
    "null_space",
    "inverse",
    "start",
    "offset",
    "repeat",
    "ramp",
    "corner_stops",
    "jerk_limits",
    "transform",
}


kinds: App = App(name="list", help="List the laws, references, plants and robots that experiments may name.")


@kinds.command
def laws() -> None:
    """List the kinds of laws for the key law of an experiment; docs/laws.md has their formulas."""
    from dqcontrol.experiments.spec import AnyLaw

    _print_kinds("law", AnyLaw)


@kinds.command
def references() -> None:
    """List the kinds of motions for the key reference of an experiment."""
    from dqcontrol.experiments.spec.reference_spec import AnyReference

    _print_kinds("reference", AnyReference, hidden="object")


@kinds.command
def plants() -> None:
    """List the kinds of plants for the key plant of an experiment."""
    from dqcontrol.experiments.spec import AnyPlant

    _print_kinds("plant", AnyPlant)


@kinds.command
def robots() -> None:
    """List the bundled robots; dqcontrol robots list --installed has those of other packages."""
    from dqcontrol.cli.robots_listing import list_bundled

    list_bundled()


def _print_kinds(title: str, union: Any, hidden: str = "") -> None:
    from dqcontrol.tables.tables import Cell, Column, Table

    rows: dict[str, list[list[Cell]]] = {}
    for kind in get_args(union):
        tag = str(kind.__struct_config__.tag)
        keys = [each for each in msgspec.structs.fields(kind) if each.encode_name not in _SHARED]
        needed = [each.encode_name for each in keys if each.required]
        if tag != hidden:
            row: list[Cell] = [tag, _first_sentence(kind), ", ".join(needed)]
            rows.setdefault(kind.__module__.partition(".")[0], []).append(row)
    columns = [Column("kind"), Column("what it is"), Column("needs")]
    for package in sorted(rows, key=lambda name: name != "dqcontrol"):
        origin = "" if package == "dqcontrol" else f", of {package}"
        print_table(Table(columns, rows[package], f"{title}: {{kind: …}}{origin}"))


def _first_sentence(kind: type) -> str:
    """Return the first line of a class' docstring, without what refers to sources."""
    line = (kind.__doc__ or "").strip().splitlines()[0]
    return _SOURCE.sub("", line).partition("; see `")[0].replace("`", "").rstrip(".")


def _write(
    *, shell: Literal["zsh", "bash", "fish", "powershell"], output: Path | None, add_to_startup: bool
) -> Path:
    from dqcontrol.errors import ExistsError

    if output is not None and output.exists():
        raise ExistsError(f"{output}: exists already; choose another name or remove it")
    return whole_app().install_completion(shell=shell, output=output, add_to_startup=add_to_startup)


install_completion: Callable[..., Any] = create_install_completion_command(_write, True)
