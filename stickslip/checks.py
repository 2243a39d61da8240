"""Checks of arguments: numbers that are numbers, sequences that are sequences."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

__all__ = ["finite", "sequence"]


def finite(value: Any, what: str) -> float:
    """Return a finite number as a float.

    Raises
    ------
    TypeError, ValueError
        If it is no number, or not finite; `what` begins the message.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise TypeError(f"{what} must be a number, got {value!r}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"{what} must be finite, got {number}")
    return number


def sequence(values: Iterable[float], what: str) -> tuple[float, ...]:
    """Return finite numbers as a tuple of floats.

    Raises
    ------
    TypeError, ValueError
        If it is no sequence, or one of its entries no finite number; `what` begins the message.
    """
    try:
        listed = list(values)
    except TypeError:
        raise TypeError(f"{what} must be a sequence of numbers, got {values!r}") from None
    return tuple(finite(value, what) for value in listed)
