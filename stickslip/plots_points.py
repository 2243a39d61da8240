"""At which times results are drawn: the computed ones, or evenly spaced ones for the columns of a raster."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stickslip.result import Result
from stickslip.sampling import sampled, view

__all__ = ["computed_points", "even_points"]

_COLUMNS = 800


def computed_points(result: Result) -> Result:
    """Return the result at the times the solver computed."""
    return view(result, "computed", 0, _computed)


def _computed(result: Result, points: int) -> Result:
    pieces = result._pieces
    t = np.concatenate([piece.times() for piece in pieces])
    if np.array_equal(t, result.t):
        return result
    y = np.concatenate([piece.states for piece in pieces]).T
    piece_of = np.repeat(np.arange(len(pieces)), [piece.taus.size for piece in pieces])
    return replace(result, t=t, y=y, _piece_of=piece_of)


def even_points(result: Result) -> Result:
    """Return the result at evenly spaced times, enough for the columns of a picture."""
    return view(result, "even", _COLUMNS, _even)


def _even(result: Result, points: int) -> Result:
    starts = np.array([piece.start for piece in result._pieces])
    times = np.linspace(starts[0], result._pieces[-1].stop, points)
    place = np.searchsorted(starts, times, side="right") - 1
    numbers, first = np.unique(place, return_index=True)
    parts = np.split(times, first[1:])
    taus = [part - starts[k] for k, part in zip(numbers.tolist(), parts, strict=True)]
    return sampled(result, numbers.tolist(), taus)
