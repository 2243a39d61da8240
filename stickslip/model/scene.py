"""A scene: bodies and what acts between them, checked as a whole, to and from plain data."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from stickslip.model.checks import check_entries
from stickslip.model.elements import KINDS, AnyBlock, Body, Contact, Drive, Element, Gap, Named, Row
from stickslip.model.elements.base import MotionKind, check_motion, listed
from stickslip.model.elements.book import GROUND
from stickslip.model.laws import Law, PreSlip, Shape
from stickslip.model.laws.dry_friction import law_from_dict
from stickslip.model.quantities import (
    Normal,
    OfRow,
    Output,
    Position,
    Power,
    Quantity,
    Velocity,
    load_from_dict,
)

_ROUNDOFF = 1e-9
_COUNTED = re.compile(r"(springs|dampers|forces)\[(\d+)\]")  # elements without a name: kind and number, from 0


@dataclass(frozen=True, init=False, repr=False)
class Scene:
    """Bodies and what acts between them; the elements may be given in any order.

    Parameters
    ----------
    *elements : Element
        Body, Drive, Contact, Tie, Gear, Planetary, OneWay, Gap, Stop, Spring, Damper, Block, StateSpace, Sampled or
        Force; they refer to bodies by name.
    motion : "rotation" or "translation", optional
        How the bodies move that do not say it themselves. It changes no number, only the units that tables and
        drawings show: by default both.

    Attributes
    ----------
    elements : tuple of Element
        All of them, kind by kind.
    bodies, drives, contacts, ties, gears, planetaries, one_ways, gaps, stops, springs, dampers : tuple
        Those of one kind, in the order given; and so `blocks`, `state_spaces`, `sampled` and `forces`.

    Raises
    ------
    ValueError, TypeError
        If a name stands twice or is unknown, an element joins nothing that can move, or nothing decides the motion of a
        body without inertia.
    """

    elements: tuple[Element, ...]
    motion: MotionKind | None = None

    shown_by: ClassVar[dict[str, Callable[..., Any]]] = {}
    """Functions that draw a scene ("draw") and write it for notebooks ("html"); `plots` enters them."""

    if TYPE_CHECKING:

        def __getattr__(self, kind: str) -> tuple[Any, ...]: ...

    def __init__(self, *elements: Element, motion: MotionKind | None = None) -> None:
        """Sort the elements by kind and check that they fit together."""
        check_motion(motion, "Scene", "for both")
        self._sort(elements, motion)
        self._check_names()
        free = frozenset(body.name for body in self.bodies)
        for element in self.elements:
            element.check_ends(free, self._moving)
        for element in self.elements:
            for load in element.quantities():
                self.check_quantities(load, element.label)
        self._check_weightless()

    def _sort(self, elements: Iterable[Element], motion: MotionKind | None) -> None:
        """Set the attributes, elements kind by kind."""
        object.__setattr__(self, "motion", motion)
        sorted_: dict[type, list[Element]] = {kind: [] for kind in KINDS.values()}
        for element in elements:
            if type(element) not in sorted_:
                known = [kind.__name__ for kind in KINDS.values()]
                raise TypeError(
                    f"Scene: {reprlib.repr(element)} is not an element; "
                    f"give {', '.join(known[:-1])} or {known[-1]} one by one (a list of them as *list)"
                )
            sorted_[type(element)].append(element)
        for name, kind in KINDS.items():
            object.__setattr__(self, name, tuple(sorted_[kind]))
        object.__setattr__(self, "elements", tuple(e for of_kind in sorted_.values() for e in of_kind))

    @classmethod
    def of_all(cls, scenes: Sequence[Scene]) -> Scene:
        """Return a scene with the elements of all `scenes`, for drawings; it is not checked, and not to be simulated.

        Of elements with one name it has the last, but a drive never replaces a body. Of elements without a name it has
        all that differ.
        """
        found: dict[Any, Element] = {}
        for scene in scenes:
            for element in scene.elements:
                match element:
                    case Drive(name=name) if isinstance(found.get(("moving", name)), Body):
                        pass
                    case Body(name=name) | Drive(name=name):
                        found["moving", name] = replace(element, motion=scene.motions[name])
                    case Named(name=name):
                        found["row" if isinstance(element, Row) else "block", name] = element
                    case _:
                        found[repr(element)] = element
        whole: Scene = object.__new__(cls)
        whole._sort(found.values(), scenes[-1].motion)
        return whole

    @property
    def rows(self) -> tuple[Any, ...]:
        """All elements with a named relative velocity and force: contacts, ties, gears, clutches, gaps and stops."""
        return tuple(element for element in self.elements if isinstance(element, Row))

    @property
    def all_blocks(self) -> tuple[AnyBlock, ...]:
        """All elements with states of their own: blocks, state spaces, sampled blocks."""
        return (*self.blocks, *self.state_spaces, *self.sampled)

    @cached_property
    def derived(self) -> dict[str, Any]:
        """Data that other modules derive from the scene, such as its matrices: kept with the scene, but not pickled."""
        return {}

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "derived"}

    @cached_property
    def _moving(self) -> frozenset[str]:
        """The names of bodies, drives and the ground."""
        return frozenset({GROUND, *(one.name for one in (*self.bodies, *self.drives))})

    @cached_property
    def _row_named(self) -> dict[str, Row]:
        return {row.name: row for row in self.rows}

    @cached_property
    def _block_named(self) -> dict[str, AnyBlock]:
        return {block.name: block for block in self.all_blocks}

    @cached_property
    def motions(self) -> dict[str, MotionKind | None]:
        """How each body and drive moves, by name: as it says itself, else as the scene says."""
        return {one.name: one.motion or self.motion for one in (*self.bodies, *self.drives)}

    def _check_names(self) -> None:
        if not self.bodies:
            raise ValueError("Scene: there is no free body; add at least one Body")
        for named in ((*self.bodies, *self.drives), self.rows, self.all_blocks):
            seen: set[str] = set()
            for one in named:
                if one.name in seen:
                    raise ValueError(f"Scene: the name of {one.label} stands twice; rename one of the two")
                seen.add(one.name)

    def check_quantities(self, load: Quantity, label: str) -> None:
        """Refuse a quantity of a body, row or block that the scene does not have; `label` is its reader."""
        moving, rows, blocks = self._moving, self._row_named, self._block_named
        for quantity in load.walk():
            if isinstance(quantity, (Position, Velocity)) and quantity.body not in moving:
                raise ValueError(f"{label}: no body is called {quantity.body!r}; known are {listed(moving)}")
            if isinstance(quantity, Output):
                if quantity.block not in blocks:
                    raise ValueError(
                        f"{label}: no block is called {quantity.block!r}; known are {listed(blocks) or 'none'}"
                    )
                count = blocks[quantity.block].output_count
                if count is not None and quantity.index >= count:
                    raise ValueError(
                        f"{label}: block {quantity.block!r} has {count} outputs, so none has the index "
                        f"{quantity.index}; they count from 0"
                    )
            if not isinstance(quantity, OfRow):
                continue
            if quantity.row not in rows:
                raise ValueError(f"{label}: no contact is called {quantity.row!r}; known are {listed(rows) or 'none'}")
            row = rows[quantity.row]
            if isinstance(quantity, Normal) and not isinstance(row, (Contact, Gap)):
                raise ValueError(
                    f"{label}: {row.label} has no normal force to read; name a contact, or a Gap, an elastic stop"
                )
            if isinstance(quantity, Power) and not isinstance(row, Contact):
                raise ValueError(f"{label}: {row.label} has no power to read; name a contact")

    def _check_weightless(self) -> None:
        """Refuse bodies without inertia whose motion ties alone do not decide: they could move without energy."""
        place = {body.name: k for k, body in enumerate(b for b in self.bodies if b.inertia == 0)}
        if not place:
            return
        rows = []
        for tie in (*self.ties, *self.gears, *self.planetaries):
            row = np.zeros(len(place))
            for name, c in tie.coefficients.items():
                if name in place:
                    row[place[name]] = c / max(map(abs, tie.coefficients.values()))
            rows.append(row)
        matrix = np.array(rows).reshape(-1, len(place))
        undecided = np.eye(len(place)) - np.linalg.pinv(matrix) @ matrix
        for name, k in place.items():
            if np.abs(undecided[k]).max() > _ROUNDOFF:
                raise ValueError(
                    f"body {name!r}: inertia must be positive, got 0, because ties alone do not decide how it moves; "
                    "give it an inertia, however small (errors are in proportion), or a Tie or Gear to bodies that "
                    "have one, use a Drive for a body of prescribed velocity and GROUND for one at rest"
                )

    def replace(self, name: str, **changes: Any) -> Scene:
        """Return the scene with some fields of one element changed.

        Parameters
        ----------
        name : str
            Name of the body, drive, block, contact or another row; ``"springs[0]"``, ``"dampers[0]"``, ``"forces[0]"``
            for elements without a name.
        **changes
            The fields to change.

        Raises
        ------
        ValueError, TypeError
            If no element has the name, or the element refuses the changes.
        """
        every: list[Any] = list(self.elements)
        named = isinstance(name, str)
        places = [k for k, e in enumerate(every) if named and isinstance(e, Named) and e.name == name]
        counted = _COUNTED.fullmatch(name) if named and not places else None
        if counted is not None and int(counted[2]) < len(among := getattr(self, counted[1])):
            places = [place_in(self, among, int(counted[2]))]
        if not places:
            known = {element.name for element in self.elements if isinstance(element, Named)}
            raise ValueError(
                f"Scene.replace: no body, drive or contact is called {name!r}; known are {listed(known)}; "
                "springs, dampers and forces are called 'springs[0]' and so on"
            )
        if len(places) > 1:
            raise ValueError(f"Scene.replace: a body and a contact are both called {name!r}; rename one of them")
        old = every[places[0]]
        check_entries(type(old), type(old).__name__, vars(old) | changes, f"Scene.replace: {old.label}")
        return self._with(replace(e, **changes) if k == places[0] else e for k, e in enumerate(every))

    def with_laws(self, change: Callable[[Any], Law]) -> Scene:
        """Return the scene with every contact's law replaced by ``change(law)``.

        Raises
        ------
        TypeError
            If `change` cannot be called, or returns no law.
        """
        if not callable(change):
            raise TypeError(f"Scene.with_laws: change must be a function of a law, got {change!r}")
        return self._with(replace(e, law=change(e.law)) if isinstance(e, Contact) else e for e in self.elements)

    def _with(self, elements: Iterable[Element]) -> Scene:
        """Return a scene of other elements that is otherwise this one."""
        return Scene(*elements, motion=self.motion)

    def regularized(self, velocity: float = 1e-3, shape: Shape = "linear") -> Scene:
        """Return the scene with every contact on a pre-slip law of the same coefficients.

        Parameters
        ----------
        velocity : float
            Pre-slip velocity in m/s or rad/s.
        shape : str
            "linear", "tanh" or "arctan".
        """
        return self.with_laws(lambda law: PreSlip(law.core, velocity, shape))

    def to_dict(self) -> dict[str, Any]:
        """Return the scene as plain data: tables of numbers, strings, lists and dicts.

        Raises
        ------
        ValueError
            If a signal or a law holds code.
        """
        data: dict[str, Any] = {} if self.motion is None else {"motion": self.motion}
        for kind in KINDS:
            if elements := getattr(self, kind):
                data[kind] = [_plain(element) for element in elements]
        return data

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Scene:
        """Return the scene that `to_dict` wrote.

        Raises
        ------
        ValueError, TypeError
            If the data do not describe a scene; the message names the element.
        """
        if not isinstance(data, Mapping):
            raise TypeError(f"Scene.from_dict: expected a table of lists, got {type(data).__name__}")
        elements = []
        for table, rows in data.items():
            if table == "motion":
                continue
            if table not in KINDS:
                raise ValueError(f"Scene.from_dict: unknown table {table!r}; known are {', '.join(KINDS)}")
            if not isinstance(rows, (list, tuple)):
                raise TypeError(f"Scene.from_dict: {table} must be a list of tables, got {rows!r}")
            elements += [_element(KINDS[table], f"{table}[{k}]", row) for k, row in enumerate(rows)]
        return cls(*elements, motion=data.get("motion"))

    def draw(self, *, ax: Any = None) -> Any:
        """Draw the scene as a schematic and return the matplotlib figure.

        Every body is a box; contacts, springs, dampers, gears and clutches are symbols between the boxes that they
        join, or between a box and the ground. Of more than a dozen bodies and drives only the first are drawn; a note
        gives the number of the others.

        Parameters
        ----------
        ax : matplotlib axes, optional
            Where to draw; by default a new figure as large as the scene needs.
        """
        return self.shown_by["draw"](self, ax=ax)

    def _repr_html_(self) -> str:
        """Return the schematic and a table of the elements, as notebooks show them."""
        return str(self.shown_by["html"](self))

    def __repr__(self) -> str:
        motion = [] if self.motion is None else [f"motion={self.motion!r}"]
        return f"Scene({', '.join([*map(repr, self.elements), *motion])})"


def _plain(element: Element) -> dict[str, Any]:
    try:
        return element.to_dict()
    except (TypeError, ValueError) as error:
        raise type(error)(f"{element.label}: {error}") from None


def _element(maker: type[Element], where: str, row: Any) -> Element:
    if not isinstance(row, Mapping):
        raise TypeError(f"{where}: expected a table, got {row!r}")
    values = dict(row)
    check_entries(maker, maker.__name__, values, where)
    for name in ("velocity", "normal", "signal"):
        if isinstance(values.get(name), Mapping):
            values[name] = load_from_dict(values[name], f"{where}.{name}")
    if isinstance(inputs := values.get("inputs"), (list, tuple)):
        values["inputs"] = [load_from_dict(one, f"{where}.inputs[{k}]") for k, one in enumerate(inputs)]
    if "law" in values:
        values["law"] = law_from_dict(values["law"], f"{where}.law")
    try:
        return maker(**values)
    except (TypeError, ValueError) as error:
        raise type(error)(f"{where}: {error}") from None


def place_in(scene: Scene, among: Sequence[Element], number: int) -> int:
    """Return the place among all elements of the scene of ``among[number]``; `among` are all elements of some kinds."""
    kind = type(among[number])
    first = next(k for k, element in enumerate(scene.elements) if type(element) is kind)
    return first + sum(type(element) is kind for element in among[:number])
