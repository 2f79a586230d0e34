"""Paths of bases that cannot move sideways: turns, lines and arcs one after the other, the arm held still."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.references.base_ways import rolled


class BasePath(NamedTuple):
    """What a base drives, over the length of its path; between pieces it has to rest.

    Lengths are √(l² + α²) of pieces that go l and turn by α, m and rad alike. Inputs v and ω stand in the columns of x
    and φ.

    Attributes
    ----------
    start
        Configuration at its begin, shape (n,).
    first
        Column of x; y and φ follow.
    pieces
        The integrals of v and ω on each, shape (K, 2), m and rad.
    """

    start: Array
    first: int
    pieces: Array

    @property
    def begins(self) -> Array:
        """Length of the path where each piece begins, and its end, shape (K + 1,)."""
        return np.concatenate([[0.0], np.cumsum(np.hypot(*self.pieces.T))])

    @property
    def places(self) -> Array:
        """Where each piece begins, and the end, (x, y, φ), shape (K + 1, 3)."""
        found = [self.start[self.first : self.first + 3]]
        for piece in self.pieces:
            found.append(rolled(found[-1][None], piece[:1], piece[1:])[0])
        return np.array(found)

    def at(self, lengths: Array) -> tuple[Array, Array, Array]:
        """Return configurations at lengths (N,), and first and second derivatives of the inputs' integrals, (N, n)."""
        piece, share = self._piece(lengths)
        done = self.pieces[piece] * share[:, None]
        q, along = np.tile(self.start, (len(lengths), 1)), np.zeros((len(lengths), len(self.start)))
        q[:, self.first : self.first + 3] = rolled(self.places[piece], done[:, 0], done[:, 1])
        sizes = np.hypot(*self.pieces.T)
        along[:, [self.first, self.first + 2]] = (self.pieces / sizes[:, None])[piece]
        return q, along, np.zeros_like(along)

    def driven(self, lengths: Array) -> Array:
        """Return the integrals of the inputs up to lengths (N,), shape (N, n)."""
        return self._summed(self.pieces, lengths)

    def travelled(self, lengths: Array) -> Array:
        """Return the same with what is driven back and forth counted alike."""
        return self._summed(np.abs(self.pieces), lengths)

    def parts(self) -> list[BasePath]:
        """Return it taken apart where the base rests."""
        return [
            self._replace(
                start=self.at(self.begins[k : k + 1])[0][0] if k else self.start,
                pieces=self.pieces[k : k + 1],
            )
            for k in range(len(self.pieces))
        ]

    def _summed(self, pieces: Array, lengths: Array) -> Array:
        piece, share = self._piece(lengths)
        before = np.vstack([np.zeros(2), np.cumsum(pieces, axis=0)])
        found = np.zeros((len(lengths), len(self.start)))
        found[:, [self.first, self.first + 2]] = before[piece] + pieces[piece] * share[:, None]
        return found

    def _piece(self, lengths: Array) -> tuple[NDArray[np.intp], Array]:
        begins = self.begins
        piece = np.clip(np.searchsorted(begins, lengths, side="right") - 1, 0, len(self.pieces) - 1)
        return piece, np.clip((lengths - begins[piece]) / np.diff(begins)[piece], 0.0, 1.0)
