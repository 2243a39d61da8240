"""What all drawings share: units, line styles that differ in greyscale, legends beside the data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stickslip.results.outcome import Drawable

__all__ = [
    "DISPLACEMENT",
    "FORCE",
    "NORMAL",
    "TIME",
    "VELOCITY",
    "WITH_DOTS",
    "beside",
    "color_bar",
    "contact_names",
    "dots",
    "edges",
    "look",
    "mark_events",
    "own_axes",
    "raster",
]

TIME = "time [s]"
VELOCITY = "velocity [m/s | rad/s]"
DISPLACEMENT = "relative displacement [m | rad]"
FORCE = "force [N | N m]"
NORMAL = "normal force [N]"

WITH_DOTS = 300
"""More computed points than this are not marked on the curves."""

_COLOURS = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#7F6000")
_LINES = ("-", "--", "-.", ":", (0, (6, 1, 1, 1, 1, 1)))
_MARKERS = "osD^vPX*<>hp"
_MARKED_EVENTS = 40


def own_axes(ax: Any, width: float = 7.5, height: float = 3.2) -> Any:
    """Return the axes given, or those of a new figure that no window and no list of figures knows."""
    return Figure(figsize=(width, height), layout="constrained").subplots() if ax is None else ax


def look(k: int) -> dict[str, Any]:
    """Return colour and line style of the k-th curve; broken lines are thinner than whole ones."""
    width = 1.9 if k % len(_LINES) == 0 else 1.4
    return {"color": _COLOURS[k % len(_COLOURS)], "linestyle": _LINES[k % len(_LINES)], "linewidth": width}


def dots(k: int) -> dict[str, Any]:
    """Return how the k-th curve's computed points are marked."""
    marker = _MARKERS[k % len(_MARKERS)]
    return {"color": _COLOURS[k % len(_COLOURS)], "linestyle": "none", "marker": marker, "markersize": 3.5}


def beside(ax: Any, **options: Any) -> None:
    """Put the legend to the right of the axes."""
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.02), frameon=False, fontsize="small", **options)


def mark_events(ax: Any, result: Drawable) -> None:
    """Draw a fine line at each event, unless there are too many to tell apart."""
    times = sorted({event.t for event in result.events})
    if len(times) <= _MARKED_EVENTS:
        for t in times:
            ax.axvline(t, color="0.7", linewidth=0.6, zorder=0)


def contact_names(result: Drawable, contacts: Sequence[str] | None) -> list[str]:
    """Return the rows to draw: those asked for, else all contacts, ties and clutches of the scene."""
    return [row.name for row in result.scene.rows] if contacts is None else list(contacts)


def edges(centres: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the edges of cells around rising centres."""
    if centres.size < 2:
        return np.array([centres[0] - 0.5, centres[0] + 0.5])
    middles = 0.5 * (centres[1:] + centres[:-1])
    return np.concatenate([centres[:1], middles, centres[-1:]])


def raster(ax: Any, t: NDArray[np.float64], rows: NDArray[Any], names: list[str], **options: Any) -> Any:
    """Draw a row of colours per name over time, the first on top, and return the mesh."""
    places = np.arange(len(names) + 1) - 0.5
    keep = np.concatenate([[True], np.diff(t) > 0])
    mesh = ax.pcolormesh(edges(t[keep]), places, rows[:, keep], rasterized=True, **options)
    ax.invert_yaxis()
    every = -(-len(names) // 20)
    ax.set_yticks(range(0, len(names), every), names[::every], fontsize="small")
    return mesh


def color_bar(ax: Any, mesh: Any, label: str, **options: Any) -> Any:
    """Draw the colour bar of a raster right beside its axes, whatever the panels above and below need; return it."""
    return ax.figure.colorbar(mesh, cax=ax.inset_axes((1.015, 0.0, 0.02, 1.0)), label=label, **options)
