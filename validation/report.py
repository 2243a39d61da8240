"""The table as one page that needs nothing else: what was checked, against what, how exactly, and pictures of it."""

from __future__ import annotations

import math
import platform
import sys
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from html import escape
from importlib.metadata import version
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from stickslip import plots
from stickslip.plots.html import STYLE, table, vector
from validation.exact import Story, pulled_block, reference, simulated, two_flywheels
from validation.rows import FORMULATIONS, Outcome
from validation.tried import summary

GOOD, BAD = "#1a7f37", "#cf222e"
ABOUT = {
    "Closed forms": "Motions with a formula. The right answer is computed in 40 digits by a program that "
    "shares no line with the package and integrates nothing. Where no spring or damper acts, motion is a "
    "parabola between events and the error should be roundoff; elsewhere it should be what the tolerance "
    "(rtol = 1e-10) allows.",
    "Published results": "Numbers that others computed, with other programs or by quadrature.",
    "Conservation": "What no motion may violate, summed up from velocities and forces over all cases of "
    "the chapters above and two scenes that have everything in them.",
    "Extremes": "The ends of every scale. Each row must end in a correct answer or in a clear error, and never hang.",
    "Long runs": "A limit cycle whose every event has a formula, for a million steps and for ten: what an event "
    "costs at the end of the run against what it cost at its beginning.",
    "Random scenes": "One to eight bodies in trees and loops, with random laws, loads, springs and drives, "
    "from a fixed seed: what must hold for any scene, whatever its motion is.",
    "Oracle": "A second simulator, slow and plain, that implements the model to the letter and shares no line with "
    "the package. Random scenes in families are compared with it: the events of each contact in order, their times "
    "(to 1e-7 of the span, 1e-6 in the multiplier formulation), friction forces where they are unique, and "
    "velocities. Where the model leaves more than one answer the oracle says so, and a scene is compared up to there.",
    "Machines": "A third simulator, of ties, radii, one-way clutches, gaps and stops beside friction: ties are solved "
    "once by a null space, one-sided rows by trying all sets of them, motion is a matrix exponential. Random machines "
    "are compared with it as with the oracle, in the default engine to 1e-9 of the span.",
    "Between computed points": "Results are read at any time, also between the points of a solver: velocities, forces, "
    "modes and heat there against those at points that a run was told to compute.",
    "Analysis": "Derivatives against differences of exact runs, limit cycles against long runs and closed forms, fits "
    "against the numbers from which data were made, linear models against the motion.",
    "Engines against each other": "What two engines say of one scene: series against CVODE, part by part against as a "
    "whole. Motions that graze are decided as exact arithmetic decides.",
}


_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 0 auto; padding: 2rem 1.5rem 4rem; }
h2 { margin-top: 3rem; } h2 small { font-weight: normal; color: #57606a; }
p, figcaption { max-width: 46rem; } nav a { margin-right: 1.2rem; } figure { margin: 1rem 0 2rem; }
code, .remark, figcaption, footer { color: #57606a; font-size: .85em; }
.good { color: #1a7f37; } .bad { color: #cf222e; } .mark { font-weight: 700; }
"""


def number(x: float) -> str:
    """Return a number as the tables show it."""
    if not math.isfinite(x):
        return "—"
    if x == 0:
        return "0"
    return f"{abs(x):.2g}" if 0.1 <= abs(x) < 1000 else f"{abs(x):.1e}"


def write(outcomes: Sequence[Outcome], folder: Path, command: str, seconds: float) -> Path:
    """Write the page into a folder and return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "validation.html"
    path.write_text(_page(outcomes, command, seconds), encoding="utf-8")
    return path


# The page


def _page(outcomes: Sequence[Outcome], command: str, seconds: float) -> str:
    failed = [o for o in outcomes if not o.passed]
    themes = list(dict.fromkeys(o.row.theme for o in outcomes))
    verdict = f"All {len(outcomes)} rows pass" if not failed else f"{len(failed)} of {len(outcomes)} rows fail"
    parts = [
        "<!doctype html><html lang=en><head><meta charset=utf-8><title>Validation of stickslip</title>",
        "<meta name=viewport content='width=device-width'>",
        f"<style>{_STYLE}</style>{STYLE}</head><body class=stickslip>",
        "<h1>Validation of stickslip</h1>",
        f"<p class='mark {'bad' if failed else 'good'}'>{verdict}</p>",
        "<p>Each row compares what <code>simulate</code> computes with an answer that owes it nothing: "
        "a closed form, a published number, a law of physics, a symmetry. The <b>error</b> is the largest one "
        "found and must not exceed the <b>bound</b>, a fixed number in the row. "
        "Errors are relative unless a row says otherwise.</p>",
        "<nav>" + "".join(f"<a href='#{_anchor(theme)}'>{escape(theme)}</a>" for theme in themes) + "</nav>",
    ]
    if failed:
        parts += ["<h2>What failed</h2>", _table(failed)]
    if tried := [(kind.capitalize(), *counts) for kind, *counts in summary(outcomes)]:
        parts.append("<h2>What was tried</h2><p>One by one, each within a time limit.</p>")
        parts.append(table(("", "Tried", "Checks", "Wrong", "Hung"), tried))
    parts.append(
        _figure(
            _overview(outcomes, themes),
            "Every row is a point: its measured error over its bound. Points on the left edge are exact; a point "
            "right of the line has failed, and stands at the right edge where it is far off or gave no answer.",
        )
    )
    for theme in themes:
        chosen = [o for o in outcomes if o.row.theme == theme]
        good = f"<small>{sum(o.passed for o in chosen)} of {len(chosen)} pass</small>"
        parts.append(f"<h2 id='{_anchor(theme)}'>{escape(theme)} {good}</h2>")
        parts.append(f"<p>{escape(ABOUT.get(theme, ''))}</p>")
        parts += [
            _story(story(), unit) for start, story, unit in STORIES if any(o.row.name.startswith(start) for o in chosen)
        ]
        parts.append(_table(chosen))
    packages = ("stickslip", "numpy", "scipy", "scikit-sundae", "mpmath")
    parts.append(
        f"<footer><code>{escape(command)}</code>, {seconds:.0f} s, {datetime.now(UTC):%d %B %Y, %H:%M} UTC. "
        f"{', '.join(f'{name} {version(name)}' for name in packages)}; Python {sys.version.split()[0]}, "
        f"{platform.system()} {platform.machine()}.</footer>"
    )
    return "\n".join(parts) + "</body></html>\n"


def _anchor(theme: str) -> str:
    return theme.lower().replace(" ", "-")


def _table(outcomes: Sequence[Outcome]) -> str:
    heads = ("", "What was checked", "Against", "Error", "Bound", "Time")
    return (
        "<table><tr>"
        + "".join(f"<th>{head}</th>" for head in heads)
        + "</tr>"
        + "".join(map(_row, outcomes))
        + "</table>"
    )


def _row(outcome: Outcome) -> str:
    row = outcome.row
    mark = "<span class='mark good'>✓</span>" if outcome.passed else "<span class='mark bad'>✗</span>"
    remark = f"<div class=remark>{escape(outcome.remark)}</div>" if outcome.remark else ""
    what = f"{escape(row.what[:1].upper() + row.what[1:])}<br><code>{escape(row.name)}</code>{remark}"
    numbers = (number(outcome.error), number(row.bound), f"{outcome.seconds:.2f} s")
    cells = "".join(f"<td>{text}</td>" for text in (mark, what, escape(row.source)))
    return f"<tr>{cells}" + "".join(f"<td class=number>{text}</td>" for text in numbers) + "</tr>"


# Figures

# Motions to draw: the beginning of the names of their rows, the story, and the unit of its velocities.
STORIES: tuple[tuple[str, Callable[[], Story], str], ...] = (
    ("two-flywheels", two_flywheels, "rad/s"),
    ("reference-flywheels-4/", lambda: reference("flywheels-4"), "rad/s"),
    ("pulled-block", pulled_block, "m/s"),
    ("reference-two-blocks", lambda: reference("two-blocks"), "m/s"),
)


def _figure(figure: Figure, caption: str) -> str:
    return f"<figure>{vector(figure, caption)}<figcaption>{escape(caption)}</figcaption></figure>"


def _overview(outcomes: Sequence[Outcome], themes: Sequence[str]) -> Figure:
    figure = Figure(figsize=(10, 0.55 * len(themes) + 1.2), layout="constrained")
    axes = figure.subplots()
    random = np.random.default_rng(0)
    lowest, highest = 1e-9, 30.0
    for place, theme in enumerate(themes):
        rows = [o for o in outcomes if o.row.theme == theme]
        ratios = [o.error / o.row.bound if o.row.bound > 0 else (0.0 if o.passed else math.inf) for o in rows]
        ratio = np.clip(np.nan_to_num(ratios, nan=math.inf), lowest, highest)
        height = place + random.uniform(-0.25, 0.25, len(rows))
        axes.scatter(ratio, height, s=16, c=[GOOD if o.passed else BAD for o in rows], alpha=0.75)
    axes.axvline(1.0, color=BAD, linewidth=1)
    axes.set(xscale="log", xlim=(lowest / 2, 2 * highest), ylim=(len(themes) - 0.4, -0.6))
    axes.set_xlabel("error / bound")
    axes.set_yticks(range(len(themes)), themes)
    return figure


def _story(story: Story, unit: str) -> str:
    """Draw a motion: as computed and exact, the error, the modes."""
    figure = Figure(figsize=(10, 5.6), layout="constrained")
    top, middle, low = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 0.5 + 0.25 * len(story.scene.contacts)))
    results = {f: simulated(story, f) for f in FORMULATIONS}
    first = results["contact-force"]
    last = 1.3 * story.events[-1][0]
    stop = last if last < 0.5 * story.stop else story.stop
    shown = np.flatnonzero(story.t <= stop)
    shown = shown[:: max(1, shown.size // 60)]
    for k, body in enumerate(story.bodies):
        (line,) = top.plot(story.t, first.velocity(body), label=body)
        top.plot(story.t[shown], story.velocities[shown, k], "o", color=line.get_color(), markersize=3)
    top.set(ylabel=f"velocity [{unit}]", xlim=(0, stop))
    top.legend(ncols=len(story.bodies))
    scale = np.abs(story.velocities).max()
    for k, (name, result) in enumerate(results.items()):
        error = np.abs(story.seen(result) - story.velocities).max(axis=1) / scale
        middle.plot(story.t, np.maximum(error, 1e-17), ("-", "--", ":")[k], label=name)
    middle.set(yscale="log", ylabel="velocity error")
    middle.legend(ncols=3)
    plots.modes(first, ax=low)
    events = [e for e in first.events if e.cause != "open"]
    worst = max(abs(e.t - t) for e, (t, *_) in zip(events, story.events, strict=True))
    title = f"{story.title[:1].upper()}{story.title[1:]}".replace("-", " ")
    caption = (
        f"{title}. Above: velocities as computed (lines) and exact (dots). Middle: the error over the largest "
        f"velocity, in three formulations. Below: the modes, of whose {len(events)} changes the computed times are "
        f"within {number(float(worst))} s of the exact ones."
    )
    return _figure(figure, caption)
