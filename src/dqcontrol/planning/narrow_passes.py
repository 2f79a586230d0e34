"""Straight passes of bases through what is hardly wider than they are; no random edge finds them."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.geometry import Box
from dqcontrol.planning.certified_edges import CertifiedEdges
from dqcontrol.references.ways_around import WaysAround, across, body_points, folded_posture
from dqcontrol.robots import Robot
from dqcontrol.world import floor_around, stands

_STEP = 0.02  # m: between points of a way that are asked for room to turn
# m and rad: how far beside the line of a pass, and how far turned, others are tried: ways on grids bend in doors
_LOOKED = 16  # configurations of a pass of a base that drives, which is proved with the rest of its way
_ASIDE, _TURNED = np.linspace(-0.2, 0.2, 81), np.radians(np.linspace(-24.0, 24.0, 25))


def narrow_passes(edges: CertifiedEdges, start: Array, goal: Array) -> list[tuple[Array, Array]]:
    """Return edges through narrow places on the way from a configuration (n,) to another, in their order.

    A disc as wide as the base's narrower side goes first; where its way leaves no room to turn, the base passes
    straight on, its longer side ahead, with the arm as it is or else folded; these are certified. Where a base drives,
    it passes with the arm as it is, and samples alone say that it is clear.
    """
    robot, given = edges.robot, edges.kept.given
    bodies = given.world.bodies if given.world else {}
    names = [name for name in given.cleared if stands(bodies[name]) and bodies[name].plane is None]
    half = _half_sizes(robot)
    if half is None or not names:
        return []
    first = robot.bases[0][0]
    here, there = start[first : first + 2], goal[first : first + 2]
    floor = floor_around(given.world, names, "constraints.clear_of")
    radius = float(half[1] if len(robot.drives) else half.min()) + given.margin
    corners = np.vstack([here, there, *floor.polygons])
    within = np.array([corners.min(axis=0) - 1.0, corners.max(axis=0) + 1.0])
    via = WaysAround(floor, here, radius, within).to(there)
    if via is None:
        return []
    corners = [here, *via, there]
    points = np.vstack(
        [
            *(
                a + np.arange(0.0, 1.0, _STEP / math.dist(a, b))[:, None] * (b - a)
                for a, b in pairwise(corners)
            ),
            there,
        ]
    )
    clear = floor.clearance(points)
    for arm in (start,) if len(robot.drives) else (start, folded_posture(robot, start)):
        tight = np.diff(np.r_[False, clear < across(robot, arm) + given.margin, False].astype(int))
        places = zip(np.flatnonzero(tight > 0) - 1, np.flatnonzero(tight < 0), strict=True)
        ends = [points[[max(int(i), 0), min(int(j), len(points) - 1)]] for i, j in places]
        found = [
            _pass_between(edges, arm, *each, sideways=half[1] > half[0] and not len(robot.drives))
            for each in ends
        ]
        if found and all(each is not None for each in found):
            return [each for each in found if each is not None]
    return []


def _half_sizes(robot: Robot) -> Array | None:
    """Return half of the length and width of a robot's only base: a box that moves sideways, or any that drives."""
    if len(robot.bases) != 1 or robot.shapes is None:
        return None
    if len(robot.drives):
        body = body_points(robot, np.zeros(robot.configuration_size))
        own = ~body.carried
        return (np.abs(body.points[own, :2]) + body.radius[own, None]).max(axis=0) if own.any() else None
    frame = robot.bases[0][0] + 3
    boxes = [
        each.shape for each in robot.shapes.shapes if each.frame == frame and isinstance(each.shape, Box)
    ]
    return 0.5 * np.asarray(boxes[0].size)[:2] if boxes else None


def _pass_between(
    edges: CertifiedEdges, arm: Array, begin: Array, end: Array, *, sideways: bool
) -> tuple[Array, Array] | None:
    """Return the edge with the most room near the line from one place, (2,), to another."""
    first = edges.robot.bases[0][0]
    half = 0.5 * math.dist(begin, end)
    along = (end - begin) / max(2.0 * half, 1e-9)
    heading = math.atan2(along[1], along[0]) + (0.5 * math.pi if sideways else 0.0)
    heading += math.pi * round(
        (arm[first + 2] - heading) / math.pi
    )  # ahead or backwards, whichever turns less
    aside, turn = (each.ravel() for each in np.meshgrid(_ASIDE, _TURNED))
    c, s = np.cos(turn), np.sin(turn)
    way = half * np.column_stack([c * along[0] - s * along[1], s * along[0] + c * along[1]])
    middles = 0.5 * (begin + end) + aside[:, None] * np.array([-along[1], along[0]])
    ends = np.tile(arm, (2, len(turn), 1))
    ends[:, :, first : first + 2] = middles - way, middles + way
    ends[:, :, first + 2] = heading + turn
    if len(edges.robot.drives):
        looked = ends[0][:, None] + np.linspace(0, 1, _LOOKED)[:, None] * (ends[1] - ends[0])[:, None]
        rooms = edges.room_at(looked.reshape(-1, len(arm)))[0].reshape(-1, _LOOKED).min(axis=1)
    else:
        found = edges.clear(ends[0], ends[1])
        rooms = np.where(found.certified, found.room, -np.inf)
    best = int(rooms.argmax())
    return (ends[0, best], ends[1, best]) if rooms[best] >= 0 else None
