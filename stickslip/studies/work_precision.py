"""Work against precision: what does accuracy cost, for any callables.

Nothing here knows friction. A setup is a callable without arguments; its result is judged by an error
function, its work read off the result where counters are there.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from statistics import median
from typing import Any

import numpy as np
from tqdm import tqdm

from stickslip.model.checks import check_name, finite, flag, whole
from stickslip.studies.table import aligned

_COUNTERS = {"steps": ("steps",), "nfev": ("nfev",), "njev": ("njev",), "nguards": ("nguards", "guard_calls")}


@dataclass(frozen=True)
class Setup:
    """One way to compute a solution.

    Parameters
    ----------
    name : str
        Unique within a study.
    run : callable
        Takes no argument, returns the solution.
    family : str, optional
        Setups of one family (a method at several tolerances, say) share a line in the plot.
    call : str, optional
        The line of code that does the same, to paste.

    Raises
    ------
    TypeError, ValueError
        If the name is not a text or empty, or `run` is not callable.
    """

    name: str
    run: Callable[[], Any]
    family: str | None = None
    call: str | None = None

    def __post_init__(self) -> None:
        """Check the arguments."""
        check_name(self.name, "Setup: name")
        if not callable(self.run):
            raise TypeError(
                f"Setup {self.name!r}: run must be a callable without arguments, got {self.run!r}; "
                "wrap the computation: lambda: simulate(...)"
            )


@dataclass(frozen=True)
class WorkRow:
    """One setup measured: wall times in s, solution error, work counters (NaN where there are none).

    `failure` is None or says why the setup has no valid time.
    """

    name: str
    family: str | None
    call: str | None
    median: float
    fastest: float
    error: float
    steps: float
    nfev: float
    njev: float
    nguards: float
    failure: str | None = None


@dataclass(frozen=True)
class WorkPrecision:
    """Rows of a work-precision study, in the order of the setups."""

    rows: tuple[WorkRow, ...]
    error_label: str = "solution error"

    def pareto(self) -> tuple[WorkRow, ...]:
        """Return the rows that no other row beats in both error and median time, fastest first."""
        valid = [row for row in self.rows if row.failure is None]
        front = [row for row in valid if not any(_beats(other, row) for other in valid)]
        return tuple(sorted(front, key=lambda row: row.median))

    def best(self, *, error: float | None = None, time: float | None = None) -> WorkRow:
        """Return the cheapest row within an error, or the most accurate row within a time.

        Parameters
        ----------
        error : float
            Largest error allowed. Give either this or `time`.
        time : float
            Largest median wall time allowed, in s.

        Raises
        ------
        TypeError
            If not exactly one of the two is given.
        ValueError
            If no row qualifies.
        """
        return best_row(self, error, time, "best", "setup")

    def to_frame(self) -> Any:
        """Return a pandas DataFrame, one line per row.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        try:
            import pandas
        except ImportError as missing:
            raise ImportError("to_frame needs pandas: pip install 'stickslip[frames]'") from missing
        return pandas.DataFrame([asdict(row) for row in self.rows])

    def plot(self, ax: Any = None) -> Any:
        """Draw error against time and return the axes."""
        from stickslip import plots

        return plots.work_precision(self, ax=ax)

    def __str__(self) -> str:
        """Return an aligned table; columns without numbers are left out."""
        names = {"median / s": "median", "min / s": "fastest", "error": "error", **dict.fromkeys(_COUNTERS)}
        columns = {title: [getattr(row, name or title) for row in self.rows] for title, name in names.items()}
        return aligned(self.rows, self.pareto(), "setup", columns, [""] * len(self.rows))


def best_row(
    table: WorkPrecision, error: float | None, time: float | None, caller: str, kind: str, left_out: int = 0
) -> WorkRow:
    """Return the cheapest row within an error, or the most accurate row within a time.

    Errors begin with the name of the `caller`, and call what a row measured by its `kind`. The user may add setups.
    Calls cannot be added, but more of them measured: `left_out` is how many there was no time for.
    """
    front = table.pareto()
    for name, value in (("error", error), ("time", time)):
        if value is not None:
            finite(value, f"{caller}: {name}")
    if error is not None and time is None:
        found = next((row for row in front if row.error <= error), None)
        wanted, nearest = f"error <= {error:g}", front[-1:]
        remedy = "tighter tolerances"
    elif time is not None and error is None:
        found = next((row for row in reversed(front) if row.median <= time), None)
        wanted, nearest = f"median time <= {time:g} s", front[:1]
        remedy = "looser tolerances"
    else:
        raise TypeError(f"{caller}: give either error= or time=, got error={error!r}, time={time!r}")
    if found is not None:
        return found
    if not nearest:
        raise ValueError(f"{caller}: no {kind} succeeded, so none has {wanted}; see the failures in .rows")
    row, more = nearest[0], f", or add setups with {remedy}" if kind == "setup" else ""
    if left_out and error is not None:
        more = f", or measure more: {left_out} {kind}s were left out for the budget"
    raise ValueError(
        f"{caller}: no {kind} has {wanted}; the nearest is {row.name!r} "
        f"(error {row.error:.3g}, {row.median:.3g} s). Allow as much{more}"
    )


def work_precision(
    setups: Mapping[str, Callable[[], Any]] | Sequence[Setup],
    *,
    error: Callable[[Any], float],
    repeats: int = 5,
    warmup: int = 1,
    progress: bool = False,
    error_label: str = "solution error",
) -> WorkPrecision:
    """Measure wall time, error and work of every setup.

    The setups take turns (A B A B ...), so that the drift of a noisy machine hits all alike. A setup that
    raises, whose result says ``success=False``, or whose error is negative or not finite becomes a row
    with a `failure` and is not run again. The error is taken from the first result of a setup, outside
    the timing.

    Parameters
    ----------
    setups : mapping or sequence of Setup
        Name -> callable without arguments, or `Setup` objects.
    error : callable
        Takes a result and returns its error, a number >= 0.
    repeats, warmup : int
        Timed and untimed rounds.
    progress : bool
        Show a progress bar.
    error_label : str
        What the error is, with its unit, for the plot.

    Raises
    ------
    TypeError, ValueError
        If an argument makes no sense, naming it and the remedy.
    """
    todo = _setups(setups)
    if not callable(error):
        raise TypeError(f"work_precision: error must be a callable that takes a result, got {error!r}")
    repeats, warmup = whole(repeats, "work_precision: repeats", 1), whole(warmup, "work_precision: warmup")
    progress = flag(progress, "work_precision: progress")
    records = [_Record(setup) for setup in todo]
    with tqdm(total=(warmup + repeats) * len(records), disable=not progress, unit="run") as bar:
        for turn in range(warmup + repeats):
            for record in records:
                bar.set_postfix_str(record.setup.name, refresh=False)
                record.run(error, timed=turn >= warmup)
                bar.update()
    return WorkPrecision(tuple(record.row() for record in records), error_label)


@dataclass
class _Record:
    """What is known of a setup so far."""

    setup: Setup
    times: list[float] = field(default_factory=list)
    error: float | None = None
    counts: dict[str, float] = field(default_factory=dict)
    failure: str | None = None

    def run(self, error: Callable[[Any], float], timed: bool) -> None:
        if self.failure is not None:
            return
        try:
            start = clock.perf_counter()
            result = self.setup.run()
            elapsed = clock.perf_counter() - start
            if timed:
                self.times.append(elapsed)
            if self.error is None:
                self.counts = _counts(result)
                self.error = float(error(result))
                self.failure = _flaw(result, self.error)
        except Exception as exception:
            self.failure = f"{type(exception).__name__}: {exception}"

    def row(self) -> WorkRow:
        timed = self.failure is None
        return WorkRow(
            name=self.setup.name,
            family=self.setup.family,
            call=self.setup.call,
            median=median(self.times) if timed else math.nan,
            fastest=min(self.times) if timed else math.nan,
            error=math.nan if self.error is None else self.error,
            failure=self.failure,
            **{name: self.counts.get(name, math.nan) for name in _COUNTERS},
        )


def _setups(setups: Mapping[str, Callable[[], Any]] | Sequence[Setup]) -> list[Setup]:
    if isinstance(setups, Mapping):
        return _setups([Setup(name, run) for name, run in setups.items()])
    if not isinstance(setups, Iterable):
        raise TypeError(f"work_precision: setups must map names to callables or list Setups, got {setups!r}")
    found = list(setups)
    if not found:
        raise ValueError("work_precision: setups is empty; give at least one callable")
    seen = set()
    for setup in found:
        if not isinstance(setup, Setup):
            raise TypeError(f"work_precision: {setup!r} is not a Setup; write Setup(name, run) or a mapping")
        if setup.name in seen:
            raise ValueError(f"work_precision: two setups are named {setup.name!r}; rename one")
        seen.add(setup.name)
    return found


def _counts(result: Any) -> dict[str, float]:
    """Return the counters found in ``result.stats``, else among the attributes of the result."""
    stats = getattr(result, "stats", None)
    stats = stats if isinstance(stats, Mapping) else {}
    counts = {}
    for name, keys in _COUNTERS.items():
        candidates = [stats.get(key) for key in keys] + [getattr(result, key, None) for key in keys]
        numbers = (float(x) for x in candidates if isinstance(x, int | float | np.integer | np.floating))
        counts[name] = next(numbers, math.nan)
    return counts


def _flaw(result: Any, error: float) -> str | None:
    """Return what disqualifies a result that came without an exception."""
    success = getattr(result, "success", True)
    if isinstance(success, bool | np.bool_) and not success:
        return f"not successful: {getattr(result, 'message', 'the result says success=False')}"
    if not math.isfinite(error):
        return f"error is not finite: {error}"
    if error < 0:
        return f"error is negative: {error:g}; let the error function return a norm"
    return None


def _beats(a: WorkRow, b: WorkRow) -> bool:
    no_worse = a.error <= b.error and a.median <= b.median
    return no_worse and (a.error < b.error or a.median < b.median)
