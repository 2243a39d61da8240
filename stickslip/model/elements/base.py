"""Base classes of the elements of a scene: named, moving, between two bodies, with a row."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import fields
from typing import Any, ClassVar, Literal, get_args

from stickslip.model.checks import NamedArguments, check_name, finite, limit
from stickslip.model.elements.book import GROUND, Book
from stickslip.model.laws.dry_friction import Law
from stickslip.model.quantities import Quantity, as_load
from stickslip.model.signals import Load

# How a body moves. This decides the units that tables and drawings show, and changes no number.
MotionKind = Literal["rotation", "translation"]


class Element(metaclass=NamedArguments):
    """A part of a scene; a wrong argument is a TypeError or a ValueError that names the element and the value."""

    called: ClassVar[str] = ""

    @classmethod
    def noun(cls) -> str:
        """Return how prose names the kind of element: `called`, or else the name of the class in lower case."""
        return cls.called or cls.__name__.lower()

    @property
    def label(self) -> str:
        """How messages name the element."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """Return the element as plain data, defaults left out."""
        data: dict[str, Any] = {}
        for field in fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            if value != field.default:
                data[field.name] = value.to_dict() if isinstance(value, (Load, Law)) else value
        return data

    def __post_init__(self) -> None:
        """Check the fields."""

    def place(self, book: Book) -> None:
        """Enter the element in a book."""
        raise NotImplementedError

    def quantities(self) -> tuple[Quantity, ...]:
        """Return the quantities of the motion that the element depends on."""
        values = [getattr(self, field.name) for field in fields(self)]  # type: ignore[arg-type]
        return tuple(value for value in values if isinstance(value, Quantity))

    def check_ends(self, free: frozenset[str], known: frozenset[str]) -> None:
        """Refuse names of bodies that the scene does not know, and an element of which no end is free to move.

        `free` are the names of the free bodies, `known` those of drives and the ground, too.
        """
        if coefficients := getattr(self, "coefficients", None):
            check_members(self.label, coefficients, free, known)

    def _number(self, name: str) -> float:
        number = finite(getattr(self, name), f"{self.label}: {name}")
        object.__setattr__(self, name, number)
        return number

    def _not_negative(self, name: str) -> None:
        if (number := self._number(name)) < 0:
            raise ValueError(f"{self.label}: {name} must not be negative, got {number:g}")

    def _not_zero(self, name: str, remedy: str) -> float:
        if (number := self._number(name)) == 0:
            raise ValueError(f"{self.label}: {name} must not be 0; {remedy}")
        return number

    def _load(self, name: str) -> None:
        object.__setattr__(self, name, as_load(getattr(self, name), f"{self.label}: {name}"))

    def _identifier(self, name: str) -> None:
        check_name(getattr(self, name), f"{type(self).__name__}: {name}")


class Named(Element):
    """An element with a name of its own."""

    name: str

    def __post_init__(self) -> None:
        """Check the name."""
        self._identifier("name")
        super().__post_init__()

    @property
    def label(self) -> str:
        """How messages name the element."""
        return f"{self.noun()} {self.name!r}"


class Moving(Named):
    """A body or a drive: it has a velocity and a position, and may say how it moves."""

    position: float
    motion: MotionKind | None

    def __post_init__(self) -> None:
        """Check name, motion and position; only bodies and drives cannot have the name of the ground."""
        super().__post_init__()
        if self.name == GROUND:
            raise ValueError(
                f"{type(self).__name__}: the name {GROUND!r} is taken by the ground, which is always there; "
                f"rename {self.label}, or leave it out and join to GROUND"
            )
        check_motion(self.motion, self.label, "for what the scene says")
        self._number("position")


class Link(Element):
    """An element between two bodies."""

    a: str
    b: str

    @property
    def label(self) -> str:
        """How messages name the element."""
        return f"{self.noun()} {self.a!r}-{self.b!r}"

    def __post_init__(self) -> None:
        """Check the ends."""
        self._identifier("a")
        self._identifier("b")
        if self.a == self.b:
            raise ValueError(f"{self.label}: joins {self.a!r} to itself; name two different bodies")


class Row(Named):
    """An element with a row of its own: a named relative velocity and a force along it.

    The names of rows are unique in the scene.
    """

    coefficients: Any


class Held(Row):
    """A row that is always held."""

    def place(self, book: Book) -> None:
        """Enter the row."""
        book.row(self.name, self.coefficients, kind="tie")


class Radii(Link):
    """A link whose ends act at radii."""

    radius_a: float
    radius_b: float

    @property
    def coefficients(self) -> dict[str, float]:
        """The factors of the velocities of the ends in the relative velocity."""
        return {self.a: self.radius_a, self.b: -self.radius_b}

    @property
    def radii(self) -> tuple[float, float]:
        """The radii of both ends."""
        return self.radius_a, self.radius_b

    def _check_limits(self) -> None:
        """Check the limits of a stretch: in order, and at least one of them finite."""
        lower, upper = (
            limit(getattr(self, name), none, f"{self.label}: {name}")
            for name, none in (("lower", -math.inf), ("upper", math.inf))
        )
        object.__setattr__(self, "lower", lower)
        object.__setattr__(self, "upper", upper)
        if lower == -math.inf and upper == math.inf:
            raise ValueError(f"{self.label}: neither lower nor upper is given; give at least one of the limits")
        if lower > upper:
            raise ValueError(f"{self.label}: lower must not be above upper, got {lower:g} and {upper:g}; exchange them")

    def __post_init__(self) -> None:
        """Check ends and radii."""
        super().__post_init__()
        for name in ("radius_a", "radius_b"):
            self._not_zero(name, "an end at radius 0 transmits no force; use 1 for the body's own velocity")


def check_motion(motion: Any, label: str, default: str) -> None:
    """Refuse a `motion` that is no kind of motion; `default` ends the message: what leaving it out means."""
    if motion is not None and not (isinstance(motion, str) and motion in get_args(MotionKind)):
        raise ValueError(f"{label}: motion must be 'rotation' or 'translation', got {motion!r}; leave it out {default}")


def check_members(label: str, members: Iterable[str], free: frozenset[str], known: frozenset[str]) -> None:
    """Refuse members that a scene does not know, and those of which none is free to move."""
    names = list(members)
    for end in names:
        if end not in known:
            ground = "; the ground is GROUND, without quotes, or 'ground'" if end.lower() == GROUND else ""
            raise ValueError(f"{label}: no body is called {end!r}; known are {listed(known)}{ground}")
    if not any(end in free for end in names):
        said = f"neither {names[0]!r} nor {names[1]!r} is" if len(names) == 2 else f"none of {listed(names)} is"
        raise ValueError(f"{label}: {said} free to move; join at least one Body")


def listed(names: Iterable[str]) -> str:
    """Return the first ten of some names in alphabetical order."""
    every = sorted(names)
    return ", ".join(map(repr, every[:10])) + (", ..." if len(every) > 10 else "")
