"""Lists of robots: the bundled ones, and the files that installed packages bring."""

from __future__ import annotations

import math
import re
import warnings
from itertools import groupby

from dqcontrol.cli.screen import print_table
from dqcontrol.tables.tables import Cell, Column, Table


def list_bundled() -> None:
    """Print the robots that come with dqcontrol."""
    from dqcontrol.robots import describe, load_robot, robot_names

    rows = []
    for name in robot_names():
        about = describe(load_robot(name))
        rows.append([name, about.bases or None, len(about.joints), about.reach, about.mass])
    columns = (
        Column("robot"),
        Column("base"),
        Column("coordinates"),
        Column("reach", "m"),
        Column("moving mass", "kg"),
    )
    print_table(Table(columns, rows))


def list_installed() -> None:
    """Load the robot files of all installed packages, and print for each what it is or why it is refused."""
    from dqcontrol.robots.files.installed import installed_robot_files

    columns = (Column("robot"), Column("loads as"), Column("joints"), Column("ends at"), Column("note"))
    counts = {"arm": 0, "tree": 0, "refused": 0}
    found = groupby(installed_robot_files(), key=lambda each: each[0].partition(":")[0])
    for package, files in found:
        rows = [loaded_row(source) for source, _ in files]
        for row in rows:
            counts[str(row[1])] += 1
        print_table(Table(columns, rows, package))
    total = sum(counts.values())
    if not total:
        print("no installed package brings robot files; pip install 'dqcontrol[robots]' gets some")
        return
    print(f"{total} files: {counts['arm']} arms, {counts['tree']} trees, {counts['refused']} refused")


def loaded_row(source: str) -> list[Cell]:
    """Return the row of a robot file: an arm if it has one longest chain, else a tree, else why it is refused."""
    from dqcontrol.errors import Error, NoteWarning
    from dqcontrol.robots import SerialArm, load_robot, load_tree

    notes: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", NoteWarning)
        try:
            robot = load_robot(source)
        except Error as no_arm:
            notes.append(_short(no_arm))
            try:
                robot = load_tree(source)
            except Error as no_tree:
                tip = re.search(r"\(--tip-link (.+?)[;)]", str(no_arm))
                try:
                    robot = load_robot(source, tip_link=tip[1] if tip else None)
                except Error:
                    return [source, "refused", None, None, _short(no_tree if tip else no_arm)]
    arm = isinstance(robot, SerialArm)
    notes += [_short(each.message) for each in caught if issubclass(each.category, NoteWarning)]
    missing, count = sum(map(math.isinf, robot.limits.velocity)), len(robot.limits.velocity)
    if missing:
        notes.append(f"no velocity limit of {f'{missing} of its' if missing < count else 'its'} joints")
    end = robot.links[-1] if arm and robot.links else None
    return [
        source,
        "arm" if arm else "tree",
        robot.configuration_size,
        end,
        "; ".join(dict.fromkeys(notes)) or None,
    ]


def _short(message: object) -> str:
    """Return what a message says, without the file and the hints that the row itself gives."""
    text = re.sub(r"(?<![\w<])/\S*/", "", " ".join(str(message).split()))  # folders
    text = re.sub(r"^tip_link: must be given for \S+; ", "", text)
    text = re.sub(r"^.*?, (?=without the joints of its gripper)", "", text)
    return text.partition(" (--tip-link")[0].partition("; for another end")[0]
