"""A scene: bodies and what acts between them, checked as a whole, to and from plain data."""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, replace
from typing import Any

from stickslip.model.elements import GROUND, Body, Contact, Damper, Drive, Element, Force, Named, Spring
from stickslip.model.laws.dry_friction import Law, law_from_dict
from stickslip.model.laws.regularized import PreSlip, Shape
from stickslip.model.signal_makers import signal_from_dict

__all__ = ["GROUND", "Body", "Contact", "Damper", "Drive", "Element", "Force", "Scene", "Spring"]

_KINDS: dict[str, type[Element]] = {
    "bodies": Body,
    "drives": Drive,
    "contacts": Contact,
    "springs": Spring,
    "dampers": Damper,
    "forces": Force,
}
_FIELDS = {
    kind: {field.name: field.default is MISSING for field in fields(kind)}  # type: ignore[arg-type]
    for kind in _KINDS.values()
}
"""Of each kind of element the names of its fields, and whether they must be given."""


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
        """Sort the elements by kind and check that they fit together."""
        sorted_: dict[type, list[Element]] = {kind: [] for kind in _KINDS.values()}
        for element in elements:
            if type(element) not in sorted_:
                raise TypeError(
                    f"Scene: {reprlib.repr(element)} is not an element; "
                    "give Body, Drive, Contact, Spring, Damper or Force one by one (a list of them as *list)"
                )
            sorted_[type(element)].append(element)
        for name, kind in _KINDS.items():
            object.__setattr__(self, name, tuple(sorted_[kind]))
        self._check_names()
        self._check_references()

    @property
    def elements(self) -> tuple[Element, ...]:
        """All elements, kind by kind."""
        return tuple(element for kind in _KINDS for element in getattr(self, kind))

    def _check_names(self) -> None:
        if not self.bodies:
            raise ValueError("Scene: there is no free body; add at least one Body")
        groups: tuple[tuple[Named, ...], ...] = ((*self.bodies, *self.drives), self.contacts)
        for named in groups:
            seen: set[str] = set()
            for one in named:
                if one.name in seen:
                    raise ValueError(f"Scene: the name of {one.label} stands twice; rename one of the two")
                seen.add(one.name)

    def _check_references(self) -> None:
        free = {body.name for body in self.bodies}
        known = free | {drive.name for drive in self.drives} | {GROUND}
        links: tuple[Contact | Spring | Damper, ...] = (*self.contacts, *self.springs, *self.dampers)
        for link in links:
            for end in (link.a, link.b):
                if end not in known:
                    raise ValueError(f"{link.label}: no body is called {end!r}; known are {_listed(known)}")
            if link.a not in free and link.b not in free:
                raise ValueError(
                    f"{link.label}: neither {link.a!r} nor {link.b!r} is free to move; join at least one Body"
                )
        for force in self.forces:
            if force.body not in free:
                remedy = f"known bodies are {_listed(free)}"
                if force.body in known:
                    remedy = "no force changes the velocity of a drive or of the ground; leave it out"
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
        named: list[Any] = [e for e in (*self.bodies, *self.drives, *self.contacts) if e.name == name]
        if not named:
            known = {e.name for e in (*self.bodies, *self.drives, *self.contacts)}
            raise ValueError(
                f"Scene.replace: no body, drive or contact is called {name!r}; known are {_listed(known)}"
            )
        if len(named) > 1:
            raise ValueError(
                f"Scene.replace: a body and a contact are both called {name!r}; rename one of them"
            )
        _check_fields(type(named[0]), f"Scene.replace: {named[0].label}", changes)
        return Scene(*(replace(e, **changes) if e is named[0] else e for e in self.elements))

    def with_laws(self, change: Callable[[Law], Law]) -> Scene:
        """Return the scene with every contact's law replaced by ``change(law)``."""
        return Scene(*(replace(e, law=change(e.law)) if isinstance(e, Contact) else e for e in self.elements))

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
        data = {}
        for kind in _KINDS:
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
        unknown = [key for key in data if key not in _KINDS]
        if unknown:
            raise ValueError(f"Scene.from_dict: unknown table {unknown[0]!r}; known are {', '.join(_KINDS)}")
        return cls(*_elements(data))

    def __repr__(self) -> str:
        """Return the call that makes the scene."""
        return f"Scene({', '.join(map(repr, self.elements))})"


def _elements(data: Mapping[str, Any]) -> Iterator[Element]:
    for kind, rows in data.items():
        if not isinstance(rows, (list, tuple)):
            raise TypeError(f"Scene.from_dict: {kind} must be a list of tables, got {rows!r}")
        for number, row in enumerate(rows):
            yield _element(_KINDS[kind], f"{kind}[{number}]", row)


def _plain(element: Element) -> dict[str, Any]:
    try:
        return element.to_dict()
    except (TypeError, ValueError) as error:
        raise type(error)(f"{element.label}: {error}") from None


def _element(maker: type[Element], where: str, row: Any) -> Element:
    if not isinstance(row, Mapping):
        raise TypeError(f"{where}: expected a table, got {row!r}")
    values = dict(row)
    _check_fields(maker, where, values)
    for name, required in _FIELDS[maker].items():
        if required and name not in values:
            raise ValueError(f"{where}: field {name!r} is missing; a {maker.__name__} needs it")
    for name in ("velocity", "normal", "signal"):
        if isinstance(values.get(name), Mapping):
            values[name] = signal_from_dict(values[name], f"{where}.{name}")
    if "law" in values:
        values["law"] = law_from_dict(values["law"], f"{where}.law")
    try:
        return maker(**values)
    except (TypeError, ValueError) as error:
        raise type(error)(f"{where}: {error}") from None


def _check_fields(kind: type[Element], where: str, values: Mapping[str, Any]) -> None:
    known = _FIELDS[kind]
    for name in values:
        if name not in known:
            raise ValueError(f"{where}: unknown field {name!r}; a {kind.__name__} has {', '.join(known)}")


def _listed(names: set[str]) -> str:
    listed = sorted(names)
    return ", ".join(map(repr, listed[:10])) + (", ..." if len(listed) > 10 else "")
