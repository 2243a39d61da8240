"""At which times results are drawn: the computed ones, or evenly spaced ones for the columns of a raster."""

from __future__ import annotations

import numpy as np

from stickslip.result import Result
from stickslip.sampling import is_dense, sampled

__all__ = ["computed_points", "even_points"]

_COLUMNS = 800


def computed_points(result: Result) -> Result:
    """Return the result at the times the solver computed."""
    if not is_dense(result):
        return result
    return sampled(result, range(len(result._pieces)), [piece.taus for piece in result._pieces])


def even_points(result: Result) -> Result:
    """Return the result at evenly spaced times, enough for the columns of a picture."""
    if not is_dense(result):
        return result
    starts = np.array([piece.start for piece in result._pieces])
    times = np.linspace(starts[0], result._pieces[-1].stop, _COLUMNS)
    place = np.searchsorted(starts, times, side="right") - 1
    numbers = np.unique(place).tolist()
    return sampled(result, numbers, [times[place == k] - starts[k] for k in numbers])
