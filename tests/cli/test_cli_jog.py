"""`dqcontrol jog` at a real pseudo-terminal: keys drive, poses are kept, and the terminal is as it was afterwards."""

import os
import re
import select
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import yaml

from dqcontrol import cli
from dqcontrol.algebra import translation
from dqcontrol.devices import Keyboard
from dqcontrol.experiments import load_run
from dqcontrol.references import load_points

PATIENCE = 240.0  # s
SPEC = {
    "name": "taught",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.01,
    "reference": {"kind": "set-point", "duration": 1},
    "law": {"kind": "proportional-feedforward", "gain": 5},
    "plant": {"kind": "servo"},
    "supervisor": {"stale_after": 1000.0},  # a machine full of tests is late, which would stop the robot
}

pty, termios = pytest.importorskip("pty"), pytest.importorskip("termios")


@pytest.fixture
def terminal():
    """Give both ends of a pseudo-terminal: a person's, and a program's."""
    person, program = pty.openpty()
    yield person, program
    os.close(person)
    os.close(program)


class Session:
    """A program at a terminal."""

    def __init__(self, terminal, *arguments, cwd):
        self.person, program = terminal
        self.before = termios.tcgetattr(program)
        command = [sys.executable, "-m", "dqcontrol", "jog", *arguments]
        self.process = subprocess.Popen(
            command, cwd=cwd, stdin=program, stdout=program, stderr=program, start_new_session=True
        )
        self.text = ""

    def read(self):
        """Take what is shown, for a tenth of a second at most."""
        if select.select([self.person], [], [], 0.1)[0]:
            self.text += os.read(self.person, 4096).decode()

    def see(self, pattern):
        """Read until something is to be seen."""
        end = time.monotonic() + PATIENCE
        while not re.search(pattern, self.text):
            assert time.monotonic() < end, self.text[-2000:]
            self.read()

    def places(self):
        """Return x of the hand, m, in all lines so far that say where it is."""
        return [float(x) for x in re.findall(r"x ([+-]\S+) y \S+ z \S+ m  ", self.text)]

    def press(self, keys):
        os.write(self.person, keys.encode())

    def code(self):
        end = time.monotonic() + PATIENCE
        while self.process.poll() is None:
            assert time.monotonic() < end, self.text[-2000:]
            self.read()
        return self.process.returncode


@pytest.mark.slow
def test_teach_two_poses_and_end(terminal, tmp_path):
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump(SPEC))
    session = Session(terminal, "arm.yaml", "--poses", "taught.csv", "--out", "jogged", cwd=tmp_path)
    session.see(r"(?s)hold to move.*x .*active")
    raw = termios.tcgetattr(terminal[1])
    assert not raw[3] & (termios.ECHO | termios.ICANON)
    session.press("p")
    session.see("pose 1 kept in taught.csv")
    begin, end = session.places()[-1], time.monotonic() + PATIENCE
    while session.places()[-1] < begin + 0.02:
        assert time.monotonic() < end, session.text[-2000:]
        session.press("w")
        session.read()
    session.press("\x1b[A\x1b[B")  # arrows are no letters
    session.press("p")
    session.see("pose 2 kept")
    os.kill(session.process.pid, signal.SIGINT)  # what Ctrl-C sends
    assert session.code() == 0, session.text
    assert "ended: inactive: soft stop; poses: taught.csv" in session.text
    assert termios.tcgetattr(terminal[1]) == session.before
    reference = load_points(tmp_path / "taught.csv")
    first, last = (translation(reference.at(t).pose) for t in (0.0, reference.duration))
    run = load_run(tmp_path / "jogged")
    assert run.record.stopped == "soft stop"
    assert "results: jogged" in session.text
    for kept in (first, last):
        assert np.linalg.norm(run.record.position - kept, axis=1).min() < 1e-6, "the hand was there"
    forward = last - first
    assert forward[0] > 0.01
    assert abs(forward[1:]).max() < 0.1 * forward[0]


def test_the_terminal_is_as_before_after_errors(terminal, monkeypatch):
    person, program = terminal
    before = termios.tcgetattr(program)
    with (
        os.fdopen(os.dup(program), "r") as typed,
        os.fdopen(os.dup(program), "w") as shown,
    ):
        monkeypatch.setattr(sys, "stdin", typed)
        monkeypatch.setattr(sys, "stdout", shown)
        keyboard = Keyboard()
        with pytest.raises(ZeroDivisionError), keyboard:  # noqa: PT012
            assert termios.tcgetattr(program) != before
            os.write(person, b"w\x1b[Aa\x1bOPS+\x1a\x13")
            typed_keys = []
            while len(typed_keys) < 6:
                typed_keys += keyboard.until(time.monotonic() + 0.05)
            assert typed_keys == list("was+\x1a\x13")
            start = time.monotonic()
            assert list(keyboard.until(start + 0.05)) == []
            assert time.monotonic() - start > 0.045
            _ = 1 / 0
        assert termios.tcgetattr(program) == before


def test_without_a_terminal_it_says_so(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["dqcontrol", "jog", "iiwa7"])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 2
    assert capsys.readouterr().err == (
        "dqcontrol: keyboard: needs a terminal; input and output may not be files or pipes\n"
    )
