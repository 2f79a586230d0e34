"""Drive a robot by hand: its target in a browser, or its end effector by keys."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from dqcontrol.cli.options import SPEED, BaseLink, Out, Port, ReplaceResults, TipLink, in_unit
from dqcontrol.cli.screen import announce

if TYPE_CHECKING:
    from dqcontrol.devices import Input, Jog, Keyboard
    from dqcontrol.loop import Live

_SHOWN_EVERY = 0.1  # s


def play(
    source: str = "panda",
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


def jog(
    source: str,
    /,
    *,
    base_link: BaseLink = None,
    tip_link: TipLink = None,
    poses: Annotated[Path, Parameter(name=["--poses", "-p"])] = Path("poses.csv"),
    speed: Annotated[float, SPEED] = 0.1,
    angular_speed: Annotated[float, in_unit("rad/s", "30deg/s")] = 0.5,
    out: Out = None,
    force: ReplaceResults = False,
) -> None:
    """Drive a robot's end effector by keys in the terminal, and keep poses as a points file.

    Parameters
    ----------
    source
        YAML file of one run: its robot, start, law, plant and supervisor. Or a robot, which is then simulated.
    poses
        New points file, made with the first pose; a spec's reference of kind points follows it.
    speed
        The fastest that the end effector moves, m/s.
    angular_speed
        The fastest that it turns, rad/s.
    out
        New folder for a recording of the motion, which `dqcontrol view` shows while it runs; what led to a stop lies
        in its black-box, without it in results/black-box.
    """
    from dqcontrol.devices import Jog, Keyboard
    from dqcontrol.devices.jog import HELP
    from dqcontrol.errors import as_positive
    from dqcontrol.experiments.driven import prepare_live, recorded_live
    from dqcontrol.loop.interrupts import first_interrupt
    from dqcontrol.loop.targets import Speeds
    from dqcontrol.recording.mcap import FOLDER
    from dqcontrol.references.points import PointsWriter

    keyboard = Keyboard()
    speeds = Speeds(as_positive("speed", speed), as_positive("angular_speed", angular_speed))
    writer = PointsWriter(poses, speeds.linear, speeds.angular)
    if out:
        session = recorded_live(source, speeds, out, ends=(base_link, tip_link), force=force)
    else:
        session = nullcontext(prepare_live(source, speeds, ends=(base_link, tip_link)))
    with session as live:
        print("\n".join(HELP))
        with keyboard, first_interrupt(live.end):
            _drive(Jog(live, writer), keyboard, (out or Path("results")) / FOLDER)
        print(f"ended: {live.condition}" + f"; poses: {poses}" * poses.exists())
    if out:
        print(f"results: {out}")


def _drive(jog: Jog, keyboard: Keyboard, black_box: Path) -> None:
    """Step in real time, hear keys while waiting, show what is going on, and keep what led to a stop.

    Whatever ends it, the robot is at rest then.
    """
    from dqcontrol.loop.live import Pace
    from dqcontrol.recording import save_black_box

    live = jog.live
    shown = before = time.monotonic()
    pace, was_stopped = Pace(live.period), False
    try:
        while not live.ended:
            for key in keyboard.until(pace.deadline):
                if told := jog.press(key):
                    keyboard.tell(told)
            begin = time.monotonic()
            live.step(begin - before if before < begin else None)
            if live.is_stopped and not was_stopped:
                kept = save_black_box(live.black_box, black_box, live.spec, f"halted: {live.reason}")
                keyboard.tell(f"{live.condition}; the last seconds: {kept}")
            was_stopped, before = live.is_stopped, begin
            pace.done()
            if begin - shown > _SHOWN_EVERY:
                shown = begin
                keyboard.show(jog.status)
    except BaseException:
        live.brake()
        raise
