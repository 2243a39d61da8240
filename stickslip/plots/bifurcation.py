"""Drawings of branches of limit cycles."""

from __future__ import annotations

from typing import Any

import numpy as np

from stickslip.plots.style import COLOURS, LINES, STUDY, check_is, own_axes, within_or_beside
from stickslip.results.units import units

__all__ = ["bifurcation"]


def bifurcation(branch: Any, body: str | None = None, *, ax: Any = None) -> Any:
    """Draw the bifurcation diagram of a branch of cycles, and return the axes.

    Stable cycles are filled dots on a full line, unstable ones empty dots on a dashed line; vertical lines mark where
    the kind of the cycles changes. What comes beyond a fold is drawn, too.

    Parameters
    ----------
    branch : Branch
    body : str, optional
        Whose amplitude is drawn; by default the period is.
    ax : matplotlib axes, optional
        Where to draw; by default a new figure.

    Raises
    ------
    ValueError, TypeError
        If there is no such body, or `branch` is something else.
    """
    check_is(branch, "Branch", "bifurcation")
    parts = _parts(branch, body)
    ax = own_axes(ax, *STUDY)
    for wanted, line, fill, label in ((True, "-", COLOURS[1], "stable"), (False, "--", "white", "unstable")):
        chosen = [(x, np.where(stable == wanted, y, np.nan)) for x, y, stable in parts]
        chosen = [one for one in chosen if np.isfinite(one[1]).any()]
        for i, (x, shown) in enumerate(chosen):
            look = {"color": COLOURS[1], "markerfacecolor": fill, "markersize": 4}
            ax.plot(x, shown, line, marker="o", label=None if i else label, **look)
    points = [point for one in _chain(branch) for point in one.points]
    for k, kind in enumerate(dict.fromkeys(point.kind for point in points)):
        values = dict.fromkeys(point.value for point in points if point.kind == kind)
        for i, value in enumerate(values):
            look = {"color": "0.35", "linestyle": LINES[1 + k % 3], "linewidth": 1.0}
            ax.axvline(value, label=None if i else kind, **look)
    parameter = f"{branch.parameter} [{branch.unit}]" if branch.unit else branch.parameter
    ax.set(
        xlabel=parameter,
        ylabel="period [s]" if body is None else f"amplitude of {body} [{_unit(branch, body)}]",
    )
    within_or_beside(ax)
    return ax


def _unit(branch: Any, body: str) -> str:
    """Return the unit of a body's position."""
    scene = next(cycle.scene for one in _chain(branch) for cycle in one.cycles if cycle is not None)
    return units(scene, next(one for one in (*scene.bodies, *scene.drives) if one.name == body)).position


def _chain(branch: Any) -> list[Any]:
    """Return a branch and what comes beyond its folds."""
    found, one = [], branch
    while one is not None:
        found.append(one)
        one = one.beyond
    return found


def _parts(branch: Any, body: str | None) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return values, heights and whether cycles are stable from fold to fold; two parts meet at each fold."""
    found, first = [], None
    for one in _chain(branch):
        y = one.periods if body is None else one.amplitudes(body)
        known = np.isfinite(y)
        x, y, stable = np.asarray(one.values)[known], y[known], np.asarray(one.stable)[known]
        fold = next((point for point in one.points if point.cycle is not None), None)
        last = None
        if fold is not None:
            last = fold.value, fold.cycle.period if body is None else fold.cycle.amplitude(body)
        for place, end in ((0, first), (x.size + (first is not None), last)):
            if end is not None and stable.size:
                x, y = np.insert(x, place, end[0]), np.insert(y, place, end[1])
                stable = np.insert(stable, place, stable[0 if place == 0 else -1])
        found.append((x, y, stable))
        first = last
    return found
