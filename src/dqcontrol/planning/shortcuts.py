"""Shorter ways: points left out, and random places of a way joined, by certified edges in one compiled loop."""

from __future__ import annotations

import math

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, READ, READ2, STATUS, WRITE, WRITE2, kernel, shared
from dqcontrol.errors import ShapeError
from dqcontrol.planning.certified_edges import ANSWER, CERTIFIED, CertifiedEdges, certify_curve, proof_of

_TRIES = (
    150  # random shortcuts: of 128 problems of MotionBenchMaker they leave 4.9 of 11.9 rad; 4.2 is straight
)
_WORTH = 1e-3  # share of a length below which a shortcut is none

# chain, needs, parameters, random numbers (tries, 2), own work, scratch, edge (3 n), way (room, n), count (1)
SHORTEN = STATUS(READ2, READ, READ, READ2, WRITE, WRITE, WRITE, WRITE2, WRITE)


@shared
def _distance(a, b):
    total = 0.0
    for i in range(a.shape[0]):
        total += (b[i] - a[i]) ** 2
    return math.sqrt(total)


@shared
def _is_clear(proof, edge, a, b, answer):
    """Return whether a straight edge is certified."""
    n = a.shape[0]
    for i in range(n):
        edge[i], edge[n + i], edge[2 * n + i] = a[i], 0.5 * (a[i] + b[i]), b[i]
    return certify_curve(proof, edge, -1.0, answer) == OK and answer[CERTIFIED] > 0.0


@shared
def _replace(way, count, first, last, inner):
    """Put as many points as ``inner`` says, which stand behind the way, between two of it; return how many it has."""
    n, end = way.shape[1], way.shape[0] - 2
    move = inner - (last - first - 1)
    if move > 0:
        for k in range(count - 1, last - 1, -1):
            for i in range(n):
                way[k + move, i] = way[k, i]
    elif move < 0:
        for k in range(last, count):
            for i in range(n):
                way[k + move, i] = way[k, i]
    for k in range(inner):
        for i in range(n):
            way[first + 1 + k, i] = way[end + k, i]
    return count + move


@shared
def _leave_out(proof, way, count, edge, answer):
    """Leave out points: from each on the farthest that an edge reaches is the next."""
    first = 0
    while first < count - 2:
        last = count - 1
        while last > first + 1 and not _is_clear(proof, edge, way[first], way[last], answer):
            last -= 1
        count = _replace(way, count, first, last, 0)
        first += 1
    return count


@shared
def _place_at(way, count, share, out):
    """Write the configuration at a share of a way's length, and return the number of the point before it."""
    total = 0.0
    for k in range(count - 1):
        total += _distance(way[k], way[k + 1])
    left = share * total
    for k in range(count - 1):
        length = _distance(way[k], way[k + 1])
        if left <= length or k == count - 2:
            part = min(left / max(length, 1e-12), 1.0)
            for i in range(out.shape[0]):
                out[i] = way[k, i] + part * (way[k + 1, i] - way[k, i])
            return k
        left -= length
    return 0


@kernel(SHORTEN)
def shorten_way(chain, needs, parameters, shares, own, scratch, edge, way, count):
    """Leave points of a way out and join random places of it, where that is certified and shorter."""
    n, end = way.shape[1], way.shape[0] - 2
    proof = proof_of(chain, n, needs, parameters, own, scratch)
    answer = edge[3 * n :]
    points = _leave_out(proof, way, int(count[0]), edge, answer)
    for tried in range(shares.shape[0]):
        if points <= 2:
            break
        low, high = min(shares[tried, 0], shares[tried, 1]), max(shares[tried, 0], shares[tried, 1])
        first = _place_at(way, points, low, way[end])
        last = _place_at(way, points, high, way[end + 1])
        if first == last or points + 2 > end:
            continue
        before, after = _distance(way[first], way[end]), _distance(way[end + 1], way[last + 1])
        old = -before - after
        for k in range(first, last + 1):
            old += _distance(way[k], way[k + 1])
        if _distance(way[end], way[end + 1]) > (1.0 - _WORTH) * old:
            continue
        if _is_clear(proof, edge, way[end], way[end + 1], answer):
            points = _replace(way, points, first, last + 1, 2)
    count[0] = float(_leave_out(proof, way, points, edge, answer))
    return OK


def shortened(edges: CertifiedEdges, way: Array, seed: int) -> Array:
    """Return a way between the same ends, shape (K, n), that is shorter where certified edges allow it."""
    count, n = way.shape
    memory = np.empty((count + 2 * _TRIES + 4, n))
    memory[:count] = way
    points = np.array([float(count)])
    shares = np.random.default_rng(seed).uniform(size=(_TRIES, 2))
    edge = np.empty(3 * n + ANSWER)
    status = shorten_way(*edges.proof, shares, *edges.work, edge, memory, points)
    if status != OK:
        raise ShapeError(f"way: no poses of {edges.robot.name} on it")
    return memory[: int(points[0])].copy()
