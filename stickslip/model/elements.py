"""The elements of a scene: bodies, drives, contacts, springs, dampers and forces, as frozen data."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, fields
from typing import Any

from stickslip.model.checks import finite
from stickslip.model.laws.dry_friction import DryFriction, Law
from stickslip.model.signal_makers import Signal, as_signal

__all__ = ["GROUND", "Body", "Contact", "Damper", "Drive", "Element", "Force", "Link", "Named", "Spring"]

GROUND = "ground"
"""Name of the ground: a body that never moves."""

_LEAST = 1e-300
"""Smaller numbers have no inverse."""


class Element:
    """A part of a scene."""

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
                data[field.name] = value.to_dict() if isinstance(value, (Signal, Law)) else value
        return data

    def _number(self, name: str) -> float:
        number = finite(getattr(self, name), f"{self.label}: {name}")
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


class Named(Element):
    """An element with a name of its own."""

    name: str

    @property
    def label(self) -> str:
        """How messages name the element."""
        return f"{type(self).__name__.lower()} {self.name!r}"

    def _free_name(self) -> None:
        """Check the name of a body or a drive: a contact may be called what it likes."""
        self._identifier("name")
        if self.name == GROUND:
            raise ValueError(
                f"{type(self).__name__}: the name {GROUND!r} is taken by the ground, which is always there; "
                f"rename {self.label}, or leave it out and join to GROUND"
            )


class Link(Element):
    """An element between two bodies."""

    a: str
    b: str

    @property
    def label(self) -> str:
        """How messages name the element."""
        return f"{type(self).__name__.lower()} {self.a!r}-{self.b!r}"

    def _two_ends(self) -> None:
        self._identifier("a")
        self._identifier("b")
        if self.a == self.b:
            raise ValueError(f"{self.label}: joins {self.a!r} to itself; name two different bodies")


@dataclass(frozen=True)
class Body(Named):
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
        If a number is not finite, the inertia not positive, or the name that of the ground.
    """

    name: str
    _: KW_ONLY
    inertia: float
    velocity: float = 0.0
    position: float = 0.0

    def __post_init__(self) -> None:
        """Check the fields."""
        self._free_name()
        if (inertia := self._number("inertia")) < _LEAST:
            raise ValueError(
                f"{self.label}: inertia must be positive, got {inertia:g}; "
                "use a Drive for a body of prescribed velocity and GROUND for one at rest"
            )
        self._number("velocity")
        self._number("position")


@dataclass(frozen=True)
class Drive(Named):
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
        If the velocity is not a signal, the position not finite, or the name that of the ground.
    """

    name: str
    _: KW_ONLY
    velocity: Signal | float
    position: float = 0.0

    def __post_init__(self) -> None:
        """Check the fields."""
        self._free_name()
        self._signal("velocity")
        self._number("position")


@dataclass(frozen=True)
class Contact(Named, Link):
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
        """Check the fields."""
        self._identifier("name")
        self._two_ends()
        if not isinstance(self.law, Law) or not isinstance(getattr(self.law, "law", self.law), DryFriction):
            raise TypeError(
                f"{self.label}: law must be a friction law such as DryFriction(0.2, 0.1), got {self.law!r}"
            )
        self._signal("normal")
        self._not_negative("rested")


@dataclass(frozen=True)
class Spring(Link):
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
        """Check the fields."""
        self._two_ends()
        self._not_negative("stiffness")
        self._not_negative("damping")
        self._number("rest")


@dataclass(frozen=True)
class Damper(Link):
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
        """Check the fields."""
        self._two_ends()
        self._not_negative("damping")


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
        """Check the fields."""
        self._identifier("body")
        self._signal("signal")

    @property
    def label(self) -> str:
        """How messages name the element."""
        return f"force on {self.body!r}"
