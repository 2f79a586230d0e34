"""Starts ``dqcontrol`` again and again as a fork of a process that has it loaded already: in a tenth of the time.

For each line of JSON that comes in, ``{"words": […], "log": FILE, "background": bool}``, it forks, tells the child's
number, waits for its end, and tells the exit code. In the background SIGINT is ignored at first, as shells do.
"""

import json
import os
import select
import signal
import subprocess
import sys

from dqcontrol.cli import main
from dqcontrol.loop.control import Control, warm_up
from dqcontrol.ros2.loading import load


def prepare(spec):
    """Import and compile what the children need; ROS itself is started by each."""
    import dqcontrol.ros2.controller_node
    import dqcontrol.ros2.robot_node

    loaded = load(spec)
    law, supervisor = loaded.prepared_law("spec"), loaded.prepared_supervisor("velocity")
    warm_up(law, supervisor, loaded.case.scene.start, loaded.case.scene.samples[0])
    _ = Control, dqcontrol.ros2


def be(words, log, background):
    """Be the command line."""
    signal.signal(signal.SIGINT, signal.SIG_IGN if background else signal.default_int_handler)
    file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    for stream in (1, 2):
        os.dup2(file, stream)
    sys.argv = ["dqcontrol", *words]
    main()


def serve(spec):
    prepare(spec)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    print("ready", flush=True)
    for line in sys.stdin:
        child = os.fork()
        if not child:
            be(**json.loads(line))
            sys.exit()
        print(child, flush=True)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


class Forks:
    """Runs commands of ours one after the other in forks of one process."""

    def __init__(self, spec, folder):
        self.log_file, self.begun = folder / "log", False
        self._process = subprocess.Popen(
            [sys.executable, __file__, str(spec)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        assert self._process.stdout
        self._said = self._process.stdout
        assert self._said.readline() == "ready\n"

    def start(self, words, background):
        self.log_file.unlink(missing_ok=True)
        line = {"words": ["ros2", *map(str, words)], "log": str(self.log_file), "background": background}
        print(json.dumps(line), file=self._process.stdin, flush=True)
        return int(self._said.readline())

    def end(self, child):
        """Return exit code and log; a child that was not yet there to hear a signal gets another one."""
        if not self.has_ended(60.0):
            assert not self.begun, self.log
            os.kill(child, signal.SIGTERM)
        return int(self._said.readline()), self.log

    def kill(self, child, number):
        self.begun = bool(self.log)
        os.kill(child, number)

    def has_ended(self, seconds=0.0):
        """Return whether the child ends within some time."""
        return bool(select.select([self._said], [], [], seconds)[0])

    @property
    def log(self):
        """What the child has said so far."""
        return self.log_file.read_text() if self.log_file.exists() else ""

    def __enter__(self):
        return self

    def __exit__(self, *_):
        os.killpg(self._process.pid, signal.SIGKILL)  # a child too, if a test has failed
        self._process.wait()


if __name__ == "__main__":
    serve(sys.argv[1])
