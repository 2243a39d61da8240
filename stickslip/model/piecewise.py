"""Piecewise-linear functions of the state: what elastic gaps, limits and tables are made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from stickslip.model.signals import Signal

__all__ = ["Linear", "Region"]


@dataclass(frozen=True)
class Linear:
    """A linear expression ``sum p_i x_i + sum c_i v_i + sum f_k signal_k(t) + constant``.

    Attributes
    ----------
    positions, velocities : dict of str to float
        Coefficients by name of the body or drive; the ground counts nothing.
    signals : tuple of (float, Signal)
        Factors and signals.
    constant : float
    """

    positions: Mapping[str, float] = field(default_factory=dict)
    velocities: Mapping[str, float] = field(default_factory=dict)
    signals: tuple[tuple[float, Signal], ...] = ()
    constant: float = 0.0

    def __add__(self, other: Linear | float) -> Linear:
        """Return the sum with another expression or a number."""
        if not isinstance(other, Linear):
            return Linear(self.positions, self.velocities, self.signals, self.constant + other)
        return Linear(
            _added(self.positions, other.positions),
            _added(self.velocities, other.velocities),
            self.signals + other.signals,
            self.constant + other.constant,
        )

    def __mul__(self, factor: float) -> Linear:
        """Return a multiple."""
        return Linear(
            {name: factor * c for name, c in self.positions.items()},
            {name: factor * c for name, c in self.velocities.items()},
            tuple((factor * f, signal) for f, signal in self.signals),
            factor * self.constant,
        )

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Linear:
        """Return the negative."""
        return -1.0 * self

    def __sub__(self, other: Linear | float) -> Linear:
        """Return the difference from another expression or a number."""
        return self + -other

    def __rsub__(self, other: float) -> Linear:
        """Return a number less the expression."""
        return -self + other


def _added(one: Mapping[str, float], other: Mapping[str, float]) -> dict[str, float]:
    return {name: one.get(name, 0.0) + other.get(name, 0.0) for name in {**one, **other}}


@dataclass(frozen=True)
class Region:
    """A part of the state space in which a piecewise-linear function is linear.

    Attributes
    ----------
    value : Linear
        The function there.
    borders : tuple of (Linear, int)
        Expressions that are positive inside, and the number of the region beyond each.
    mode : int
        What a row shows while its function is there: OPEN, FORWARD or BACKWARD.
    """

    value: Linear
    borders: tuple[tuple[Linear, int], ...] = ()
    mode: int = 0
