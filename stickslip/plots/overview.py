"""Everything about a run over time, panel by panel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from matplotlib.figure import Figure

from stickslip.model.checks import numbers
from stickslip.plots.blocks import block
from stickslip.plots.contact import contact_forces, load_of_contacts, normal_forces, varying
from stickslip.plots.limits import limited, stretch
from stickslip.plots.motion import MANY, body_names, modes, velocities, velocity_units
from stickslip.plots.style import TIME, contact_names, mark_events, of_result, panels
from stickslip.results.readable import Readable

_FORCE_PANELS = 4
_BLOCK_PANELS = 3
Panel = tuple[float, Callable[..., Any]]


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
    More than four contacts share one raster of ``|r| / B``; panels with nothing to show are left out. Of gaps and stops
    the first four are drawn, of blocks the first three.

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
        If a name is unknown, the number of axes is not that of the panels, or `t_span` is outside the result.
    """
    names = contact_names(result, contacts)
    shown = None if t_span is None else numbers(t_span, "overview: t_span")
    if shown is not None and not (shown.size == 2 and shown[0] < shown[1]):
        raise ValueError(f"overview: t_span must be two times (start, end), got {t_span!r}")
    if shown is not None and result.t.size and not (shown[0] < result.t[-1] and result.t[0] < shown[1]):
        raise ValueError(
            f"overview: t_span ({shown[0]:g}, {shown[1]:g}) s lies outside the times of the result, "
            f"{result.t[0]:g} to {result.t[-1]:g} s"
        )
    drawings = _panels(result, bodies, names)
    own = panels(axes, [height for height, _ in drawings], "overview")
    if axes is None:
        own[0].figure.align_ylabels(own)
    for ax, (_, draw) in zip(own, drawings, strict=True):
        draw(ax=ax)
        mark_events(ax, result)
        ax.set_xlabel("")
        if shown is not None:
            ax.set_xlim(*shown)
    own[-1].set_xlabel(TIME)
    drawn: Figure = own[0].get_figure()
    return drawn


def _panels(result: Readable, bodies: Sequence[str] | None, names: list[str]) -> list[Panel]:
    """Return height in inches and drawing of each panel."""
    found: list[Panel] = [(2.4, partial(velocities, result, some)) for some in _by_unit(result, bodies)]
    of_blocks = _first_few(
        [(1.4, partial(block, result, own.name)) for own in result.scene.all_blocks], _BLOCK_PANELS, "blocks"
    )
    if not names:
        return found + of_blocks
    height = 0.5 + 0.22 * len(names) if len(names) <= MANY else 2.2
    found.append((max(height, 0.95), partial(modes, result, names)))
    if len(names) <= _FORCE_PANELS:
        found += [(1.6, partial(contact_forces, result, name)) for name in names]
    elif of_contacts := [one.name for one in result.scene.contacts if one.name in names]:
        found.append((2.2, partial(load_of_contacts, result, of_contacts)))
    elements = limited(result)
    between: list[Panel] = [(1.5, partial(stretch, result, name)) for name in names if name in elements]
    found += _first_few(between, _FORCE_PANELS, "gaps and stops")
    loaded = [name for name in varying(result) if name in names]
    if loaded:
        found.append((1.4, partial(normal_forces, result, loaded)))
    return found + of_blocks


def _first_few(drawings: list[Panel], most: int, what: str) -> list[Panel]:
    """Return the first drawings, `most` of them; the last one says how many more there are."""
    shown, more = drawings[:most], len(drawings) - most
    if more > 0:
        height, draw = shown[-1]
        shown[-1] = height, partial(_with_note, draw, f"not drawn:\n{more} more {what}")
    return shown


def _with_note(draw: Callable[..., Any], note: str, *, ax: Any) -> None:
    draw(ax=ax)
    ax.text(1.02, 0.0, note, transform=ax.transAxes, va="bottom", fontsize="small")


def _by_unit(result: Readable, bodies: Sequence[str] | None) -> list[list[str]]:
    """Return bodies and drives in groups that are measured in the same unit: a panel each."""
    names = body_names(result, bodies)
    own = velocity_units(result, names)
    return [[name for name in names if own[name] == unit] for unit in dict.fromkeys(own.values())]
