"""Rows of the table of checks, and how they are judged."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip import Result, SimulationError

Array = NDArray[np.float64]
Change = tuple[float, str, int, int]  # a change of mode: time in s, contact, mode before, mode after
FORMULATIONS = ("contact-force", "merged", "multiplier")


def asked(formulation: str) -> dict[str, Any]:
    """Return arguments of `simulate` for a formulation: the default engine, but CVODE for merged inertias."""
    return {"formulation": formulation} | ({"method": "BDF"} if formulation == "merged" else {})


class Wrong(Exception):
    """An answer that is wrong in kind, not by an amount: a missing event, a stuck contact that moves."""


@dataclass(frozen=True)
class Tried:
    """The result of many cases of one kind that were tried one by one."""

    error: float
    remark: str
    count: int
    wrong: int = 0
    hung: int = 0


Answer = float | tuple[float, str] | Tried


@dataclass(frozen=True)
class Row:
    """A check: data, so that it can be listed, sent to another process, and printed."""

    theme: str  # chapter of the table it stands in
    name: str  # by which it can be run on its own
    what: str  # the quantity that is compared, and the scale of its error
    source: str  # where the right answer comes from
    # returns the error, or error and remark, or the result of many cases; raises `Wrong` for an error without a size
    check: Callable[[], Answer]
    bound: float  # largest error that passes
    quick: bool = True  # whether it belongs to the quick run
    limit: float = 30.0  # time in s after which it counts as hanging
    tries: str = ""  # plural noun for the cases that it tries one by one, if it does: the report counts these
    same: bool = False  # whether all rows with the same `tries` try the same cases


@dataclass(frozen=True)
class Outcome:
    """The result of a row: measured error, time spent in s, a remark if there is one, and the result of many cases
    if it tried some.
    """

    row: Row
    error: float
    seconds: float
    remark: str = ""
    tried: Tried | None = None

    @property
    def passed(self) -> bool:
        """Whether the error is within the bound; an error that is not a number is not."""
        return self.error <= self.row.bound


def judge(row: Row) -> Outcome:
    """Run a row here and now."""
    start = time.perf_counter()
    tried = None
    try:
        answer = row.check()
        if isinstance(answer, Tried):
            tried, answer = answer, (answer.error, answer.remark)
        error, remark = answer if isinstance(answer, tuple) else (answer, "")
    except Wrong as wrong:
        error, remark = math.inf, str(wrong)
    except Exception as fault:
        error, remark = math.inf, f"{type(fault).__name__}: {fault}"
    return Outcome(row, float(error), time.perf_counter() - start, remark, tried)


# How errors are measured


def require(condition: bool, otherwise: str) -> None:
    """Raise `Wrong` unless a condition holds."""
    if not condition:
        raise Wrong(otherwise)


def changes(result: Result, opened: bool = False) -> list[Change]:
    """Return the events as plain numbers, without those of open contacts unless `opened`."""
    events = (e for e in result.events if opened or e.cause != "open")
    return [(e.t, e.contact, int(e.before), int(e.after)) for e in events]


def event_error(found: Sequence[Change], exact: Iterable[Sequence[Any]], scale: float) -> float:
    """Return the largest error of the event times over a time scale; other events than the exact ones are wrong.

    Events closer together than roundoff may come in any order.
    """
    wanted = [(float(t), name, int(before), int(after)) for t, name, before, after in exact]
    key = lambda event: (round(event[0] / scale, 10), event[1:])  # noqa: E731
    if [e[1:] for e in found] != [e[1:] for e in wanted]:
        found, wanted = sorted(found, key=key), sorted(wanted, key=key)
    if [e[1:] for e in found] != [e[1:] for e in wanted]:
        raise Wrong(f"events {story(found)} instead of {story(wanted)}")
    return max((abs(a[0] - b[0]) / scale for a, b in zip(found, wanted, strict=True)), default=0.0)


def story(events: Sequence[Change]) -> str:
    """Return the first of some events in words, and how many there are."""
    shown = ", ".join(f"{t:.9g} s {name} {before:+d}>{after:+d}" for t, name, before, after in events[:6])
    return f"[{shown}{', ...' if len(events) > 6 else ''}] ({len(events)})"


def worst(found: Any, exact: Any, scale: float | None = None) -> float:
    """Return the largest difference over `scale`, by default over the largest exact value (1 where all are 0)."""
    found, exact = np.asarray(found, dtype=float), np.asarray(exact, dtype=float)
    require(found.shape == exact.shape, f"shape {found.shape} instead of {exact.shape}")
    if not exact.size:
        return 0.0
    size = (float(np.abs(exact).max()) or 1.0) if scale is None else scale
    return float(np.abs(found - exact).max()) / size


def refused(run: Callable[[], Any], *words: str) -> float:
    """Return 0 where a run ends in an error whose message holds all the words; anything else is wrong."""
    try:
        run()
    except (SimulationError, ValueError, TypeError) as error:
        missing = [word for word in words if word not in str(error)]
        require(not missing, f"the error does not say {', '.join(missing)}: {error}")
        return 0.0
    raise Wrong("an answer where there is none: an error was expected")
