"""Generate an excitation trajectory for `identify`."""

from __future__ import annotations

from typing import Annotated, Literal

from cyclopts import Parameter

from dqcontrol.cli.options import BaseLink, Force, Out, Seconds, TipLink, in_unit, numbers
from dqcontrol.cli.screen import print_table

Way = Annotated[float, in_unit("rad or m", "17deg")]


def excite(
    robot: str,
    /,
    *,
    start: Annotated[
        str | None,
        Parameter(help="Configuration about which it moves: a,b,c in rad or m, or with units: 90deg,0."),
    ] = None,
    base_link: BaseLink = None,
    tip_link: TipLink = None,
    signal: Literal["zigzag", "multisine", "chirp"] = "zigzag",
    together: Annotated[bool, Parameter(negative=())] = False,
    duration: Seconds = 60.0,
    period: Seconds = 0.008,
    amplitude: Way = 0.3,
    joint_speed: Annotated[float, in_unit("rad/s or m/s", "60deg/s")] = 1.0,
    joint_acceleration: Annotated[float, in_unit("rad/s² or m/s²", "90deg/s²")] = 6.0,
    workspace: Annotated[
        str | None, Parameter(help="Box that the hand does not leave: x0,x1,y0,y1,z0,z1 in m, base frame.")
    ] = None,
    lag: Seconds = 0.05,
    delay: Seconds = 0.02,
    noise: Way = 1e-4,
    resolution: Way = 0.0,
    seed: int = 1,
    out: Out = None,
    force: Force = False,
) -> None:
    """Generate an excitation trajectory for `identify`, and say how precise the estimates will be.

    Numbers may have a unit: 8ms, 17deg.

    Parameters
    ----------
    robot
        Name, .yaml or .urdf file, or example-robot-data:PATH.
    signal
        zigzag (tells most), multisine or chirp (smoother).
    together
        All joints at once, the whole time; else one after the other, then all together by a multisine.
    duration
        Of the motion, s.
    period
        Control period, s.
    amplitude
        Largest distance of a joint from its start, rad or m.
    joint_speed
        Largest of a joint, rad/s or m/s; no more than 0.9 of the robot's limits.
    joint_acceleration
        Largest of a joint, rad/s² or m/s².
    lag
        To expect, s: what the precision is said for; so are delay, noise and resolution.
    delay
        To expect, s.
    noise
        Of the encoders to expect, rad or m.
    resolution
        Of the encoders to expect, rad or m.
    seed
        Of turning points and phases.
    out
        New folder for motion.csv, hand.csv and excite.yaml, which runs them.
    force
        Replace these files in an existing folder.
    """
    from dqcontrol.experiments.results_folder import check_new
    from dqcontrol.logs.servos import excite as design

    if out is not None and not force:
        check_new(out, force=False)
    found = design(
        robot,
        numbers("start", start, "rad or m"),
        base_link=base_link,
        tip_link=tip_link,
        signal=signal,
        together=together,
        duration=duration,
        period=period,
        amplitude=amplitude,
        speed=joint_speed,
        acceleration=joint_acceleration,
        workspace=numbers("workspace", workspace, "m"),
        lag=lag,
        delay=delay,
        noise=noise,
        resolution=resolution,
        seed=seed,
    )
    if out is not None:
        found.save(out, force=force)
        print(f"results: {out}")
    print_table(found.table)
    for remark in found.remarks:
        print(remark)
    if out is not None:
        print(f"run it: dqcontrol run {out / 'excite.yaml'} --out RESULTS")
