"""Drawings of contacts: forces and what they can hold, phase portraits, characteristics, normal forces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps

from stickslip.model.arrays import Array
from stickslip.model.elements import Contact
from stickslip.model.laws.table import steady_forces
from stickslip.model.modes import Mode
from stickslip.model.signals import Constant
from stickslip.plots.motion import MANY
from stickslip.plots.style import (
    AS_IT_IS,
    FINE,
    NORMAL,
    TIME,
    WITH_DOTS,
    beside,
    color_bar,
    contact_names,
    dots,
    even_points,
    few,
    labelled,
    look,
    name_of_points,
    of_result,
    over_time,
    own_axes,
    raster,
    short_numbers,
    value_raster,
)
from stickslip.results.readable import Readable
from stickslip.results.units import units, units_of_body

_MARKS = 300  # about so many computed times are marked on a characteristic
_GREYS = colormaps["Greys"].with_extremes(bad="white")  # missing values hide the lines at events


@of_result
def contact_forces(result: Readable, contact: str, *, ax: Any = None) -> Any:
    """Draw the friction force of a contact over time, between its breakaway levels, and return the axes.

    The upper line is the level above which the contact slips forward, the lower one that below which it slips
    backward; they have the same distance from 0 unless the coefficients of the directions differ.

    Parameters
    ----------
    result : Result
    contact : str
        Name of the contact.
    ax : matplotlib axes, optional
        Where to draw; by default a new figure.

    Raises
    ------
    ValueError
        If there is no such contact.
    """
    element = _element(result, contact)
    fine, computed = result.fit_for_plot(FINE), result.fit_for_plot()
    ax = own_axes(ax)
    # a tie holds any force, a one-way clutch or a stop any to one side: there is no level to draw
    if isinstance(element, Contact):
        upper, lower = fine.breakaway(contact, 1), -fine.breakaway(contact, -1)
        label = "± breakaway level" if np.array_equal(upper, -lower, equal_nan=True) else "breakaway levels"
        grey: dict[str, Any] = {"color": "0.45", "linestyle": "--", "linewidth": 1.0, "zorder": 1}
        ax.fill_between(fine.t, lower, upper, color="0.92", linewidth=0, zorder=0)
        ax.plot(fine.t, upper, label=label, **grey)
        ax.plot(fine.t, lower, **grey)
    ax.plot(fine.t, fine.force(contact), label="force r", zorder=2, **look(0))
    if computed.t.size <= WITH_DOTS:
        ax.plot(computed.t, computed.force(contact), zorder=3, **dots(0))
    return over_time(ax, f"force [{units(result.scene, element).force}]", f"{element.noun()} {contact}")


@of_result
def load_of_contacts(result: Readable, contacts: Sequence[str] | None = None, *, ax: Any = None) -> Any:
    """Draw ``|r| / B`` of contacts over time as a raster with a colour bar; return the axes.

    Parameters
    ----------
    result : Result
    contacts : sequence of str, optional
        Names of contacts; by default all that have a level.
    ax : matplotlib axes, optional
        Where to draw; by default a new figure.

    Raises
    ------
    ValueError
        If there is no such contact.
    """
    names = contact_names(result, contacts)
    coarse = even_points(result)
    ax = own_axes(ax)
    rows = {name: _ratio(np.abs(coarse.force(name)), coarse.breakaway(name)) for name in names}
    if contacts is None:
        # gaps have no level, and are not drawn beside what has one
        names = [name for name, ratio in rows.items() if np.isfinite(ratio).any()] or names
    known = np.ma.masked_invalid(np.reshape([rows[name] for name in names], (len(names), coarse.t.size)))
    mesh = raster(ax, coarse.t, known, names, cmap=_GREYS, vmin=0.0, vmax=1.0)
    color_bar(ax, mesh, "|force| / breakaway level")
    ax.set(xlabel=TIME, ylabel="contact")
    return ax


def _ratio(force: Array, level: Array) -> Array:
    finite = np.isfinite(level)
    carries = finite & (level > 1e-9 * level.max(initial=0.0, where=finite))
    return np.divide(force, level, out=np.full_like(force, np.nan), where=carries)


@of_result
def normal_forces(result: Readable, contacts: Sequence[str] | None = None, *, ax: Any = None) -> Any:
    """Draw normal forces over time, by default those that vary if any do, and return the axes.

    Parameters
    ----------
    result : Result
    contacts : sequence of str, optional
        Names of contacts; by default those whose normal force varies, or all where none does.
    ax : matplotlib axes, optional
        Where to draw; by default a new figure.

    Raises
    ------
    ValueError
        If there is no such contact.
    """
    shown = varying(result) or [contact.name for contact in result.scene.contacts]
    names = shown if contacts is None else contact_names(result, contacts)
    ax = own_axes(ax)
    if len(names) > MANY:
        coarse = even_points(result)
        rows = np.array([coarse.normal(name) for name in names])
        value_raster(ax, coarse.t, rows, names, NORMAL)
        ax.set(xlabel=TIME, ylabel="contact")
        return ax
    fine = result.fit_for_plot(FINE)
    for k, name in enumerate(names):
        ax.plot(fine.t, fine.normal(name), label=labelled(name), **look(k))
    return over_time(ax, NORMAL)


def varying(result: Readable) -> list[str]:
    """Return the contacts whose normal force is not constant."""
    return [c.name for c in result.scene.contacts if not isinstance(c.normal, (Constant, float, int))]


@of_result
def phase_portrait(result: Readable, contact: str, *, body: str | None = None, ax: Any = None) -> Any:
    """Draw relative velocity against relative displacement of a contact, or those of a body; return the axes.

    Parameters
    ----------
    result : Result
    contact : str
        Name of the contact. Grey squares stand where it is stuck.
    body : str, optional
        Draw the velocity of this body against its position. On a belt a limit cycle closes so: the relative
        displacement grows with the travel of the belt.
    ax : matplotlib axes, optional
        Where to draw; by default a new figure.

    Raises
    ------
    ValueError
        If there is no such contact or body, or positions were not kept.
    """
    element = _element(result, contact)
    fine = result.fit_for_plot(FINE)
    if body is None:
        x = sum((c * fine.position(name) for name, c in element.coefficients.items()), np.zeros_like(fine.t))
        w, unit = fine.relative_velocity(contact), units(result.scene, element)
        names = "relative displacement", "relative velocity"
    else:
        x, w = fine.position(body), fine.velocity(body)
        unit, names = units_of_body(result.scene, body), (f"position of {body}", f"velocity of {body}")
    ax = own_axes(ax, 6.0, 4.2)
    ax.axhline(0.0, color="0.7", linewidth=0.6, zorder=0)
    ax.plot(x, w, label="trajectory", zorder=1, **look(0))
    stuck = fine.mode(contact) == Mode.STUCK
    if stuck.any():
        ax.plot(x[stuck], w[stuck], "s", color="0.6", markersize=5, markeredgewidth=0, zorder=2, label="stuck")
    ax.plot(x[:1], w[:1], "o", color="black", markerfacecolor="white", zorder=3, label="start")
    ax.plot(x[-1:], w[-1:], "X", color="black", markersize=8, zorder=3, label="end")
    ax.set_xlabel(f"{names[0]} [{unit.position}]", **AS_IT_IS)
    ax.set_ylabel(f"{names[1]} [{unit.velocity}]", **AS_IT_IS)
    short_numbers(ax)
    if ax.get_xscale() == "linear":
        # displacements may be small, and their labels long
        ax.locator_params(axis="x", nbins=6)
    beside(ax, title=f"{element.noun()} {contact}", alignment="left")
    return ax


@of_result
def characteristic(result: Readable, contact: str, *, ax: Any = None) -> Any:
    """Draw the force of a contact against its relative velocity, over the curve of its law; return the axes.

    Where the normal force varies, force and curve are divided by it.

    Parameters
    ----------
    result : Result
    contact : str
        Name of the contact.
    ax : matplotlib axes, optional
        Where to draw; by default a new figure.

    Raises
    ------
    ValueError
        If there is no such contact.
    """
    element = _element(result, contact)
    if not isinstance(element, Contact):
        raise ValueError(f"characteristic: {element.label} has no friction law; name a contact")
    ax = own_axes(ax, 6.0, 4.2)
    fine, computed = result.fit_for_plot(FINE), result.fit_for_plot()
    divided = contact in varying(result)
    normal = float(np.nanmean(fine.normal(contact))) if fine.t.size else 0.0
    whole = normal if divided and normal > 0 else 1.0
    fastest = float(np.nan_to_num(np.abs(fine.relative_velocity(contact))).max(initial=0.0)) or 1.0
    w = np.linspace(-1.1 * fastest, 1.1 * fastest, 801)
    law = {"color": "0.65", "linewidth": 4, "zorder": 0, "solid_capstyle": "butt"}
    for side in (w[w < 0], w[w > 0]):
        ax.plot(side, steady_forces(element.law, side, normal) / whole, **law)
    core = element.law.core
    if element.law.character.sticks:
        ax.plot([0, 0], [-normal / whole * core.mu_s(-1), normal / whole * core.mu_s(1)], **law)
    ax.plot([], [], color="0.65", linewidth=4, label=type(element.law).__name__)
    line: dict[str, Any] = {"color": "black", "linewidth": 1.2, "label": "trajectory"}
    size = 5 if computed.t.size <= WITH_DOTS else 2.5
    some, said = few(computed.t.size, _MARKS)
    points = dots(1) | {
        "marker": "o",
        "markersize": size,
        "markerfacecolor": "white",
        "label": name_of_points(result) + said,
    }
    for at, shown, style in ((fine, slice(None), line), (computed, some, points)):
        carried = at.force(contact)
        if divided:
            carried = _ratio(carried, at.normal(contact))
        ax.plot(at.relative_velocity(contact)[shown], carried[shown], **style)
    unit = units(result.scene, element)
    # where the force is in N m, the coefficient of friction contains the lever arm
    arm = {"N": "[1]", "N m": "[m]"}.get(unit.force, "[1 | m]")
    force = f"force / normal force {arm}" if divided else f"force [{unit.force}]"
    ax.set(xlabel=f"relative velocity [{unit.velocity}]", ylabel=force)
    short_numbers(ax)
    beside(ax, title=f"contact {contact}", alignment="left")
    return ax


def _element(result: Readable, contact: str) -> Any:
    result.mode(contact)  # raises an error for a name that does not exist
    return next(row for row in result.scene.rows if row.name == contact)
