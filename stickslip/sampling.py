"""A result read at other times: the same pieces of motion, sampled as a drawing or an integral needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stickslip.pieces import interpolate
from stickslip.result import Result

__all__ = ["is_dense", "refined", "sampled"]

Array = NDArray[np.float64]


def is_dense(result: Result) -> bool:
    """Return whether the result keeps what interpolation needs."""
    return bool(result._pieces) and all(piece.complete for piece in result._pieces)


def sampled(result: Result, numbers: Sequence[int], taus: Sequence[Array]) -> Result:
    """Return the result at local times of some of its pieces, everything else as it is.

    Parameters
    ----------
    result : Result
        One that keeps what interpolation needs.
    numbers : sequence of int
        Which pieces.
    taus : sequence of array
        For each of them the times in s since its start.

    Returns
    -------
    Result
        Its `t` and `y` hold these times, piece after piece, and all that is read by name follows them.
    """
    times, states = [np.empty(0)], [np.empty((0, result._system.size))]
    for number, local in zip(numbers, taus, strict=True):
        piece = result._pieces[number]
        times.append(np.minimum(piece.start + local, piece.stop))
        states.append(interpolate(piece.segment(), piece, local))
    piece_of = np.repeat(np.asarray(numbers, dtype=np.intp), [local.size for local in taus])
    return replace(result, t=np.concatenate(times), y=np.concatenate(states).T, _piece_of=piece_of)


def refined(result: Result, points: int = 1500) -> Result:
    """Return the result at so many times that straight lines between them look like the motion.

    Both limits stand at every event. A result without what interpolation needs is returned as it is.

    Parameters
    ----------
    result : Result
    points : int
        About how many times to add to the computed ones.
    """
    if not is_dense(result):
        return result
    pieces = result._pieces
    span = pieces[-1].stop - pieces[0].start
    least = 16 if 16 * len(pieces) <= points else 1
    taus = []
    for piece in pieces:
        count = max(least, round(points * (piece.stop - piece.start) / span))
        taus.append(np.union1d(piece.taus, np.linspace(0.0, piece.taus[-1], count + 1)))
    return sampled(result, range(len(pieces)), taus)
