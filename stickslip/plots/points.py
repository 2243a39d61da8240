"""At which times results are drawn: fit for a plot, or evenly spaced ones for the columns of a raster."""

from __future__ import annotations

from typing import TypeVar

from stickslip.results.outcome import Drawable

__all__ = ["FINE", "computed_points", "even_points"]

SomeResult = TypeVar("SomeResult", bound=Drawable)

FINE = 1500
"""About how many evenly spaced points curves have besides those fit for a plot."""

_COLUMNS = 800


def computed_points(result: SomeResult) -> SomeResult:
    """Return the result at times between which straight lines look like the motion."""
    return result.fit_for_plot() if result.is_dense else result


def even_points(result: SomeResult) -> SomeResult:
    """Return the result at evenly spaced times, enough for the columns of a picture."""
    return result.sample(_COLUMNS) if result.is_dense else result
