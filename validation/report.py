"""The table as one page that needs nothing else: what was checked, against what, how exactly, and pictures of it."""

from __future__ import annotations

import html
import io
import math
import platform
import sys
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from stickslip import simulate
from validation.exact import Story, pulled_block, reference, simulated, two_flywheels
from validation.published import CLUTCH_EVENTS, coupled_clutches
from validation.rows import FORMULATIONS, Outcome
from validation.tried import as_html

COLOURS = ("#2a6f97", "#d1495b", "#66a182", "#8d6a9f")
INK, FAINT = "#24292f", "#8c959f"
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
}

_STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.55 system-ui, -apple-system, 'Segoe UI', 'Liberation Sans', sans-serif; color: #24292f;
  background: #fff; max-width: 70rem; margin: 0 auto; padding: 2.5rem 1.5rem 4rem; }
h1 { font-size: 1.9rem; margin: 0 0 .3rem; letter-spacing: -.01em; }
h2 { font-size: 1.3rem; margin: 3rem 0 .4rem; }
h2 small { font-weight: normal; color: #57606a; font-size: .95rem; margin-left: .6rem; }
p { max-width: 46rem; margin: .5rem 0 1rem; }
.verdict { display: inline-block; padding: .35rem .9rem; border-radius: 1rem; font-weight: 600; margin: .8rem 0; }
.good { background: #dafbe1; color: #116329; } .bad { background: #ffebe9; color: #a40e26; }
table { border-collapse: collapse; width: 100%; font-size: .88rem; margin: .8rem 0 1.5rem; }
th { text-align: left; font-weight: 600; color: #57606a; border-bottom: 2px solid #d0d7de; padding: .35rem .6rem; }
td { border-bottom: 1px solid #eaeef2; padding: .35rem .6rem; vertical-align: top; }
td.n, th.n { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums; }
table.t { width: auto; } td code { color: #57606a; font-size: .8rem; } div.r { color: #57606a; font-size: .82rem; }
td.r { color: #57606a; white-space: nowrap; } sup { line-height: 0; }
tr.fail td { background: #fff5f5; } .mark { font-weight: 700; }
.fail .mark { color: #cf222e; } .ok .mark { color: #1a7f37; }
figure { margin: 1.2rem 0 2rem; } figure svg { width: 100%; height: auto; }
figcaption { color: #57606a; font-size: .88rem; max-width: 46rem; }
footer { margin-top: 3rem; color: #57606a; font-size: .82rem; border-top: 1px solid #d0d7de; padding-top: .8rem; }
nav a { margin-right: 1.2rem; color: #0969da; text-decoration: none; }
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
    verdict = (
        f"All {len(outcomes)} rows pass" if not failed else f"{len(failed)} of {len(outcomes)} rows fail"
    )
    parts = [
        "<!doctype html><html lang=en><head><meta charset=utf-8><title>Validation of stickslip</title>",
        "<meta name=viewport content='width=device-width'>",
        f"<style>{_STYLE}</style></head><body>",
        "<h1>Validation of stickslip</h1>",
        f"<div class='verdict {'bad' if failed else 'good'}'>{verdict}</div>",
        "<p>Each row compares what <code>simulate</code> computes with an answer that owes it nothing: "
        "a closed form, a published number, a law of physics, a symmetry. The <b>error</b> is the largest one "
        "found and must not exceed the <b>bound</b>, a fixed number in the row. "
        "Errors are relative unless a row says otherwise.</p>",
        "<nav>"
        + "".join(f"<a href='#{_anchor(theme)}'>{html.escape(theme)}</a>" for theme in themes)
        + "</nav>",
    ]
    if failed:
        parts += ["<h2>What failed</h2>", _table(failed)]
    parts.append(as_html(outcomes))
    parts.append(
        _figure(
            _overview(outcomes, themes),
            "Every row is a point: its measured error over its bound. Points on the left edge are exact; a point "
            "right of the line has failed, and stands at the right edge where it is far off or gave no answer.",
        )
    )
    for theme in themes:
        chosen = [o for o in outcomes if o.row.theme == theme]
        good = sum(o.passed for o in chosen)
        parts.append(
            f"<h2 id='{_anchor(theme)}'>{html.escape(theme)}<small>{good} of {len(chosen)} pass</small></h2>"
        )
        parts.append(f"<p>{html.escape(ABOUT.get(theme, ''))}</p>")
        parts += _figures_of(theme, chosen)
        parts.append(_table(chosen))
    parts.append(_footer(command, seconds))
    return "\n".join(parts) + "</body></html>\n"


def _anchor(theme: str) -> str:
    return theme.lower().replace(" ", "-")


def _table(outcomes: Sequence[Outcome]) -> str:
    """Return rows as a table; the formulations of one check share a row."""
    groups: dict[str, list[Outcome]] = {}
    for o in outcomes:
        groups.setdefault(o.row.name.split("/")[0], []).append(o)
    head = (
        "<table><thead><tr><th></th><th>What was checked</th><th>Against</th><th></th>"
        "<th class=n>Error</th><th class=n>Bound</th><th class=n>Time</th></tr></thead><tbody>"
    )
    return head + "".join(_row(name, group) for name, group in groups.items()) + "</tbody></table>"


def _row(name: str, group: Sequence[Outcome]) -> str:
    kind = "ok" if all(o.passed for o in group) else "fail"
    formulations = [o.row.name.partition("/")[2] for o in group]
    what = group[0].row.what.removesuffix(f" ({formulations[0]})")
    telling = [o for o in group if o.remark and not o.passed] or [o for o in group if o.remark][:1]
    remarks = "".join(
        f"<div class=r>{html.escape(remark)}</div>" for remark in dict.fromkeys(o.remark for o in telling)
    )
    columns = (
        ("mark", ["✓" if o.passed else "✗" for o in group]),
        ("", [f"{_sentence(what)}<br><code>{html.escape(name)}</code>{remarks}"]),
        ("", [html.escape(group[0].row.source)]),
        ("r", formulations),
        ("n", [_power(o.error) for o in group]),
        ("n", [_power(o.row.bound) for o in group]),
        ("n", [f"{o.seconds:.2f} s" for o in group]),
    )
    cells = "".join(f"<td class='{look}'>{'<br>'.join(lines)}</td>" for look, lines in columns)
    return f"<tr class={kind}>{cells}</tr>"


def _sentence(text: str) -> str:
    return html.escape(text[:1].upper() + text[1:])


def _power(x: float) -> str:
    text = number(x)
    if "e" not in text:
        return text
    mantissa, exponent = text.split("e")
    factor = "" if mantissa == "1.0" else f"{mantissa}\N{THIN SPACE}·\N{THIN SPACE}"
    return f"{factor}10<sup>{int(exponent)}</sup>".replace("-", "\N{MINUS SIGN}")


def _footer(command: str, seconds: float) -> str:
    packages = ", ".join(
        f"{name} {version(name)}" for name in ("stickslip", "numpy", "scipy", "scikit-sundae", "mpmath")
    )
    when = datetime.now(UTC).strftime("%d %B %Y, %H:%M UTC")
    return (
        f"<footer><code>{html.escape(command)}</code>, {seconds:.0f} s, {when}. {html.escape(packages)}; "
        f"Python {sys.version.split()[0]}, {platform.system()} {platform.machine()}.</footer>"
    )


# Figures

_LOOK: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.sans-serif": ["system-ui", "Segoe UI", "Liberation Sans", "DejaVu Sans", "sans-serif"],
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "legend.frameon": False,
    "lines.linewidth": 1.4,
}


def _figure(draw: Callable[[], Figure], caption: str) -> str:
    with mpl.rc_context(_LOOK | {"svg.hashsalt": caption}):
        drawn = io.StringIO()
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        draw().savefig(drawn, format="svg", metadata=nothing, transparent=True, bbox_inches="tight")
    text = drawn.getvalue()
    return f"<figure>{text[text.index('<svg') :]}<figcaption>{html.escape(caption)}</figcaption></figure>"


def _overview(outcomes: Sequence[Outcome], themes: Sequence[str]) -> Callable[[], Figure]:
    def draw() -> Figure:
        figure = Figure(figsize=(10, 0.55 * len(themes) + 1.2))
        axes = figure.subplots()
        random = np.random.default_rng(0)
        lowest = 1e-9
        for place, theme in enumerate(themes):
            rows = [o for o in outcomes if o.row.theme == theme]
            ratio = np.clip([_ratio(o) for o in rows], lowest, 30.0)
            height = place + random.uniform(-0.25, 0.25, len(rows))
            colours = [COLOURS[0] if o.passed else "#cf222e" for o in rows]
            axes.scatter(ratio, height, s=16, c=colours, alpha=0.75, linewidths=0)
        axes.axvline(1.0, color="#cf222e", linewidth=1)
        axes.text(1.2, -0.62, "bound", color="#cf222e", va="center")
        axes.set(
            xscale="log", xlim=(lowest / 2, 60.0), ylim=(len(themes) - 0.4, -0.85), xlabel="error / bound"
        )
        axes.set_yticks(range(len(themes)), themes)
        axes.tick_params(axis="y", length=0)
        axes.spines["left"].set_visible(False)
        return figure

    return draw


def _ratio(outcome: Outcome) -> float:
    error, bound = outcome.error, outcome.row.bound
    if bound > 0 and math.isfinite(error):
        return error / bound
    return 0.0 if outcome.passed else math.inf


def _figures_of(theme: str, outcomes: Sequence[Outcome]) -> list[str]:
    names = [o.row.name for o in outcomes]
    ran = lambda start: any(name.startswith(start) for name in names)  # noqa: E731
    if theme == "Closed forms":
        stories: list[tuple[str, Callable[[], Story], str]] = [
            ("two-flywheels", two_flywheels, "rad/s"),
            ("four-flywheels", "rad/s"),
            ("pulled-block", pulled_block, "m/s"),
            ("reference-two-blocks", lambda: reference("two-blocks"), "m/s"),
        ]
        return [_story_figure(story(), unit) for name, story, unit in stories if ran(name)]
    if theme == "Published results" and ran("coupled-clutches"):
        caption = (
            "Coupled clutches: four shafts that three clutches join. Lines as computed, vertical lines at the "
            "exact times of the six changes of mode; below, which clutch is stuck when."
        )
        return [_figure(_clutches, caption)]
    if theme == "Extremes" and ran("rtol-"):
        points = [(float(o.row.name[5:]), o.error) for o in outcomes if o.row.name.startswith("rtol-")]
        caption = "The pulled block at several tolerances: the error follows the tolerance."
        return [_figure(_tolerances(points), caption)]
    return []


def _story_figure(story: Story, unit: str) -> str:
    def draw() -> Figure:
        figure = Figure(figsize=(10, 5.6))
        top, middle, low = figure.subplots(
            3, 1, sharex=True, height_ratios=(3, 2, 0.5 + 0.25 * len(_contacts(story)))
        )
        results = {f: simulated(story, f) for f in FORMULATIONS}
        first = results["contact-force"]
        last = 1.3 * story.events[-1][0]
        stop = last if last < 0.5 * story.stop else story.stop
        every = max(1, int(story.t.size * stop / story.stop) // 60)
        for k, body in enumerate(story.bodies):
            colour = COLOURS[k % len(COLOURS)]
            top.plot(story.t, first.velocity(body), color=colour, label=body)
            top.plot(
                story.t[::every], story.velocities[::every, k], "o", color=colour, markersize=3, alpha=0.5
            )
        top.set(
            ylabel=f"velocity [{unit}]", title=f"{story.title[:1].upper()}{story.title[1:]}".replace("-", " ")
        )
        top.legend(ncols=len(story.bodies), loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
        scale = np.abs(story.velocities).max()
        for k, (name, result) in enumerate(results.items()):
            v = story.seen(result)
            error = np.abs(v - story.velocities).max(axis=1) / scale
            style: dict[str, Any] = {"linestyle": ("-", "--", ":")[k], "color": COLOURS[k]}
            middle.plot(story.t, np.maximum(error, 1e-17), label=name, **style)
        middle.set(yscale="log", ylabel="velocity error")
        middle.legend(ncols=3, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
        _modes(low, story.events, _contacts(story), story.stop)
        low.set(xlabel="time [s]", xlim=(0, stop))
        figure.align_ylabels()
        return figure

    worst = max(
        abs(e.t - t)
        for e, (t, *_) in zip(
            [e for e in simulated(story).events if e.cause != "open"], story.events, strict=True
        )
    )
    caption = (
        f"{story.title[:1].upper()}{story.title[1:]}. Above: velocities as computed (lines) and exact (dots). Middle: "
        "the error over the largest velocity, in three formulations. Below: when each contact is "
        f"stuck, from the exact event times, of which the {len(story.events)} computed ones are "
        f"within {number(float(worst))} s."
    )
    return _figure(draw, caption)


def _contacts(story: Story) -> list[str]:
    return [c.name for c in story.scene.contacts]


def _modes(axes: Any, events: Sequence[Any], contacts: Sequence[str], stop: float) -> None:
    """Draw a bar wherever a contact is stuck, and a tick at each event."""
    for row, contact in enumerate(contacts):
        own = [(t, before, after) for t, name, before, after in events if name == contact]
        edges = [0.0, *(t for t, _, _ in own), stop]
        modes = [own[0][1] if own else 0, *(after for _, _, after in own)]
        for left, right, mode in zip(edges[:-1], edges[1:], modes, strict=True):
            if mode == 0 and own:
                axes.barh(
                    row, right - left, left=left, height=0.55, color=COLOURS[0], alpha=0.35, linewidth=0
                )
        axes.plot([t for t, _, _ in own], [row] * len(own), "|", color=INK, markersize=9)
    axes.set_yticks(range(len(contacts)), contacts)
    axes.set_ylim(len(contacts) - 0.4, -0.6)
    axes.set_ylabel("stuck")
    axes.tick_params(axis="y", length=0)


def _clutches() -> Figure:
    figure = Figure(figsize=(10, 4.4))
    top, low = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    result = simulate(
        coupled_clutches(), (0.0, 1.5), rtol=1e-10, atol=1e-12, t_eval=np.linspace(0.0, 1.5, 601)
    )
    for k in (1, 2, 3, 4):
        top.plot(result.t, result.velocity(f"J{k}"), color=COLOURS[k - 1], label=f"J{k}")
    for t, *_ in CLUTCH_EVENTS:
        top.axvline(t, color=FAINT, linewidth=0.7)
    top.set(ylabel="velocity [rad/s]", title="Coupled clutches")
    top.legend(ncols=4, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
    _modes(low, CLUTCH_EVENTS, ["clutch1", "clutch2", "clutch3"], 1.5)
    low.set(xlabel="time [s]", xlim=(0, 1.5))
    figure.align_ylabels()
    return figure


def _tolerances(points: Sequence[tuple[float, float]]) -> Callable[[], Figure]:
    def draw() -> Figure:
        figure = Figure(figsize=(10, 3.6))
        axes = figure.subplots()
        rtol = np.array([p for p, _ in points])
        error = np.array([p * e for p, e in points])
        axes.loglog(rtol, rtol, color=FAINT, linewidth=1)
        axes.annotate(
            "error = rtol", (rtol[-1], rtol[-1]), xytext=(8, -2), textcoords="offset points", color=FAINT
        )
        axes.loglog(rtol, error, "o-", color=COLOURS[0])
        axes.invert_xaxis()
        axes.set(xlabel="relative tolerance", ylabel="largest error", title="Tolerance and error")
        return figure

    return draw
