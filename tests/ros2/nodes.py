"""How tests start nodes as processes, and how patient they are with them."""

import sys

# A machine full of other tests stalls processes for longer than a robot's would be, and what is late seems stale,
# frozen or far from where it was told to be: a test that is about none of these has them off.
PATIENCE = 240.0  # s: of what waits for something that is to come; no test says how soon it has to
UNHURRIED = {
    f"supervisor.{name}": 1000.0
    for name in ("stale_after", "frozen_after", "tracking_error", "jump", "overspeed")
}
PATIENT = ("--", *(word for name, bound in UNHURRIED.items() for word in ("-p", f"{name}:={bound}")))
NODES = [sys.executable, "-u", "-m", "dqcontrol", "ros2"]


def read_until(process, text):
    """Return the log up to the line that has a text."""
    log = ""
    for line in process.stdout:
        log += line
        if text in line:
            return log
    raise AssertionError(f"'{text}' never came in:\n{log}")
