"""Drawings of branches of limit cycles."""

from __future__ import annotations

from typing import Any

import numpy as np

from stickslip.plots.style import AS_IT_IS, COLOURS, STUDY, check_is, own_axes, within_or_beside
from stickslip.results.units import units_of_body

# The marker of each kind of point on a branch.
_SIGNS = {"fold": "D", "crossing": "s", "flip": "^", "torus": "v", "sequence": "P", "end": "X"}

_ENDS = ("fold", "end")  # of these a part of a branch has one at its end

# A point: its value, its height, a text, whether the curve rises there, and on which side the arms of a fold lie: 1 or
# -1, 0 where the point is no fold.
_Named = tuple[float, float, str, bool, float]

_TOGETHER = 0.02, 0.05  # points these parts of the width and of the height apart share a text
_ROOM = 0.7  # a point less than this part of the width from both ends has room for its text on either side
_NEAR = 1e-3  # part of the range of a branch over which its slope is looked at


def bifurcation(branch: Any, body: str | None = None, *, ax: Any = None) -> Any:
    """Draw the bifurcation diagram of a branch: amplitudes of a body, by default periods; return the axes.

    Stable cycles are filled dots on a full line, unstable ones empty dots on a dashed line. Dark signs with names mark
    where the kind of the cycles changes. The branch beyond a fold is drawn, too.

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
    ax.margins(x=0.12)
    for wanted, line, fill, label in ((True, "-", COLOURS[1], "stable"), (False, "--", "white", "unstable")):
        look = {"color": COLOURS[1], "markerfacecolor": fill, "markersize": 4, "label": label}
        for x, y, stable in parts:
            chosen = stable == wanted
            if not chosen.any():
                continue
            # a line from a stable to an unstable cycle is drawn as unstable
            ends = chosen if wanted else chosen | np.append(chosen[1:], False) | np.append(False, chosen[:-1])
            ax.plot(x, np.where(ends, y, np.nan), line, marker="o", markevery=chosen.nonzero()[0].tolist(), **look)
            look["label"] = None
    points = []
    for one, (x, y, _) in zip(_chain(branch), parts, strict=True):
        order = np.argsort(x)
        # a branch without cycles has no place to mark
        for point in one.points if x.size else ():
            about = point.value + _NEAR * np.ptp(x) * np.array([0, -1, 1])
            height, before, after = np.interp(about, x[order], y[order])
            ax.plot([point.value], [height], marker=_SIGNS[point.kind], color="0.15", zorder=3)
            # a branch turns back at a fold: the text has room between its arms
            side = np.sign(np.mean(x) - point.value) if point.kind == "fold" else 0.0
            points.append((point.value, height, f"{point.kind} at {point.value:.6g}", after > before, side))
    _write_beside(ax, points)
    parameter = f"{branch.parameter} [{branch.unit}]" if branch.unit else branch.parameter
    ax.set_xlabel(parameter, **AS_IT_IS)
    ax.set_ylabel("period [s]" if body is None else f"amplitude of {body} [{_unit(branch, body)}]", **AS_IT_IS)
    within_or_beside(ax)
    return ax


def _write_beside(ax: Any, points: list[_Named]) -> None:
    """Write the texts of points beside the curve, on either side of it in turn, and within the axes.

    Points next to each other share a text, except folds.
    """
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    near = _TOGETHER[0] * abs(right - left), _TOGETHER[1] * abs(top - bottom)
    texts: list[_Named] = []
    for value, height, text, rises, side in sorted(points):
        last = texts[-1] if texts else None
        if last and not (side or last[4]) and value - last[0] < near[0] and abs(height - last[1]) < near[1]:
            texts[-1] = value, height, f"{last[2]}\n{text}", rises, side
        else:
            texts.append((value, height, text, rises, side))
    for k, (value, height, text, rises, side) in enumerate(texts):
        is_right = side > 0 if side else k % 2 == 0
        if not side and not left + _ROOM * (right - left) > value > right - _ROOM * (right - left):
            is_right = value < 0.5 * (left + right)
        ax.annotate(
            text,
            (value, height),
            xytext=(7 if is_right else -7, 0 if side else -9 if is_right == rises else 9),
            textcoords="offset points",
            fontsize="small",
            ha="left" if is_right else "right",
            va="center",
        )


def _unit(branch: Any, body: str) -> str:
    """Return the unit of a body's position; for the ground, the unit of all bodies together."""
    scene = next(cycle.scene for one in _chain(branch) for cycle in one.cycles if cycle is not None)
    return units_of_body(scene, body).position


def _chain(branch: Any) -> list[Any]:
    """Return a branch and the branches beyond its folds."""
    found, one = [], branch
    while one is not None:
        found.append(one)
        one = one.beyond
    return found


def _parts(branch: Any, body: str | None) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return for each part, from fold to fold, values, heights and stability; two parts meet at each fold.

    Points with cycles stand among them.
    """
    found, first = [], None
    for one in _chain(branch):
        y = one.periods if body is None else one.amplitudes(body)
        known = np.isfinite(y)
        x, y, stable = np.asarray(one.values)[known], y[known], np.asarray(one.stable)[known]
        places = [
            (point.value, point.cycle.period if body is None else point.cycle.amplitude(body), point.kind)
            for point in one.points
            if point.cycle is not None
        ]
        last = next(((value, height) for value, height, kind in places if kind in _ENDS), None)
        for place, end in ((0, first), (x.size + (first is not None), last)):
            if end is not None:
                x, y, stable = _with(x, y, stable, place, end)
        for value, height, kind in places:
            # with one place alone there is no line on which others could stand
            if kind not in _ENDS and x.size > 1:
                way = np.sign(x[-1] - x[0])
                x, y, stable = _with(x, y, stable, int(np.searchsorted(way * x, way * value)), (value, height))
        found.append((x, y, stable))
        first = last
    return found


def _with(
    x: np.ndarray, y: np.ndarray, stable: np.ndarray, place: int, point: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return values, heights and stability with one more point, as stable as the more stable one beside it."""
    own = stable[max(place - 1, 0) : place + 1].any()
    return np.insert(x, place, point[0]), np.insert(y, place, point[1]), np.insert(stable, place, own)
