"""Drawings of a value over two parameters of a sweep."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from stickslip.plots.style import STUDY, check_is, own_axes, robust


def sweep_map(
    result: Any,
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

    Raises
    ------
    TypeError, ValueError
        If the names or the shape of the grid do not fit.
    """
    check_is(result, "SweepResult", "sweep_map")
    names = list(result.parameters)
    for name in (x, y):
        if name not in names:
            raise ValueError(f"sweep_map: no parameter {name!r}; choose from {', '.join(names)}")
    if x == y:
        raise ValueError(f"sweep_map: x and y are both {x!r}; choose two parameters")
    if labels is not None and not isinstance(labels, Mapping):
        raise TypeError(f"sweep_map: labels must be a mapping such as {{'x': 'speed [m/s]'}}, got {labels!r}")
    field = result.value(value)
    if field.ndim != len(names):
        raise ValueError(f"sweep_map: value {value!r} has shape {field.shape[len(names) :]} per point, not one number")
    others = [name for name in names if name not in (x, y) and len(result.parameters[name]) > 1]
    if others:
        raise ValueError(f"sweep_map: {', '.join(others)} varies too; sweep it with a single value, or draw a slice")
    field = np.moveaxis(field, (names.index(y), names.index(x)), (0, 1))
    field = field.reshape(field.shape[:2])

    ax = own_axes(ax, *STUDY)
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


def _cells(ax: Any, which: str, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Set scale and ticks of the axes along x or y, and return edges and centres of the cells."""
    if values.dtype.kind not in "iuf" or not np.all(np.isfinite(values)) or np.any(np.diff(values) <= 0):
        centres = np.arange(len(values), dtype=float)
        ax.set(**{f"{which}ticks": centres, f"{which}ticklabels": [str(item) for item in values]})
        return _extrapolated_edges(centres), centres
    centres = values.astype(float)
    if len(centres) > 2 and centres[0] > 0:
        steps = np.diff(np.log(centres))
        if np.allclose(steps, steps[0]):
            ax.set(**{f"{which}scale": "log"})
            axis = ax.xaxis if which == "x" else ax.yaxis
            few = centres[-1] < 1e3 * centres[0]
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(NullFormatter())
            return np.exp(_extrapolated_edges(np.log(centres))), centres
    return _extrapolated_edges(centres), centres


def _extrapolated_edges(centres: np.ndarray) -> np.ndarray:
    if len(centres) == 1:
        half = 0.5 * abs(centres[0]) or 0.5
        return np.array([centres[0] - half, centres[0] + half])
    middles = 0.5 * (centres[1:] + centres[:-1])
    return np.concatenate([[2 * centres[0] - middles[0]], middles, [2 * centres[-1] - middles[-1]]])
