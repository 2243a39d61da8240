"""The book in which elements place themselves: bodies, rows, couplings, forces."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from stickslip.model.laws.dry_friction import Law
from stickslip.model.piecewise import Linear, Region
from stickslip.model.signals import Constant, Load, Signal

__all__ = ["GROUND", "Book", "Coupling", "Piecewise", "RowEntry"]

GROUND = "ground"
"""Name of the ground: a body that never moves."""


@dataclass(frozen=True)
class RowEntry:
    """``w = sum c_i v_i`` over bodies and drives; its force r acts with ``-c_i r`` on body i.

    Attributes
    ----------
    name : str
    coefficients : dict of int to float
        By index of the body or drive.
    law : Law or None
        The friction law; None for a row of another kind.
    kind : str
        "friction", "tie" (always held), "one-way" (held while its force is positive) or "gap" (never held: its force
        is a piecewise-linear function of the state), or "stop" (held at its limits while it pushes).
    normal : Signal or Quantity
        In N.
    rested : float
        How long in s it has been held at the start.
    deflection : float
        Of its bristles at the start, in m or rad.
    slipping : bool
        Whether it starts as one that has slipped.
    restitution : float
        Of impacts.
    """

    name: str
    coefficients: Mapping[int, float]
    law: Law | None
    kind: str
    normal: Load
    rested: float
    deflection: float
    slipping: bool
    restitution: float


@dataclass(frozen=True)
class Coupling:
    """A spring and damper along ``stretch = sum c_i x_i``: force ``-c_i (k (stretch - rest) + c stretch')``."""

    label: str
    coefficients: Mapping[int, float]
    stiffness: float
    damping: float
    rest: float


@dataclass(frozen=True)
class Piecewise:
    """A piecewise-linear function of the state.

    Attributes
    ----------
    label : str
    regions : tuple of Region
    acts : dict of int to float
        Its force on a body, as a multiple of its value, by index.
    row : int
        The row whose force it is, -1 for none.
    """

    label: str
    regions: tuple[Region, ...]
    acts: Mapping[int, float]
    row: int


class Book:
    """What elements enter, in the order of the elements, and loads that are watched without acting on anything.

    Attributes
    ----------
    index : dict of str to int
        The number of each body and drive: first the bodies, then the drives, last the ground.
    row_index : dict of str to int
        The number of each row.
    read : set of int
        Bodies and drives whose positions piecewise-linear functions read.
    """

    def __init__(self, elements: Iterable[Any], watched: Sequence[Load] = ()) -> None:
        self.watched = list(watched)
        # these three hold elements
        self.bodies: list[Any] = []
        self.drives: list[Any] = []
        self.blocks: list[Any] = []
        self.rows: list[RowEntry] = []
        self.couplings: list[Coupling] = []
        self.forces: list[tuple[int, Load, str]] = []
        self.piecewises: list[Piecewise] = []
        self.signals: list[Signal] = []
        self.read: set[int] = set()
        self.index: dict[str, int] = {}
        self.row_index: dict[str, int] = {}
        for element in elements:
            element.place(self)
        self.index[GROUND] = len(self.index)

    def body(self, body: Any) -> None:
        """Enter a free body; all of them come before the drives."""
        self.index[body.name] = len(self.index)
        self.bodies.append(body)

    def drive(self, drive: Any) -> None:
        """Enter a body of prescribed velocity."""
        self.index[drive.name] = len(self.index)
        self.drives.append(drive)

    def row(
        self,
        name: str,
        coefficients: Mapping[str, float],
        *,
        law: Law | None = None,
        kind: str = "friction",
        normal: Load | float = 0.0,
        rested: float = 0.0,
        deflection: float = 0.0,
        slipping: bool = False,
        restitution: float = 0.0,
    ) -> None:
        """Enter a row: ``w = sum c_i v_i``, whose force r acts with ``-c_i r`` on body i."""
        self.row_index[name] = len(self.rows)
        own = self._by_index(coefficients)
        entry = RowEntry(name, own, law, kind, _load(normal), rested, deflection, slipping, restitution)
        self.rows.append(entry)

    def couple(
        self, label: str, coefficients: Mapping[str, float], stiffness: float, damping: float, rest: float
    ) -> None:
        """Enter a spring and damper along ``stretch = sum c_i x_i``."""
        self.couplings.append(Coupling(label, self._by_index(coefficients), stiffness, damping, rest))

    def block(self, block: Any) -> None:
        """Enter a block."""
        self.blocks.append(block)

    def push(self, body: str, force: Load | float) -> None:
        """Enter a force on a body."""
        self.forces.append((self.index[body], _load(force), f"force on {body!r}"))

    def read_position(self, name: str) -> None:
        """Make the position of a body or drive a state, as springs do: something else reads it."""
        if name != GROUND:
            self.read.add(self.index[name])

    def piecewise(
        self, label: str, regions: Sequence[Region], *, acts: Mapping[str, float], row: str | None = None
    ) -> int:
        """Enter a continuous piecewise-linear function of the state, and return its number.

        In each set of modes the function is in one of its regions: there it is linear, and the borders of the region
        are guards like all others. Settling picks the region after each event. A push limited to -1 and 1::

            q = Linear(positions={"cart": -k})
            regions = [Region(q, ((q + 1, 1), (1 - q, 2)))]
            regions += [Region(Linear(constant=-1), ((-1 - q, 0),)), Region(Linear(constant=1), ((q - 1, 0),))]
            book.piecewise("push on 'cart'", regions, acts={"cart": 1})

        Where something other than a force on a body reads the value, leave `acts` empty; in one set of modes the value
        is ``functions.value_y[at] @ y + functions.value_q[at] @ q`` with ``functions = system.piecewise`` and ``at =
        functions.places(equations.regions)``.

        Parameters
        ----------
        label : str
            How messages name it.
        regions : sequence of Region
            Their borders name each other by their place in this sequence.
        acts : dict of str to float
            By name of the body: its force on body i is ``acts[i]`` times the value. It may be empty.
        row : str, optional
            The row that shows the modes of the regions. Where it is of kind "gap" the value is its force r.
        """
        for region in regions:
            for expression in (region.value, *(border for border, _ in region.borders)):
                self._note(expression)
        j = -1 if row is None else self.row_index[row]
        self.piecewises.append(Piecewise(label, tuple(regions), self._by_index(acts), j))
        return len(self.piecewises) - 1

    def loads(self) -> list[Load]:
        """Return all loads that may depend on the state."""
        forces = [load for _, load, _ in self.forces]
        normals = [row.normal for row in self.rows]
        return [*forces, *normals, *(load for block in self.blocks for load in block.inputs), *self.watched]

    def _note(self, expression: Linear) -> None:
        """Enter the positions and signals that an expression reads."""
        for name in expression.positions:
            self.read_position(name)
        self.signals += [s for _, s in expression.signals if not any(s is known for known in self.signals)]

    def _by_index(self, coefficients: Mapping[str, float]) -> dict[int, float]:
        return {self.index[name]: c for name, c in coefficients.items() if name != GROUND}


def _load(value: Load | float) -> Load:
    return value if isinstance(value, Load) else Constant(float(value))
