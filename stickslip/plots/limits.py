"""Drawings of gaps and stops: their stretch over time, and the limits beyond which they push."""

from __future__ import annotations

from typing import Any

import numpy as np

from stickslip.plots.style import FINE, look, of_result, over_time, own_axes
from stickslip.results.readable import Readable
from stickslip.results.units import units


def limited(result: Readable) -> dict[str, Any]:
    """Return gaps and stops by name."""
    return {element.name: element for element in (*result.scene.gaps, *result.scene.stops)}


@of_result
def stretch(result: Readable, row: str, *, ax: Any = None) -> Any:
    """Draw the stretch of a gap or a stop over time between its limits, impacts marked, and return the axes.

    Parameters
    ----------
    result : Result
    row : str
        Name of the gap or stop.
    ax : matplotlib axes, optional
        Where to draw; by default a new figure.

    Raises
    ------
    ValueError
        If there is no such gap or stop.
    """
    elements = limited(result)
    if not isinstance(row, str) or row not in elements:
        known = ", ".join(map(repr, elements)) or "none"
        raise ValueError(f"stretch: no gap or stop is called {row!r}; known are {known}")
    element = elements[row]
    ax = own_axes(ax)
    fine = result.fit_for_plot(FINE)
    values = fine.stretch(row)
    ax.plot(fine.t, values, label="stretch", zorder=2, **look(0))
    struck = [event.t for event in result.events if event.contact == row and event.cause == "impact"]
    if struck:
        where = np.interp(struck, fine.t, values)
        ax.plot(struck, where, "x", color="black", markersize=4.5, label="impact", zorder=3)
    ends = [limit for limit in (element.lower, element.upper) if np.isfinite(limit)]
    low, high = np.nanmin([*ends, *values]), np.nanmax([*ends, *values])
    room = 0.08 * (high - low or 1.0)
    low, high = low - room, high + room
    for limit, end in ((element.lower, low), (element.upper, high)):
        if np.isfinite(limit):
            ax.axhspan(min(limit, end), max(limit, end), color="0.88", linewidth=0, zorder=0)
            ax.axhline(limit, color="0.45", linestyle="--", linewidth=1.0, zorder=1)
    ax.plot([], [], color="0.45", linestyle="--", linewidth=1.0, label="limit")
    ax.set_ylim(low, high)
    return over_time(ax, f"stretch [{units(result.scene, element).position}]", f"{element.noun()} {row}")
