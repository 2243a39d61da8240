"""What notebooks show of scenes, results and studies: a small figure and a table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from html import escape
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from stickslip.model.laws.dry_friction import Law
from stickslip.model.quantities import Quantity
from stickslip.model.scene import Scene
from stickslip.model.signals import Signal
from stickslip.plots.html import STYLE, bitmap, table, vector
from stickslip.plots.overview import overview
from stickslip.plots.schematic import MOST, schematic
from stickslip.plots.style import apart_from_pyplot
from stickslip.results.outcome import Event
from stickslip.results.readable import Readable
from stickslip.results.units import units

_EVENTS = 12
_ELEMENTS = 40
_ENDS = ("a", "b", "body", "sun", "carrier", "ring")


def _shown(*parts: str) -> str:
    return f'<div class="stickslip">{STYLE}' + "\n".join(parts) + "</div>"


@apart_from_pyplot()
def scene_html(scene: Scene) -> str:
    """Return the schematic of a scene, and a table of its elements."""
    return _shown(vector(schematic(scene).figure, "schematic of the scene"), elements_table(scene))


@apart_from_pyplot()
def result_html(result: Readable) -> str:
    """Return figure, events and last velocities of a result."""
    if not result.t.size:
        return _shown(f"<p>{escape(result.message)}</p>")
    figure = overview(result)
    stats = [", ".join(f"{name} {value}" for name, value in run.stats.items()) for run in result.runs]
    return _shown(
        f"<p>{escape(result.message)}</p>",
        bitmap(figure, "velocities, modes and forces over time", 80),
        events_table(result.events, _EVENTS),
        final_table(result),
        *(f"<p><small>{escape(counts)}</small></p>" for counts in stats),
    )


def study_html(study: Any) -> str:
    """Return figure and table of a study."""
    ax = Figure(figsize=(7.5, 4.5), layout="constrained").subplots()
    study.plot(ax=ax)
    return _shown(bitmap(ax.figure, "error against time"), f"<pre>{escape(str(study))}</pre>")


@apart_from_pyplot()
def cycle_html(cycle: Any) -> str:
    """Return one period of a limit cycle as a figure, and its description."""
    figure = bitmap(overview(cycle.result), "one period: velocities, modes and forces", 80)
    return _shown(figure, f"<pre>{escape(str(cycle))}</pre>")


def elements_table(scene: Scene) -> str:
    """Return a table of a scene's elements, a line each."""
    rows = []
    for element in scene.elements[:_ELEMENTS]:
        every = [(one, getattr(element, one.name)) for one in fields(element)]  # type: ignore[arg-type]
        given = {one.name: value for one, value in every if value is not one.default}
        name = given.pop("name", "")
        ends = " – ".join(given.pop(key) for key in _ENDS if key in given)
        rows.append((element.noun(), name, ends, ", ".join(f"{key} {_brief(x)}" for key, x in given.items())))
    return table(("element", "name", "joins", "values"), rows, len(scene.elements))


def _brief(value: Any) -> str:
    """Return a value of a field as a short text."""
    if isinstance(value, Quantity):
        value = str(value)
    if isinstance(value, (Signal, Law)):
        try:
            value = value.to_dict()
        except (TypeError, ValueError):
            return "a function"
    if isinstance(value, Mapping):
        kind = value.get("type")
        inner = ", ".join(f"{key} {_brief(item)}" for key, item in value.items() if key != "type")
        return f"{kind}({inner})" if kind else f"({inner})"
    if isinstance(value, (list, tuple)):
        value = f"[{', '.join(map(_brief, value))}]"
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    return text if len(text) <= 60 else text[:59] + "…"


def events_table(events: list[Event], most: int) -> str:
    """Return a table of events, at most `most`."""
    rows = [(e.t, e.contact, f"{e.before.name} → {e.after.name}", e.cause) for e in events[:most]]
    if not rows:
        return "<p>no events</p>"
    return table(("time [s]", "what", "change", "why"), rows, len(events))


def final_table(result: Readable) -> str:
    """Return a table of the velocities at the last time."""
    scene = result.scene
    rows = [
        (body.name, float(result.velocity(body.name)[-1]), units(scene, body).velocity)
        for body in scene.bodies[:MOST]
        if np.isfinite(result.velocity(body.name)[-1])  # NaN where the last of several runs does not have the body
    ]
    left = max(len(scene.bodies) - MOST, 0)
    return table(("body", f"velocity at {result.t[-1]:.9g} s", "unit"), rows, len(rows) + left)
