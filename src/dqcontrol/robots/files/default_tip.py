"""The end of a chain if nobody says: at the end of the longest one, or at the link that carries its gripper."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import takewhile
from typing import Any, NamedTuple, TypeAlias

from dqcontrol.errors import NoteWarning, UnknownNameError, suggest

_GRIPPER = re.compile("grip|finger|thumb|jaw|claw|knuckle", re.IGNORECASE)


Joint: TypeAlias = Any
"""What joins two links, whatever kind of file it is from: it has a name, ``parent``, ``child`` and ``mimic``."""


class PartedWay(NamedTuple):
    """The joints from a link to an end of the tree: those of the arm, and the moving ones of the gripper at its end."""

    arm: list[Joint]
    gripper: list[Joint]


def known_link(field: str, name: str, links: Iterable[str], where: str) -> str:
    """Return a link's name, or say that there is none such in a file."""
    if name not in links:
        raise UnknownNameError(
            f"{field}: unknown link '{name}'{suggest(name, links)} (links of {where}: {', '.join(links)})"
        )
    return name


def way_between(carried: Mapping[str, Joint], base: str, tip: str, where: str) -> list[Joint]:
    """Return the joints from one link down to another, of those by the links that they carry."""
    joints, link = list[Joint](), tip
    while link != base:
        if link not in carried:
            way = " < ".join([tip, *(joint.parent for joint in joints)])
            raise UnknownNameError(
                f"tip_link: '{tip}' is not below base link '{base}' in {where}, but on {way}"
            )
        joints.append(carried[link])
        link = joints[-1].parent
    return joints[::-1]


def ways_down(joints: Iterable[Joint], base: str) -> Iterator[list[Joint]]:
    """Yield the joints from a link down to each end below it; ``joints`` has parents before children."""
    ways: dict[str, list[Joint]] = {base: []}
    parents = set()
    for joint in joints:
        parents.add(joint.parent)
        if joint.parent in ways:
            ways[joint.child] = [*ways[joint.parent], joint]
    yield from (way for link, way in ways.items() if link not in parents)


def longest_arms(
    ways: Iterable[list[Joint]], moves: Callable[[Joint], bool], held: Callable[[Joint], bool]
) -> tuple[int, list[PartedWay]]:
    """Return the ways with most joints before their grippers, and how many joints these are.

    A gripper is what moves last, if it is named like one or held: by a loop, or by another joint that it follows, but
    none of the arm's. It has no more joints than the arm that carries it.

    Parameters
    ----------
    ways
        From `ways_down`.
    moves
        Whether a joint would be one of the arm's.
    held
        Whether a joint moves with others only.
    """
    parted = [_parted(way, moves, held) for way in ways]
    counts = [sum(map(moves, way.arm)) for way in parted]
    most = max(counts, default=0)
    return most, [way for way, count in zip(parted, counts, strict=True) if count == most]


def default_tip(
    where: str,
    name: str,
    base: str,
    ways: Iterable[list[Joint]],
    moves: Callable[[Joint], bool],
    held: Callable[[Joint], bool],
) -> str:
    """Return the link where a chain ends if nobody says; a `NoteWarning` tells which gripper is left out.

    Raises
    ------
    UnknownNameError
        If several links may be meant.
    """
    most, best = longest_arms(ways, moves, held)
    ends: dict[str, list[str]] = {}
    for hand in _hands(best, moves):
        holding = [way for way in hand if way.gripper]
        if holding:
            tip = shared([way.arm for way in holding])[-1].child
            ends[tip] = list(dict.fromkeys(joint.name for way in holding for joint in way.gripper))
        else:
            ends |= {way.arm[-1].child: [] for way in hand if way.arm}
    if not ends:
        return base
    tip, gripper = next(iter(ends.items()))
    if len(ends) > 1:
        raise UnknownNameError(
            f"tip_link: must be given for {where}; {len(ends)} links end a chain of {most} joints: "
            f"{', '.join(ends)} (--tip-link {tip}; in a spec robot: {{source: …, tip_link: {tip}}})"
        )
    if gripper:
        warnings.warn(
            f"{name}: the arm ends at {tip}, without the joints of its gripper ({', '.join(gripper)}); "
            "for another end: --tip-link LINK; in a spec robot: {source: …, tip_link: LINK}",
            NoteWarning,
            stacklevel=4,
        )
    return tip


def shared(ways: Sequence[list[Joint]]) -> list[Joint]:
    """Return the joints with which all of some ways begin."""
    steps = takewhile(lambda each: len({joint.name for joint in each}) == 1, zip(*ways, strict=False))
    return [each[0] for each in steps]


def _parted(way: list[Joint], moves: Callable[[Joint], bool], held: Callable[[Joint], bool]) -> PartedWay:
    moving = [i for i, joint in enumerate(way) if moves(joint) or held(joint)]
    last = list(takewhile(lambda i: held(way[i]) or _GRIPPER.search(way[i].name), reversed(moving)))
    if not last or 2 * len(last) > len(moving):
        return PartedWay(way, [])
    arm, gripper = way[: last[-1]], [way[i] for i in reversed(last)]
    followed = {joint.mimic.joint for joint in gripper if joint.mimic is not None}
    return PartedWay(way, []) if followed & {joint.name for joint in arm} else PartedWay(arm, gripper)


def _hands(ways: Iterable[PartedWay], moves: Callable[[Joint], bool]) -> Iterable[list[PartedWay]]:
    """Return ways by the joint that moves their ends."""
    hands: dict[str, list[PartedWay]] = {}
    for way in ways:
        last = next((joint.name for joint in reversed(way.arm) if moves(joint)), "")
        hands.setdefault(last, []).append(way)
    return hands.values()
