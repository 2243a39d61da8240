"""What accuracy costs for a scene of one's own: every applicable call measured, and one of them advised."""

from __future__ import annotations

import time as clock
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from typing import Any

import numpy as np
from tqdm import tqdm

from stickslip.model.arrays import Array
from stickslip.model.checks import check_takes, finite, flag
from stickslip.model.scene import Scene
from stickslip.results.units import units
from stickslip.simulation.arguments import Times
from stickslip.simulation.arguments import span as checked_span
from stickslip.simulation.result import Result, SimulationError, SimulationInterrupted
from stickslip.simulation.simulate import compiled
from stickslip.studies.table import aligned
from stickslip.studies.tradeoff_setups import Call, calls, reference_calls
from stickslip.studies.work_precision import Setup, WorkPrecision, best_row, work_precision

_TIMES = 1001
_REPEATS = 5
Error = Callable[[Result, Result], float]


@dataclass(frozen=True)
class Advice:
    """A call of `simulate` with its measured error and its median wall time in s.

    Its text is a line to paste. Where the error is smaller than the reference can show, it is `at_limit`: `error` is
    the limit.
    """

    call: str
    error: float
    time: float
    at_limit: bool = False

    def __str__(self) -> str:
        """Return the line to paste."""
        least = "at most " if self.at_limit else ""
        return f"{self.call}  # error {least}{self.error:.2g}, {1e3 * self.time:.3g} ms"


@dataclass(frozen=True)
class Skipped:
    """A call that was not measured, and why."""

    call: str
    reason: str


@dataclass(frozen=True)
class Tradeoff:
    """Times and errors of the applicable calls of `simulate`, for one scene.

    Attributes
    ----------
    work : WorkPrecision
        One row per call; errors below `limit` are set to it.
    limit : float
        By how much the reference and its check differ: smaller errors cannot be measured.
    reference, check : str
        The calls whose results were compared.
    skipped : tuple of Skipped
        Calls left out for the budget.
    creeping : frozenset of str
        Calls in which contacts creep where they should stick.
    """

    work: WorkPrecision
    limit: float
    reference: str
    check: str
    skipped: tuple[Skipped, ...] = ()
    creeping: frozenset[str] = frozenset()

    def recommend(self, *, error: float | None = None, time: float | None = None, may_creep: bool = True) -> Advice:
        """Return the cheapest call within an error, or the most accurate one within a time.

        Parameters
        ----------
        error : float
            Largest error allowed. Give either this or `time`.
        time : float
            Largest median wall time allowed, in s.
        may_creep : bool
            Whether contacts may creep where they should stick, as in regularised scenes.

        Raises
        ------
        TypeError
            If not exactly one of the two is given.
        ValueError
            If no call is good enough, or the error is below the limit of the reference.
        """
        if (error is None) == (time is None):
            raise TypeError(f"recommend: give either error= or time=, got error={error!r}, time={time!r}")
        flag(may_creep, "recommend: may_creep")
        if error is not None and finite(error, "recommend: error") < self.limit:
            raise ValueError(f"recommend: error={error:g} is below what the reference can tell; allow {self.limit:.2g}")
        rows = tuple(row for row in self.work.rows if may_creep or row.name not in self.creeping)
        if not rows and self.skipped:
            raise ValueError(
                f"recommend: {len(self.skipped)} calls were left out, and no other one was measured"
                f"{'' if may_creep else ' whose contacts do not creep'}; give tradeoff a larger budget"
            )
        measured = WorkPrecision(rows, self.work.error_label)
        row = best_row(measured, error, time, "recommend", "call", len(self.skipped))
        return Advice(row.call or row.name, row.error, row.median, row.error <= self.limit)

    @property
    def table(self) -> str:
        """The measured calls as an aligned table."""
        rows = self.work.rows
        ends = ["below what the reference can tell" if row.error <= self.limit else "" for row in rows]
        columns = {
            "time / ms": [1e3 * row.median for row in rows],
            self.work.error_label: [row.error for row in rows],
            "steps": [row.steps for row in rows],
            "nfev": [row.nfev for row in rows],
        }
        return aligned(rows, self.work.pareto(), "call", columns, ends)

    def to_frame(self) -> Any:
        """Return a pandas DataFrame, one line per measured call.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        return self.work.to_frame()

    def plot(self, ax: Any = None) -> Any:
        """Draw error against time, with the limit of the reference, and return the axes."""
        from stickslip.plots.work_precision import tradeoff as draw

        return draw(self, ax=ax)

    def _repr_html_(self) -> str:
        """Return figure and table, as notebooks show them."""
        from stickslip.plots.notebook import study_html

        return study_html(self)

    def __str__(self) -> str:
        """Return the table, what the reference is worth, and what was left out."""
        lines = [
            self.table,
            f"reference: {self.reference}",
            f"  differs from {self.check} by {self.limit:.2g}",
        ]
        tried = [skipped for skipped in self.skipped if skipped.reason.startswith("took")]
        lines += [f"left out: {skipped.call}: {skipped.reason}" for skipped in tried]
        if len(tried) < len(self.skipped):
            lines.append(f"left out untried: {len(self.skipped) - len(tried)} costlier calls of these kinds")
        return "\n".join(lines)


def tradeoff(
    scene: Scene,
    t_span: Times,
    *,
    error: str | Error = "velocity",
    budget: float = 60.0,
    progress: bool = False,
) -> Tradeoff:
    """Measure what the formulations, methods, tolerances, steps and pre-slip velocities cost for a scene.

    The reference is an event-exact run so tight that a second, different one agrees with it. The difference
    between the two is the smallest error that can be measured.

    Parameters
    ----------
    scene : Scene
    t_span : (float, float)
        Start and end in s.
    error : "velocity" or callable
        "velocity": the largest deviation of any body's velocity from the reference, over 1001 times spread
        evenly and, without stops and Karnopp's law, beside all events and in the middle of steps. A callable
        takes a result and the reference result and returns a number >= 0.
    budget : float
        Wall time in s for all calls, after the two of the reference, shared equally by the families of calls. Calls
        that alone take more than what is left to their family are left out, and so are costlier ones of the same
        family. The first call is measured whatever it takes.
    progress : bool
        Show progress bars.

    Returns
    -------
    Tradeoff

    Raises
    ------
    TypeError, ValueError
        If an argument is not usable.
    SimulationError
        If no reference run comes to its end.
    """
    if not isinstance(scene, Scene):
        raise TypeError(f"tradeoff: scene must be a Scene, got {type(scene).__name__}")
    if not (callable(error) or (isinstance(error, str) and error == "velocity")):
        raise TypeError(f"tradeoff: error must be 'velocity' or a callable of (result, reference), got {error!r}")
    if callable(error):
        check_takes(error, 2, "tradeoff: error", "a result and the reference")
    if isinstance(budget, bool) or not (isinstance(budget, int | float) and 0 < budget < float("inf")):
        raise ValueError(f"tradeoff: budget must be a positive number of seconds, got {budget!r}")
    budget = finite(budget, "tradeoff: budget")
    progress = flag(progress, "tradeoff: progress")
    span = checked_span(t_span, "tradeoff")
    measure = _checked(error) if callable(error) else _velocity_error(scene, span)
    tight, loose, reference, limit, scale = reference_of(scene, span, measure)
    deadline = clock.perf_counter() + budget
    known = calls(scene, span, scale)
    setups = [
        Setup(call.text(span), partial(_quietly, call, scene, span), call.family, call.text(span)) for call in known
    ]
    chosen, skipped, once = _affordable(setups, budget, progress)
    creeping = frozenset(call.text(span) for call in known if call.creeps)
    left = deadline - clock.perf_counter()
    work = work_precision(
        chosen,
        error=lambda result: max(measure(result, reference), limit),
        repeats=min(max(int(left / once), 1), _REPEATS),
        warmup=0,
        progress=progress,
        error_label=f"largest velocity error [{units(scene).velocity}]" if error == "velocity" else "error",
    )
    return Tradeoff(work, limit, tight.text(span), loose.text(span), tuple(skipped), creeping)


def _checked(error: Error) -> Error:
    """Return an error function of the user that refuses what is no number, or negative."""

    def measure(result: Result, reference: Result) -> float:
        found: Any = error(result, reference)
        if isinstance(found, bool) or not isinstance(found, int | float | np.number) or not found >= 0:
            raise ValueError(
                f"tradeoff: error(result, reference) must return a number that is at least 0, got {found!r}; "
                "take the absolute value of a difference, or a norm"
            )
        return float(found)

    return measure


def _velocity_error(scene: Scene, span: tuple[float, float]) -> Error:
    """Return the largest deviation of any body's velocity, at times spread evenly, beside events and within steps."""
    bodies, times = len(scene.bodies), np.linspace(*span, _TIMES)
    # Velocities jump at impacts, and where Karnopp's dead band begins. A jump that is early by roundoff is no error,
    # but beside the event it would be measured as one.
    is_smooth = not (scene.stops or compiled(scene).has_dead_bands)

    def measure(result: Result, reference: Result) -> float:
        at = times
        if is_smooth:
            # within a step that ends in an event, the error is largest at the event
            events = np.array([event.t for event in (*result.events, *reference.events)])
            beside = np.nextafter(events, -np.inf).clip(*span), events.clip(*span)
            at = np.concatenate([times, *beside, _middles(result)])
        return float(np.abs(result(at)[:bodies] - reference(at)[:bodies]).max())

    return measure


def _middles(result: Result) -> Array:
    """Return the middles of `_TIMES` steps or so: just after an event errors last for a few short steps only."""
    trajectory = result.trajectory
    if trajectory.is_patchwork:
        # it is exact
        return np.empty(0)
    ends = [t + trajectory.steps(k) for k, t in enumerate(trajectory.starts.tolist())]
    middles = np.concatenate([0.5 * (one[1:] + one[:-1]) for one in ends])
    return middles[:: max(middles.size // _TIMES, 1)]


def _quietly(call: Call, scene: Scene, span: tuple[float, float]) -> Result:
    """Run a call on a scene without warnings: the measured error shows what they warn of."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return call.run(scene, span)
        except SimulationInterrupted:
            # the result of one call is not what the user wants to keep
            raise KeyboardInterrupt("tradeoff interrupted: nothing is kept; give it a smaller budget") from None


def reference_of(scene: Scene, span: tuple[float, float], measure: Error) -> tuple[Call, Call, Result, float, float]:
    """Return two tight calls, the result of the tighter, by how much they differ, and the velocity scale."""
    failure: Exception | None = None
    for tight, loose in reference_calls():
        try:
            result, other = (_quietly(call, scene, span) for call in (tight, loose))
        except SimulationError as error:
            failure = error
            continue
        scale = float(np.abs(result.y[: len(scene.bodies)]).max()) or 1.0
        limit = max(measure(other, result), 8 * float(np.finfo(float).eps) * scale)
        if limit == np.inf:
            raise ValueError(
                "tradeoff: error(result, reference) is inf between two tight runs of the scene; "
                "return a finite number there, or nothing can be compared"
            )
        return tight, loose, result, limit, float(f"{scale:.1g}")
    assert failure is not None
    raise failure


def _affordable(setups: list[Setup], budget: float, progress: bool) -> tuple[list[Setup], list[Skipped], float]:
    """Run every setup once; return those within their share, those left out, and the time of a round in s.

    The first one is never left out.
    """
    chosen: list[Setup] = []
    skipped: list[Skipped] = []
    families = {family: list(kind) for family, kind in groupby(setups, key=lambda setup: setup.family)}
    left, once = budget / 2, 0.0
    with tqdm(total=len(setups), disable=not progress, unit="call", desc="trying") as bar:
        for rest, kind in zip(range(len(families), 0, -1), families.values(), strict=True):
            share, slow = max(left, 0.0) / rest, ""
            for setup in kind:
                bar.update()
                if slow:
                    skipped.append(Skipped(setup.name, f"not tried, costlier than one that took {slow}"))
                    continue
                start = clock.perf_counter()
                with suppress(Exception):  # it fails again in `work_precision`, which records failures
                    setup.run()
                elapsed = clock.perf_counter() - start
                left -= elapsed
                if elapsed <= share or setup is setups[0]:
                    chosen.append(setup)
                    once += elapsed
                    share -= elapsed
                else:
                    slow = f"{elapsed:.2g} s"
                    skipped.append(Skipped(setup.name, f"took {slow}, its share is {share:.2g} s"))
    return chosen, skipped, max(once, 1e-9)
