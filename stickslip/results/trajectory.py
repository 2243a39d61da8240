"""The motion between events, piece by piece: small data from which every quantity can be computed at any time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.equations.loads import Loads
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.equations.system import System

__all__ = ["Piece", "Trajectory", "by_piece"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Modes = NDArray[np.int8]


@dataclass(frozen=True)
class Piece:
    """One motion, from one event or break of the loads to the next.

    Attributes
    ----------
    t, stop : float
        Start and end in s.
    y : array (size,)
        State at the start.
    modes : array (m,) of int8
        Modes as the equations know them.
    labels : array (m,) of int8
        Modes that the rows show: -1, 0 or +1.
    since : array (m,)
        When each row last became held, in s.
    path : Path or None
        The states; None where only the requested outputs were kept.
    """

    t: float
    stop: float
    y: Array = field(repr=False)
    modes: Modes
    labels: Modes
    since: Array = field(repr=False)
    path: Path | None = field(repr=False)

    @property
    def end(self) -> float:
        """Local time in s of the end."""
        return self.stop - self.t if self.path is None else float(self.path.taus[-1])


@dataclass(frozen=True)
class Trajectory:
    """All pieces of a simulated motion, in order of time.

    Attributes
    ----------
    system : System
    span : (float, float, bool)
        Start and end in s of the loads, and whether a fixed-step method read them.
    pieces : sequence of Piece
    """

    system: System = field(repr=False)
    span: tuple[float, float, bool]
    pieces: Sequence[Piece] = field(repr=False)

    @cached_property
    def loads(self) -> Loads:
        """The inputs over the time span."""
        return self.system.loads(*self.span)

    @cached_property
    def starts(self) -> Array:
        """Start of each piece in s."""
        return np.array([piece.t for piece in self.pieces])

    @cached_property
    def stops(self) -> Array:
        """End of each piece in s."""
        return np.array([piece.stop for piece in self.pieces])

    @cached_property
    def is_dense(self) -> bool:
        """Whether the states are known at all times."""
        return bool(self.pieces) and all(piece.path is not None for piece in self.pieces)

    def motion(self, number: int) -> Motion:
        """Return the motion of a piece, built again."""
        piece = self.pieces[number]
        equations = self.system.equations(piece.modes.tobytes())
        return Motion(equations, self.loads.after(piece.t), piece.t, piece.y, piece.since)

    def places(self, times: Array) -> Indices:
        """Return the piece that holds each time, the later one at an event.

        Raises
        ------
        ValueError
            If a time lies outside, or only the requested outputs were kept.
        """
        if not self.is_dense:
            raise ValueError("the points between the outputs were not kept; simulate with dense_output=True")
        start, stop = self.pieces[0].t, self.pieces[-1].stop
        if times.size and not (times.min() >= start and times.max() <= stop):
            raise ValueError(
                f"times must lie in [{start:g}, {stop:g}] s, got {times.min():g} to {times.max():g}"
            )
        return np.searchsorted(self.starts, times, side="right") - 1

    def local(self, piece_of: Indices, times: Array) -> Array:
        """Return times in s since the starts of their pieces, none before and none past the end."""
        return np.clip(times - self.starts[piece_of], 0.0, self._ends[piece_of])

    def order(self, number: int) -> int:
        """Return the degree of the polynomials of a piece."""
        path = self.pieces[number].path
        return 0 if path is None or not path.taus[1:].size else path.coefficients.shape[1] - 1

    @cached_property
    def _ends(self) -> Array:
        return np.array([piece.end for piece in self.pieces])

    def states(self, piece_of: Indices, taus: Array) -> Array:
        """Return the states at local times of pieces, one column each.

        Velocities of held bodies are written through the ties that hold them: equal velocities are equal to the bit.

        Parameters
        ----------
        piece_of : array (k,) of int
            The piece of each time.
        taus : array (k,)
            Times in s since its start.
        """
        found = np.empty((self.system.size, taus.size))
        for number, chosen in by_piece(piece_of):
            path = self.pieces[number].path
            assert path is not None
            local = taus[chosen]
            columns = path.at(local).T
            if self._is_led(number):
                columns = self.motion(number).exact(local, columns)
            found[:, chosen] = columns
        return found

    def _is_led(self, number: int) -> bool:
        """Tell whether velocities depend on others in a piece."""
        return bool(self.system.equations(self.pieces[number].modes.tobytes()).dependent.size)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what follows from the rest."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)


def by_piece(piece_of: Indices) -> Iterator[tuple[int, Indices | slice]]:
    """Yield each piece that holds times, and which times it holds."""
    if not piece_of.size:
        return
    if (piece_of[1:] >= piece_of[:-1]).all():
        ends = [0, *((piece_of[1:] != piece_of[:-1]).nonzero()[0] + 1).tolist(), piece_of.size]
        for first, last in pairwise(ends):
            yield int(piece_of[first]), slice(first, last)
        return
    order = np.argsort(piece_of, kind="stable")
    numbers, firsts = np.unique(piece_of[order], return_index=True)
    yield from zip(numbers.tolist(), np.split(order, firsts[1:]), strict=True)
