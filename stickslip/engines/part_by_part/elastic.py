"""The gaps of a scene that is followed part by part: in which region each is, and its force there."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from stickslip.equations.forest import Forest, spans
from stickslip.equations.piecewise import Regions
from stickslip.model.arrays import Array, Indices, Modes


class Elastic:
    """The regions of all gaps, and the couplings and forces that follow from the regions.

    It is made once for a scene: the next motion that is followed part by part begins with the regions of the last one
    but for few.

    Attributes
    ----------
    region : array (p,) of int
    stiffness, damping : arrays
        Couplings as in the forest, with those of gaps added.
    coupled : array (n,) of bool
        Which bodies springs, dampers, acting gaps or forces that follow the motion act on.
    constant : array (n,)
        The constant parts of the forces of gaps on the bodies.
    neighbours : list of lists of int
        The bodies that couple to each one now.
    """

    def __init__(self, forest: Forest) -> None:
        self._forest, self._functions = forest, forest.piecewise
        self.stiffness, self.damping, self.neighbours = forest.stiffness, forest.damping, forest.neighbours
        self.constant, self.count, self.coupled = np.zeros(forest.n), forest.gaps.size, forest.coupled
        self.region = np.zeros(self._functions.count, dtype=np.int16)
        # the number of the gap that a row is, -1 for others
        self.number = np.full(forest.m, -1)
        self.number[forest.gaps] = np.arange(self.count)
        if not self.count:
            return
        self.stiffness, self.damping = self.stiffness.copy(), self.damping.copy()
        self.neighbours, self.coupled = [own.copy() for own in self.neighbours], self.coupled.copy()
        # the force of each gap in its region: factors of stretch and rate, and the constant
        self._now = self.values(np.arange(self.count)).tolist()
        # the entries of each gap; the gaps that add to each entry, and to the constant force on each body
        self._entries: list[list[int]] = [[] for _ in range(self.count)]
        self._acting: dict[int, list[tuple[int, float]]] = defaultdict(list)
        for entry, gap, factor in zip(*(x.tolist() for x in forest.gap_entries), strict=True):
            self._entries[gap].append(entry)
            self._acting[entry].append((gap, factor))
        self._ends: list[list[tuple[int, float]]] = []
        self._at: dict[int, list[tuple[int, float]]] = defaultdict(list)
        for gap, j in enumerate(forest.gaps.tolist()):
            ends = [
                (int(i), float(c))
                for i, c in zip((forest.child[j], forest.parent[j]), forest.lever[j], strict=False)
                if i >= 0
            ]
            self._ends.append(ends)
            for i, c in ends:
                self._at[i].append((gap, c))
        self._act(range(self.count))

    def begin(self, regions: Regions) -> None:
        """Let all gaps go on in the regions of a motion."""
        changed = (self.region != regions).nonzero()[0]
        if changed.size:
            self.enter(changed, regions[changed])

    def enter(self, gaps: Indices, regions: Regions) -> Indices:
        """Let gaps go on in other regions, beyond a border; return the bodies at their ends."""
        self.region[gaps] = regions
        for gap, value in zip(gaps.tolist(), self.values(gaps).tolist(), strict=True):
            self._now[gap] = value
        return np.array(self._act(gaps.tolist()), dtype=np.intp)

    def _act(self, gaps: range | list[int]) -> list[int]:
        """Enter the forces of gaps in the sums that they belong to; return the bodies at the ends of the gaps."""
        forest, now = self._forest, self._now
        for entry in sorted({entry for gap in gaps for entry in self._entries[gap]}):
            acting = self._acting[entry]
            self.stiffness[entry] = forest.stiffness[entry] + sum(f * now[g][0] for g, f in acting)
            self.damping[entry] = forest.damping[entry] + sum(f * now[g][1] for g, f in acting)
        bodies = sorted({i for gap in gaps for i, _ in self._ends[gap]})
        for i in bodies:
            self.constant[i] = -sum(c * now[g][2] for g, c in self._at[i])
            taut = [g for g, _ in self._at[i] if any(now[g][:2])]
            self.neighbours[i] = forest.neighbours[i] + [k for g in taut for k, _ in self._ends[g] if k != i]
            self.coupled[i] = forest.coupled[i] or bool(taut)
        return bodies

    def labels(self, gaps: Indices) -> Modes:
        """Return the modes that some gaps show."""
        return np.asarray(self._functions.mode[self._functions.first[gaps] + self.region[gaps]])

    def values(self, gaps: Indices) -> Array:
        """Return the forces of some gaps in their regions: factors of stretch and rate, and constants, a row each."""
        return np.asarray(self._functions.value[self._functions.first[gaps] + self.region[gaps]])

    def borders(self, gaps: Indices) -> tuple[Indices, Indices]:
        """Return the borders of the regions of some gaps, and the place of the gap of each among these."""
        at, starts = self._functions.first[gaps] + self.region[gaps], self._functions.border_from
        return spans(starts, at), np.repeat(np.arange(gaps.size), starts[at + 1] - starts[at])

    def beyond(self, gaps: Indices, places: Modes) -> Regions:
        """Return the regions beyond one border of each of some gaps, by its place among those of its region."""
        at = self._functions.first[gaps] + self.region[gaps]
        return np.asarray(self._functions.beyond[self._functions.border_from[at] + places], dtype=self.region.dtype)
