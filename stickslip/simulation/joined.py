"""Runs in a row, read as one: gear shifts, supervisory logic, restarts."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.model.arrays import Array
from stickslip.model.checks import every_digit, in_order, whole
from stickslip.model.modes import Mode
from stickslip.model.scene import Scene
from stickslip.results.in_a_row import BETWEEN, joined, of_each
from stickslip.results.outcome import Event
from stickslip.results.readable import times_within
from stickslip.results.samples import Samples
from stickslip.simulation.presented import Presented
from stickslip.simulation.result import Result


@dataclass(frozen=True, eq=False)
class Joined(Presented):
    """Results of runs in a row; each quantity is read by name as of a single one.

    What a run does not know (a body that only another scene has) is NaN in its part. Heat and work are counted from the
    start of the first run.

    Attributes
    ----------
    results : tuple of Result
        In order of time.
    """

    results: tuple[Result, ...] = field(repr=False)

    @property
    def runs(self) -> tuple[Result, ...]:
        """The runs of which this is made: the results."""
        return self.results

    @property
    def t(self) -> Array:
        """Times in s; where one run ends and the next begins stand two."""
        return np.concatenate([result.t for result in self.results])

    @cached_property
    def events(self) -> list[Event]:
        """All events in order of time, with the changes of mode from the end of one run to the start of the next."""
        found = list(self.results[0].events)
        for before, after in pairwise(self.results):
            found += [*_between(before, after), *after.events]
        return found

    @property
    def success(self) -> bool:
        """Whether every run reached its end."""
        return all(result.success for result in self.results)

    @property
    def message(self) -> str:
        """How the runs ended, in words: the last, or the first that failed."""
        return next((result for result in self.results if not result.success), self.results[-1]).message

    @property
    def is_dense(self) -> bool:
        """Whether the motion between the outputs was kept in every run."""
        return all(result.is_dense for result in self.results)

    @cached_property
    def scene(self) -> Scene:
        """The elements of all runs, for tables and drawings; of several with one name, that of the last run."""
        return Scene.of_all([result.scene for result in self.results])

    def _read(self, read: Callable[[Samples, str], NDArray[Any]], name: str) -> NDArray[Any]:
        parts = of_each(self.results, lambda samples: read(samples, name))
        return joined(parts, [result.t.size for result in self.results])

    def final_scene(self) -> Scene:
        """Return the scene at the end of the last run."""
        return self.results[-1].final_scene()

    def sample(self, times: int | Sequence[float] | Array) -> Joined:
        """Return the same runs at other times; where one ends and the next begins, the next one's.

        Parameters
        ----------
        times : int or array (k,)
            Increasing times in s within the runs, or how many evenly spaced ones.

        Raises
        ------
        ValueError, TypeError
            If a time lies outside, the times do not increase, or only the requested outputs were kept.
        """
        starts = [float(result.trajectory.starts[0]) for result in self.results]
        stop = float(self.results[-1].trajectory.stops[-1])
        wanted = times_within(times, starts[0], stop)
        if np.any(np.diff(wanted) < 0):
            raise ValueError("sample: give increasing times: runs in a row are read in order of time")
        if wanted.size and not (starts[0] <= wanted[0] and wanted[-1] <= stop):
            raise ValueError(
                f"times must lie in [{starts[0]:g}, {stop:g}] s, got "
                f"{every_digit(wanted[0])} to {every_digit(wanted[-1])}"
            )
        parts = np.split(wanted, np.searchsorted(wanted, starts[1:]))
        # runs without a time stay, so that heat and work are counted through all of them
        return Joined(tuple(result.sample(part) for result, part in zip(self.results, parts, strict=True)))

    def fit_for_plot(self, points: int = 0) -> Joined:
        """Return the same runs at times between which straight lines look like the motion, events twice.

        Parameters
        ----------
        points : int
            About how many evenly spaced times to add.
        """
        whole(points, "fit_for_plot: points")
        spans = [result.trajectory.stops[-1] - result.trajectory.starts[0] for result in self.results]
        each = [math.ceil(points * span / (sum(spans) or 1.0)) for span in spans]
        return Joined(tuple(result.fit_for_plot(own) for result, own in zip(self.results, each, strict=True)))

    def __str__(self) -> str:
        """Return when the runs begin and end, and their events."""
        spans = [
            f"{result.trajectory.starts[0]:g} to {result.trajectory.stops[-1]:g} s: {result.message}"
            for result in self.results
        ]
        return "\n".join([*spans, *map(str, self.events)])


def _between(before: Result, after: Result) -> list[Event]:
    """Return the changes from the end of one run to the start of the next that neither run has noted."""
    if not (before.trajectory.pieces and after.trajectory.pieces):
        return []
    last = before.trajectory.starts.size - 1
    ended = _shown(before, last, float(before.trajectory.ends[-1]))
    began = _shown(after, 0, 0.0)
    t = float(after.trajectory.starts[0])
    noted = {event.contact for event in after.events if event.t <= t}
    return [
        Event(t, name, was, began[name], BETWEEN)
        for name, was in ended.items()
        if name in began and began[name] != was and name not in noted
    ]


def _shown(result: Result, piece: int, tau: float) -> dict[str, Mode]:
    """Return the modes that the rows with modes show in one piece of a run, by name."""
    system = result.trajectory.system
    shown = result.trajectory.modes(np.array([piece]), np.array([tau]))[1][:, 0]
    return {
        row.name: Mode(int(mode))
        for row, mode, is_free in zip(system.rows, shown, system.free, strict=True)
        if not is_free
    }


def join(results: Sequence[Result | Joined]) -> Joined:
    """Return the results of runs in a row as one.

    Parameters
    ----------
    results : sequence of Result or Joined
        Each begins where the one before ends, from its `final_scene` or any other scene.

    Raises
    ------
    TypeError, ValueError
        If there is none, one is no result, or one does not begin where the one before has ended.
    """
    given = in_order(results, "join: results", "Result(...)")
    if not given:
        raise ValueError("join: there are no results; give at least one")
    for result in given:
        if not isinstance(result, Result | Joined):
            raise TypeError(f"join: expected results of simulate or join, got {reprlib.repr(result)}")
    listed = tuple(run for result in given for run in result.runs)
    for number, result in enumerate(listed):
        if not result.trajectory.pieces:
            raise ValueError(f"join: of run {number + 1} nothing was computed, or nothing was kept; leave it out")
        if not number:
            continue
        end = float(listed[number - 1].trajectory.stops[-1])
        start = float(result.trajectory.starts[0])
        if abs(start - end) > 1e-9 * max(abs(start), abs(end)):
            remedy = "give runs in order of time, without gaps"
            if not (result.is_dense and listed[number - 1].is_dense):
                remedy = "what lies between was not kept: simulate with dense_output=True"
            raise ValueError(
                f"join: run {number + 1} begins at {start:g} s, but the one before ends at {end:g} s; {remedy}"
            )
    return Joined(listed)
