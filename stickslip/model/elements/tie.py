"""A fixed relation between velocities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from stickslip.model.checks import finite
from stickslip.model.elements.base import Held


@dataclass(frozen=True)
class Tie(Held):
    """A fixed relation between velocities: ``sum c_i v_i = 0`` for ever.

    Its force lambda is whatever keeps it so; it acts with ``-c_i lambda`` on body i, and does no work (the constraint
    equations of mechanics with multipliers, ``M v' + G^T lambda = F``).

    Parameters
    ----------
    name : str
        Unique among the contacts and other rows of the scene.
    coefficients : dict of str to float
        By name of the body or drive, or GROUND; none of them 0.

    Raises
    ------
    ValueError, TypeError
        If there is no member, or a coefficient is 0 or not finite.
    """

    name: str
    coefficients: Mapping[str, float]

    def __post_init__(self) -> None:
        super().__post_init__()
        given = self.coefficients
        if not isinstance(given, Mapping):
            raise TypeError(
                f"{self.label}: coefficients must be a dict of body names to numbers "
                f"such as {{'wheel': 1.0, 'shaft': -2.0}}, got {given!r}"
            )
        if not given:
            raise ValueError(f"{self.label}: coefficients are empty; name at least one body")
        checked: dict[str, float] = {}
        for member, value in given.items():
            if not isinstance(member, str) or not member:
                raise TypeError(f"{self.label}: members must be names of bodies, got {member!r}")
            checked[member] = finite(value, f"{self.label}: coefficient of {member!r}")
            if checked[member] == 0:
                raise ValueError(f"{self.label}: coefficient of {member!r} must not be 0; leave {member!r} out")
        object.__setattr__(self, "coefficients", MappingProxyType(checked))

    def __reduce__(self) -> tuple[type[Tie], tuple[str, dict[str, float]]]:
        """Pickle the coefficients as a dict: a read-only mapping cannot be pickled."""
        return type(self), (self.name, dict(self.coefficients))

    def __repr__(self) -> str:
        return f"{type(self).__name__}(name={self.name!r}, coefficients={dict(self.coefficients)!r})"

    def __hash__(self) -> int:
        """Equal ties have equal hashes, whatever the order of their members."""
        return hash((self.name, frozenset(self.coefficients.items())))

    def to_dict(self) -> dict[str, Any]:
        """Return the tie as plain data."""
        return {"name": self.name, "coefficients": dict(self.coefficients)}
