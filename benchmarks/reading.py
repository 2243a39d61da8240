"""How long it takes to read every quantity of every name of a result, beside the simulation itself.

Run as ``python -m benchmarks.reading``. Times are CPU times of this process, the least of a few runs.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from stickslip import GROUND, Body, Contact, Drive, DryFriction, Result, Scene, Spring, plots, simulate
from stickslip.benchmark import flywheel_chain

SIZES = (4, 50, 200)

# Times in s within which small scenes have more than a hundred events.
LONGER = {("fault", 4): 400.0, ("belt", 4): 100.0, ("fault", 50): 60.0, ("belt", 50): 30.0}

_RUNS = 5
_OF_CONTACTS = ("mode", "force", "breakaway", "power", "normal", "relative_velocity")


def fault(count: int) -> Scene:
    """Return blocks on rough ground, pulled by a plate through springs (Burridge and Knopoff's fault)."""
    names = [f"b{i}" for i in range(count)]
    levels = np.random.default_rng(2000).uniform(0.8, 1.2, count)
    return Scene(
        Drive("plate", velocity=5e-3, position=0.75),
        *(Body(name, inertia=1.0) for name in names),
        *(
            Contact(f"c{name}", name, GROUND, DryFriction(1.0, 0.8), normal=level)
            for name, level in zip(names, levels.tolist(), strict=True)
        ),
        *(Spring(name, "plate", stiffness=1.0, damping=0.3) for name in names),
        *(Spring(a, b, stiffness=3.0) for a, b in pairwise(names)),
    )


def on_a_belt(count: int, **curve: Any) -> Scene:
    """Return blocks that a belt carries along, held back by springs: they are often stuck to the belt."""
    names, law = [f"b{i}" for i in range(count)], DryFriction(0.35, 0.2, **curve)
    places = 0.5 + 0.5 * np.sin(7.3 * np.arange(count))
    return Scene(
        Drive("belt", velocity=0.3),
        *(Body(name, inertia=1.0, velocity=0.3, position=x) for name, x in zip(names, places.tolist(), strict=True)),
        *(Contact(f"c{name}", name, "belt", law, normal=5.0) for name in names),
        *(Spring(name, GROUND, stiffness=1.0, damping=0.05) for name in names),
        *(Spring(a, b, stiffness=3.0) for a, b in pairwise(names)),
    )


def stribeck(count: int) -> Scene:
    """Return the same with friction that falls with velocity: CVODE follows them."""
    return on_a_belt(count, stribeck_velocity=0.1)


def wheels(count: int) -> Scene:
    """Return flywheels in a row, joined by friction alone: their positions are integrated when they are read."""
    return flywheel_chain(count)


SCENES: dict[str, tuple[Callable[[int], Scene], float]] = {
    "fault": (fault, 20.0),
    "belt": (on_a_belt, 5.0),
    "stribeck": (stribeck, 5.0),
    "wheels": (wheels, 4.0),
}


def read_everything(result: Result) -> None:
    """Read every quantity of every name."""
    scene = result.scene
    for element in (*scene.bodies, *scene.drives):
        result.velocity(element.name)
        result.position(element.name)
    for contact in scene.contacts:
        for quantity in _OF_CONTACTS:
            getattr(result, quantity)(contact.name)


def cpu(run: Callable[[], Any]) -> tuple[Any, float]:
    """Return the result of a function, and the CPU time in s that it took."""
    start = time.process_time()
    found = run()
    return found, time.process_time() - start


def row(name: str, count: int, stop: float) -> tuple[int, int, float, float, float, float]:
    """Return events, times, and CPU times in s: simulating a scene built anew and once more, reading, drawing."""
    first: list[float] = []
    again: list[float] = []
    read: list[float] = []
    drawn: list[float] = []
    for _ in range(_RUNS):
        scene = SCENES[name][0](count)
        for seconds in (first, again):
            result, spent = cpu(partial(simulate, scene, (0.0, stop)))
            seconds.append(spent)
            read.append(cpu(partial(read_everything, result))[1])
        drawn.append(cpu(partial(plots.overview, result))[1])
        plt.close("all")
    return len(result.events), result.t.size, min(first), min(again), min(read), min(drawn)


def main() -> None:
    """Print the table."""
    print("CPU times in s; reading means velocity and position of every body and drive, and of every contact")
    print(", ".join(_OF_CONTACTS))
    print("its ratios are those to the simulation of a scene that was built just now, and of the same once more")
    print(
        f"{'scene':10}{'bodies':>7}{'span':>7}{'events':>8}{'times':>8}"
        f"{'first':>10}{'again':>10}{'read':>9}{'ratios':>14}{'plot':>8}"
    )
    simulate(fault(4), (0.0, 1.0))  # load all that is loaded once only
    for name, (_, stop) in SCENES.items():
        for count in SIZES:
            for span in sorted({stop, LONGER.get((name, count), stop)}):
                events, times, first, again, read, drawn = row(name, count, span)
                print(
                    f"{name:10}{count:7}{span:7g}{events:8}{times:8}{first:10.4f}{again:10.4f}{read:9.4f}"
                    f"{read / first:8.3f}{read / again:6.3f}{drawn:8.2f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
