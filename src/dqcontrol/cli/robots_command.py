"""Show a robot, look at it, or solve for where its joints must be."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter, validators

from dqcontrol.cli.options import ANGLES, BaseLink, Port, Switch, TipLink
from dqcontrol.cli.screen import joint_columns, joint_values, print_table

robots: App = App(
    name="robots",
    help="Show a robot, look at it in a browser, or find joint angles for a pose; dqcontrol robots list has names.",
)


@robots.command(name="list")
def list_all(*, installed: Switch = False) -> None:
    """List the bundled robots, or those whose files other installed packages bring.

    Parameters
    ----------
    installed
        Load each robot file of the installed packages, and each model of MuJoCo Menagerie on this computer, or say why
        not; the first column names it to every command.
    """
    from dqcontrol.cli.robots_listing import list_bundled, list_installed

    if installed:
        list_installed()
    else:
        list_bundled()


@robots.command
def show(source: str, /, *, base_link: BaseLink = None, tip_link: TipLink = None) -> None:
    """Show a robot's joints and limits.

    Parameters
    ----------
    source
        Name, .yaml, .urdf, .xacro or .xml (MJCF) file, PACKAGE:PATH or menagerie:NAME.
    """
    from dqcontrol.robots import describe, load_robot
    from dqcontrol.tables.tables import Column, Table

    about = describe(load_robot(source, base_link, tip_link))
    rows = [[j.name, j.type, j.lower, j.upper, j.velocity, j.effort, j.input or None] for j in about.joints]
    units = {"lower": "° or m", "upper": "° or m", "velocity": "°/s or m/s", "effort": "N·m or N"}
    columns = [Column(name, units.get(name, "")) for name in ("joint", "type", *units, "input")]
    if not about.bases:  # an arm's inputs are its joints
        rows, columns = [row[:-1] for row in rows], columns[:-1]
    base = f"{about.bases} base, " if about.bases else f"{about.ends}, " if about.ends else ""
    mass = f", moving mass {about.mass:.3g} kg" if about.mass is not None else ", no inertia"
    print_table(Table(columns, rows, f"{about.name}: {base}reach {about.reach:.3g} m{mass}"))
    unlimited = [j.name for j in about.joints if j.velocity == math.inf and not about.bases]
    if unlimited:
        print(f"joints without velocity limit: {len(unlimited)}; docs/own-robot.md says how to give one")
    if about.links:
        print(f"links from base to tip, for --base-link and --tip-link: {', '.join(about.links)}")


@robots.command
def view(
    source: str,
    /,
    *,
    base_link: BaseLink = None,
    tip_link: TipLink = None,
    port: Port = 8080,
) -> None:
    """Look at a robot in a browser: sliders for its joints, frames, limits and reach; Ctrl+C ends it.

    Parameters
    ----------
    source
        Name, .yaml, .urdf, .xacro or .xml (MJCF) file, PACKAGE:PATH or menagerie:NAME.
    port
        Of this machine, where only its own users reach it; the next free one if it is taken.
    """
    from dqcontrol.browser import RobotPage
    from dqcontrol.browser.served_page import import_viser
    from dqcontrol.robots import describe, load_robot

    import_viser()  # before the work: it may be missing
    robot = load_robot(source, base_link, tip_link)
    about = describe(robot)
    page = RobotPage(robot, port)
    ends = f": {about.ends}" if about.ends else ""
    print(f"{about.name}{ends}, {len(about.joints)} coordinates, reach {about.reach:.3g} m")
    print(f"view: {page.url} (Ctrl+C ends)", flush=True)
    page.serve()


@robots.command
def convert(
    source: str,
    out: Path,
    /,
    *,
    base_link: BaseLink = None,
    tip_link: TipLink = None,
    tips: str | None = None,
) -> None:
    """Write a URDF, xacro or MJCF file as a robot file of ours: the chain between two links, or a tree.

    Parameters
    ----------
    source
        Name, .yaml, .urdf, .xacro or .xml (MJCF) file, PACKAGE:PATH or menagerie:NAME.
    out
        New .yaml file.
    tips
        Links with commas between them, or "all": the tree of the joints above them in place of a chain.
    """
    from dqcontrol.errors import ExistsError, ShapeError
    from dqcontrol.files.output_file import yaml_text
    from dqcontrol.robots import SerialArm, TreeRobot, TwoArms, load_robot
    from dqcontrol.robots.files.robot_file import plain_arm
    from dqcontrol.robots.files.tree_file import plain_tree

    if out.exists():
        raise ExistsError(f"{out}: exists; choose another name")
    if tips is None:
        robot = load_robot(source, base_link, tip_link)
    elif tip_link is not None:
        raise ShapeError("--tips: makes a tree and --tip-link a chain; give one of them")
    else:
        robot = load_robot(source, base_link, tips="all" if tips == "all" else tips.split(","))
    if isinstance(robot, TreeRobot) and not isinstance(robot, TwoArms):
        data = plain_tree(robot)
    elif isinstance(robot, SerialArm):
        data = plain_arm(robot)
    else:
        raise ShapeError(f"{source}: is made of several files; convert those")
    data["sources"] = [f"converted from {Path(source).name}"]
    out.write_text(yaml_text(data), encoding="utf-8")
    print(f"{out}: {robot.name}, {robot.configuration_size} coordinates")


@robots.command
def wheels(
    source: str,
    /,
    *,
    drive: str | None = None,
    wheel_radius: float | None = None,
    track: float | None = None,
) -> None:
    """Show the wheels that a URDF, xacro or MJCF file has, and the mobile base that they make.

    Parameters
    ----------
    source
        .urdf, .xacro or .xml (MJCF) file, PACKAGE:PATH or menagerie:NAME.
    drive
        What the wheels do not tell: differential, mecanum, omni, car-like or tricycle.
    wheel_radius
        Where the file does not tell, m.
    track
        Where the file does not tell, m.
    """
    from dqcontrol.cli.robots_listing import list_wheels

    list_wheels(source, drive, wheel_radius, track)


@robots.command
def shapes(
    source: str,
    /,
    *,
    base_link: BaseLink = None,
    tip_link: TipLink = None,
    write: Path | None = None,
    picture: Path | None = None,
    pairs: Switch = False,
) -> None:
    """Show, check and draw the shapes of a robot's links and the pairs kept apart; of a URDF or MJCF file find both.

    Primitives of a file stay, capsules are fitted to its meshes, and random configurations tell which pairs are
    worth keeping apart.

    Parameters
    ----------
    source
        Name, .yaml, .urdf, .xacro or .xml (MJCF) file, PACKAGE:PATH or menagerie:NAME.
    write
        A new robot file with shapes and pairs, to be edited and loaded in place of the source.
    picture
        A new .png, .pdf or .svg file: the shapes around the joints, in the middle of the joints' ranges.
    pairs
        List all pairs, how near they come and why they are left out.
    """
    from dqcontrol.cli.robots_listing import list_shapes

    list_shapes(source, base_link, tip_link, write, picture, every_pair=pairs)


@robots.command
def solve(
    source: str,
    /,
    *,
    position: tuple[float, float, float],
    rpy: Annotated[tuple[float, float, float] | None, ANGLES] = None,
    quaternion: tuple[float, float, float, float] | None = None,
    base_link: BaseLink = None,
    tip_link: TipLink = None,
    top: Annotated[int, Parameter(validator=validators.Number(gte=1))] = 5,
) -> None:
    """Find joint angles that bring a robot's end effector to a pose; the best to start from comes first.

    The best has the most room to its joint limits and the most manipulability. Without --rpy and --quaternion the
    orientation does not matter.

    Parameters
    ----------
    source
        Name, .yaml, .urdf, .xacro or .xml (MJCF) file, PACKAGE:PATH or menagerie:NAME.
    position
        Of the end effector in the base frame: x y z, m.
    rpy
        Its roll, pitch and yaw, rad or as 90deg: Rz(yaw) Ry(pitch) Rx(roll).
    quaternion
        In their place: w x y z.
    top
        How many solutions to list at most.
    """
    from dqcontrol.experiments.spec import HandStart
    from dqcontrol.robots import load_robot
    from dqcontrol.tables.tables import Column, Table

    robot = load_robot(source, base_link, tip_link)
    found = HandStart(position=position, quaternion=quaternion, rpy=rpy).postures(robot)
    columns = [
        *joint_columns(robot),
        Column("room to limits", "°" if found[0].unit == "rad" else "m", ".3g"),
        Column("nearest limit"),
        Column("manipulability", "", ".3g"),
    ]
    rows = [
        [
            *joint_values(robot, each.q),
            math.degrees(each.margin) if each.unit == "rad" else each.margin,
            each.nearest,
            each.manipulability,
        ]
        for each in found[:top]
    ]
    print_table(Table(columns, rows, f"{robot.name}: {len(found)} found, the best first"))
    print(f"start: [{', '.join(f'{round(value, 9):z.6g}' for value in found[0].q)}]   # for a spec: rad or m")
