"""The elements of a scene: bodies, drives, contacts, springs, dampers and forces, as frozen data."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass, fields, replace
from typing import Any

from stickslip.laws import DryFriction, Law, law_from_dict
from stickslip.regularized import PreSlip
from stickslip.signals import Signal, _finite, as_signal, signal_from_dict

__all__ = ["GROUND", "Body", "Contact", "Damper", "Drive", "Element", "Force", "Scene", "Spring"]

GROUND = "ground"


@dataclass(frozen=True)
class Element:
    """A part of a scene."""

    @property
    def label(self) -> str:
        """How messages name the element."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """Return the element as plain data, defaults left out."""
        data: dict[str, Any] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if value != field.default:
                data[field.name] = value.to_dict() if isinstance(value, (Signal, Law)) else value
        return data

    def _number(self, name: str) -> float:
        number = _finite(getattr(self, name), f"{self.label}: {name}")
        object.__setattr__(self, name, number)
        return number

    def _not_negative(self, name: str) -> None:
        if (number := self._number(name)) < 0:
            raise ValueError(f"{self.label}: {name} must not be negative, got {number:g}")

    def _signal(self, name: str) -> None:
        object.__setattr__(self, name, as_signal(getattr(self, name), f"{self.label}: {name}"))

    def _identifier(self, name: str) -> None:
        value = getattr(self, name)
        if not isinstance(value, str) or not value:
            raise TypeError(
                f"{type(self).__name__}: {name} must be a name (a string that is not empty), got {value!r}"
            )

    def _two_ends(self, a: str, b: str) -> None:
        for end in ("a", "b"):
            self._identifier(end)
        if a == b:
            raise ValueError(f"{self.label}: joins {a!r} to itself; name two different bodies")


@dataclass(frozen=True)
class Body(Element):
    """A free body: a flywheel, a block, a node of a drive line.

    Parameters
    ----------
    name : str
        Unique in the scene.
    inertia : float
        Mass in kg or moment of inertia in kg m^2, positive.
    velocity, position : float
        At the start, in m/s or rad/s and in m or rad.

    Raises
    ------
    ValueError, TypeError
        If a number is not finite or the inertia not positive.
    """

    name: str
    _: KW_ONLY
    inertia: float
    velocity: float = 0.0
    position: float = 0.0

    def __post_init__(self) -> None:
        self._identifier("name")
        if (inertia := self._number("inertia")) <= 0:
            raise ValueError(
                f"{self.label}: inertia must be positive, got {inertia:g}; "
                "use a Drive for a body of prescribed velocity and GROUND for one at rest"
            )
        self._number("velocity")
        self._number("position")

    @property
    def label(self) -> str:
        return f"body {self.name!r}"


@dataclass(frozen=True)
class Drive(Element):
    """A body of prescribed velocity: a belt, a motor, a moving plate.

    Parameters
    ----------
    name : str
        Unique in the scene.
    velocity : float or Signal
        In m/s or rad/s.
    position : float
        At the start, in m or rad.

    Raises
    ------
    ValueError, TypeError
        If the velocity is not a signal or the position not finite.
    """

    name: str
    _: KW_ONLY
    velocity: Signal | float
    position: float = 0.0

    def __post_init__(self) -> None:
        self._identifier("name")
        self._signal("velocity")
        self._number("position")

    @property
    def label(self) -> str:
        return f"drive {self.name!r}"


@dataclass(frozen=True)
class Contact(Element):
    """A friction contact between two bodies, or between a body and a drive or the ground.

    Its relative velocity is ``w = v_a - v_b``; its friction force r acts with -r on `a` and +r on `b`.

    Parameters
    ----------
    name : str
        Unique in the scene.
    a, b : str
        Names of bodies or drives, or GROUND.
    law : Law
        The friction law.
    normal : float or Signal
        Normal force in N; where it is negative the contact is open and the force is 0.
    rested : float
        How long in s a contact that is stuck at the start has been stuck already.

    Raises
    ------
    ValueError, TypeError
        If the ends are the same, or an argument is of the wrong kind.
    """

    name: str
    a: str
    b: str
    law: Law
    _: KW_ONLY
    normal: Signal | float
    rested: float = 0.0

    def __post_init__(self) -> None:
        self._identifier("name")
        self._two_ends(self.a, self.b)
        if not isinstance(self.law, Law):
            raise TypeError(
                f"{self.label}: law must be a friction law such as DryFriction(0.2, 0.1), got {self.law!r}"
            )
        self._signal("normal")
        self._not_negative("rested")

    @property
    def label(self) -> str:
        return f"contact {self.name!r}"


@dataclass(frozen=True)
class Spring(Element):
    """A linear spring, with a damper in parallel: ``-k (x_a - x_b - rest) - c (v_a - v_b)`` acts on `a`.

    Parameters
    ----------
    a, b : str
        Names of bodies or drives, or GROUND.
    stiffness, damping : float
        In N/m and N s/m (N m/rad and N m s/rad), not negative.
    rest : float
        ``x_a - x_b`` in m or rad at which the spring is free of force.

    Raises
    ------
    ValueError, TypeError
        If the ends are the same, or a number is negative or not finite.
    """

    a: str
    b: str
    _: KW_ONLY
    stiffness: float
    damping: float = 0.0
    rest: float = 0.0

    def __post_init__(self) -> None:
        self._two_ends(self.a, self.b)
        self._not_negative("stiffness")
        self._not_negative("damping")
        self._number("rest")

    @property
    def label(self) -> str:
        return f"spring {self.a!r}-{self.b!r}"


@dataclass(frozen=True)
class Damper(Element):
    """Viscous friction: ``-c (v_a - v_b)`` acts on `a`.

    Parameters
    ----------
    a, b : str
        Names of bodies or drives, or GROUND.
    damping : float
        In N s/m or N m s/rad, not negative.

    Raises
    ------
    ValueError, TypeError
        If the ends are the same, or the damping is negative or not finite.
    """

    a: str
    b: str
    _: KW_ONLY
    damping: float

    def __post_init__(self) -> None:
        self._two_ends(self.a, self.b)
        self._not_negative("damping")

    @property
    def label(self) -> str:
        return f"damper {self.a!r}-{self.b!r}"


@dataclass(frozen=True)
class Force(Element):
    """An external force or torque on a body.

    Parameters
    ----------
    body : str
        Name of a free body.
    signal : float or Signal
        In N or N m.

    Raises
    ------
    TypeError
        If the force is not a signal.
    """

    body: str
    signal: Signal | float

    def __post_init__(self) -> None:
        self._identifier("body")
        self._signal("signal")

    @property
    def label(self) -> str:
        return f"force on {self.body!r}"


_KINDS: dict[str, type[Element]] = {
    "bodies": Body,
    "drives": Drive,
    "contacts": Contact,
    "springs": Spring,
    "dampers": Damper,
    "forces": Force,
}


@dataclass(frozen=True, init=False, repr=False)
class Scene:
    """Bodies and what acts between them; the elements may be given in any order.

    Parameters
    ----------
    *elements : Body, Drive, Contact, Spring, Damper or Force
        Bodies are referred to by name.

    Raises
    ------
    ValueError, TypeError
        If a name stands twice or is unknown, or an element joins nothing that can move.
    """

    bodies: tuple[Body, ...]
    drives: tuple[Drive, ...]
    contacts: tuple[Contact, ...]
    springs: tuple[Spring, ...]
    dampers: tuple[Damper, ...]
    forces: tuple[Force, ...]

    def __init__(self, *elements: Element) -> None:
        for element in elements:
            if type(element) not in _KINDS.values():
                raise TypeError(
                    f"Scene: {element!r} is not an element; give Body, Drive, Contact, Spring, Damper or Force"
                )
        for name, kind in _KINDS.items():
            object.__setattr__(self, name, tuple(e for e in elements if type(e) is kind))
        self._check_names()
        self._check_references()

    @property
    def elements(self) -> tuple[Element, ...]:
        """All elements, kind by kind."""
        return tuple(element for kind in _KINDS for element in getattr(self, kind))

    def _check_names(self) -> None:
        if not self.bodies:
            raise ValueError("Scene: there is no free body; add at least one Body")
        for kinds in ((self.bodies, self.drives), (self.contacts,)):
            seen: set[str] = set()
            for element in (e for kind in kinds for e in kind):
                if element.name == GROUND:
                    raise ValueError(f"Scene: the name {GROUND!r} is taken by the ground; rename {element.label}")
                if element.name in seen:
                    raise ValueError(f"Scene: the name of {element.label} stands twice; names must be unique")
                seen.add(element.name)

    def _check_references(self) -> None:
        free = {body.name for body in self.bodies}
        known = free | {drive.name for drive in self.drives} | {GROUND}
        for link in (*self.contacts, *self.springs, *self.dampers):
            for end in (link.a, link.b):
                if end not in known:
                    raise ValueError(f"{link.label}: no body is called {end!r}; known are {_listed(known)}")
            if link.a not in free and link.b not in free:
                raise ValueError(
                    f"{link.label}: neither {link.a!r} nor {link.b!r} is free to move; join at least one Body"
                )
        for force in self.forces:
            if force.body not in free:
                remedy = (
                    "a drive's velocity is prescribed, a force cannot change it"
                    if force.body in known
                    else f"known bodies are {_listed(free)}"
                )
                raise ValueError(f"{force.label}: no free body is called {force.body!r}; {remedy}")

    def replace(self, name: str, **changes: Any) -> Scene:
        """Return the scene with some fields of one body, drive or contact changed.

        Parameters
        ----------
        name : str
            Name of the body, drive or contact.
        **changes
            The fields to change.

        Raises
        ------
        ValueError, TypeError
            If no element has the name, or the element refuses the changes.
        """
        named = [e for e in (*self.bodies, *self.drives, *self.contacts) if e.name == name]
        if not named:
            raise ValueError(f"Scene.replace: no body, drive or contact is called {name!r}")
        return Scene(*(replace(e, **changes) if e is named[0] else e for e in self.elements))

    def with_laws(self, change: Callable[[Law], Law]) -> Scene:
        """Return the scene with every contact's law replaced by ``change(law)``."""
        return Scene(*(replace(e, law=change(e.law)) if isinstance(e, Contact) else e for e in self.elements))

    def regularized(self, velocity: float = 1e-3, shape: str = "linear") -> Scene:
        """Return the scene with every contact on a pre-slip law of the same coefficients.

        Parameters
        ----------
        velocity : float
            Pre-slip velocity in m/s or rad/s.
        shape : str
            "linear", "tanh" or "arctan".
        """
        return self.with_laws(lambda law: PreSlip(law if isinstance(law, DryFriction) else law.law, velocity, shape))

    def to_dict(self) -> dict[str, Any]:
        """Return the scene as plain data: tables of numbers, strings, lists and dicts.

        Raises
        ------
        ValueError
            If a signal or a law holds code.
        """
        return {
            kind: [element.to_dict() for element in getattr(self, kind)] for kind in _KINDS if getattr(self, kind)
        }

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
        unknown = [key for key in data if key not in _KINDS]
        if unknown:
            raise ValueError(f"Scene.from_dict: unknown table {unknown[0]!r}; known are {', '.join(_KINDS)}")
        return cls(*_elements(data))

    def __repr__(self) -> str:
        return f"Scene({', '.join(map(repr, self.elements))})"


def _elements(data: Mapping[str, Any]) -> Iterator[Element]:
    for kind, rows in data.items():
        if not isinstance(rows, (list, tuple)):
            raise TypeError(f"Scene.from_dict: {kind} must be a list of tables, got {rows!r}")
        for number, row in enumerate(rows):
            yield _element(_KINDS[kind], f"{kind}[{number}]", row)


def _element(maker: type[Element], where: str, row: Any) -> Element:
    if not isinstance(row, Mapping):
        raise TypeError(f"{where}: expected a table, got {row!r}")
    values = dict(row)
    known = [field.name for field in fields(maker)]
    for name in values:
        if name not in known:
            raise ValueError(f"{where}: unknown field {name!r}; a {maker.__name__} has {', '.join(known)}")
    for name in ("velocity", "normal", "signal"):
        if isinstance(values.get(name), dict):
            values[name] = signal_from_dict(values[name], f"{where}.{name}")
    if "law" in values:
        values["law"] = law_from_dict(values["law"], f"{where}.law")
    try:
        return maker(**values)
    except TypeError as error:
        raise TypeError(f"{where}: {error}") from None
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def _listed(names: set[str]) -> str:
    listed = sorted(names)
    return ", ".join(map(repr, listed[:10])) + (", ..." if len(listed) > 10 else "")
