"""The README and the pages do what they say: each block is run as a reader runs it, from top to bottom, in one folder.

A command is run, or stands in NOT_RUN, with the reason; then at least its options, targets and extras exist.
What takes long waits for the slow tests.
"""

import math
import re
import shlex
import subprocess
import sys
import tomllib

import pytest
from cyclopts import MissingArgumentError
from page_blocks import PAGES, ROOT, blocks, inline_commands
from page_files import prepare
from page_specs import PageSpec

from dqcontrol import cli

NOT_RUN = {  # patterns of whole commands
    "git clone .*": "the reader's own copy",
    "python3 -m venv .*": "installs",
    "pip install .*": "installs",
    "make demo": "installs; what it runs, test_page_tables.py runs",
    "make test": "is what runs this",
    "ros2 .*": "needs a ROS 2 installation",
    "ssh .*": "needs another computer",
    "dqcontrol ros2 .*": "goes on until it is stopped: tests/ros2",
    "dqcontrol learn .* --ros2 .*": "needs a robot behind topics: tests/ros2/test_repeated_motions.py",
    "dqcontrol jog .*": "waits for keys: tests/cli/test_cli_jog.py",
    "dqcontrol robots view .*": "waits for a browser: tests/browser/test_robot_page.py",
    "dqcontrol play.*": "waits for a browser: tests/browser/test_play_page.py",
    "dqcontrol view .*": "waits for a browser: tests/browser/test_browser_page.py",
    "dqcontrol reproduce pereira2016(/spiral)?": "thousands of runs; two repeats of each are slow enough",
}
EVERYTHING = ("",)
SLOW = {  # parts of commands and of Python
    "README.md": ("run first.yaml",),
    "export.md": EVERYTHING,
    "from-matlab.md": ("run examples/", "convert"),
    "calibrate.md": EVERYTHING,
    "contact.md": ("results/",),
    "constraints.md": ("run examples/", "report results", "robots shapes"),
    "experiments.md": ("run examples/", "compare", "demo.yaml", "repeats.yaml"),
    "identify.md": EVERYTHING,
    "learn.md": EVERYTHING,
    "mobile-bases.md": ("run examples/",),
    "mobile-physics.md": EVERYTHING,
    "own-data.md": ("results/mine", "results/from-python"),
    "painting.md": ("dqcontrol paint",),
    "pereira2016.md": ("--repeats 2", "--plant servo"),
    "pereira2016-causes.md": EVERYTHING,
    "physics.md": ("run examples/",),
    "real-time.md": EVERYTHING,
    "reports.md": ("results/demo", "figures results", "write_report", "column_width"),
    "silva2017.md": ("reproduce",),
    "sweeps.md": EVERYTHING,
    "tune.md": ("tune examples/",),
    "tutorial.md": ("run mine.yaml", "compare results/mine"),
    "two-arms.md": ("run examples/",),
    "which-law.md": ("run examples/",),
    "view.md": ("run examples/", "clip"),
}
MADE = "make -C results/"  # in folders that commands of ours wrote
SEPARATELY = {"errors.md": "test_errors_page.py compares what each example raises"}
NOTHING_TO_RUN = (
    "",
    "text",
    "c",
    "csv",
    "toml",
    "py",
    "matlab",
)  # what is printed; files; other libraries' code
BUILT = ("{include}", "{toctree}", "{eval-rst}")  # by Sphinx: test_site.py
KNOWN = ("python", "console", "yaml", *NOTHING_TO_RUN, *BUILT)
WITH_BLOCKS = [page for page in PAGES if blocks(page) and page not in SEPARATELY]


@pytest.fixture
def reader(tmp_path, monkeypatch, capsys):
    """Return a function that does a page, but for what is left out."""

    def run(command):
        if command.startswith(MADE):
            done = subprocess.run(shlex.split(command), capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
            return
        monkeypatch.setattr(sys, "argv", shlex.split(command))
        code = 0
        try:
            cli.main()
        except SystemExit as end:
            code = end.code
        # Pages show runs and logs that did not do what was asked, but no mistakes.
        assert code == 0 or (code == 1 and sys.argv[1] in ("run", "evaluate")), command
        assert capsys.readouterr().out, command

    def do(page, left_out=()):
        prepare(page, tmp_path)
        monkeypatch.chdir(tmp_path)
        names, spec = {"__name__": "page"}, PageSpec(tmp_path)
        for block in blocks(page):
            if block.language == "yaml":
                spec.take(block.text)
            elif block.language == "python" and not holds(block.text, left_out):
                exec(compile(block.text, f"{page}:{block.line}", "exec"), names)
                assert_promises_kept(block.text, capsys.readouterr().out)
            elif block.language == "console":
                for command in block.commands:
                    if not (is_listed(command) or holds(command, left_out)):
                        run(command)

    return do


def is_listed(command):
    return any(re.fullmatch(pattern, command) for pattern in NOT_RUN)


def holds(text, parts):
    return any(part in text for part in parts)


def assert_promises_kept(code, printed):
    """Each ``print(…)  # this`` has printed this; a number, to 5 %."""
    for promise in re.findall(r"^ *print\(.*\)  # (.+)$", code, re.MULTILINE):
        assert promise in printed or any(near(promise, line) for line in printed.splitlines()), promise


def near(promise, line):
    try:
        return math.isclose(float(promise), float(line), rel_tol=0.05)
    except ValueError:
        return False


@pytest.mark.parametrize("page", [page for page in WITH_BLOCKS if SLOW.get(page) != EVERYTHING])
def test_page_does_what_it_says(page, reader):
    reader(page, left_out=SLOW.get(page, ()))


@pytest.mark.slow
@pytest.mark.parametrize("page", SLOW)
def test_page_does_what_it_says_with_what_takes_long(page, reader):
    reader(page)


@pytest.mark.parametrize("page", PAGES)
def test_nothing_on_a_page_escapes(page):
    for block in blocks(page):
        assert block.language in KNOWN, f"{page}:{block.line}: nobody runs blocks of {block.language}"
        for command in block.commands if block.language == "console" else ():
            assert command.startswith(("dqcontrol ", MADE)) or is_listed(command), (
                f"{page}:{block.line}: {command}"
            )
            assert_exists(command)
    for command in inline_commands(page):
        assert_exists(command)
    for file in re.findall(r"(?<!pictures/)\bexamples/[\w./-]+\w", PAGES[page].read_text(encoding="utf-8")):
        assert (ROOT / file).exists(), f"{page}: {file}"


def test_the_lists_name_nothing_that_is_gone():
    commands = [command for page in PAGES for block in blocks(page) for command in block.commands]
    for pattern in NOT_RUN:
        assert any(re.fullmatch(pattern, command) for command in commands), pattern
    for page, parts in SLOW.items():
        for part in parts:
            assert any(part in block.text for block in blocks(page)), part


def assert_exists(command):
    """Options of our own commands, targets of make, extras of the package, programs."""
    synopsis = re.sub(r" \[[^]]*…\]", "", command)
    words = shlex.split(re.sub(r" \[([^]|]*)[^]]*\]", r" \1", synopsis))  # of several choices the first
    if words[0] in ("ssh", "dqcontrol"):
        parse(words[words.index("dqcontrol") + 1 :])
    elif command.startswith(MADE):
        makefile = ROOT / "src/dqcontrol/export/c/Makefile"
        assert re.search(rf"^[a-z ]*\b{words[3]}\b[a-z ]*:", makefile.read_text(), re.MULTILINE), command
    elif words[0] == "make":
        assert re.search(rf"^{words[1]}:", (ROOT / "Makefile").read_text(), re.MULTILINE), command
    elif words[0] == "pip":
        extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
        wanted = re.search(r"\[(.*)\]", command)
        assert not wanted or set(wanted[1].split(",")) <= set(extras), command
    elif words[0] in ("python", "pytest") and words[1] != "-m":
        assert (ROOT / words[1]).exists(), command


def parse(words):
    if "COMMAND" in words or words == ["--help"]:  # any
        return
    try:
        cli.whole_app().parse_args(words, exit_on_error=False, print_error=False)
    except MissingArgumentError:
        assert words[-1] in cli.whole_app(), words  # named in the prose, without its argument


def test_a_wrong_option_would_be_found():
    with pytest.raises(Exception, match="--jbs"):
        assert_exists("dqcontrol run spec.yaml --jbs 2")


def test_commands_of_the_makefile_are_understood():
    """What draws the demo's picture may fail without OpenGL, and so would hide an option that is refused."""
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    given = dict(re.findall(r"^(\w+) :?= (.*)$", text, re.MULTILINE))
    commands = re.findall(r"\$\(BIN\)/dqcontrol (.*?)(?: \|\|.*)?$", text, re.MULTILINE)
    assert len(commands) >= 2
    for command in commands:
        parse(shlex.split(re.sub(r"\$\((\w+)\)", lambda name: given[name[1]], command)))
