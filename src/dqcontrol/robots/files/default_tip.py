"""The end of a chain if nobody says: at the end of the longest one, or at the link that carries its gripper."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import takewhile
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

from dqcontrol.errors import NoteWarning, UnknownNameError

_GRIPPER = re.compile("grip|finger|thumb|jaw|claw|knuckle", re.IGNORECASE)


class TreeEdge(Protocol):
    """What joins two links, whatever kind of file it is from."""

    @property
    def name(self) -> str:
        """Its own."""
        ...

    @property
    def parent(self) -> str:
        """The link above."""
        ...

    @property
    def child(self) -> str:
        """The link below."""
        ...

    @property
    def mimic(self) -> Any:
        """What it follows, with the name of that ``joint``; None if nothing."""
        ...


J = TypeVar("J", bound=TreeEdge)


class PartedWay(NamedTuple, Generic[J]):
    """The joints from a link to an end of the tree: those of the arm, and the moving ones of the gripper at its end."""

    arm: list[J]
    gripper: list[J]


def ways_down(joints: Iterable[J], base: str) -> Iterator[list[J]]:
    """Yield the joints from a link down to each end below it; ``joints`` has parents before children."""
    ways: dict[str, list[J]] = {base: []}
    parents = set()
    for joint in joints:
        parents.add(joint.parent)
        if joint.parent in ways:
            ways[joint.child] = [*ways[joint.parent], joint]
    yield from (way for link, way in ways.items() if link not in parents)


def longest_arms(
    ways: Iterable[list[J]], moves: Callable[[J], bool], held: Callable[[J], bool]
) -> tuple[int, list[PartedWay[J]]]:
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
    ways: Iterable[list[J]],
    moves: Callable[[J], bool],
    held: Callable[[J], bool],
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


def shared(ways: Sequence[list[J]]) -> list[J]:
    """Return the joints with which all of some ways begin."""
    steps = takewhile(lambda each: len({joint.name for joint in each}) == 1, zip(*ways, strict=False))
    return [each[0] for each in steps]


def _parted(way: list[J], moves: Callable[[J], bool], held: Callable[[J], bool]) -> PartedWay[J]:
    moving = [i for i, joint in enumerate(way) if moves(joint) or held(joint)]
    last = list(takewhile(lambda i: held(way[i]) or _GRIPPER.search(way[i].name), reversed(moving)))
    if not last or 2 * len(last) > len(moving):
        return PartedWay(way, [])
    arm, gripper = way[: last[-1]], [way[i] for i in reversed(last)]
    followed = {joint.mimic.joint for joint in gripper if joint.mimic is not None}
    return PartedWay(way, []) if followed & {joint.name for joint in arm} else PartedWay(arm, gripper)


def _hands(ways: Iterable[PartedWay[J]], moves: Callable[[J], bool]) -> Iterable[list[PartedWay[J]]]:
    """Return ways by the joint that moves their ends."""
    hands: dict[str, list[PartedWay[J]]] = {}
    for way in ways:
        last = next((joint.name for joint in reversed(way.arm) if moves(joint)), "")
        hands.setdefault(last, []).append(way)
    return hands.values()
