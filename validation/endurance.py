"""Rows over one long run: a limit cycle whose every event has a formula, and what it costs in time and memory.

A block on a belt, held by a spring: it rides along until the spring pulls with ``mu_s N``, slips back, and is caught.
"""

from __future__ import annotations

import contextlib
import math
import resource
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from stickslip import GROUND, Body, Contact, Drive, DryFriction, Scene, Spring, simulate
from stickslip.engines import MethodName
from stickslip.simulation.recorder import Recorder
from validation import analytic
from validation.rows import Answer, Array, Row, require

BELT, STIFFNESS, NORMAL, LAW = 0.2, 10.0, 10.0, DryFriction(0.35, 0.2)

# Steps of each method at the default tolerances; they say how many periods a run of a given number of steps takes.
STEPS_PER_PERIOD = {"BDF": 161, "series": 7}

_LOOKS = 200
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


# The same motion, seen from the belt.
CYCLE = analytic.pulled_block(1, STIFFNESS, BELT, normal=NORMAL, mu_static=LAW.mu_static, mu_coulomb=LAW.mu_coulomb)
FIRST, SLIP = float(CYCLE.first_break), float(CYCLE.slip_time)
PERIOD = float(CYCLE.slip_time + CYCLE.stick_time)


@dataclass(frozen=True)
class Run:
    """Measurements: times of the events in s, steps, and `looks` at (events so far, CPU time in s, memory in bytes)."""

    events: Array
    steps: int
    looks: Array

    def per_event(self, column: int) -> Array:
        """Return the cost of an event in each tenth of the run: CPU time in s (column 1) or memory in bytes (2)."""
        tenths = np.linspace(0, len(self.looks) - 1, 11).astype(int)
        spent = np.diff(self.looks[tenths], axis=0)
        return np.asarray(spent[:, column] / spent[:, 0])


def memory() -> int:
    """Return the memory of this process in bytes, that of C libraries included; its maximum so far without /proc."""
    if _STATM.exists():
        return int(_STATM.read_text().split()[1]) * resource.getpagesize()
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


@contextlib.contextmanager
def _watched(every: int) -> Iterator[list[tuple[float, ...]]]:
    """Look at events, time and memory after `every` segments."""
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


@cache
def run(method: MethodName, steps: int) -> Run:
    """Simulate a limit cycle for about `steps` steps; nothing but its events is kept."""
    periods = steps // STEPS_PER_PERIOD[method]
    stop = FIRST + periods * PERIOD
    with _watched(max(2 * periods // _LOOKS, 1)) as looks:
        result = simulate(scene(), (0.0, stop), method=method, t_eval=[stop], dense_output=False)
    return Run(np.array([e.t for e in result.events]), int(result.stats["steps"]), np.array(looks))


def punctual(method: MethodName, steps: int) -> Answer:
    """Compare all event times with the formula, over the length of the run."""
    found = run(method, steps)
    count = found.events.size
    said = f"{found.steps} steps, {count} events"
    require(found.steps > 0.9 * steps and abs(count - 2 * (steps // STEPS_PER_PERIOD[method])) <= 2, said)
    k = np.arange(count)
    exact = FIRST + (k // 2) * PERIOD + (k % 2) * SLIP
    return float(np.abs(found.events - exact).max() / exact[-1]), said


def time_growth(method: MethodName, steps: int) -> Answer:
    """Return the least CPU time of an event in a tenth of the second half over that of the first, less 1."""
    # other work of the machine may slow any tenth down, but hardly all five of a half
    first, second = run(method, steps).per_event(1).reshape(2, 5).min(axis=1).tolist()
    remark = (
        f"{1e6 * first:.0f} us per event in the fastest tenth of the first half, {1e6 * second:.0f} us of the second"
    )
    return max(second / first - 1, 0.0), remark


def memory_growth(method: MethodName, steps: int) -> float:
    """Return the memory in kB that an event takes in the last tenth of a run that keeps its events only."""
    return max(float(run(method, steps).per_event(2)[-1]), 0.0) / 1e3


def _rows(method: MethodName, steps: int, bound: float) -> list[Row]:
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
            "the same run: CPU time per event in the fastest tenth of the second half over that of the first, less 1",
            "ratio",
            partial(time_growth, method, steps),
            0.5,
        ),
        long_row(
            f"cycle-memory-{size}",
            "the same run, which keeps nothing but its events: memory per event in the last tenth [kB]",
            "what an event is made of",
            partial(memory_growth, method, steps),
            0.5,
        ),
    ]


ROWS = [
    *_rows("BDF", 10**6, 1e-7),
    *_rows("BDF", 10**7, 1e-7),
    *_rows("series", 10**6, 1e-12),
]
