"""Take a robot's target in the hand."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from dqcontrol.cli.options import BaseLink, Port, TipLink
from dqcontrol.cli.screen import announce

if TYPE_CHECKING:
    from dqcontrol.devices import Input
    from dqcontrol.loop import Live

_ROBOT = "panda"


def play(
    source: str = _ROBOT,
    /,
    *,
    base_link: BaseLink = None,
    tip_link: TipLink = None,
    device: Literal["gamepad", "space-mouse", "web-xr", "ros2"] | None = None,
    out: Path = Path(),
    port: Port = 8080,
) -> None:
    """Drag the target of a simulated robot in a browser, and change its law, joints and surroundings meanwhile.

    Parameters
    ----------
    source
        A robot's name or file; a spec of one run; or the folder of a run, which begins where that began.
    device
        What drives the end effector beside the mouse: web-xr is a page for a phone or headset, ros2 topics of poses and
        twists.
    out
        Folder where recordings are saved.
    port
        Of this machine, where only its own users reach it; the next free one if it is taken.
    """
    from dqcontrol.browser.served_page import address, start_server, stop_server
    from dqcontrol.robots import robot_names

    server = start_server(port, "dqcontrol play")
    is_known = source in robot_names() or Path(source).exists()
    if is_known:  # the browser begins meanwhile; what follows takes seconds
        announce("play", address(server))
    loading = server.gui.add_html("Loading the robot …")

    from dqcontrol.browser.play import PlayPage, PlaySession
    from dqcontrol.experiments.driven import driven_spec

    with ExitStack() as stack:
        stack.callback(stop_server, server)  # where the page does not come to it
        spec, folder = driven_spec(source, (base_link, tip_link))
        session = PlaySession(spec, folder)
        if device:
            held = _held(device, stack)
            stack.callback(held.close)
            session.driver = _driver(held)
        stack.enter_context(session)
        loading.remove()
        page = PlayPage(session, out, server=server)
        if not is_known:
            announce("play", page.url)
        page.serve()


def _held(device: str, stack: ExitStack) -> Input:
    """Return a device."""
    from dqcontrol import devices

    if device == "gamepad":
        return devices.Gamepad()
    if device == "space-mouse":
        return devices.SpaceMouse()
    if device == "web-xr":
        page = devices.WebXr()
        print(f"web-xr: {page.url}; on a cable: adb reverse tcp:{page.port} tcp:{page.port}", flush=True)
        return page
    from dqcontrol.browser.play.session import SPEEDS
    from dqcontrol.ros2 import middleware

    middleware.check_installed()
    stack.enter_context(middleware.ros((), ["dqcontrol_hand"]))
    from dqcontrol.ros2.hand_topics import HandTopics

    return HandTopics(speeds=SPEEDS)


def _driver(held: Input) -> Callable[[Live], None]:
    """Return what a device makes of a robot in each period."""
    from dqcontrol.devices import Teleoperation

    driven: list[Teleoperation] = []

    def drive(live: Live) -> None:
        if not driven or driven[0].live is not live:  # another robot, or the same one put elsewhere
            driven[:] = [Teleoperation(live)]
        driven[0].take(held.read(), time.monotonic())

    return drive
