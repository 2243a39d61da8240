"""A scene as a schematic: bodies are boxes one above the other, with symbols of the elements between them.

It is drawn as quarter-car models are. A symbol between neighbours fills the gap between their boxes. A symbol between
other bodies goes on as a line, dotted behind the boxes that it passes. Lengths are inches of a drawing in its own size.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.patches import FancyArrowPatch, FancyBboxPatch, Rectangle

from stickslip.model.elements import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    Force,
    Gap,
    Gear,
    OneWay,
    Planetary,
    Spring,
    Stop,
    Tie,
)
from stickslip.model.elements.base import Link, Radii
from stickslip.model.laws.dry_friction import DryFriction
from stickslip.model.scene import Scene
from stickslip.model.signals import Constant, Signal
from stickslip.plots import symbols
from stickslip.plots.style import AS_IT_IS, new_figure, own_axes
from stickslip.results.units import units

MOST = 12  # more bodies and drives than this are not drawn
_BOX, _GAP, _LEFT, _RIGHT = 0.36, 0.78, 0.24, 0.24
_LETTER = 0.069  # width of a letter; half of it is little enough to clear everything else
_POINTS = 8.0
_LONGEST = 18


@dataclass(frozen=True)
class _Link:
    """An element between bodies, or between a body and the ground."""

    ends: Mapping[str, str]
    """What is written beside each end, by name of the body."""
    symbol: symbols.Symbol
    label: tuple[str, ...]


def schematic(scene: Scene, *, ax: Any = None) -> Any:
    """Draw a scene as a schematic and return the axes.

    Parameters
    ----------
    scene : Scene
    ax : matplotlib axes, optional
        Where to draw; by default a new figure as large as the scene needs. Letters shrink with the axes.

    Raises
    ------
    TypeError
        If `scene` is something else.
    """
    if not isinstance(scene, Scene):
        raise TypeError(f"schematic: expected a Scene, got {type(scene).__name__}")
    return _Drawing(scene).on(ax)


class _Drawing:
    """A scene with the places of all that is drawn."""

    def __init__(self, scene: Scene) -> None:
        # drives keep room beside many bodies: all of these may be joined to one drive
        drives = scene.drives[: max(MOST - len(scene.bodies), MOST // 2)]
        bodies = scene.bodies[: MOST - len(drives)]
        self.scene = scene
        self.nodes: dict[str, Body | Drive] = {one.name: one for one in (*bodies, *drives)}
        links = [found for element in scene.elements if (found := _link(element, scene)) is not None]
        self.links = [one for one in links if all(end in self.nodes or end == GROUND for end in one.ends)]
        self.pushes = _pushes(scene)
        self.blocks = _blocks(scene)
        # how many are drawn, and how many there are
        self.counts = {
            "bodies and drives": (len(self.nodes), len(scene.bodies) + len(scene.drives)),
            "elements between them": (len(self.links), len(links)),
            "other elements": (len(self.blocks), sum(map(_stands_alone, scene.elements))),
        }
        self.rows = {name: row for row, name in enumerate(_order(list(self.nodes), self.links))}
        self._place()

    def span(self, link: _Link) -> tuple[int, int]:
        """Return the first and the last gap that a link takes; gap k lies below body k."""
        rows = [self.rows[end] for end in link.ends if end in self.rows]
        return min(rows), max(min(rows), max(rows) - (GROUND not in link.ends))

    def _place(self) -> None:
        """Give every link a column, the leftmost that is free along its gaps; short links come first."""
        taken: list[set[int]] = []
        self.column: dict[int, int] = {}
        spans = [self.span(link) for link in self.links]
        for k in sorted(range(len(spans)), key=lambda k: (spans[k][1] - spans[k][0], spans[k][0])):
            gaps = set(range(spans[k][0], spans[k][1] + 1))
            column = next((c for c, used in enumerate(taken) if not used & gaps), len(taken))
            if column == len(taken):
                taken.append(set())
            taken[column] |= gaps
            self.column[k] = column
        widths = [0.0] * max(len(taken), 1)
        for k, link in enumerate(self.links):
            texts = [*link.label, *(f"  {note}" for note in link.ends.values())]
            widths[self.column[k]] = max(widths[self.column[k]], *(_LETTER * len(text) for text in texts))
        widths = [_LEFT + _RIGHT + width + 0.1 for width in widths]
        for name in self.nodes:
            first, last = self._columns(name)
            missing = self._least(name) + 0.1 - sum(widths[first : last + 1])
            widths[last] += max(missing, 0.0)
        self.lefts = [sum(widths[:k]) for k in range(len(widths) + 1)]

    def _top(self, row: int) -> float:
        return -row * (_BOX + _GAP)

    def _x(self, k: int) -> float:
        return self.lefts[self.column[k]] + _LEFT

    def _sides(self, name: str) -> tuple[float, float]:
        """Return the left and the right side of a body's box: it reaches over all links of the body."""
        first, last = self._columns(name)
        left = self.lefts[first]
        return left, max(self.lefts[last] + _LEFT + _RIGHT, left + self._least(name))

    def _columns(self, name: str) -> tuple[int, int]:
        columns = [self.column[k] for k, link in enumerate(self.links) if name in link.ends] or [0]
        return min(columns), max(columns)

    def _hidden(self, name: str) -> list[float]:
        """Return where links between other bodies pass behind a body's box, from left to right."""
        row, (left, right) = self.rows[name], self._sides(name)
        others = [k for k, one in enumerate(self.links) if name not in one.ends]
        found = [self._x(k) for k in others if self.span(self.links[k])[0] < row <= self.span(self.links[k])[1]]
        return sorted(x for x in found if left < x < right)

    def _least(self, name: str) -> float:
        """Return how broad a box must be for its text."""
        return _LETTER * (len(self._text(name)) + 2)

    def _text(self, name: str) -> str:
        one = self.nodes[name]
        unit = units(self.scene, one)
        if isinstance(one, Drive):
            return f"{_short(name)}: drive, {_load('v', one.velocity, unit.velocity)}"
        return f"{_short(name)}: {'' if unit.known else 'inertia '}{_with_unit(one.inertia, unit.inertia)}"

    def on(self, ax: Any) -> Any:
        """Draw on axes, or on those of a new figure."""
        lowest = self._top(len(self.rows) - 1) - _BOX
        if any(self.span(link)[1] == len(self.rows) - 1 for link in self.links):
            lowest -= _GAP
        right = max(self.lefts[-1], *(self._sides(name)[1] for name in self.nodes))
        left = -0.1
        for name, text in self.pushes.items():
            if name in self.nodes:
                left = min(left, self._sides(name)[0] - 0.45 - _LETTER * len(text))
        note = self._note()
        right = max(right, left + _LETTER * len(note), *(end for _, end, _ in self.blocks)) + 0.1
        self.below = lowest
        lowest -= 0.15 + (0.2 if note else 0.0) + (_BOX + 0.1 if self.blocks else 0.0)
        width, height = right - left, 0.15 - lowest
        if ax is None:
            ax = new_figure(width, height).add_axes((0.0, 0.0, 1.0, 1.0))
        ax = own_axes(ax)
        ax.set(xlim=(left, right), ylim=(lowest, 0.15), aspect="equal")
        ax.set_axis_off()
        box = ax.get_window_extent()
        shrunk = min(box.width / width, box.height / height) / ax.figure.dpi
        self._draw(ax)
        if note:
            ax.text(left + 0.05, lowest + 0.05, note, va="bottom", style="italic")
        for text in ax.texts:
            size = _POINTS * shrunk * (0.9 if text.get_gid() == "symbol" else 1.0)
            text.set(fontsize=size, **AS_IT_IS)
        for line in (*ax.lines, *ax.patches):
            line.set_linewidth(line.get_linewidth() * min(shrunk, 1.0))
        return ax

    def _note(self) -> str:
        left = [f"{there - drawn} of {there} {kind}" for kind, (drawn, there) in self.counts.items() if drawn < there]
        return f"not drawn: {', '.join(left)}" if left else ""

    def _draw(self, ax: Any) -> None:
        for name, row in self.rows.items():
            left, right = self._sides(name)
            driven = isinstance(self.nodes[name], Drive)
            box = (left, self._top(row) - _BOX), right - left, _BOX
            inside = Rectangle(*box, facecolor="0.88", linewidth=0.0, zorder=2)
            if driven:
                inside.set(facecolor="white", hatch="////", edgecolor="0.6")
            ax.add_patch(inside)
            ax.add_patch(Rectangle(*box, fill=False, linewidth=1.2, zorder=5))
            hidden = self._hidden(name)
            for x in hidden:
                # dots show that a link passes behind the box and does not join it
                ax.plot([x, x], [box[0][1], self._top(row)], color="0.2", linewidth=1.0, linestyle=":", zorder=3)
            text: dict[str, Any] = {"ha": "center", "va": "center", "zorder": 6}
            if driven:
                text["bbox"] = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
            sides = [left, *hidden, right]
            free = max(range(len(hidden) + 1), key=lambda k: sides[k + 1] - sides[k])
            middle = 0.5 * (sides[free] + sides[free + 1])
            ax.text(middle, self._top(row) - 0.5 * _BOX, self._text(name), **text)
            if name in self.pushes:
                self._push(ax, left, self._top(row) - 0.5 * _BOX, self.pushes[name])
        for k, link in enumerate(self.links):
            self._join(ax, k, link)
        for left, right, name in self.blocks:
            low = self.below - _BOX - 0.1
            shape = FancyBboxPatch((left, low), right - left, _BOX, boxstyle="round,pad=0,rounding_size=0.12")
            shape.set(facecolor="white", edgecolor="black", linewidth=1.1, linestyle="--")
            ax.add_patch(shape)
            ax.text(0.5 * (left + right), low + 0.5 * _BOX, name, ha="center", va="center")

    def _push(self, ax: Any, x: float, y: float, text: str) -> None:
        look: dict[str, Any] = {"color": "black", "linewidth": 1.2, "zorder": 4}
        ends = (x - 0.38, y), (x, y)
        ax.add_patch(FancyArrowPatch(*ends, arrowstyle="-|>", mutation_scale=9, shrinkA=0, shrinkB=0, **look))
        ax.text(x - 0.42, y, text, ha="right", va="center", zorder=4)

    def _join(self, ax: Any, k: int, link: _Link) -> None:
        x, rows = self._x(k), sorted(self.rows[end] for end in link.ends if end in self.rows)
        high = self._top(rows[0]) - _BOX
        low = high - _GAP if len(rows) > 1 else high - _GAP + 0.16
        symbol = link.symbol
        if symbol is symbols.one_way and self.rows.get(next(iter(link.ends)), len(self.rows)) > rows[0]:
            # its first end, which drives, is the lower one
            symbol = symbols.one_way_up
        symbol(ax, x, low, high)
        if len(rows) > 1:
            end = self._top(rows[-1])
            ax.plot([x, x], [low, end], color="black", linewidth=1.1, zorder=1)
            for row in rows[1:-1]:
                # points where the line joins a body on its way, which it would else seem to pass
                for y in (self._top(row), self._top(row) - _BOX):
                    ax.plot([x], [y], "o", color="black", markersize=3.5, zorder=6)
        if GROUND in link.ends:
            bottom = low if len(rows) == 1 else self._top(rows[-1]) - _BOX - _GAP + 0.16
            if len(rows) > 1:
                ax.plot([x, x], [self._top(rows[-1]), bottom], color="black", linewidth=1.1, zorder=1)
            symbols.ground(ax, x, bottom)
        middle = 0.5 * (low + high)
        ax.text(x + _RIGHT, middle, "\n".join(link.label), va="center", linespacing=1.15, zorder=4)
        for name, note in link.ends.items():
            if note and name in self.rows:
                # beside the end: above a box where the link comes from above, else below it
                above = self.rows[name] > rows[0]
                y = self._top(self.rows[name]) + (0.09 if above else -_BOX - 0.09)
                ax.text(x + 0.06, y, note, va="center", zorder=4, gid="symbol", color="0.25")


def _order(names: list[str], links: Sequence[_Link]) -> list[str]:
    """Return names in an order in which links are short: moved one by one from the order given while that helps."""
    ends = [[end for end in link.ends if end != GROUND] for link in links]
    ends = [some for some in ends if len(some) > 1]

    def length(order: list[str]) -> int:
        place = {name: k for k, name in enumerate(order)}
        return sum(max(at) - min(at) for some in ends if (at := [place[end] for end in some]))

    best, shortest = names, length(names)
    while True:
        orders = [
            [*rest[:k], name, *rest[k:]]
            for name in best
            if (rest := [other for other in best if other != name])
            for k in range(len(best))
        ]
        found = min(orders, key=length, default=best)
        if length(found) >= shortest:
            return best
        best, shortest = found, length(found)


def _link(element: Any, scene: Scene) -> _Link | None:
    """Return how an element is drawn between bodies; None for bodies, drives and forces."""
    if isinstance(element, (Body, Drive, Force)):
        return None
    ends = dict.fromkeys(_ends(element), "")
    if not ends:
        return None
    if isinstance(element, Radii):
        at = zip((element.a, element.b), element.radii, strict=True)
        ends |= {end: f"r = {radius:.4g}" for end, radius in at if radius != 1}
    name = (_short(element.name),) if hasattr(element, "name") else ()
    unit = units(scene, element)
    symbol: symbols.Symbol = symbols.link
    label: tuple[str, ...] = (element.noun(),)
    match element:
        case Contact():
            law = () if type(element.law) is DryFriction else (type(element.law).__name__,)
            symbol, label = symbols.plates, (_load("N", element.normal, "N"), *law)
        case Spring():
            symbol = symbols.spring_and_dashpot if element.damping else symbols.spring
            damping = (f"c = {_with_unit(element.damping, unit.damping)}",) if element.damping else ()
            label = (f"k = {_with_unit(element.stiffness, unit.stiffness)}", *damping)
        case Damper():
            symbol, label = symbols.dashpot, (f"c = {_with_unit(element.damping, unit.damping)}",)
        case Gear():
            symbol, label = symbols.gears, (f"{_short(element.a)} = {element.ratio:.4g} ×", _short(element.b))
        case OneWay():
            symbol, label = symbols.one_way, (f"{_short(element.a)} drives",)
        case Planetary():
            ends = {element.sun: "sun", element.carrier: "carrier", element.ring: "ring"}
            symbol, label = symbols.planetary, (f"ratio {element.ratio:.4g}",)
        case Gap() | Stop():
            symbol = symbols.gap if isinstance(element, Gap) else symbols.stop
            label = (f"{element.lower:.3g} to {element.upper:.3g}",)
        case Tie():
            ends = {end: f"× {c:.4g}" for end, c in element.coefficients.items()}
            symbol, label = symbols.relation, ()
    return _Link(ends, symbol, (*name, *label))


def _ends(element: Any) -> list[str]:
    """Return the names of the bodies that an element of any kind joins."""
    return [element.a, element.b] if isinstance(element, Link) else list(getattr(element, "coefficients", ()))


def _stands_alone(element: Any) -> bool:
    """Tell whether an element joins no bodies and acts on none, such as a block."""
    return not (isinstance(element, (Body, Drive, Force)) or _ends(element))


def _blocks(scene: Scene) -> list[tuple[float, float, str]]:
    """Return left side, right side and text of elements that join no bodies, such as blocks, all in one line."""
    found: list[tuple[float, float, str]] = []
    left = 0.0
    for element in scene.elements:
        if not _stands_alone(element):
            continue
        text = f"{element.noun()} {_short(getattr(element, 'name', ''))}".rstrip()
        right = left + _LETTER * (len(text) + 2)
        if len(found) < MOST:
            found.append((left, right, text))
        left = right + 0.15
    return found


def _pushes(scene: Scene) -> dict[str, str]:
    """Return the text at the forces on each body."""
    found: dict[str, Counter[str]] = {}
    for force in scene.forces:
        found.setdefault(force.body, Counter())[_load("F", force.signal, units(scene, force).force)] += 1
    return {
        body: _short(", ".join(text if n == 1 else f"{n} × {text}" for text, n in texts.items()))
        for body, texts in found.items()
    }


def _load(symbol: str, load: Any, unit: str) -> str:
    """Return a constant load with its unit, any other with what it depends on."""
    if isinstance(load, Constant):
        return f"{symbol} = {_with_unit(load.value, unit)}"
    return f"{symbol}(t)" if isinstance(load, Signal) else f"{symbol}(t, state)"


def _with_unit(value: float, unit: str) -> str:
    """Return a number with its unit; where there are two possible units, without."""
    return f"{value:.4g}" if "|" in unit else f"{value:.4g} {unit}"


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"
