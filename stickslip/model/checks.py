"""Checks of arguments: numbers that are numbers, sequences that are sequences."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

__all__ = ["check_entries", "check_takes_one", "finite", "sequence"]


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


def check_entries(
    maker: Callable[..., Any], kind: str, given: Mapping[str, Any], what: str, code: tuple[str, ...] = ()
) -> None:
    """Refuse entries of a table that what is made from it does not know, and tables that lack one it needs.

    Arguments named in `code` cannot stand in a table.

    Raises
    ------
    TypeError
        `what` begins the message.
    """
    arguments = inspect.signature(maker).parameters
    known = {name: argument for name, argument in arguments.items() if name not in code}
    for name in given:
        if name not in known:
            raise TypeError(f"{what}: unknown field {name!r}; a {kind} has {', '.join(known)}")
    for name, argument in known.items():
        if argument.default is argument.empty and name not in given:
            raise TypeError(f"{what}: field {name!r} is missing; a {kind} needs it")


def check_takes_one(function: Callable[..., Any], what: str, argument: str) -> None:
    """Refuse a function that cannot be called with one argument; one that does not tell is taken as it is.

    Raises
    ------
    TypeError
        `what` begins the message.
    """
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return
    try:
        signature.bind(0.0)
    except TypeError:
        raise TypeError(
            f"{what} must take one argument, {argument}, but it is declared as {signature}: {function!r}"
        ) from None
