"""The command line: thin calls into the library, errors in one line."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from difflib import get_close_matches
from functools import cache
from typing import NoReturn

import lazy_loader
from cyclopts import App, CycloptsError, Group, Parameter
from cyclopts.exceptions import CommandCollisionError, UnknownCommandError, UnusedCliTokensError

import dqcontrol
from dqcontrol.cli import screen
from dqcontrol.extensions import POLICY, REFUSED, offered

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

USER_ERROR = 2
INTERRUPTED = 130
GROUPS = {  # of commands, whose files are imported when they are called: `--help` stays quick
    "Start": {
        "new": "Write a first experiment: five questions make a file to run and to change.",
        "doctor": "Check the environment: versions, extras, cache, OpenGL, ROS 2, ports; and what to do.",
        "list": "List the laws, references, plants and robots that experiments may name.",
        "robots": "Show a robot, look at it in a browser, or find joint angles for a pose.",
    },
    "Simulate and compare": {
        "check": "Check an experiment without running it: mistakes, and how near its loops are to instability.",
        "plan": "Plan the way of an experiment around what stands there, and say what is proved of it.",
        "run": "Run an experiment and write its table, recordings and plots.",
        "sweep": "Run a parameter study, here or on a Dask cluster, and list its best points.",
        "compare": "Compare saved runs: one table, and plots.",
    },
    "Look": {
        "play": "Take a robot's target in the hand, in a browser: laws, gains, joints and bodies change meanwhile.",
        "view": "Look at runs in a browser, over time or while they run; or save them as a page.",
        "report": "Regenerate the reports of saved runs, with all figures, which studies leave out.",
        "figures": "Draw the figures of saved results for papers, as PDF, SVG or PNG.",
        "clip": "Save a clip of a run or several, .mp4, .webp or .gif, or one picture, .png.",
        "paint": "Paint a drawing with light: an SVG or a text file becomes a long exposure and a clip.",
    },
    "Data of your robot": {
        "evaluate": "Measure your own joint log against a reference.",
        "excite": "Generate an excitation trajectory for identify, and say how precise the estimate will be.",
        "identify": "Estimate servo lag, delay, gain, sag and encoder resolution from logs, with intervals.",
        "calibrate": "Correct the geometry of an arm from measured poses of its end effector.",
        "convert": "Write all signals of a run for other programs: CSV, Parquet, MATLAB, a LeRobot dataset.",
    },
    "Tune and learn": {
        "gains": "Say which gains a robot's period, delay and lag allow each law, and what to expect.",
        "tune": "Find the best parameters of laws for your robot and task: each law tuned.",
        "learn": "Repeat a motion and learn from each repeat, until the end effector goes where it should.",
    },
    "Live": {
        "jog": "Drive a robot's end effector by keys in the terminal, and keep poses as a points file.",
        "ros2": "Controllers and simulated robots as ROS 2 nodes.",
    },
    "Deploy": {"export": "Write the controller of a spec as a library in C, with its tests."},
}
COMMANDS = {name: text for commands in GROUPS.values() for name, text in commands.items()}
_PACKAGE = "--package"
_WIDE, _COLUMNS = "--wide", "--columns"

app: App = App(
    name="dqcontrol",
    help="Pose control of arms and mobile manipulators with dual quaternions: simulate, compare, deploy. Options of "
    "any command: --wide shows all columns of tables, --columns NAMES those named (a,b); --no-code refuses specs that "
    "bring code of their own; --package FOLDER (repeatable) says where packages are that URDF and xacro files name.",
    version=dqcontrol.__version__,
    help_format="plaintext",
    group_commands=Group("Options", sort_key=len(GROUPS) + 1),
    suppress_keyboard_interrupt=False,
    default_parameter=Parameter(negative_iterable=()),  # no --empty-position beside --position
)
_TOGETHER = {  # in one file; others have one of their own
    "start_commands": ("new", "list"),
    "experiment_commands": ("check", "plan", "run", "sweep", "gains", "tune", "learn", "export"),
    "result_commands": ("compare", "view", "report", "figures", "clip"),
    "log_commands": ("evaluate", "excite", "identify", "calibrate", "convert"),
    "live_commands": ("play", "jog"),
}
_FILES = {name: file for file, names in _TOGETHER.items() for name in names}
for _place, (_title, _commands) in enumerate(GROUPS.items()):
    _group = Group(_title, sort_key=_place)
    for _name, _help in _commands.items():
        _file, _function = _FILES.get(_name, f"{_name}_command"), "kinds" if _name == "list" else _name
        app.command(f"dqcontrol.cli.{_file}:{_function}", name=_name, help=_help, group=_group)
app.command(
    "dqcontrol.cli.start_commands:install_completion",
    name="--install-completion",
    help="Let the shell (bash, zsh, fish) complete commands and options.",
)


def add_offered(app: App, group: str, heading: Group | None = None) -> None:
    """Add the functions of a group of entry points to a command line, each under its name and one heading of the help.

    Raises
    ------
    FileFormatError
        If one cannot be loaded, or has the name of another command.
    """
    for name, function in offered(group):
        try:
            app.command(function, name=name, group=heading)
        except CommandCollisionError:
            from dqcontrol.errors import FileFormatError  # only now: it loads NumPy

            raise FileFormatError(f"entry point {group}: {name} is a command already; rename it") from None


@cache
def whole_app() -> App:
    """Return the command line with what installed packages offer, too: looking for that takes a moment."""
    add_offered(app, "dqcontrol.commands", Group("Theses and other packages", sort_key=len(GROUPS)))
    return app


def main() -> None:
    """Run the command line; a user's mistake gives one line and exit code 2."""
    _make_printable()
    warnings.showwarning = _warnings_once()
    arguments = _without_flags(sys.argv[1:])
    if not sys.argv[1:]:
        from dqcontrol.cli.start_commands import print_start_page

        print_start_page()
        return
    try:
        arguments = _without_values(arguments)
        try:
            chosen = app if arguments[:1] and arguments[0] in COMMANDS else whole_app()
            chosen(arguments, exit_on_error=False, print_error=False, result_action="return_value")
        finally:
            sys.stdout.flush()  # here, where it can still be said that the disk is full
    except CycloptsError as error:
        command = " ".join(["dqcontrol", *(error.command_chain or ()), "--help"])
        mistake = _mistake(error)
        _fail(USER_ERROR, f"{mistake}{' See' if mistake.endswith('?') else '; see'} {command}")
    except dqcontrol.Error as error:  # looked up only now: it loads NumPy
        _fail(USER_ERROR, str(error), error)
    except KeyboardInterrupt as interrupt:
        _fail(INTERRUPTED, "interrupted", interrupt)
    except BrokenPipeError:
        _drop_output()
        sys.exit(0)
    except OSError as error:  # a full disk, a folder that went away
        _drop_output()
        _fail(USER_ERROR, str(error), error)
    except ValueError as error:
        if type(error).__name__ != "LinAlgError":  # by name: NumPy may not be loaded
            raise
        _fail(
            USER_ERROR,
            f"cannot be computed: {error}; look for a zero, an infinite or a very large number",
            error,
        )
    except MemoryError as error:
        _fail(USER_ERROR, "not enough memory for this; take fewer or shorter runs, or smaller files", error)


def _without_flags(arguments: list[str]) -> list[str]:
    """Note the flags that every command takes; return the other words."""
    for flag, variable, value in (("--no-code", POLICY, REFUSED), (_WIDE, screen.WIDE, "1")):
        if flag in arguments:
            os.environ[variable] = value
            arguments = [word for word in arguments if word != flag]
    return arguments


def _without_values(arguments: list[str]) -> list[str]:
    """Note ``--package`` and ``--columns``, which every command takes; return the other words."""
    rest, words = [], iter(arguments)
    found: dict[str, list[str]] = {_PACKAGE: [], _COLUMNS: []}
    for word in words:
        name, equals, value = word.partition("=")
        if word == "--":
            rest += [word, *words]
        elif name in found:
            found[name].append(value if equals else next(words, ""))
        else:
            rest.append(word)
    if found[_COLUMNS]:
        os.environ[screen.COLUMNS] = ",".join(found[_COLUMNS])
    if found[_PACKAGE]:
        from dqcontrol.robots.files.urdf_xml import add_packages  # only now: it loads NumPy

        add_packages(found[_PACKAGE])
    return rest


def _mistake(error: CycloptsError) -> str:
    """Return what is wrong with a command line, without a full stop."""
    if isinstance(error, UnknownCommandError):
        unknown = (error.unused_tokens or [""])[0]
        near = get_close_matches(unknown, error.app or COMMANDS, n=1)
        return f"there is no command '{unknown}'" + (f"; did you mean '{near[0]}'?" if near else "")
    if isinstance(error, UnusedCliTokensError):
        words = " ".join(f"'{word}'" for word in error.unused_tokens or ())
        return f"takes no further argument, got {words}"
    return str(error).strip().rstrip(".")


def _make_printable() -> None:
    """Let output go nowhere if it was closed, and let no letter fail that its encoding lacks."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 — until the process ends
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def _drop_output() -> None:
    """Keep Python from flushing once more at its end what could not be written."""
    with suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _fail(code: int, text: str, error: BaseException | None = None) -> NoReturn:
    """End with a line, and what an error notes beside what it says."""
    text = "; ".join([text, *getattr(error, "__notes__", ())])
    print(f"dqcontrol: {' '.join(text.split())}", file=sys.stderr)
    sys.exit(code)


def _warnings_once() -> Callable[..., None]:
    """Return what shows each warning once: Python forgets what it has shown as soon as a filter changes."""
    shown: set[str] = set()

    def show(message: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
        from dqcontrol.errors import NoteWarning  # only now: it loads NumPy

        kind = "note" if issubclass(category, NoteWarning) else "warning"
        line = f"dqcontrol: {kind}: {' '.join(str(message).split())}"
        if line not in shown:
            shown.add(line)
            print(line, file=sys.stderr)

    return show
