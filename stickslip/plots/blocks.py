"""Drawings of blocks: their outputs and states over time."""

from __future__ import annotations

from typing import Any

import numpy as np

from stickslip.plots.style import FINE, labelled, look, of_result, over_time, own_axes, short
from stickslip.results.readable import Readable

_CURVES = 8


@of_result
def block(result: Readable, name: str, *, ax: Any = None) -> Any:
    """Draw the outputs and states of a block over time and return the axes.

    States that are equal to an output are drawn once. Of many curves the first eight are drawn; the legend says so.

    Parameters
    ----------
    result : Result
    name : str
        Name of a block.
    ax : matplotlib axes, optional
        Where to draw; by default a new figure.

    Raises
    ------
    ValueError
        If there is no such block.
    """
    fine = result.fit_for_plot(FINE)
    outputs, states = (np.atleast_2d(found) for found in (fine.output(name), fine.state(name)))
    ax = own_axes(ax)
    curves = {_numbered("output", k, len(outputs)): values for k, values in enumerate(outputs)}
    for k, values in enumerate(states):
        if not any(np.array_equal(values, drawn) for drawn in outputs):
            curves[_numbered("state", k, len(states))] = values
    shown = list(curves.items())[:_CURVES]
    for k, (label, values) in enumerate(shown):
        ax.plot(fine.t, values, label=labelled(label), **look(k))
    if len(curves) > len(shown):
        ax.plot([], [], linestyle="none", label=f"and {len(curves) - len(shown)} more")
    return over_time(ax, short(name), f"block {name}")


def _numbered(what: str, k: int, count: int) -> str:
    return f"{what} {k}" if count > 1 else what
