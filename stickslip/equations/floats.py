"""A small motion in plain floats: on a few numbers, arrays cost ten times what they compute.

It covers motions whose inputs are lines between breaks, with friction that slips in known directions. Then the rates,
and the guards but for levels that rise, are ``c + c' tau + row (y, e)``, with the friction forces ``e`` that depend on
velocity.
"""

from __future__ import annotations

from collections.abc import Callable
from operator import mul
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["LawInFloats", "Line", "evaluate", "forces", "lines"]

Array = NDArray[np.float64]


class Line(NamedTuple):
    """``value + slope tau + row x``."""

    value: float
    slope: float
    row: list[float]


class LawInFloats(NamedTuple):
    """A contact whose friction depends on its relative velocity: that, its normal force, and its law."""

    w: Line
    normal: float
    normal_slope: float
    law: Callable[[float, float], float]


def lines(value: Array, slope: Array, *parts: Array) -> list[Line]:
    """Return quantities as lines; the parts of their rows stand side by side."""
    return [Line(*x) for x in zip(value.tolist(), slope.tolist(), np.hstack(parts).tolist(), strict=True)]


def forces(laws: list[LawInFloats], tau: float, y: list[float]) -> list[float]:
    """Return the friction forces at local time `tau`."""
    return [
        law(w[0] + w[1] * tau + sum(map(mul, w[2], y)), max(normal + slope * tau, 0.0))
        for w, normal, slope, law in laws
    ]


def evaluate(quantities: list[Line], tau: float, x: list[float]) -> list[float]:
    """Return quantities at local time `tau`, from states followed by friction forces."""
    return [value + slope * tau + sum(map(mul, row, x)) for value, slope, row in quantities]
