"""A report of one run: one HTML file that needs nothing else."""

from __future__ import annotations

from html import escape
from typing import Any

from stickslip.model.modes import Mode
from stickslip.plots.energy import energy
from stickslip.plots.html import STYLE, bitmap, table, vector
from stickslip.plots.notebook import elements_table, events_table, final_table
from stickslip.plots.overview import overview
from stickslip.plots.schematic import schematic
from stickslip.plots.style import apart_from_pyplot
from stickslip.results.energy import losses
from stickslip.results.explanations import explain_result
from stickslip.results.readable import Readable
from stickslip.results.shares import share

_EVENTS = 200
_ROWS = 40

# Figures with more times than this are bitmaps: as lines they would make the page large.
_POINTS = 300

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
body {{ font-family: system-ui, sans-serif; line-height: 1.45; color: #111; background: white;
        max-width: 60rem; margin: 0 auto; padding: 0.5rem 1rem 3rem; }}
h1 {{ font-size: 1.5rem; }} h2 {{ font-size: 1.15rem; margin-top: 2rem; border-bottom: 2px solid #111; }}
.figure img, .figure svg {{ min-width: 36rem; }}
pre {{ white-space: pre-wrap; overflow-wrap: anywhere; font-size: 0.8rem; background: #f3f3f3; padding: 0.6rem; }}
</style>
{style}
</head>
<body class="stickslip">
{body}
</body>
</html>
"""


@apart_from_pyplot()
def report(result: Readable, title: str) -> str:
    """Return a page on a result: scene, motion, modes, forces, energies, events with their causes, accuracy."""
    if not result.t.size:
        return _page(title, [("Outcome", f"<p>{escape(result.message)}</p>"), _scene(result)])
    sections = [
        ("Outcome", _outcome(result)),
        _scene(result),
        ("Motion, modes and forces", _motion(result)),
        ("Events", events_table(result.events, _EVENTS)),
        ("Time in each mode", _shares(result)),
        ("Energy", _energy(result)),
        ("Engine and accuracy", _accuracy(result)),
        ("In words", f"<pre>{escape(explain_result(result))}</pre>"),
    ]
    return _page(title, [(heading, content) for heading, content in sections if content])


def _page(title: str, sections: list[tuple[str, str]]) -> str:
    parts = [f"<section><h2>{escape(heading)}</h2>{content}</section>" for heading, content in sections]
    return _PAGE.format(title=escape(title), style=STYLE, body="\n".join([f"<h1>{escape(title)}</h1>", *parts]))


def _spans(result: Readable) -> list[str]:
    """Return in words when each run starts and ends."""
    trajectories = [run.samples.trajectory for run in result.runs]
    return [f"from {one.starts[0]:.9g} s to {one.stops[-1]:.9g} s" if one.pieces else "" for one in trajectories]


def _scene(result: Readable) -> tuple[str, str]:
    parts = []
    for run, span in zip(result.runs, _spans(result), strict=True):
        scene = run.samples.system.scene
        if len(result.runs) > 1:
            parts.append(f"<h3>{escape(span[0].upper() + span[1:])}</h3>")
        parts += [vector(schematic(scene).figure, "schematic of the scene"), elements_table(scene)]
    return "Scene", "".join(parts)


def _outcome(result: Readable) -> str:
    events = len(result.events)
    counted = f"{events} events" if events != 1 else "1 event"
    said = f"{result.message}: {', '.join(_spans(result))}, {counted}."
    return f"<p>{escape(said[0].upper() + said[1:])}</p>{final_table(result)}"


def _motion(result: Readable) -> str:
    figure = overview(result)
    draw = vector if result.t.size <= _POINTS else bitmap
    return _figure(draw(figure, "velocities, modes, forces and normal forces over time"))


def _figure(picture: str) -> str:
    """Return a figure that is scrolled on narrow pages: shrunk to them, its letters could not be read."""
    return f'<div class="wide figure">{picture}</div>'


def _shares(result: Readable) -> str:
    names = [row.name for row in result.scene.rows]
    if not names or not result.is_dense:
        return ""
    shares = {name: share(result, name) for name in names[:_ROWS]}
    modes = [mode for mode in Mode if any(mode in parts for parts in shares.values())]
    rows = [
        (name, *(f"{100 * parts[mode]:.4g} %" if mode in parts else "" for mode in modes))
        for name, parts in shares.items()
    ]
    heads = ("what", *(mode.name for mode in modes))
    return table(heads, rows, len(names))


def _energy(result: Readable) -> str:
    if not result.is_dense:
        return ""
    ledger: Any = result.energy()
    accounts = ledger.totals | losses(ledger)
    rows = [(name, float(value[0]), float(value[-1])) for name, value in accounts.items()]
    picture = bitmap(energy(result).figure, "energies over time")
    heads = ("energy [J]", "at the start", "at the end")
    return _figure(picture) + table(heads, rows[:_ROWS], len(rows))


def _accuracy(result: Readable) -> str:
    every = [run.stats for run in result.runs]
    names = dict.fromkeys(name for stats in every for name in stats)
    rows = [(name.replace("_", " "), *(str(stats.get(name, "")) for stats in every)) for name in names]
    heads = _spans(result) if len(every) > 1 else [""]
    said = dict.fromkeys(map(_certificate, every))
    if result.is_dense:
        error = f"The energies balance to {result.energy().relative_error:.1e} of the largest of them."
        said = {error: None} | said
    return table(("", *heads), rows) + "".join(f"<p>{escape(sentence)}</p>" for sentence in said)


def _certificate(stats: Any) -> str:
    """Return what is known of events that could have been missed."""
    excluded, isolated = stats.get("guards_excluded", 0), stats.get("guards_isolated", 0)
    if excluded or isolated:
        return (
            f"No event was missed: of {excluded + isolated} guards in the steps of the series, {excluded} were proved "
            f"to have no root by a bound on their polynomials, and {isolated} were searched for their first root."
        )
    if stats.get("guards", 0):
        return (
            "Events were found by root finding and by a look between the points of the solver; "
            "a guard that dips below 0 and comes back within a small part of one step can be missed."
        )
    return "No contact could change its mode, so there was no event to miss."
