"""Drawings of the motion: velocities of bodies and modes of contacts over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.patches import Patch
from matplotlib.path import Path

from stickslip.model.arrays import Array
from stickslip.model.modes import Mode
from stickslip.plots.style import (
    AS_IT_IS,
    FINE,
    TIME,
    WITH_DOTS,
    beside,
    color_bar,
    contact_names,
    dots,
    even_points,
    few,
    keep_names_inside,
    labelled,
    look,
    name_of_points,
    of_result,
    own_axes,
    raster,
    short,
    value_raster,
    wanted_names,
)
from stickslip.results.readable import Readable
from stickslip.results.units import units

MANY = 12  # more curves or strips than this become a raster
_TICKS = 200
_UNKNOWN = 99  # stands for the mode where a run does not have the contact
_BAND: dict[str, Any] = {"color": "0.82", "linewidth": 8, "solid_capstyle": "projecting"}
_CROWDED = 500  # if a strip has more bars of one kind than this, they have no edges and hatches
_STRIPS: dict[int, dict[str, Any]] = {
    Mode.FORWARD: {"facecolor": "white", "hatch": "////"},
    Mode.STUCK: {"facecolor": "0.35"},
    Mode.BACKWARD: {"facecolor": "0.85", "hatch": "...."},
    Mode.OPEN: {"facecolor": "white"},
}


@of_result
def velocities(result: Readable, bodies: Sequence[str] | None = None, *, ax: Any = None) -> Any:
    """Draw velocities of bodies and drives, by default of all, over time and return the axes.

    Where bodies are measured in different units, the legend names those of each. Markers stand at times fit for a plot.
    Where these are many, ticks at the bottom replace them; the legend says how many times each tick stands for. A broad
    grey line runs under a body while a contact with a normal force holds it. More than a dozen bodies become a raster
    with a colour bar.

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
    names = body_names(result, bodies)
    shared, labels = _units(result, names)
    ax = own_axes(ax)
    if len(names) > MANY:
        coarse = even_points(result)
        rows = np.array([coarse.velocity(name) for name in names])
        value_raster(ax, coarse.t, rows, labels, f"velocity [{shared}]")
        ax.set_ylabel("body")
    else:
        _velocity_curves(result, names, labels, ax)
        ax.set_ylabel(f"velocity [{shared}]")
    ax.set_xlabel(TIME)
    return ax


def _velocity_curves(result: Readable, names: list[str], labels: list[str], ax: Any) -> None:
    fine, computed = result.fit_for_plot(FINE), result.fit_for_plot()
    held = _bands(fine, names, ax)
    few = computed.t.size <= WITH_DOTS
    driven = {drive.name for drive in result.scene.drives}
    for k, name in enumerate(names):
        ax.plot(fine.t, fine.velocity(name), label=labelled(labels[k]), zorder=2, **look(k))
        if few and name not in driven:
            ax.plot(computed.t, computed.velocity(name), zorder=3, **dots(k))
    ax.margins(x=0.01)
    if held:
        ax.plot([], [], label="held by a contact", **_BAND)
    points: dict[str, Any] = {"color": "0.3", "linestyle": "none", "label": name_of_points(result)}
    if few:
        ax.plot([], [], marker="o", markersize=3.5, **points)
    else:
        _rug(ax, computed.t, points)
    beside(ax)


def body_names(result: Readable, bodies: Sequence[str] | None) -> list[str]:
    """Return the bodies and drives to draw: those asked for, else all of the scene."""
    return wanted_names((*result.scene.bodies, *result.scene.drives), bodies, "bodies", result.velocity)


def velocity_units(result: Readable, names: Sequence[str]) -> dict[str, str]:
    """Return the unit of the velocity of each body or drive; both units where it is not said how it moves.

    The ground has the unit of all bodies and drives together.
    """
    moving = {one.name: (one,) for one in (*result.scene.bodies, *result.scene.drives)}
    return {name: units(result.scene, *moving.get(name, ())).velocity for name in names}


def _units(result: Readable, names: list[str]) -> tuple[str, list[str]]:
    """Return the unit of the axis, and the names of bodies: with their own units where these differ."""
    own = velocity_units(result, names)
    if len(set(own.values())) == 1:
        return own[names[0]], names
    return units(result.scene).velocity, [f"{name} [{unit}]" for name, unit in own.items()]


def _bands(fine: Readable, names: list[str], ax: Any) -> bool:
    """Draw a broad line under each body while a contact carries and holds it; return whether there is any."""
    drawn = False
    for contact in fine.scene.contacts:
        spans = [
            (start, stop)
            for mode, unpressed, start, stop in _runs(fine, contact.name)
            if mode == Mode.STUCK and not unpressed
        ]
        if not spans:
            continue
        # an event stands twice, with its two limits, and only one of them is stuck
        starts, stops = np.array(spans).T
        place = np.searchsorted(starts, fine.t, side="right") - 1
        holds = (fine.mode(contact.name) == Mode.STUCK) & (place >= 0) & (fine.t <= stops[place])
        for name in sorted({contact.a, contact.b} & set(names)):
            (band,) = ax.plot(fine.t, np.where(holds, fine.velocity(name), np.nan), zorder=1, **_BAND)
            # the ends of a broad line reach beyond its times: they are cut off
            band.set_clip_path(_stripes(spans), ax.get_xaxis_transform())
            drawn = True
    return drawn


def _stripes(spans: list[tuple[float, float]]) -> Path:
    """Return upright stripes from bottom (0) to top (1), one for each span of times."""
    corners = [((a, 0), (b, 0), (b, 1), (a, 1), (a, 0)) for a, b in spans]
    codes = [Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY] * len(spans)
    return Path(np.array(corners, dtype=float).reshape(-1, 2), codes)


def _rug(ax: Any, times: Array, points: dict[str, Any]) -> None:
    """Draw ticks along the bottom at computed times, only one in several where all would run together."""
    some, said = few(times.size, _TICKS)
    points = points | {"label": points["label"] + said}
    chosen = times[some]
    ticks = {"transform": ax.get_xaxis_transform(), "markersize": 9, "markeredgewidth": 0.6}
    ax.plot(chosen, np.zeros(chosen.size), "|", **ticks, **points)
    ax.margins(y=0.09)  # or a line at the lowest velocity would run into the ticks


@of_result
def modes(result: Readable, contacts: Sequence[str] | None = None, *, ax: Any = None) -> Any:
    """Draw the modes of contacts, by default of all, over time, a strip each, and return the axes.

    A strip is thin while the normal force is 0; the legend names the modes that occur. More than a dozen
    contacts become a raster.

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
    names = contact_names(result, contacts)
    ax = own_axes(ax, height=1.2 + 0.25 * min(len(names), MANY))
    if len(names) > MANY:
        _mode_raster(result, names, ax)
    else:
        _mode_strips(result.fit_for_plot(FINE), names, ax)
    ax.set(xlabel=TIME, ylabel="mode")
    return ax


def _mode_strips(fine: Readable, names: list[str], ax: Any) -> None:
    is_open, occurring = False, set()
    for place, name in enumerate(names):
        alike: dict[tuple[int, bool], list[tuple[float, float]]] = {}
        for mode, unpressed, start, stop in _runs(fine, name):
            alike.setdefault((mode, unpressed), []).append((start, stop - start))
        for (mode, unpressed), bars in alike.items():
            height = 0.2 if unpressed else 0.7
            is_open |= unpressed
            occurring.add(mode)
            look = {"edgecolor": "black", "linewidth": 0.5, "zorder": 2} | _STRIPS[mode]
            if len(bars) > _CROWDED:
                # edges and hatches would cover all of it
                look |= {"linewidth": 0.0, "hatch": None, "snap": False}
            ax.broken_barh(bars, (place - height / 2, height), **look)
    ax.set_yticks(range(len(names)), [short(name) for name in names], **AS_IT_IS)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.margins(x=0.01)
    ax.tick_params(axis="y", length=0)
    keep_names_inside(ax)
    entries = [
        Patch(edgecolor="black", linewidth=0.5, label=Mode(mode).name, **bar)
        for mode, bar in _STRIPS.items()
        if mode in occurring
    ]
    if is_open:
        entries.append(Patch(alpha=0.0, label="thin: normal force 0"))
    beside(ax, handles=entries)


def _runs(fine: Readable, name: str) -> list[tuple[int, bool, float, float]]:
    """Return mode, whether the contact is open, start and stop of each time span between changes."""
    t, mode = fine.t, np.nan_to_num(fine.mode(name).astype(float), nan=_UNKNOWN)
    unpressed = np.zeros(t.size, dtype=bool)
    if any(contact.name == name for contact in fine.scene.contacts):
        unpressed = fine.normal(name) == 0
    steps = np.flatnonzero(np.diff(t) > 0)
    if not steps.size:
        return []
    # a break stands twice, with its two limits, so the values at the two ends of a step belong to that step
    code, shut = mode[steps], unpressed[steps] & unpressed[steps + 1]
    changes = np.flatnonzero((np.diff(code) != 0) | (shut[1:] != shut[:-1])) + 1
    first = np.concatenate([[0], changes])
    last = np.concatenate([changes - 1, [steps.size - 1]])
    return [
        (int(code[i]), bool(shut[i]), float(t[steps[i]]), float(t[steps[j] + 1]))
        for i, j in zip(first, last, strict=True)
        if code[i] != _UNKNOWN
    ]


def _mode_raster(result: Readable, names: list[str], ax: Any) -> None:
    coarse = even_points(result)
    rows = np.ma.masked_invalid([coarse.mode(name).astype(float) for name in names])
    shown = list(range(-1, 3 if (rows == Mode.OPEN).any() else 2))
    shades = ListedColormap(["#b5a642", "0.25", "0.93", "white"][: len(shown)])
    norm = BoundaryNorm([-1.5, *(mode + 0.5 for mode in shown)], len(shown))
    mesh = raster(ax, coarse.t, rows, names, cmap=shades, norm=norm)
    bar = color_bar(ax, mesh, "", ticks=shown)
    bar.ax.set_yticklabels([Mode(mode).name for mode in shown])
