"""Piecewise-linear functions of the stretch of a row and of its rate: what elastic gaps and rigid stops are made of."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Linear:
    """A linear expression: factors of the stretch of a row and of its rate, and a constant."""

    stretch: float = 0.0
    rate: float = 0.0
    constant: float = 0.0

    def __add__(self, other: Linear | float) -> Linear:
        if not isinstance(other, Linear):
            other = Linear(constant=other)
        return Linear(self.stretch + other.stretch, self.rate + other.rate, self.constant + other.constant)

    def __mul__(self, factor: float) -> Linear:
        return Linear(factor * self.stretch, factor * self.rate, factor * self.constant)

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Linear:
        return -1.0 * self

    def __sub__(self, other: Linear | float) -> Linear:
        return self + -other

    def __rsub__(self, other: float) -> Linear:
        return -self + other


@dataclass(frozen=True)
class Region:
    """A part of the state space in which a piecewise-linear function is linear."""

    value: Linear  # the function there
    # expressions that are positive inside, and the number of the region beyond each
    borders: tuple[tuple[Linear, int], ...] = ()
    mode: int = 0  # what a row shows while its function is there: OPEN, FORWARD or BACKWARD
