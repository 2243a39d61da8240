"""Drawings of the motion: velocities of bodies and modes of contacts over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.patches import Patch
from numpy.typing import NDArray

from stickslip.modes import Mode
from stickslip.plots_style import TIME, VELOCITY, WITH_DOTS, beside, dots, look, own_axes, raster
from stickslip.result import Result
from stickslip.sampling import is_dense, refined, sampled

__all__ = ["modes", "velocities"]

MANY = 12
"""More curves or strips than this become a raster."""

_COLUMNS = 800
_SHADE = "0.82"
_STRIPS: dict[int, dict[str, Any]] = {
    Mode.FORWARD: {"facecolor": "white", "hatch": "////"},
    Mode.STUCK: {"facecolor": "0.35"},
    Mode.BACKWARD: {"facecolor": "0.85", "hatch": "...."},
}


def velocities(result: Result, bodies: Sequence[str] | None = None, *, ax: Any = None) -> Any:
    """Draw velocities over time and return the axes.

    Markers are the computed points, or ticks at the bottom where they are many; a broad grey line runs under
    a body while a contact holds it. More than a dozen bodies become a raster with a colour bar.

    Parameters
    ----------
    result : Result
    bodies : sequence of str, optional
        Names of bodies and drives; by default all of them.
    ax : matplotlib axes, optional
        Where to draw; by default a new figure.

    Raises
    ------
    ValueError
        If there is no such body.
    """
    ax = own_axes(ax)
    scene = result.scene
    names = [element.name for element in (*scene.bodies, *scene.drives)] if bodies is None else list(bodies)
    if len(names) > MANY:
        _velocity_raster(result, names, ax)
    else:
        _velocity_curves(result, names, ax)
    ax.set_xlabel(TIME)
    return ax


def _velocity_curves(result: Result, names: list[str], ax: Any) -> None:
    fine, computed = refined(result), _computed(result)
    for contact in result.scene.contacts:
        held = {contact.a, contact.b} & set(names)
        stuck = fine.mode(contact.name) == Mode.STUCK if held else np.empty(0)
        for name in sorted(held) if stuck.any() else ():
            ax.plot(fine.t, np.where(stuck, fine.velocity(name), np.nan), color=_SHADE, linewidth=8, zorder=1)
    few = computed.t.size <= WITH_DOTS
    driven = {drive.name for drive in result.scene.drives}
    for k, name in enumerate(names):
        ax.plot(fine.t, fine.velocity(name), label=name, zorder=2, **look(k))
        if few and name not in driven:
            ax.plot(computed.t, computed.velocity(name), zorder=3, **dots(k))
    ax.set_ylabel(VELOCITY)
    ax.margins(x=0.01)
    if any(line.get_color() == _SHADE for line in ax.get_lines()):
        ax.plot([], [], color=_SHADE, linewidth=8, label="held by a contact")
    points: dict[str, Any] = {"color": "0.3", "linestyle": "none", "label": "computed points"}
    if few:
        ax.plot([], [], marker="o", markersize=3.5, **points)
    else:
        low = np.zeros(computed.t.size)
        ax.plot(computed.t, low, "|", transform=ax.get_xaxis_transform(), markersize=9, **points)
    beside(ax)


def _velocity_raster(result: Result, names: list[str], ax: Any) -> None:
    coarse = _evenly(result)
    rows = np.array([coarse.velocity(name) for name in names])
    mesh = raster(ax, coarse.t, rows, names, cmap="cividis")
    ax.figure.colorbar(mesh, ax=ax, label=VELOCITY, pad=0.01)
    ax.set_ylabel("body")


def modes(result: Result, contacts: Sequence[str] | None = None, *, ax: Any = None) -> Any:
    """Draw the modes of contacts over time, a strip each, and return the axes.

    A strip is thin while the normal force is 0. More than a dozen contacts become a raster.

    Parameters
    ----------
    result : Result
    contacts : sequence of str, optional
        Names of contacts; by default all of them.
    ax : matplotlib axes, optional
        Where to draw; by default a new figure.

    Raises
    ------
    ValueError
        If there is no such contact.
    """
    names = [contact.name for contact in result.scene.contacts] if contacts is None else list(contacts)
    ax = own_axes(ax, height=1.2 + 0.25 * min(len(names), MANY))
    if len(names) > MANY:
        _mode_raster(result, names, ax)
    else:
        _mode_strips(refined(result), names, ax)
    ax.set(xlabel=TIME, ylabel="mode")
    return ax


def _mode_strips(fine: Result, names: list[str], ax: Any) -> None:
    is_open = False
    for place, name in enumerate(names):
        for mode, idle, start, stop in _runs(fine, name):
            height = 0.2 if idle else 0.7
            is_open |= idle
            bar = {"edgecolor": "black", "linewidth": 0.5, "zorder": 2} | _STRIPS[mode]
            ax.broken_barh([(start, stop - start)], (place - height / 2, height), **bar)
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.margins(x=0.01)
    ax.tick_params(axis="y", length=0)
    entries = [
        Patch(edgecolor="black", linewidth=0.5, label=Mode(mode).name, **bar) for mode, bar in _STRIPS.items()
    ]
    if is_open:
        entries.append(Patch(alpha=0.0, label="thin: normal force 0"))
    beside(ax, handles=entries)


def _runs(fine: Result, name: str) -> list[tuple[int, bool, float, float]]:
    """Return the mode, whether the contact is open, start and stop of each stretch between changes."""
    t, mode, idle = fine.t, fine.mode(name).astype(int), fine.normal(name) == 0
    steps = np.flatnonzero(np.diff(t) > 0)
    if not steps.size:
        return []
    # both limits stand at a break, so a step's own limits are at its two ends
    code, shut = mode[steps], idle[steps] & idle[steps + 1]
    changes = np.flatnonzero((np.diff(code) != 0) | (shut[1:] != shut[:-1])) + 1
    first = np.concatenate([[0], changes])
    last = np.concatenate([changes - 1, [steps.size - 1]])
    return [
        (int(code[i]), bool(shut[i]), float(t[steps[i]]), float(t[steps[j] + 1]))
        for i, j in zip(first, last, strict=True)
    ]


def _mode_raster(result: Result, names: list[str], ax: Any) -> None:
    coarse = _evenly(result)
    rows: NDArray[np.int8] = np.array([coarse.mode(name) for name in names])
    shades = ListedColormap(["#b5a642", "0.25", "0.93"])
    mesh = raster(ax, coarse.t, rows, names, cmap=shades, norm=BoundaryNorm([-1.5, -0.5, 0.5, 1.5], 3))
    bar = ax.figure.colorbar(mesh, ax=ax, ticks=[-1, 0, 1], pad=0.01)
    bar.ax.set_yticklabels([Mode(mode).name for mode in (-1, 0, 1)])


def _computed(result: Result) -> Result:
    if not is_dense(result):
        return result
    return sampled(result, range(len(result._pieces)), [piece.taus for piece in result._pieces])


def _evenly(result: Result) -> Result:
    """Return the result at evenly spaced times, enough for the columns of a picture."""
    if not is_dense(result):
        return result
    starts = np.array([piece.start for piece in result._pieces])
    times = np.linspace(starts[0], result._pieces[-1].stop, _COLUMNS)
    place = np.searchsorted(starts, times, side="right") - 1
    numbers = np.unique(place).tolist()
    return sampled(result, numbers, [times[place == k] - starts[k] for k in numbers])
