"""Checks of arguments: numbers that are numbers, sequences that are sequences."""

from __future__ import annotations

import inspect
import math
import reprlib
from collections.abc import Callable, Iterable, Mapping, Set
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stickslip.model.arrays import Array

_MOST = 100_000_000


class NamedArguments(type):
    """A metaclass: an error of the constructor names the arguments that are missing or unknown, and all that exist."""

    if not TYPE_CHECKING:  # type checkers look at the constructor itself

        def __call__(cls, *args: Any, **given: Any) -> Any:
            """Make an object."""
            try:
                return super().__call__(*args, **given)
            except TypeError:
                _check_call(cls, args, given)
                raise

        @property
        def __signature__(cls) -> inspect.Signature:
            """The arguments of the constructor, which `__call__` would hide."""
            own = inspect.signature(cls.__init__)
            return own.replace(parameters=list(own.parameters.values())[1:])


def _check_call(cls: type, args: tuple[Any, ...], given: Mapping[str, Any]) -> None:
    """Refuse a call that does not fit the constructor; return if it fits: then the error is about a value."""
    arguments = inspect.signature(cls).parameters
    if any(one.kind in (one.VAR_POSITIONAL, one.VAR_KEYWORD) for one in arguments.values()):
        return
    plain = [name for name, one in arguments.items() if one.kind is not one.KEYWORD_ONLY]
    has = f"it has {', '.join(arguments)}"
    if len(args) > len(plain):
        after = arguments.keys() - set(plain)
        by_name = f"; give {', '.join(name for name in arguments if name in after)} by name" if after else ""
        raise TypeError(f"{cls.__name__}: too many positional arguments; {has}{by_name}") from None
    taken = set(plain[: len(args)])
    for name in given:
        if name not in arguments:
            raise TypeError(f"{cls.__name__}: unknown argument {name!r}; {has}") from None
        if name in taken:
            raise TypeError(f"{cls.__name__}: argument {name!r} is given twice; {has}") from None
    for name, one in arguments.items():
        if one.default is one.empty and name not in given and name not in taken:
            raise TypeError(f"{cls.__name__}: argument {name!r} is missing; {has}") from None


def every_digit(number: float) -> str:
    """Return a short text that reads back as exactly this number: 5, 0.1, 0.30000000000000004."""
    short = f"{number:g}"
    return short if float(short) == number else repr(float(number))


def finite(value: Any, what: str) -> float:
    """Return a finite number as a float; refuse other values with a message that begins with `what`."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        remedy = "; give it in SI units, without quotes" if isinstance(value, str) else ""
        if callable(value) or hasattr(value, "_not_linear"):  # a function or a load
            remedy = "; what changes with time or the motion is a Force(body, load) or a contact's normal=load"
        raise TypeError(f"{what} must be a number, got {value!r}{remedy}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"{what} must be finite, got {number}")
    return number


def as_number(value: Any) -> float:
    """Return the value of a user's function, a number or an array of one number, as a float; NaN for anything else."""
    if isinstance(value, float):
        # np.float64 is a float, too; this takes a tenth of the time of reshape
        return float(value)
    try:
        return math.nan if isinstance(value, (str, bytes)) else float(np.reshape(value, ()))
    except (TypeError, ValueError, OverflowError):
        return math.nan


def flag(value: Any, what: str) -> bool:
    """Return True or False; refuse other values with a message that begins with `what`."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{what} must be True or False, got {reprlib.repr(value)}")
    return bool(value)


def whole(value: Any, what: str, least: int = 0) -> int:
    """Return a whole number from `least` on; refuse other values with a message that begins with `what`."""
    is_whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not is_whole or value < least:
        error = ValueError if is_whole else TypeError
        raise error(f"{what} must be a whole number from {least} on, got {reprlib.repr(value)}")
    if value > _MOST:
        raise ValueError(f"{what} must be at most {_MOST:,}, got {reprlib.repr(value)}")
    return int(value)


def limit(value: Any, none: float, what: str) -> float:
    """Return a finite number, or `none`, the infinite one that means no limit; files write `none` as a string."""
    if isinstance(value, (str, int, float)) and value in (none, str(none)):
        return none
    if isinstance(value, float) and value == -none:
        raise ValueError(f"{what} must be a number or {none:g}, got {value:g}; leave it out for no limit")
    return finite(value, what)


def in_order(values: Any, what: str, kind: str = "numbers") -> list[Any]:
    """Return the items of a sequence as a list; refuse text, and sets and tables, which have no order.

    `what` begins the message; `kind` names the items that the sequence should hold.
    """
    try:
        if not isinstance(values, (str, bytes, Set, Mapping)):
            return list(values)
    except TypeError:
        pass
    raise TypeError(f"{what} must be a sequence of {kind}, got {reprlib.repr(values)}") from None


def sequence(values: Iterable[float], what: str) -> tuple[float, ...]:
    """Return finite numbers as a tuple of floats; refuse other values with a message that begins with `what`."""
    return tuple(finite(value, what) for value in in_order(values, what))


def check_name(value: Any, what: str) -> str:
    """Return a name; refuse other values with a message that begins with `what`."""
    if not isinstance(value, str) or not value:
        raise TypeError(f"{what} must be a name (a string that is not empty), got {value!r}")
    return value


def check_entries(
    maker: Callable[..., Any],
    kind: str,
    given: Mapping[str, Any],
    what: str,
    error: type[Exception] = ValueError,
    code: tuple[str, ...] = (),
) -> None:
    """Refuse a table that has an entry which its `maker` does not know, or lacks one which it needs.

    The entries are the arguments of `maker`, but for those in `code`. `what` begins the message of the error, and
    `kind` names the maker there.
    """
    known = {name: needed for name, needed in _arguments(maker).items() if name not in code}
    for name in given:
        if name not in known:
            raise error(f"{what}: unknown field {name!r}; a {kind} has {', '.join(known)}")
    for name, needed in known.items():
        if needed and name not in given:
            raise error(f"{what}: field {name!r} is missing; a {kind} needs it")


@lru_cache
def _arguments(maker: Callable[..., Any]) -> dict[str, bool]:
    """Return the names of the arguments of a function, and whether each must be given."""
    arguments = inspect.signature(maker).parameters
    return {name: one.default is one.empty for name, one in arguments.items()}


def check_takes(function: Callable[..., Any], count: int, what: str, arguments: str, named: Iterable[str] = ()) -> None:
    """Refuse a function that cannot be called with `count` arguments and the `named` ones by name.

    A function without a signature is not refused.

    In the message, `what` names the function, and `arguments` says which arguments it must take.
    """
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return
    try:
        signature.bind(*[0.0] * count, **dict.fromkeys(named, 0.0))
    except TypeError:
        raise TypeError(f"{what} must take {arguments}, but it is declared as {signature}: {function!r}") from None


def name_of(function: Callable[..., Any]) -> str:
    """Return how messages name a function."""
    # ufuncs have no qualified name before numpy 2
    simple = getattr(function, "__name__", repr(function))
    return str(getattr(function, "__qualname__", simple))


def numbers(values: Any, what: str) -> Array:
    """Return numbers in one line as an array; their values are not checked.

    `what` begins the message where something is refused.
    """
    try:
        found = np.asarray(values)
    except ValueError:  # rows of different lengths
        found = np.empty(0, dtype=object)
    if not found.ndim or found.dtype.kind not in "iuf":
        raise TypeError(f"{what} must be a sequence of numbers, got {reprlib.repr(values)}")
    if found.ndim > 1:
        raise ValueError(f"{what} must be numbers in one line, got an array of shape {found.shape}")
    return found.astype(float)


def names(values: Any, what: str) -> list[str]:
    """Return a sequence of names as a list; whether they exist is not checked.

    `what` begins the message where something is refused.
    """
    if isinstance(values, str):
        raise TypeError(f"{what} must be a sequence of names, got {values!r}; write [{values!r}]")
    return [check_name(value, f"{what}: one") for value in in_order(values, what, "names")]


def file_path(path: Any, what: str) -> Path:
    """Return the path of a file.

    `what` begins the message where something is refused.
    """
    if not isinstance(path, (str, PathLike)):
        raise TypeError(f"{what}: path must be a text or a pathlib.Path, got {reprlib.repr(path)}")
    return Path(path)


def rounded_up(value: float) -> str:
    """Return a positive number in two digits, rounded up: a message names it as a least value that is enough."""
    return f"{1.05 * value:.2g}"
