"""The pieces of a motion: those that are stored as a whole, and those that are put together from patchworks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import overload

import numpy as np

from stickslip.equations.path import Path
from stickslip.equations.piecewise import Regions
from stickslip.equations.system import System
from stickslip.model.arrays import Array, Indices, Mask, Modes
from stickslip.results.patchwork import Patchwork
from stickslip.results.pickled import PickledByFields
from stickslip.results.steps import Blocks, Steps


@dataclass(frozen=True, eq=False)
class Piece:
    """One motion, from one event or break of the loads to the next."""

    # start and end in s
    t: float
    stop: float
    y: Array = field(repr=False)  # (size,): state at the start
    modes: Modes  # (m,): modes as the equations know them
    labels: Modes  # (m,): modes that the rows show: -1, 0 or +1, OPEN where a gap or stop is
    since: Array = field(repr=False)  # (m,): when each row last became held, in s
    regions: Regions = field(repr=False)  # (p,): the region of each piecewise-linear function
    # (m,): impulses of the rows at the start; None if there were none
    impulses: Array | None = field(repr=False)
    lost: Array | None = field(repr=False)  # (m,): the energy in J that each row took with its impulse
    path: Path | None = field(repr=False)  # the states; None where only outputs were kept, or a patchwork has them

    @property
    def kept_path(self) -> Path:
        """The states of a run that has kept them and was followed as a whole."""
        assert self.path is not None
        return self.path

    @property
    def end(self) -> float:
        """Local time in s of the end."""
        return self.stop - self.t if self.path is None else float(self.path.taus[-1])

    @classmethod
    def of(cls, patchwork: Patchwork, k: int) -> Piece:
        """Return one piece of a patchwork, without its states in between."""
        at, t = np.array([k]), patchwork.starts[k : k + 1]
        inner, shown = patchwork.modes(at, t)
        since, regions = patchwork.since_when(at, t)[:, 0], patchwork.regions(at, t)[:, 0]
        y = patchwork.states(at, t)[:, 0]
        stop = float(patchwork.stops[k])
        return cls(float(t[0]), stop, y, inner[:, 0], shown[:, 0], since, regions, None, None, None)


class WholePieces:
    """Pieces that are stored as a whole, side by side. They are read like a patchwork, but at local times."""

    def __init__(self, system: System, pieces: Sequence[Piece]) -> None:
        self._system, self.pieces = system, pieces

    @cached_property
    def starts(self) -> Array:
        """Start of each piece in s."""
        return np.array([piece.t for piece in self.pieces])

    @cached_property
    def stops(self) -> Array:
        """End of each piece in s."""
        return np.array([piece.stop for piece in self.pieces])

    @cached_property
    def durations(self) -> Array:
        """Local time in s of the end of each piece."""
        return np.array([piece.end for piece in self.pieces])

    @cached_property
    def is_dense(self) -> bool:
        """Whether the paths of all were kept."""
        return all(piece.path is not None for piece in self.pieces)

    @cached_property
    def steps(self) -> Blocks:
        """The steps of the paths, as far as these were kept."""
        return Blocks([piece.path for piece in self.pieces if piece.path is not None])

    @cached_property
    def _modes(self) -> Modes:
        """Modes as the equations know them, and those shown, a column each."""
        both = [[piece.modes for piece in self.pieces], [piece.labels for piece in self.pieces]]
        return np.array(both, dtype=np.int8).reshape(2, len(self.pieces), self._system.m).transpose(0, 2, 1)

    @cached_property
    def _since(self) -> Array:
        """Since when rows rest, in s, a column each."""
        return np.array([piece.since for piece in self.pieces]).reshape(len(self.pieces), self._system.m).T

    @cached_property
    def _regions(self) -> Regions:
        """The regions of the piecewise-linear functions, a column each."""
        regions = np.array([piece.regions for piece in self.pieces], dtype=np.int16)
        return regions.reshape(len(self.pieces), self._system.piecewise.count).T

    @cached_property
    def held_sets(self) -> tuple[list[Mask], Indices]:
        """All sets of held rows, the empty one first, and the number of the set of each piece."""
        held = (self._modes[0].T == 0) & self._system.hard
        number = {bytes(self._system.m): 0}
        sets = [number.setdefault(row.tobytes(), len(number)) for row in held]
        return [np.frombuffer(key, dtype=bool) for key in number], np.array(sets)

    @staticmethod
    def times(piece: Indices, taus: Array) -> Array:
        """Return the times at which whole pieces are read: the local times themselves."""
        return taus

    def modes(self, piece: Indices, taus: Array, rows: slice = slice(None)) -> Modes:
        """Return the modes of rows as the equations know them, and modes that they show: (2, m, k)."""
        return self._modes[:, rows].take(piece, axis=2)

    def since_when(self, piece: Indices, taus: Array, rows: slice = slice(None)) -> Array:
        """Return since when rows rest, in s."""
        return self._since[rows].take(piece, axis=1)

    def regions(self, piece: Indices, taus: Array, rows: slice = slice(None)) -> Regions:
        """Return the regions of the piecewise-linear functions of some rows, a line each."""
        return self._regions[self._system.piecewise.among(rows)].take(piece, axis=1)

    def forces(self, piece: Indices, taus: Array, rows: slice = slice(None)) -> Array:
        """Return zeros: whole pieces do not store the forces of held rows."""
        return np.zeros((len(range(self._system.m)[rows]), taus.size))

    def states(self, piece: Indices, taus: Array) -> Array:
        """Return the states at local times of pieces, a column each."""
        return self._along(piece, taus, self._system.size, lambda steps, own, taus: steps.values(own, taus))

    def distances(self, piece: Indices, taus: Array) -> Array:
        """Return how far the bodies have come since the starts of pieces, a column each."""
        n = self._system.n
        return self._along(piece, taus, n, lambda steps, own, taus: steps.integrals(own, taus, n))

    def _along(self, piece: Indices, taus: Array, lines: int, read: Callable[[Steps, Indices, Array], Array]) -> Array:
        found = np.empty((lines, taus.size))
        for some, own, steps in self.steps.of(piece):
            found[:, some] = read(steps, own, taus[some]).T
        return found


@dataclass(frozen=True)
class Pieces(PickledByFields, Sequence[Piece]):
    """Pieces in order, some of them put together from parts when they are asked for."""

    parts: tuple[Piece | Patchwork, ...] = field(repr=False)

    @cached_property
    def firsts(self) -> Indices:
        """The number of the first piece of each part, then the number of all pieces."""
        sizes = [part.starts.size if isinstance(part, Patchwork) else 1 for part in self.parts]
        return np.cumsum([0, *sizes])

    def __len__(self) -> int:
        return int(self.firsts[-1])

    @overload
    def __getitem__(self, number: int) -> Piece: ...

    @overload
    def __getitem__(self, number: slice) -> Sequence[Piece]: ...

    def __getitem__(self, number: int | slice) -> Piece | Sequence[Piece]:
        if isinstance(number, slice):
            return [self[k] for k in range(len(self))[number]]
        part, k = self.part(range(len(self))[number])
        return part if isinstance(part, Piece) else Piece.of(part, k)

    def part(self, number: int) -> tuple[Piece | Patchwork, int]:
        """Return the part that holds a piece, and the number of the piece there."""
        place = int(self.firsts.searchsorted(number, side="right")) - 1
        return self.parts[place], number - int(self.firsts[place])
