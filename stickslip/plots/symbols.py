"""Symbols of a schematic: each stands on the vertical line between two bodies, in inches of the drawing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from matplotlib.patches import Circle, Polygon, Rectangle

# A function that draws on axes, at a place x, from a lower to an upper end.
Symbol = Callable[[Any, float, float, float], None]

_LINE: dict[str, Any] = {"color": "black", "linewidth": 1.1, "solid_capstyle": "butt", "zorder": 3}
_THICK: dict[str, Any] = _LINE | {"linewidth": 2.2}
_SHAPE: dict[str, Any] = {"facecolor": "white", "edgecolor": "black", "linewidth": 1.1, "zorder": 3}


def _leads(ax: Any, x: float, low: float, high: float, half: float) -> tuple[float, float]:
    """Draw the lines from both ends to a symbol of height ``2 half`` in the middle; return its lower and upper end."""
    middle = 0.5 * (low + high)
    ax.plot([x, x], [low, middle - half], **_LINE)
    ax.plot([x, x], [middle + half, high], **_LINE)
    return middle - half, middle + half


def plates(ax: Any, x: float, low: float, high: float) -> None:
    """Draw a friction contact: two plates, pressed together on a rough surface."""
    bottom, top = _leads(ax, x, low, high, 0.05)
    for y in (bottom, top):
        ax.plot([x - 0.16, x + 0.16], [y, y], **_THICK)
    for k in range(6):
        left = x - 0.15 + 0.05 * k
        ax.plot([left, left + 0.04], [bottom, top], **_LINE | {"linewidth": 0.7})


def spring(ax: Any, x: float, low: float, high: float) -> None:
    """Draw a spring: a zigzag."""
    bottom, top = _leads(ax, x, low, high, 0.2)
    _zigzag(ax, x, bottom, top)


def dashpot(ax: Any, x: float, low: float, high: float) -> None:
    """Draw a damper: a piston in a cup."""
    bottom, top = _leads(ax, x, low, high, 0.13)
    _piston(ax, x, bottom, top)


def spring_and_dashpot(ax: Any, x: float, low: float, high: float) -> None:
    """Draw a spring with its damper in parallel."""
    bottom, top = _leads(ax, x, low, high, 0.24)
    for y in (bottom, top):
        ax.plot([x - 0.11, x + 0.11], [y, y], **_LINE)
    _zigzag(ax, x - 0.11, bottom, top)
    middle = 0.5 * (bottom + top)
    for y, end in ((middle - 0.1, bottom), (middle + 0.1, top)):
        ax.plot([x + 0.11, x + 0.11], [y, end], **_LINE)
    _piston(ax, x + 0.11, middle - 0.1, middle + 0.1, 0.06)


def _zigzag(ax: Any, x: float, bottom: float, top: float, turns: int = 8) -> None:
    heights = [bottom + (top - bottom) * k / turns for k in (0, *(j + 0.5 for j in range(turns)), turns)]
    sides = [x, *(x + (0.08 if j % 2 else -0.08) for j in range(turns)), x]
    ax.plot(sides, heights, **_LINE)


def _piston(ax: Any, x: float, bottom: float, top: float, half: float = 0.1) -> None:
    middle = 0.5 * (bottom + top)
    ax.plot([x - half, x - half, x + half, x + half], [top, bottom, bottom, top], **_LINE)
    ax.plot([x - 0.7 * half, x + 0.7 * half], [middle, middle], **_THICK)
    ax.plot([x, x], [middle, top], **_LINE)


def gears(ax: Any, x: float, low: float, high: float) -> None:
    """Draw a pair of gears: two wheels that touch."""
    bottom, top = _leads(ax, x, low, high, 0.22)
    for y, radius in ((top - 0.13, 0.13), (bottom + 0.09, 0.09)):
        ax.add_patch(Circle((x, y), radius, **_SHAPE))
        ax.add_patch(Circle((x, y), 0.8 * radius, **_SHAPE | {"linestyle": ":", "linewidth": 0.8}))
        ax.add_patch(Circle((x, y), 0.018, **_SHAPE | {"facecolor": "black"}))


def planetary(ax: Any, x: float, low: float, high: float) -> None:
    """Draw a planetary gear: a sun and three planets in a ring."""
    _leads(ax, x, low, high, 0.18)
    middle = 0.5 * (low + high)
    ax.add_patch(Circle((x, middle), 0.18, **_SHAPE))
    ax.add_patch(Circle((x, middle), 0.06, **_SHAPE | {"facecolor": "0.5"}))
    for dx, dy in ((0.0, 0.115), (0.1, -0.0575), (-0.1, -0.0575)):
        ax.add_patch(Circle((x + dx, middle + dy), 0.05, **_SHAPE | {"linewidth": 0.8}))


def relation(ax: Any, x: float, low: float, high: float) -> None:
    """Draw a tie: a sum that is 0."""
    bottom, _ = _leads(ax, x, low, high, 0.13)
    ax.add_patch(Rectangle((x - 0.2, bottom), 0.4, 0.26, **_SHAPE))
    ax.text(x, bottom + 0.125, "Σ = 0", ha="center", va="center", zorder=4, gid="symbol")


def one_way(ax: Any, x: float, low: float, high: float) -> None:
    """Draw a one-way clutch: an arrow from the upper body, which drives, against a bar at the lower one."""
    bottom, top = _leads(ax, x, low, high, 0.12)
    _arrow(ax, x, bottom, top)


def one_way_up(ax: Any, x: float, low: float, high: float) -> None:
    """Draw a one-way clutch whose lower body drives."""
    bottom, top = _leads(ax, x, low, high, 0.12)
    _arrow(ax, x, top, bottom)


def _arrow(ax: Any, x: float, tip: float, foot: float) -> None:
    ax.add_patch(Polygon([(x, tip), (x - 0.13, foot), (x + 0.13, foot)], **_SHAPE | {"facecolor": "0.45"}))
    ax.plot([x - 0.15, x + 0.15], [tip, tip], **_THICK)


def gap(ax: Any, x: float, low: float, high: float) -> None:
    """Draw a gap: a fork around a pin, with a spring on either side."""
    bottom, top = _leads(ax, x, low, high, 0.24)
    for y, end in ((bottom, bottom + 0.16), (top, top - 0.16)):
        _zigzag(ax, x, min(y, end), max(y, end), 5)
        ax.plot([x - 0.1, x + 0.1], [end, end], **_LINE)


def stop(ax: Any, x: float, low: float, high: float) -> None:
    """Draw a rigid stop: two plates apart."""
    bottom, top = _leads(ax, x, low, high, 0.1)
    for y in (bottom, top):
        ax.plot([x - 0.16, x + 0.16], [y, y], **_THICK)


def link(ax: Any, x: float, low: float, high: float) -> None:
    """Draw an element that has no symbol of its own: a box; its label says what it is."""
    bottom, _ = _leads(ax, x, low, high, 0.13)
    ax.add_patch(Rectangle((x - 0.15, bottom), 0.3, 0.26, **_SHAPE | {"hatch": "xxx"}))


def ground(ax: Any, x: float, y: float) -> None:
    """Draw the ground: a line that is hatched below."""
    ax.plot([x - 0.22, x + 0.22], [y, y], **_THICK)
    for k in range(5):
        right = x - 0.14 + 0.085 * k
        ax.plot([right - 0.07, right], [y - 0.08, y], **_LINE | {"linewidth": 0.8})
