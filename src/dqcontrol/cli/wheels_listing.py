"""What `dqcontrol robots wheels` prints."""

from __future__ import annotations

from typing import Any

from dqcontrol.cli.screen import print_table
from dqcontrol.robots.files.load import file_of
from dqcontrol.robots.files.mobile_robot_file import base_of_file
from dqcontrol.tables.tables import Column, Table

_NUMBERS = (
    "wheel_radius",
    "half_track",
    "half_wheelbase",
    "wheelbase",
    "wheel_distance",
    "steering_limit",
    "rim_speed",
)


def list_wheels(source: str, drive: Any, wheel_radius: float | None, track: float | None) -> None:
    """Print the wheels and casters of a file, and the base that they make."""
    tree, found = base_of_file(file_of(source), drive, wheel_radius, track)
    rows = []
    for role, wheels in (("wheel", found.wheels), ("caster", found.casters)):
        for wheel in wheels:
            what = "steered wheel" if wheel.steering and role == "wheel" else role
            rows.append([wheel.joint, what, *wheel.middle, wheel.radius, wheel.speed])
    columns = (
        Column("joint"),
        Column("is"),
        *(Column(axis, "m", ".4f") for axis in "xyz"),
        Column("radius", "m", ".4f"),
        Column("speed", "rad/s"),
    )
    print_table(Table(columns, rows))
    base = found.base
    said = [f"{name} {getattr(base, name):.4g}" for name in _NUMBERS if hasattr(base, name)]
    print(f"{tree.name}: {base.kind}, {', '.join(said)}")
