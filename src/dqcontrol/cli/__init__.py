"""The command line: one file a command, thin calls into the library, errors in one line."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from typing import NoReturn

import lazy_loader
from cyclopts import App, CycloptsError
from cyclopts.exceptions import UnusedCliTokensError

import dqcontrol
from dqcontrol.cli.offered import add_offered
from dqcontrol.extensions import POLICY, REFUSED

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

USER_ERROR = 2
INTERRUPTED = 130
COMMANDS = {  # as files of this folder, imported when called: `--help` stays quick
    "new": "Write a first experiment: five questions make a file to run and to change.",
    "run": "Run an experiment and write its table, recordings and plots.",
    "sweep": "Run a parameter study, here or on a Dask cluster, and list its best points.",
    "tune": "Find the best parameters of laws for your robot and task, each law at its own best.",
    "learn": "Repeat a motion and learn from each repeat, until the hand goes where it should.",
    "check": "Check an experiment without running it: mistakes, and how near its loops are to instability.",
    "gains": "Say which gains a robot's period, delay and lag allow each law, and what to expect.",
    "compare": "Compare saved runs: one table, and plots.",
    "evaluate": "Measure your own joint log against a reference.",
    "excite": "Write a motion from whose log identify can tell the servos of a robot, and say how precisely.",
    "identify": "Find what the servos of a robot are from its logs: lag, delay, gain, sag, encoder, with intervals.",
    "calibrate": "Correct the geometry of an arm from measured poses of its hand: DH parameters, base and tool.",
    "figures": "Draw the figures of saved results for papers, as PDF, SVG or PNG.",
    "report": "Write the reports of saved runs anew, with all figures, which studies leave out.",
    "view": "Look at runs in a browser, over time or while they run.",
    "clip": "Save a clip of a run or several, .mp4, .webp or .gif, or one picture, .png.",
    "export": "Write the controller of a spec as a library in C, or all signals of a run for other programs.",
    "jog": "Drive a robot's hand by keys in the terminal, and keep poses as a points file.",
    "ros2": "Controllers and simulated robots as ROS 2 nodes.",
    "paint": "Paint a drawing with light: an SVG or a text file becomes a long exposure and a clip.",
    "doctor": "Check the environment: versions, extras, cache, OpenGL, ROS 2, ports; and what to do.",
    "robots": "List the robots that come with dqcontrol, show one, look at one, or find joint angles for a pose.",
    "laws": "List the kinds of laws for experiments, one line each.",
    "references": "List the kinds of motions for experiments, one line each.",
    "plants": "List the kinds of plants for experiments, one line each.",
}
_PACKAGE = "--package"
_FILES = {"laws": "kinds", "references": "kinds", "plants": "kinds"}

app: App = App(
    name="dqcontrol",
    help="Drive arms and mobile manipulators along desired poses with dual quaternion control laws. With --no-code any "
    "command refuses specs that bring code of their own; with --package FOLDER (once or more often) any command looks "
    "there for the packages that URDF and xacro files name.",
    version=dqcontrol.__version__,
    help_format="plaintext",
    suppress_keyboard_interrupt=False,
)
for _name, _help in COMMANDS.items():
    app.command(f"dqcontrol.cli.{_FILES.get(_name, _name)}_command:{_name}", name=_name, help=_help)
app.command(
    "dqcontrol.cli.install_completion_command:install_completion",
    name="--install-completion",
    help="Let the shell (bash, zsh, fish) complete commands and options.",
)


@cache
def whole_app() -> App:
    """Return the command line with what installed packages offer, too: looking for that takes a moment."""
    add_offered(app, "dqcontrol.commands")
    return app


def main() -> None:
    """Run the command line; a user's mistake gives one line and exit code 2."""
    _make_printable()
    warnings.showwarning = _warnings_once()
    arguments = [word for word in sys.argv[1:] if word != "--no-code"]
    if len(arguments) < len(sys.argv) - 1:
        os.environ[POLICY] = REFUSED
    if not sys.argv[1:]:
        from dqcontrol.cli.start_page import print_start_page

        print_start_page()
        return
    try:
        arguments = _without_packages(arguments)
        try:
            chosen = app if arguments[:1] and arguments[0] in COMMANDS else whole_app()
            chosen(arguments, exit_on_error=False, print_error=False, result_action="return_value")
        finally:
            sys.stdout.flush()  # here, where it can still be said that the disk is full
    except CycloptsError as error:
        _fail(
            USER_ERROR,
            f"{_mistake(error)}; see dqcontrol {' '.join([*(error.command_chain or ()), '--help'])}",
        )
    except dqcontrol.Error as error:  # looked up only now: it loads NumPy
        _fail(USER_ERROR, str(error))
    except KeyboardInterrupt as interrupt:
        _fail(INTERRUPTED, f"interrupted{interrupt}")
    except BrokenPipeError:
        _drop_output()
        sys.exit(0)
    except OSError as error:  # a full disk, a folder that went away
        _drop_output()
        _fail(USER_ERROR, str(error))
    except ValueError as error:
        if type(error).__name__ != "LinAlgError":  # by name: NumPy may not be loaded
            raise
        _fail(USER_ERROR, f"cannot be computed: {error}; look for a zero, an infinite or a very large number")
    except MemoryError:
        _fail(USER_ERROR, "not enough memory for this; take fewer or shorter runs, or smaller files")


def _without_packages(arguments: list[str]) -> list[str]:
    """Note the folders of ``--package``, which every command takes; return the other words."""
    if not any(word.partition("=")[0] == _PACKAGE for word in arguments):
        return arguments
    from dqcontrol.robots.package_folders import add_packages  # only now: it loads NumPy

    rest, folders, words = [], [], iter(arguments)
    for word in words:
        name, equals, folder = word.partition("=")
        if word == "--":
            rest += [word, *words]
        elif name != _PACKAGE:
            rest.append(word)
        else:
            folders.append(folder if equals else next(words, ""))
    add_packages(folders)
    return rest


def _mistake(error: CycloptsError) -> str:
    """Return what is wrong with a command line, without a full stop."""
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


def _fail(code: int, text: str) -> NoReturn:
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
