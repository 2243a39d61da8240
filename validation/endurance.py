"""Rows over one long run: a limit cycle whose every event has a formula, and what it costs in time and memory.

A block on a belt, held by a spring: it rides along until the spring pulls with ``mu_s N``, slips back, and is caught.
"""

from __future__ import annotations

import contextlib
import math
import resource
import sys
import time
import tracemalloc
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from stickslip import GROUND, Body, Contact, Drive, DryFriction, Scene, Spring, simulate
from stickslip.simulation.recorder import Recorder
from validation.rows import Answer, Array, Row, require

BELT, STIFFNESS, NORMAL, LAW = 0.2, 10.0, 10.0, DryFriction(0.35, 0.2)
STEPS_PER_PERIOD = {"BDF": 161, "series": 7}
"""What each method takes at the default tolerances; from it follows how long a run of so many steps is."""

_LOOKS = 200
_PAGE = resource.getpagesize()
_STATM = Path("/proc/self/statm")

long_row = partial(Row, "Long runs", quick=False, limit=3600.0)


def scene() -> Scene:
    """Return the block, of 1 kg, that rides on the belt from the spring's rest on."""
    return Scene(
        Drive("belt", velocity=BELT),
        Body("block", inertia=1.0, velocity=BELT),
        Contact("sole", "block", "belt", LAW, normal=NORMAL),
        Spring("block", GROUND, stiffness=STIFFNESS),
    )


def cycle() -> tuple[float, float, float]:
    """Return in s the time of the first breakaway, how long a slip takes, and the period.

    The block breaks loose at ``x_s = mu_s N / k`` and slips about ``x_c = mu_c N / k``: with ``d = x_s - x_c`` it is
    back at the belt's velocity after ``2 (pi - atan(omega d / v)) / omega``, at ``x_c - d``, and rides ``2 d / v``.
    """
    omega = math.sqrt(STIFFNESS)
    farthest, distance = (
        LAW.mu_static * NORMAL / STIFFNESS,
        (LAW.mu_static - LAW.mu_coulomb) * NORMAL / STIFFNESS,
    )
    slip = 2 * (math.pi - math.atan2(omega * distance, BELT)) / omega
    return farthest / BELT, slip, slip + 2 * distance / BELT


@dataclass(frozen=True)
class Run:
    """What was measured: times of the events in s, steps, and looks (events, CPU time in s, memory in bytes)."""

    events: Array
    steps: int
    looks: Array

    def per_event(self, column: int) -> tuple[float, float]:
        """Return what an event cost in the first tenth and in the last, in s (1) or bytes (2)."""
        tenth = len(self.looks) // 10
        costs = []
        for first, last in ((0, tenth), (-1 - tenth, -1)):
            events, cost = (
                self.looks[last, 0] - self.looks[first, 0],
                self.looks[last, column] - self.looks[first, column],
            )
            costs.append(float(cost / events))
        return costs[0], costs[1]


def memory() -> int:
    """Return the memory in bytes of Python's objects if they are traced; else what this process has, C included.

    Where the system does not tell, it is the most that the process has had.
    """
    if tracemalloc.is_tracing():
        return tracemalloc.get_traced_memory()[0]
    if _STATM.exists():
        return int(_STATM.read_text().split()[1]) * _PAGE
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


@contextlib.contextmanager
def _watched(every: int) -> Iterator[list[tuple[float, ...]]]:
    """Look at time and memory after every so many segments."""
    looks: list[tuple[float, ...]] = []
    keep, calls = Recorder.keep, 0

    def watched(self: Recorder, *arguments: Any) -> None:
        nonlocal calls
        keep(self, *arguments)
        calls += 1
        if calls % every == 0:
            looks.append((len(self.events), time.process_time(), memory()))

    with mock.patch.object(Recorder, "keep", watched):
        yield looks


@contextlib.contextmanager
def _traced() -> Iterator[None]:
    tracemalloc.start()
    try:
        yield
    finally:
        tracemalloc.stop()


@cache
def run(method: str, steps: int, kept: bool) -> Run:
    """Simulate a limit cycle of about so many steps, with all of its motion kept or nothing but its events."""
    periods = steps // STEPS_PER_PERIOD[method]
    first, _, period = cycle()
    stop = first + periods * period
    options: dict[str, Any] = {"method": method}
    if not kept:
        options |= {"t_eval": [stop], "dense_output": False}
    with _watched(max(2 * periods // _LOOKS, 1)) as looks, _traced() if kept else contextlib.nullcontext():
        result = simulate(scene(), (0.0, stop), **options)
    return Run(np.array([e.t for e in result.events]), int(result.stats["steps"]), np.array(looks))


def _said(found: Run) -> str:
    return f"{found.steps} steps, {found.events.size} events"


def punctual(method: str, steps: int) -> Answer:
    """Compare all event times with the formula, over the length of the run."""
    found = run(method, steps, kept=False)
    first, slip, period = cycle()
    count = found.events.size
    require(found.steps > 0.9 * steps, f"only {_said(found)}")
    require(abs(count - 2 * (steps // STEPS_PER_PERIOD[method])) <= 2, f"{count} events")
    k = np.arange(count)
    exact = first + (k // 2) * period + (k % 2) * slip
    return float(np.abs(found.events - exact).max() / exact[-1]), _said(found)


def time_growth(method: str, steps: int) -> Answer:
    """Return the CPU time of an event in the last tenth over that in the first, less 1."""
    found = run(method, steps, kept=False)
    first, last = found.per_event(1)
    remark = (
        f"{_said(found)}: {1e6 * first:.0f} us per event in the first tenth, {1e6 * last:.0f} us in the last"
    )
    return max(last / first - 1, 0.0), remark


def memory_growth(method: str, steps: int) -> Answer:
    """Return the memory that an event takes in the last tenth over that in the first, less 1; all motion is kept."""
    found = run(method, steps, kept=True)
    first, last = found.per_event(2)
    remark = (
        f"{_said(found)}: {first / 1e3:.1f} kB per event in the first tenth, {last / 1e3:.1f} kB in the last"
    )
    return max(last / first - 1, 0.0), remark


def memory_unkept(method: str, steps: int) -> Answer:
    """Return the memory in kB that an event takes in the last tenth of a run that keeps its events only."""
    found = run(method, steps, kept=False)
    _, last = found.per_event(2)
    grown = (found.looks[-1, 2] - found.looks[len(found.looks) // 10, 2]) / 1e6
    remark = (
        f"{_said(found)}: {grown:.1f} MB more at the end than after the first tenth, {last:.0f} B per event"
    )
    return max(last, 0.0) / 1e3, remark


def _rows(method: str, steps: int, bound: float) -> list[Row]:
    size = f"1e{round(math.log10(steps))}"
    if method != "BDF":
        size += f"-{method}"
    return [
        long_row(
            f"cycle-events-{size}",
            f"a block on a belt for {steps:.0e} steps of {method}: all its event times, over the time run",
            "sines and straight lines",
            partial(punctual, method, steps),
            bound,
        ),
        long_row(
            f"cycle-time-{size}",
            "the same run: CPU time per event in the last tenth over that in the first, less 1",
            "ratio",
            partial(time_growth, method, steps),
            0.5,
        ),
        long_row(
            f"cycle-memory-{size}",
            "the same run, which keeps nothing but its events: memory per event in the last tenth [kB]",
            "what an event is made of",
            partial(memory_unkept, method, steps),
            0.5,
        ),
    ]


ROWS = [
    *_rows("BDF", 10**6, 1e-7),
    *_rows("BDF", 10**7, 1e-7),
    *_rows("series", 10**6, 1e-12),
    long_row(
        "cycle-memory-kept",
        "the same for 3e5 steps, all kept: memory per event in the last tenth over that in the first, less 1",
        "ratio",
        partial(memory_growth, "BDF", 3 * 10**5),
        0.2,
    ),
]
