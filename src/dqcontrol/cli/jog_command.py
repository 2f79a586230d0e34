"""Drive a robot by keys."""

from __future__ import annotations

import time
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from dqcontrol.cli.options import SPEED, BaseLink, Out, ReplaceResults, TipLink, in_unit

if TYPE_CHECKING:
    from dqcontrol.devices import Jog, Keyboard

_SHOWN_EVERY = 0.1  # s


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
