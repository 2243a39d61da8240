"""The book in which elements place themselves: bodies, rows, couplings, forces."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from stickslip.model.laws.dry_friction import Law
from stickslip.model.piecewise import Region
from stickslip.model.quantities import Quantity
from stickslip.model.signals import ZERO, Constant, Load

GROUND = "ground"  # name of the ground: a body that never moves


@dataclass(frozen=True)
class RowEntry:
    """``w = sum c_i v_i`` over bodies and drives; its force r acts with ``-c_i r`` on body i."""

    name: str
    coefficients: Mapping[int, float]  # by index of the body or drive
    law: Law | None = None  # the friction law; None for a row of another kind
    # "friction", "tie" (always held), "one-way" (held while its force is positive) or "gap" (never held: its
    # force is a piecewise-linear function of the state), or "stop" (held at its limits while it pushes)
    kind: str = "friction"
    normal: Load = ZERO  # in N
    rested: float = 0.0  # how long in s it has been held at the start
    deflection: float = 0.0  # of its bristles at the start, in m or rad
    slipping: bool = False  # whether it starts as one that has slipped
    restitution: float = 0.0  # of impacts
    # Of a gap or a stop: the regions of a continuous piecewise-linear function of its stretch and of the rate of
    # its stretch. A set of modes includes one region of each function; the row shows the mode of that region. The
    # borders of a region are guards. Each border gives the place in this sequence of the region beyond it. The
    # value of the function is the force of a gap; for a stop it is 0 and not used.
    regions: Sequence[Region] = ()
    # of a gap: returns the size of its force in N, so that it may press a contact
    pressing: Callable[[], Quantity] | None = None


@dataclass(frozen=True)
class Coupling:
    """A spring and damper along ``stretch = sum c_i x_i``: force ``-c_i (k (stretch - rest) + c stretch')``."""

    label: str
    coefficients: Mapping[int, float]
    stiffness: float
    damping: float
    rest: float


class Book:
    """Everything that elements have entered, in the order of the elements, and `observed` loads that act on nothing.

    Each body, drive and row has a number; bodies come before drives, and the ground last.
    """

    def __init__(self, elements: Iterable[Any], observed: Sequence[Load] = ()) -> None:
        self.observed = list(observed)
        # the elements themselves
        self.bodies: list[Any] = []
        self.drives: list[Any] = []
        self.blocks: list[Any] = []
        self.rows: list[RowEntry] = []
        self.couplings: list[Coupling] = []
        self.forces: list[tuple[int, Load, str]] = []
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

    def row(self, name: str, coefficients: Mapping[str, float], **facts: Any) -> None:
        """Enter a row; `facts` are the other fields of its `RowEntry`."""
        self.row_index[name] = len(self.rows)
        self.rows.append(RowEntry(name, self._by_index(coefficients), **facts))

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
        load = force if isinstance(force, Load) else Constant(force)
        self.forces.append((self.index[body], load, f"force on {body!r}"))

    def quantities(self) -> Iterator[Quantity]:
        """Yield all quantities of the motion that are read, and those that they are made of."""
        forces = [load for _, load, _ in self.forces]
        normals = [row.normal for row in self.rows]
        inputs = [load for block in self.blocks for load in block.quantities()]
        for load in (*forces, *normals, *inputs, *self.observed):
            if isinstance(load, Quantity):
                yield from load.walk()

    def _by_index(self, coefficients: Mapping[str, float]) -> dict[int, float]:
        return {self.index[name]: c for name, c in coefficients.items() if name != GROUND}
