"""At which times results are drawn: fit for a plot, or evenly spaced ones for the columns of a raster."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stickslip.simulation.result import Result

__all__ = ["FINE", "computed_points", "even_points"]

FINE = 1500
"""About how many evenly spaced points curves have besides those fit for a plot."""

_COLUMNS = 800


def computed_points(result: Result) -> Result:
    """Return the result at times between which straight lines look like the motion."""
    return result.fit_for_plot() if result.trajectory.is_dense else result


def even_points(result: Result) -> Result:
    """Return the result at evenly spaced times, enough for the columns of a picture."""
    return result.sample(_COLUMNS) if result.trajectory.is_dense else result
