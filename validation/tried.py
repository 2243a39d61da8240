"""Many cases of one kind tried one by one: each has a time limit, and those that are wrong or hang are counted."""

from __future__ import annotations

import contextlib
import math
import os
import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from validation.rows import Outcome, Tried


class Hung(BaseException):
    """No answer within the time limit. Not an `Exception`: no handler of errors may catch it."""


@contextlib.contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raise `Hung` after `seconds`; without alarms, as on Windows, there is only the limit of the row."""
    if not hasattr(signal, "setitimer"):
        yield
        return

    def ring(*_: Any) -> None:
        raise Hung

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def patience() -> float:
    """Return the factor by which time limits are longer: the environment's VALIDATION_PATIENCE, or 1."""
    return float(os.environ.get("VALIDATION_PATIENCE", "1"))


def try_each(items: Iterable[tuple[str, Callable[[], float]]], limit: float) -> Tried:
    """Try items by name; each returns its error, or raises where it is wrong. A wrong item makes the error infinite."""
    wrong: list[str] = []
    hung: list[str] = []
    errors: dict[str, float] = {}
    for name, item in items:
        try:
            with time_limit(limit * patience()):
                errors[name] = item()
        except Hung:
            hung.append(f"{name}: no answer within {limit:g} s")
        except Exception as fault:
            wrong.append(f"{name}: {type(fault).__name__}: {fault}")
    wrong += [f"{name}: the error is not a number" for name, error in errors.items() if math.isnan(error)]
    count = len(errors) + len(wrong) + len(hung) - sum(map(math.isnan, errors.values()))
    if wrong or hung:
        said = f"of {count} tried {len(wrong)} wrong, {len(hung)} hung; {(wrong + hung)[0]}"
        return Tried(math.inf, said, count, len(wrong), len(hung))
    worst = max(errors, key=lambda name: errors[name], default="")
    error = errors.get(worst, 0.0)
    return Tried(error, f"{count} tried" + (f"; worst is {worst}" if error else ""), count)


def summary(outcomes: Sequence[Outcome]) -> list[tuple[str, int, int, int, int]]:
    """Return for each kind of case: its name, how many were tried, in how many checks, how many wrong, how many hung.

    A row over its bound counts as one that is wrong; one that gave no answer counts as one that hung.
    """
    lines = []
    for kind in dict.fromkeys(o.row.tries for o in outcomes if o.row.tries):
        rows = [o for o in outcomes if o.row.tries == kind]
        told = [o.tried for o in rows if o.tried is not None]
        wrong = sum(t.wrong for t in told)
        wrong += sum(o.tried is not None and not (o.passed or o.tried.wrong or o.tried.hung) for o in rows)
        hung = sum(t.hung for t in told) + len(rows) - len(told)
        counts = [t.count for t in told] or [0]
        count = max(counts) if rows[0].row.same else sum(counts)
        lines.append((kind, count, sum(counts), wrong, hung))
    return lines
