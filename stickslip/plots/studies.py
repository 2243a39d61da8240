"""Drawings of studies: error against time, and a value over two parameters of a sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol, runtime_checkable

import numpy as np
from matplotlib.ticker import LogFormatterSciNotation, LogLocator

from stickslip.plots.style import COLOURS, makes_room, new_figure, own_axes, robust

__all__ = ["bifurcation", "fit", "sweep_map", "tradeoff", "work_precision"]

_MARKERS = "osD^vP*X<>ph"
_LINES = ("-", "--", "-.", ":")
_INSIDE = 8  # legend entries that find room within the axes
_NOTES = 6
_SIZE = (9.0, 5.0)  # inches
_APART = 0.4
"""Decades between families below what the reference can tell."""


class Measured(Protocol):
    """What is drawn of a measured setup: a `WorkRow`."""

    name: str
    family: str | None
    median: float
    error: float
    failure: str | None


@runtime_checkable
class Table(Protocol):
    """What is drawn of a work-precision study: a `WorkPrecision`."""

    @property
    def rows(self) -> Sequence[Any]:
        """What was measured."""
        ...

    @property
    def error_label(self) -> str:
        """Text of the error's axis."""
        ...

    def pareto(self) -> Sequence[Any]:
        """Return the rows that no other beats."""
        ...


class Study(Protocol):
    """What is drawn of a scene's trade-off: a `Tradeoff`."""

    @property
    def work(self) -> Any:
        """The table."""
        ...

    @property
    def limit(self) -> float:
        """What the reference can tell."""
        ...


@runtime_checkable
class Swept(Protocol):
    """What is drawn of a sweep: a `SweepResult`."""

    @property
    def parameters(self) -> Mapping[str, Any]:
        """The values of each parameter."""
        ...

    @property
    def values(self) -> Mapping[str, Any]:
        """The results by name."""
        ...

    def value(self, name: str | None = None) -> Any:
        """Return one result as an array."""
        ...


def work_precision(table: Table, *, ax: Any = None) -> Any:
    """Draw error against median wall time, both logarithmic, and return the axes.

    Every family has a marker and a line of its own, so that greyscale is enough. The line joins those of its
    rows that no other row of the family beats: to join all would draw the noise of the clock. Rings mark the
    rows that nothing beats; what cannot be drawn (failures, an error of exactly 0) is listed in a note.

    Parameters
    ----------
    table : WorkPrecision
        What `work_precision` measured.
    ax : matplotlib axes, optional
        Where to draw; by default a new figure.

    Raises
    ------
    TypeError
        If `table` is something else.
    """
    if not isinstance(table, Table):
        raise TypeError(f"work_precision plot: expected a WorkPrecision, got {type(table).__name__}")
    return _errors_against_times(table, own_axes(ax, *_SIZE), {})


def _errors_against_times(table: Table, ax: Any, at_floor: dict[int, float]) -> Any:
    """Draw the rows of a study; those at its floor at heights of their own, by id."""
    families: dict[str, list[Measured]] = {}
    for row in table.rows:
        if _drawable(row):
            families.setdefault(row.family or row.name, []).append(row)
    for k, (family, rows) in enumerate(families.items()):
        _family(ax, k, family, rows, table, at_floor)
    front = [row for row in table.pareto() if _drawable(row)]
    if front:
        where = [row.median for row in front], [at_floor.get(id(row), row.error) for row in front]
        ax.scatter(*where, s=150, facecolors="none", edgecolors="black", zorder=3, label="no other beats it")
        _legend(ax)
    ax.set(xscale="log", yscale="log", xlabel="median wall time [s]", ylabel=table.error_label)
    # 2 and 5 between the decades have room, also where the times span less than one
    ax.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    ax.xaxis.set_minor_formatter(LogFormatterSciNotation(minor_thresholds=(2, 0.5)))
    ax.grid(True, which="major", linewidth=0.4, alpha=0.6)
    notes = [f"{row.name}: {_reason(row)}" for row in table.rows if not _drawable(row)]
    if notes:
        more = [f"and {len(notes) - _NOTES} more"] if len(notes) > _NOTES else []
        note = "not drawn:\n" + "\n".join([*notes[:_NOTES], *more])
        if makes_room(ax):
            below = {"xycoords": "axes fraction", "xytext": (0, -40), "textcoords": "offset points"}
            ax.annotate(note, (0, 0), va="top", fontsize="small", annotation_clip=False, **below)
        else:
            ax.text(0.02, 0.02, note, transform=ax.transAxes, fontsize="x-small", wrap=True)
    return ax


def _family(
    ax: Any, k: int, family: str, rows: list[Measured], table: Any, at_floor: dict[int, float]
) -> None:
    """Draw all rows of a family as markers, and a line through those that no other of them beats."""
    colour = COLOURS[k % len(COLOURS)]
    marker: dict[str, Any] = {"marker": _MARKERS[k % len(_MARKERS)], "color": colour}
    line: dict[str, Any] = {"linestyle": _LINES[k % len(_LINES)], "color": colour, "linewidth": 1.2}
    best = replace(table, rows=tuple(rows)).pareto()
    for some, style in ((rows, marker | {"linestyle": "none"}), (best, line)):
        heights = [at_floor.get(id(row), row.error) for row in some]
        ax.plot([row.median for row in some], heights, **style)
    ax.plot([], [], label=family, **marker | line)


def tradeoff(study: Study, *, ax: Any = None) -> Any:
    """Draw error against time of a scene's calls, down to what the reference can tell, and return the axes.

    Calls whose errors are below that stand in the grey band, each family at a height of its own that says nothing.

    Parameters
    ----------
    study : Tradeoff
        What `tradeoff` measured.
    ax : matplotlib axes, optional
        Where to draw; by default a new figure.
    """
    floor = [row for row in study.work.rows if _drawable(row) and row.error <= study.limit]
    families = list(dict.fromkeys(row.family or row.name for row in floor))
    lower = {family: study.limit * 10 ** (-_APART * (k + 1)) for k, family in enumerate(families)}
    heights = {id(row): lower[row.family or row.name] for row in floor}
    ax = _errors_against_times(study.work, own_axes(ax, *_SIZE), heights)
    ax.axhspan(0, study.limit, color="0.85", zorder=0, label="below what the reference can tell")
    ax.set_ylim(bottom=study.limit * 10 ** (-_APART * (len(families) + 1)))
    _legend(ax)
    return ax


def sweep_map(
    result: Swept,
    x: str,
    y: str,
    value: str | None = None,
    *,
    labels: Mapping[str, str] | None = None,
    ax: Any = None,
) -> Any:
    """Draw a value of a sweep over two of its parameters and return the axes.

    Points without a value are crossed out. Evenly spaced logarithms give a logarithmic axis; texts and
    other values that are not rising numbers are set side by side.

    Parameters
    ----------
    result : SweepResult
        Other parameters than `x` and `y` must have a single value.
    x, y : str
        Names of parameters.
    value : str, optional
        Name of a value with one number per point; not needed where there is only one.
    labels : mapping, optional
        Name -> text with the unit, such as ``{"speed": "speed / (m/s)"}``.
    ax : matplotlib axes, optional
        Where to draw; by default a new figure.

    Raises
    ------
    TypeError, ValueError
        If the names or the shape of the grid do not fit.
    """
    if not isinstance(result, Swept):
        raise TypeError(f"sweep_map: expected a SweepResult, got {type(result).__name__}")
    names = list(result.parameters)
    for name in (x, y):
        if name not in names:
            raise ValueError(f"sweep_map: no parameter {name!r}; choose from {', '.join(names)}")
    if x == y:
        raise ValueError(f"sweep_map: x and y are both {x!r}; choose two parameters")
    field = result.value(value)
    if field.ndim != len(names):
        raise ValueError(
            f"sweep_map: value {value!r} has shape {field.shape[len(names) :]} per point, not one number"
        )
    others = [name for name in names if name not in (x, y) and len(result.parameters[name]) > 1]
    if others:
        raise ValueError(
            f"sweep_map: {', '.join(others)} varies too; sweep it with a single value, or draw a slice"
        )
    field = np.moveaxis(field, (names.index(y), names.index(x)), (0, 1))
    field = field.reshape(field.shape[:2])

    ax = own_axes(ax, *_SIZE)
    labels = labels or {}
    (x_edges, x_centres), (y_edges, y_centres) = (
        _cells(ax, which, result.parameters[name]) for which, name in (("x", x), ("y", y))
    )
    limits, ends = robust(field)
    mesh = ax.pcolormesh(x_edges, y_edges, np.ma.masked_invalid(field), cmap="cividis", **limits)
    rows, columns = np.nonzero(~np.isfinite(field))
    if rows.size:
        ax.plot(x_centres[columns], y_centres[rows], "kx", label="no value")
        ax.legend(fontsize="small")
    shown = next(iter(result.values)) if value is None else value
    ax.set(xlabel=labels.get(x, x), ylabel=labels.get(y, y))
    ax.figure.colorbar(mesh, ax=ax, label=labels.get(shown, shown), extend=ends)
    return ax


class Followed(Protocol):
    """What is drawn of a branch of cycles: a `Branch`."""

    @property
    def parameter(self) -> str:
        """The name of the parameter."""
        ...

    @property
    def values(self) -> Any:
        """Its values."""
        ...

    @property
    def periods(self) -> np.ndarray:
        """Periods in s."""
        ...

    @property
    def stable(self) -> np.ndarray:
        """Whether each cycle is stable."""
        ...

    @property
    def points(self) -> Sequence[Any]:
        """Where the kind of the cycles changes."""
        ...

    @property
    def beyond(self) -> Any:
        """The branch beyond a fold, or None."""
        ...

    def amplitudes(self, body: str) -> np.ndarray:
        """Return half of the ranges of a body's position."""
        ...


_SIGNS = {"fold": "D", "crossing": "s", "flip": "^", "torus": "v", "sequence": "P", "end": "X"}
"""What marks each kind of point on a branch."""


def bifurcation(branch: Followed, body: str | None = None, *, ax: Any = None) -> Any:
    """Draw the bifurcation diagram of a branch of cycles, and return the axes.

    Stable cycles are filled dots on a full line, unstable ones empty dots on a dashed line. Dark signs with names mark
    where the kind of the cycles changes. What comes beyond a fold is drawn, too.

    Parameters
    ----------
    branch : Branch
    body : str, optional
        Whose amplitude is drawn; by default the period is.
    ax : matplotlib axes, optional
        Where to draw; by default a new figure.

    Raises
    ------
    ValueError
        If there is no such body.
    """
    ax = own_axes(ax, *_SIZE)
    parts = _parts(branch, body)
    for wanted, line, fill, label in ((True, "-", "C0", "stable"), (False, "--", "white", "unstable")):
        chosen = [(x, np.where(stable == wanted, y, np.nan)) for x, y, stable in parts]
        chosen = [one for one in chosen if np.isfinite(one[1]).any()]
        for i, (x, shown) in enumerate(chosen):
            look = {"color": "C0", "markerfacecolor": fill, "markersize": 4}
            ax.plot(x, shown, line, marker="o", label=None if i else label, **look)
    for one, (x, y, _) in zip(_chain(branch), parts, strict=True):
        order = np.argsort(x)
        for point in one.points:
            height = np.interp(point.value, x[order], y[order]) if x.size else np.nan
            ax.plot([point.value], [height], marker=_SIGNS[point.kind], color="0.15", zorder=3)
            ax.annotate(
                f"{point.kind} at {point.value:.6g}",
                (point.value, height),
                xytext=(9, 0),
                textcoords="offset points",
                fontsize="small",
                va="center",
                bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0},
            )
    ax.margins(x=0.12)
    ax.set(
        xlabel=branch.parameter, ylabel="period [s]" if body is None else f"amplitude of {body} [m or rad]"
    )
    _legend(ax)
    return ax


def _chain(branch: Followed) -> list[Followed]:
    """Return a branch and what comes beyond its folds."""
    found, one = [], branch
    while one is not None:
        found.append(one)
        one = one.beyond
    return found


def _parts(branch: Followed, body: str | None) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return values, heights and whether cycles are stable from fold to fold; two parts meet at each fold."""
    found, first = [], None
    for one in _chain(branch):
        y = one.periods if body is None else one.amplitudes(body)
        known = np.isfinite(y)
        x, y, stable = np.asarray(one.values)[known], y[known], np.asarray(one.stable)[known]
        ends = next((point for point in one.points if point.cycle is not None), None)
        last = None
        if ends is not None:
            last = ends.value, ends.cycle.period if body is None else ends.cycle.amplitude(body)
        for place, end in ((0, first), (x.size + (first is not None), last)):
            if end is not None:
                x, y = np.insert(x, place, end[0]), np.insert(y, place, end[1])
                near = stable[0 if place == 0 else -1] if stable.size else False
                stable = np.insert(stable, place, near)
        found.append((x, y, stable))
        first = last
    return found


class Fitted(Protocol):
    """What is drawn of a fit: a `Fit`."""

    @property
    def measured(self) -> Sequence[Any]:
        """What was measured: name, times and values."""
        ...

    @property
    def result(self) -> Any:
        """The motion of the fitted scene."""
        ...

    def residuals(self) -> Mapping[str, np.ndarray]:
        """Return what was measured less what the fitted scene does."""
        ...


def fit(found: Fitted, *, axes: Any = None) -> Any:
    """Draw what was measured, what the fitted scene does, and below it the residuals; return the figure.

    Parameters
    ----------
    found : Fit
    axes : sequence of matplotlib axes, optional
        Two for each quantity, from top to bottom; by default a new figure.

    Raises
    ------
    ValueError
        If the number of axes is not that of the panels.
    """
    count = 2 * len(found.measured)
    if axes is None:
        heights = [2.4, 1.2] * len(found.measured)
        figure = new_figure(9.0, 0.6 + sum(heights), layout="constrained")
        axes = figure.subplots(count, 1, sharex=True, height_ratios=heights)
    elif len(axes) != count:
        raise ValueError(f"fit: {count} panels need as many axes, got {len(axes)}")
    smooth, left = found.result.fit_for_plot(1000), found.residuals()
    for k, one in enumerate(found.measured):
        top, below = axes[2 * k], axes[2 * k + 1]
        top.plot(one.t, one.values, linestyle="none", marker=".", markersize=3, color="0.5", label="measured")
        top.plot(smooth.t, getattr(smooth, one.quantity)(one.of), color="C0", label="fitted")
        top.set_ylabel(one.name)
        below.plot(one.t, left[one.name], linestyle="none", marker=".", markersize=3, color="C0")
        below.axhline(0.0, color="0.35", linewidth=0.8)
        below.set_ylabel("residual")
        _legend(top)
    axes[-1].set_xlabel("time [s]")
    return axes[0].get_figure()


def _legend(ax: Any) -> None:
    """Name the curves: within the axes where there is room, else to their right."""
    crowded = len(ax.get_legend_handles_labels()[1]) > _INSIDE
    if not makes_room(ax):
        ax.legend(fontsize="xx-small" if crowded else "x-small", framealpha=0.8)
        return
    place = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0)} if crowded else {}
    ax.legend(fontsize="small", **place)


def _drawable(row: Measured) -> bool:
    return row.failure is None and row.error > 0


def _reason(row: Measured) -> str:
    text = f"error 0 in {row.median:.3g} s" if row.failure is None else row.failure.split("\n")[0]
    return text if len(text) <= 70 else text[:69] + "…"


def _cells(ax: Any, which: str, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return edges and centres of the cells along x or y, having set the scale and ticks of the axes."""
    if values.dtype.kind not in "iuf" or not np.all(np.isfinite(values)) or np.any(np.diff(values) <= 0):
        centres = np.arange(len(values), dtype=float)
        ax.set(**{f"{which}ticks": centres, f"{which}ticklabels": [str(item) for item in values]})
        return _edges(centres), centres
    centres = values.astype(float)
    if len(centres) > 2 and centres[0] > 0:
        steps = np.diff(np.log(centres))
        if np.allclose(steps, steps[0]):
            ax.set(**{f"{which}scale": "log"})
            return np.exp(_edges(np.log(centres))), centres
    return _edges(centres), centres


def _edges(centres: np.ndarray) -> np.ndarray:
    if len(centres) == 1:
        half = 0.5 * abs(centres[0]) or 0.5
        return np.array([centres[0] - half, centres[0] + half])
    middles = 0.5 * (centres[1:] + centres[:-1])
    return np.concatenate([[2 * centres[0] - middles[0]], middles, [2 * centres[-1] - middles[-1]]])
