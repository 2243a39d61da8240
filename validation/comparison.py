"""How runs are held against an oracle: the events of each row in order, and the scenes of a family one by one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Protocol

from stickslip import Result, Signal, piecewise_linear, sine
from validation.oracle import Event
from validation.rows import Array, Tried, require
from validation.tried import try_each

__all__ = ["AT_THE_END", "PATIENCE", "Truth", "compare_events", "over_family", "signal_of"]

AT_THE_END = 2e-7
"""Part of the span before its end in which events are not compared: whether they come before it is roundoff."""

PATIENCE = 60.0
"""Time in s after which a scene counts as hanging."""


class Truth(Protocol):
    """What an oracle finds: up to `stop`, at times `t`; `doubt` says why that is not the whole scene."""

    @property
    def stop(self) -> float:
        """Time in s."""
        ...

    @property
    def events(self) -> list[Event]:
        """The events before that."""
        ...

    @property
    def t(self) -> Array:
        """Times in s at which velocities and forces are compared."""
        ...

    @property
    def doubt(self) -> str:
        """Empty where the answer is unique to the end."""
        ...


def signal_of(data: Any) -> Signal | float:
    """Return a load given as plain data: a number, a sine, or points of straight lines."""
    if isinstance(data, Mapping):
        return sine(**data)
    if isinstance(data, (int, float)):
        return float(data)
    return piecewise_linear(*zip(*data, strict=True))


def compare_events(right: Truth, result: Result, tolerance: float) -> None:
    """Compare the events of each row, in order; those of different rows may come in any order.

    Raises
    ------
    Wrong
        If a row has other events, or one is late by more than `tolerance` as a part of the span.
    """
    last = right.stop * (1 - AT_THE_END)
    found = [(e.t, e.contact, int(e.before), int(e.after)) for e in result.events if e.t < last]
    for name in sorted({event[1] for event in [*right.events, *found]}):
        wanted = [event for event in right.events if event[1] == name]
        have = [event for event in found if event[1] == name]
        told = f"{name} has {_story(have)} instead of {_story(wanted)}"
        require([e[2:] for e in have] == [e[2:] for e in wanted], told)
        for a, b in zip(have, wanted, strict=True):
            late = abs(a[0] - b[0]) / right.stop
            require(late <= tolerance, f"{name}: time {a[0]:.12g} s instead of {b[0]:.12g} s")


def _story(events: list[Event]) -> str:
    return "[" + ", ".join(f"{t:.9g} s {before:+d}>{after:+d}" for t, _, before, after in events[:6]) + "]"


def over_family(
    truth: Callable[[str, int], Truth],
    difference: Callable[[str, str, int], float],
    family: str,
    group: str,
    count: int,
) -> Tried:
    """Return the worst of scenes 1 to `count` of a family; where the oracle has no answer, nothing is compared."""
    numbers = [n for n in range(1, count + 1) if truth(family, n).t.size]
    tried = try_each(((f"{family} {n}", partial(difference, family, group, n)) for n in numbers), PATIENCE)
    events = sum(len(truth(family, n).events) for n in numbers)
    truncated = sum(bool(truth(family, n).doubt) for n in numbers)
    remark = f"{tried.remark}; {events} events"
    if truncated:
        remark += f"; {truncated} scenes up to where the answer is no longer unique"
    if len(numbers) < count:
        remark += f", {count - len(numbers)} left out where it never is"
    return replace(tried, remark=remark)
