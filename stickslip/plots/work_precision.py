"""Drawings of error against time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from textwrap import fill
from typing import Any

from matplotlib.ticker import LogFormatterSciNotation, LogLocator

from stickslip.plots.style import (
    COLOURS,
    LINES,
    MARKERS,
    STUDY,
    check_is,
    is_crowded,
    makes_room,
    own_axes,
    within_or_beside,
)

_NOTES = 6
_WIDTH, _BESIDE_LEGEND = 125, 85  # letters of a note that fit into a figure, and below axes with a legend beside them
_LINES_OF_NOTE = 2
_APART = 0.4  # decades between the heights of families in the grey band below the limit of the reference


def work_precision(table: Any, *, ax: Any = None) -> Any:
    """Draw error against median wall time, both logarithmic, and return the axes.

    Every family has a marker and a line of its own, so that greyscale is enough. The line joins those of its
    rows that no other row of the family beats in both error and time: to join all would draw the noise of the
    clock. Rings mark the rows that no row of any family beats. Rows that cannot be drawn (failures, an error of
    exactly 0) are listed in a note.

    Parameters
    ----------
    table : WorkPrecision
        What `work_precision` measured.
    ax : matplotlib axes, optional
        Where to draw; by default a new figure.

    Raises
    ------
    TypeError
        If `table` is something else.
    """
    check_is(table, "WorkPrecision", "work_precision plot")
    return _errors_against_times(table, own_axes(ax, *STUDY), {})


def _errors_against_times(table: Any, ax: Any, at_floor: dict[int, float]) -> Any:
    """Draw the rows of a study; `at_floor` are heights, by id, of rows whose errors are too small to be measured."""
    families = _by_family(row for row in table.rows if _drawable(row))
    for k, (family, rows) in enumerate(families.items()):
        _family(ax, k, family, rows, table, at_floor)
    front = [row for row in table.pareto() if _drawable(row)]
    if front:
        where = [row.median for row in front], [at_floor.get(id(row), row.error) for row in front]
        ax.scatter(*where, s=150, facecolors="none", edgecolors="black", zorder=3, label="no other beats it")
        within_or_beside(ax)
    ax.set(xscale="log", yscale="log", xlabel="median wall time [s]", ylabel=table.error_label)
    # there is room to label 2 and 5 between the decades, also where the times span less than one decade
    ax.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    ax.xaxis.set_minor_formatter(LogFormatterSciNotation(minor_thresholds=(2, 0.5)))
    ax.grid(True, which="major", linewidth=0.4, alpha=0.6)
    notes = _notes([row for row in table.rows if not _drawable(row)], _BESIDE_LEGEND if is_crowded(ax) else _WIDTH)
    if notes:
        more = [f"and {len(notes) - _NOTES} more"] if len(notes) > _NOTES else []
        note = "not drawn:\n" + "\n".join([*notes[:_NOTES], *more])
        if makes_room(ax):
            below = {"xycoords": "axes fraction", "xytext": (0, -40), "textcoords": "offset points"}
            ax.annotate(note, (0, 0), va="top", fontsize="small", annotation_clip=False, **below)
        else:
            ax.text(0.02, 0.02, note, transform=ax.transAxes, fontsize="x-small", wrap=True)
    return ax


def _family(ax: Any, k: int, family: str, rows: list[Any], table: Any, at_floor: dict[int, float]) -> None:
    """Draw all rows of a family as markers, and a line through those that no other of them beats."""
    colour = COLOURS[k % len(COLOURS)]
    marker: dict[str, Any] = {"marker": MARKERS[k % len(MARKERS)], "color": colour}
    line: dict[str, Any] = {"linestyle": LINES[k % len(LINES)], "color": colour, "linewidth": 1.2}
    best = replace(table, rows=tuple(rows)).pareto()
    for some, style in ((rows, marker | {"linestyle": "none"}), (best, line)):
        heights = [at_floor.get(id(row), row.error) for row in some]
        ax.plot([row.median for row in some], heights, **style)
    ax.plot([], [], label=family, **marker | line)


def tradeoff(study: Any, *, ax: Any = None) -> Any:
    """Draw error against time of a scene's calls, down to the limit of the reference, and return the axes.

    Errors below the limit cannot be measured. Calls with such errors stand in the grey band, where the height only
    keeps families apart.

    Parameters
    ----------
    study : Tradeoff
        What `tradeoff` measured.
    ax : matplotlib axes, optional
        Where to draw; by default a new figure.
    """
    families = _by_family(row for row in study.work.rows if _drawable(row) and row.error <= study.limit)
    lower = [study.limit * 10 ** (-_APART * (k + 1)) for k in range(len(families))]
    heights = {id(row): y for y, rows in zip(lower, families.values(), strict=True) for row in rows}
    ax = _errors_against_times(study.work, own_axes(ax, *STUDY), heights)
    ax.axhspan(0, study.limit, color="0.85", zorder=0, label="below what the reference can tell")
    ax.set_ylim(bottom=study.limit * 10 ** (-_APART * (len(families) + 1)))
    within_or_beside(ax)
    return ax


def _by_family(rows: Iterable[Any]) -> dict[str, list[Any]]:
    families: dict[str, list[Any]] = {}
    for row in rows:
        families.setdefault(row.family or row.name, []).append(row)
    return families


def _drawable(row: Any) -> bool:
    return row.failure is None and row.error > 0


def _notes(rows: list[Any], width: int) -> list[str]:
    """Return a note for each family of which rows cannot be drawn, and why the first of them cannot.

    Its lines have at most `width` letters.
    """
    lines = []
    for name, some in _by_family(rows).items():
        first = some[0]
        counted = f"{name}, {len(some)} of its calls" if len(some) > 1 else first.name
        why = f"error 0 in {first.median:.3g} s" if first.failure is None else first.failure.split("\n")[0]
        lines.append(
            fill(f"{counted}: {why}", width, max_lines=_LINES_OF_NOTE, placeholder=" …", subsequent_indent="    ")
        )
    return lines
