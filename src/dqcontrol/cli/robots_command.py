"""List the robots that come along, or show one."""

from __future__ import annotations

from typing import Annotated

from cyclopts import App, Parameter

from dqcontrol.cli.screen import print_table

robots: App = App(name="robots", help="List the robots that come with dqcontrol, or show one.")


@robots.default
def list_robots() -> None:
    """List the robots that come with dqcontrol."""
    from dqcontrol.measures.tables import Column, Table
    from dqcontrol.robots import describe, load_robot, robot_names

    rows = []
    for name in robot_names():
        about = describe(load_robot(name))
        rows.append([name, about.name, about.bases or None, len(about.joints), about.reach, about.mass])
    columns = (
        Column("name"),
        Column("robot"),
        Column("base"),
        Column("coordinates"),
        Column("reach", "m"),
        Column("moving mass", "kg"),
    )
    print_table(Table(columns, rows))


@robots.command
def show(
    source: str,
    /,
    *,
    base_link: Annotated[str | None, Parameter(help="Start of the chain in a URDF file.")] = None,
    tip_link: Annotated[str | None, Parameter(help="End of the chain in a URDF file.")] = None,
) -> None:
    """Show a robot's joints and limits.

    Parameters
    ----------
    source
        Name, .yaml or .urdf file, or example-robot-data:PATH.
    """
    from dqcontrol.measures.tables import Column, Table
    from dqcontrol.robots import describe, load_robot

    about = describe(load_robot(source, base_link, tip_link))
    rows = [[j.name, j.type, j.lower, j.upper, j.velocity, j.effort, j.input or None] for j in about.joints]
    columns = (
        Column("joint"),
        Column("type"),
        Column("lower", "° or m"),
        Column("upper", "° or m"),
        Column("velocity", "°/s or m/s"),
        Column("effort", "N·m or N"),
        Column("input"),
    )
    if not about.bases:  # an arm's inputs are its joints
        rows, columns = [row[:-1] for row in rows], columns[:-1]
    base = f"{about.bases} base, " if about.bases else ""
    mass = f", moving mass {about.mass:.3g} kg" if about.mass is not None else ", no inertia"
    print_table(Table(columns, rows, f"{about.name}: {base}reach {about.reach:.3g} m{mass}"))
