"""Drawings of results and studies.

Each takes a result, the names of what to draw of it, and `ax`, the axes of matplotlib to draw on: by default those of a
new figure of pyplot. It returns the axes. A name that the scene does not know is a ValueError, what is no result or no
axes a TypeError.

This module and its parts are the only ones that load matplotlib.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from matplotlib.figure import Figure as Figure

from stickslip.model.checks import numbers
from stickslip.plots.bifurcation import bifurcation
from stickslip.plots.blocks import block
from stickslip.plots.contact import (
    characteristic,
    contact_forces,
    load_of_contacts,
    normal_forces,
    phase_portrait,
    varying,
)
from stickslip.plots.fit import fit
from stickslip.plots.limits import limited, stretch
from stickslip.plots.motion import MANY, body_names, modes, velocities, velocity_units
from stickslip.plots.schematic import schematic
from stickslip.plots.style import (
    FINE,
    TIME,
    contact_names,
    look,
    mark_events,
    of_result,
    over_time,
    own_axes,
    panels,
)
from stickslip.plots.sweep_map import sweep_map
from stickslip.plots.work_precision import work_precision
from stickslip.results.energy import losses
from stickslip.results.readable import Readable

__all__ = [
    "Figure",
    "bifurcation",
    "block",
    "characteristic",
    "contact_forces",
    "energy",
    "fit",
    "load_of_contacts",
    "modes",
    "normal_forces",
    "overview",
    "phase_portrait",
    "schematic",
    "stretch",
    "sweep_map",
    "velocities",
    "work_precision",
]

_FORCE_PANELS = 4
_BLOCK_PANELS = 3
_CURVES = 6
Panel = tuple[float, Callable[[Any], Any]]


@of_result
def overview(
    result: Readable,
    *,
    bodies: Sequence[str] | None = None,
    contacts: Sequence[str] | None = None,
    t_span: tuple[float, float] | None = None,
    axes: Sequence[Any] | None = None,
) -> Figure:
    """Draw velocities, modes, contact forces within breakaway levels, normal forces that vary, and blocks, over time.

    This is figure 8 of Breedveld (2000). Bodies that rotate and bodies that move along lines have panels of their own.
    More than four contacts share one raster of ``|r| / B``; panels with nothing to show are left out.

    Parameters
    ----------
    result : Result
    bodies, contacts : sequence of str, optional
        What to draw; by default everything.
    t_span : (float, float), optional
        Times in s to show; by default all.
    axes : sequence of matplotlib axes, optional
        One per panel, from top to bottom; by default a new figure.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        If a name is unknown, or the number of axes is not that of the panels.
    """
    names = contact_names(result, contacts)
    shown = None if t_span is None else numbers(t_span, "overview: t_span")
    if shown is not None and not (shown.size == 2 and shown[0] < shown[1]):
        raise ValueError(f"overview: t_span must be two times (start, end), got {t_span!r}")
    drawings = _panels(result, bodies, names)
    own = panels(axes, [height for height, _ in drawings], "overview")
    if axes is None:
        own[0].figure.align_ylabels(own)
    for ax, (_, draw) in zip(own, drawings, strict=True):
        draw(ax)
        mark_events(ax, result)
        ax.set_xlabel("")
        if shown is not None:
            ax.set_xlim(*shown)
    own[-1].set_xlabel(TIME)
    drawn: Figure = own[0].get_figure()
    return drawn


def _panels(result: Readable, bodies: Sequence[str] | None, names: list[str]) -> list[Panel]:
    """Return height in inches and drawing of each panel."""
    found: list[Panel] = [
        (2.4, lambda ax, some=some: velocities(result, some, ax=ax))  # type: ignore[misc]
        for some in _by_unit(result, bodies)
    ]
    blocks = result.scene.all_blocks[:_BLOCK_PANELS]
    of_blocks: list[Panel] = [(1.4, lambda ax, name=own.name: block(result, name, ax=ax)) for own in blocks]  # type: ignore[misc]
    if not names:
        return found + of_blocks
    height = 0.5 + 0.22 * len(names) if len(names) <= MANY else 2.2
    found.append((max(height, 0.95), lambda ax: modes(result, names, ax=ax)))
    if len(names) <= _FORCE_PANELS:
        found += [(1.6, lambda ax, name=name: contact_forces(result, name, ax=ax)) for name in names]  # type: ignore[misc]
    else:
        found.append((2.2, lambda ax: load_of_contacts(result, names, ax=ax)))
    elements = limited(result)
    between = [name for name in names if name in elements][:_FORCE_PANELS]
    found += [(1.5, lambda ax, name=name: stretch(result, name, ax=ax)) for name in between]  # type: ignore[misc]
    loaded = [name for name in varying(result) if name in names]
    if loaded:
        found.append((1.4, lambda ax: normal_forces(result, loaded, ax=ax)))
    return found + of_blocks


def _by_unit(result: Readable, bodies: Sequence[str] | None) -> list[list[str]]:
    """Return bodies and drives in groups that are measured in the same unit: a panel each."""
    names = body_names(result, bodies)
    own = velocity_units(result, names)
    return [[name for name in names if own[name] == unit] for unit in dict.fromkeys(own.values())]


@of_result
def energy(result: Readable, *, ax: Any = None) -> Any:
    """Draw the energy ledger: what is stored, the heat so far and the work so far; return the axes.

    Parameters
    ----------
    result : Result
    ax : matplotlib axes, optional
        Where to draw; by default a new figure.

    Raises
    ------
    ValueError
        If only the requested outputs were kept.
    """
    ledger = result.fit_for_plot(FINE).energy()
    ax = own_axes(ax)
    curves = {"kinetic": ledger.kinetic}
    if result.scene.springs:
        curves["springs"] = ledger.spring
    if result.scene.forces:
        curves["work of loads"] = ledger.loads
    if result.scene.drives:
        curves["work of drives"] = ledger.drives
    if ledger.changes.any():
        curves["changes between runs"] = ledger.changes
    heat = losses(ledger)
    if len(heat) > _CURVES:
        heat = {"heat of contacts and dampers": ledger.heat}
    for k, (label, value) in enumerate((curves | heat).items()):
        ax.plot(ledger.t, value, label=label, **look(k))
    ax.set_title(f"balance error {ledger.relative_error:.1e} of the largest energy", loc="left", fontsize="small")
    return over_time(ax, "energy [J]")
