"""Drawings of fits: what was measured, what the fitted scene does, and the residuals."""

from __future__ import annotations

from typing import Any

from stickslip.plots.style import AS_IT_IS, COLOURS, TIME, check_is, panels, within_or_beside
from stickslip.results.units import units


def fit(found: Any, *, axes: Any = None) -> Any:
    """Draw what was measured, what the fitted scene does, and below it the residuals; return the figure.

    Parameters
    ----------
    found : Fit
    axes : sequence of matplotlib axes, optional
        Two for each quantity, from top to bottom; by default a new figure.

    Raises
    ------
    ValueError, TypeError
        If the number of axes is not that of the panels, or `found` is something else.
    """
    check_is(found, "Fit", "fit plot")
    both = [(record, one) for record in found.records for one in record.measured]
    axes = panels(axes, [2.4, 1.2] * len(both), "fit")
    left = found.residuals()
    dots: dict[str, Any] = {"linestyle": "none", "marker": ".", "markersize": 4, "color": COLOURS[1]}
    for k, (record, one) in enumerate(both):
        scene, smooth = record.scene, record.result.fit_for_plot(1000)
        elements = {one.name: one for one in (*scene.bodies, *scene.drives, *scene.rows)}
        top, below = axes[2 * k], axes[2 * k + 1]
        unit = getattr(units(scene, elements[one.of]), one.quantity)
        top.plot(one.t, one.values, label="measured", **dots)
        top.plot(smooth.t, getattr(smooth, one.quantity)(one.of), color="black", linewidth=1.0, label="fitted")
        top.set_ylabel(f"{one.name} [{unit}]", **AS_IT_IS)
        top.set_title(record.name, loc="left", fontsize="medium", **AS_IT_IS)
        below.plot(one.t, left[record.label(one)], **dots)
        below.axhline(0.0, color="0.35", linewidth=0.8)
        below.set_ylabel(f"residual [{unit}]")
        within_or_beside(top)
    axes[-1].set_xlabel(TIME)
    return axes[0].get_figure()
