"""The energy ledger over time."""

from __future__ import annotations

from typing import Any

from stickslip.plots.style import FINE, look, of_result, over_time, own_axes
from stickslip.results.energy import losses
from stickslip.results.readable import Readable

_CURVES = 6  # more losses than this are drawn as one curve


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
    scene = result.scene
    acting = {"springs": (*scene.springs, *scene.gaps), "work of loads": scene.forces, "work of drives": scene.drives}
    curves = {name: value for name, value in ledger.totals.items() if acting.get(name, True)}
    heat = losses(ledger)
    if len(heat) > _CURVES:
        heat = {"heat of contacts and dampers": ledger.heat}
    for k, (label, value) in enumerate((curves | heat).items()):
        ax.plot(ledger.t, value, label=label, **look(k))
    ax.set_title(f"balance error {ledger.relative_error:.1e} of the largest energy", loc="left", fontsize="small")
    return over_time(ax, "energy [J]")
