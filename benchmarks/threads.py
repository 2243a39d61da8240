"""What BLAS on one thread saves: simulations with as many threads as there are cores, and with one.

Run as ``python -m benchmarks.threads`` on a machine that does nothing else, without OMP_NUM_THREADS. Times are those of
the clock, the medians of a few runs in turn: first alone, then beside as many busy processes as there are cores.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from itertools import pairwise
from multiprocessing import Process, cpu_count
from statistics import median
from typing import Any
from unittest import mock

from benchmarks.reading import fault, stribeck
from stickslip import GROUND, Body, Contact, DryFriction, Force, Gap, Scene, simulate, sine
from stickslip.equations.one_thread import one_thread

_RUNS = 5


def train(count: int) -> Scene:
    """Return wagons with play in their couplers."""
    names = [f"w{i}" for i in range(count)]
    return Scene(
        *(Body(name, inertia=1.0, velocity=1.0) for name in names),
        *(Contact(f"c{name}", name, GROUND, DryFriction(0.3, 0.25), normal=1.0) for name in names),
        *(Gap(f"{a}-{b}", a, b, lower=-0.02, upper=0.02, stiffness=400.0, damping=1.0) for a, b in pairwise(names)),
        Force("w0", sine(5.0, 0.5)),
    )


SCENES: dict[str, tuple[Callable[[], Scene], float]] = {
    "20 blocks on a belt, Stribeck": (partial(stribeck, 20), 2.0),
    "100 blocks on a belt, Stribeck": (partial(stribeck, 100), 0.5),
    "40 wagons with play": (partial(train, 40), 1.0),
    "50 blocks of a fault": (partial(fault, 50), 20.0),
}


def seconds(scene: Callable[[], Scene], stop: float, context: Callable[..., AbstractContextManager[Any]]) -> float:
    """Return how long a simulation takes by the clock in s, with another choice of threads."""
    with mock.patch("stickslip.simulation.simulate.one_thread", context):
        one = scene()
        start = time.perf_counter()
        simulate(one, (0.0, stop))
        return time.perf_counter() - start


def measured(scene: Callable[[], Scene], stop: float) -> tuple[float, float]:
    """Return the medians with all threads and with one, in s."""
    pairs = [
        (seconds(scene, stop, lambda *_, **__: nullcontext()), seconds(scene, stop, one_thread)) for _ in range(_RUNS)
    ]
    every, one = map(median, zip(*pairs, strict=True))
    return every, one


def spin() -> None:
    """Keep a core busy."""
    while True:
        pass


def main() -> None:
    """Print the table."""
    print("wall time in s with threads on all cores / on one thread, and the ratio")
    print(f"{'scene':34}{'alone':>26}{'beside busy cores':>26}")
    for name, (scene, stop) in SCENES.items():
        seconds(scene, stop, one_thread)
        alone = measured(scene, stop)
        others = [Process(target=spin, daemon=True) for _ in range(cpu_count())]
        for other in others:
            other.start()
        busy = measured(scene, stop)
        for other in others:
            other.kill()
        told = [f"{every:.3f} / {one:.3f} = {every / one:.1f}" for every, one in (alone, busy)]
        print(f"{name:34}{told[0]:>26}{told[1]:>26}")


if __name__ == "__main__":
    main()
