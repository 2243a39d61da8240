"""How the work grows with the size of a scene: wheels, blocks, wagons, and pre-slip.

    python -m benchmarks.scaling [--quick]

Every size runs in a process of its own, for its peak memory. Wheels: inertia 1, free ends, friction between
neighbours, to the standstill of all interfaces; their last velocity must be the average of the first ones.
Blocks: each tied by springs to its two neighbours and to a plate at rest, on a belt that moves steadily.
Watched: the same blocks with an event of the user that watches the first.
Shaken: the same blocks with a sine among the forces on each.
Guided: the same blocks, each with a second contact to a guide on the ground.
Loaded: blocks on the ground, each under a load of its own that kinks five times.
Wagons: a train with play between its wagons, which roll at unequal speeds and rub on the rails.
Pre-slip: the same chains of wheels on the linear law, time per step.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import resource
import sys
import time as clock
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Gap,
    Scene,
    Spring,
    When,
    piecewise_linear,
    position,
    simulate,
    sine,
)

WHEELS = (10, 100, 1000, 10_000)
BLOCKS = (10, 100, 1000)
SHAKEN = (10, 100, 1000)
GUIDED = (10, 100, 1000)
LOADED = (10, 100, 1000)
WAGONS = (10, 100, 1000)
PRE_SLIP = (10, 100, 1000)
DRY = DryFriction(mu_static=0.2, mu_coulomb=0.1)
PRE_SLIP_VELOCITY = 1e-4
WHEELS_STOP = 0.05
BLOCKS_STOP = 5.0
LOADED_STOP = 1.0
WAGONS_STOP = 0.5
BELT = 0.3
PUSH = 0.5


def wheels(n: int) -> Scene:
    """Return a row of wheels of unequal speeds, pressed against each other unequally."""
    return Scene(
        *(Body(f"w{i}", inertia=1.0, velocity=1.0 + 0.01 * math.sin(7.3 * i)) for i in range(n)),
        *(
            Contact(f"c{i}", f"w{i}", f"w{i + 1}", DRY, normal=100.0 * (1.0 + 0.5 * math.sin(3.1 * i)))
            for i in range(n - 1)
        ),
    )


def blocks(n: int, push: float = 0.0) -> Scene:
    """Return blocks in a row on a belt, each tied to its neighbours and to a plate at rest, and pushed by a sine."""
    law, index = DryFriction(mu_static=0.35, mu_coulomb=0.2), range(n)
    return Scene(
        Drive("belt", velocity=BELT),
        *(Body(f"b{i}", inertia=1.0, velocity=BELT, position=0.5 + 0.5 * math.sin(7.3 * i)) for i in range(n)),
        *(Contact(f"f{i}", f"b{i}", "belt", law, normal=5.0) for i in index),
        *(Spring(f"b{i}", GROUND, stiffness=1.0, damping=0.05) for i in index),
        *(Spring(f"b{i}", f"b{i + 1}", stiffness=3.0) for i in index[:-1]),
        *(Force(f"b{i}", sine(push, 1.5, phase=0.7 * i)) for i in index if push),
    )


def guided(n: int) -> Scene:
    """Return the blocks on a belt with a guide on the ground on which each rubs, too."""
    guide = DryFriction(mu_static=0.05, mu_coulomb=0.04)
    return Scene(*blocks(n).elements, *(Contact(f"g{i}", f"b{i}", GROUND, guide, normal=2.0) for i in range(n)))


def loaded(n: int) -> Scene:
    """Return blocks that nothing joins, each pushed to and fro at times of its own."""
    law, times = DryFriction(mu_static=0.35, mu_coulomb=0.2), np.arange(1, 6) / 6.0
    return Scene(
        *(Body(f"b{i}", inertia=1.0) for i in range(n)),
        *(Contact(f"f{i}", f"b{i}", GROUND, law, normal=5.0) for i in range(n)),
        *(
            Force(f"b{i}", piecewise_linear(times + 0.05 * math.sin(7.3 * i), [0.0, 3.0, -3.0, 3.0, 0.0]))
            for i in range(n)
        ),
    )


def wagons(n: int) -> Scene:
    """Return wagons in a row with buffers and couplings between them."""
    law, index = DryFriction(mu_static=0.02, mu_coulomb=0.01), range(n)
    return Scene(
        *(Body(f"w{i}", inertia=1.0, velocity=0.3 * math.sin(7.3 * i), position=-1.0 * i) for i in index),
        *(Contact(f"r{i}", f"w{i}", GROUND, law, normal=10.0) for i in index),
        *(Gap(f"b{i}", f"w{i}", f"w{i + 1}", lower=0.98, upper=1.03, stiffness=200.0, damping=1.0) for i in index[:-1]),
    )


@dataclass(frozen=True)
class Measured:
    """One size of one kind: what was done in which time, with which error and peak memory in MB."""

    n: int
    events: int
    steps: int
    seconds: float
    error: float
    memory: float

    def per_item(self, kind: str) -> float:
        """Return the time in s per event, or per step of a pre-slip scene."""
        return self.seconds / max(self.steps if kind == "pre-slip" else self.events, 1)


def measure(kind: str, n: int) -> Measured:
    """Simulate one size in this process."""
    is_chain = kind in ("wheels", "pre-slip")
    if is_chain:
        scene, stop = wheels(n), WHEELS_STOP
    elif kind == "wagons":
        scene, stop = wagons(n), WAGONS_STOP
    elif kind == "guided":
        scene, stop = guided(n), BLOCKS_STOP
    elif kind == "loaded":
        scene, stop = loaded(n), LOADED_STOP
    else:
        scene, stop = blocks(n, PUSH if kind == "shaken" else 0.0), BLOCKS_STOP
    if kind == "pre-slip":
        scene = scene.regularized(PRE_SLIP_VELOCITY)
    options: dict[str, Any] = {"rtol": 1e-6, "atol": 1e-8} if kind == "pre-slip" else {}
    if kind == "watched":
        options = {"events": [When("passes", position("b0") - 0.7)]}
    before = clock.perf_counter()
    result = simulate(scene, (0.0, stop), t_eval=[stop], dense_output=False, **options)
    seconds = clock.perf_counter() - before
    error = math.nan
    last = result.y[:n, -1]
    if is_chain:
        error = float(np.abs(last - np.mean([body.velocity for body in scene.bodies])).max())
    if kind == "wheels" and any(result.mode(f"c{i}")[-1] for i in range(n - 1)):
        error = math.inf
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 << (20 if sys.platform == "darwin" else 10))
    return Measured(n, len(result.events), int(result.stats["steps"]), seconds, error, peak)


def apart(kind: str, n: int) -> Measured:
    """Simulate one size in a process of its own."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(measure, (kind, n))


def exponent(rows: Sequence[Measured], what: Sequence[float]) -> float:
    """Return the slope of a straight line through the logarithms, over the larger half of the sizes."""
    last = slice(max(len(rows) // 2 - 1, 0), None)
    return float(np.polyfit(np.log([row.n for row in rows][last]), np.log(what[last]), 1)[0])


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; return the number of chains that did not come to the right standstill."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--quick", action="store_true", help="leave out the largest size of each kind")
    quick = parser.parse_args(arguments).quick
    wrong = 0
    kinds = (
        ("wheels", WHEELS),
        ("blocks", BLOCKS),
        ("watched", BLOCKS),
        ("shaken", SHAKEN),
        ("guided", GUIDED),
        ("loaded", LOADED),
        ("wagons", WAGONS),
        ("pre-slip", PRE_SLIP),
    )
    for kind, sizes in kinds:
        item = "step" if kind == "pre-slip" else "event"
        titles = (kind, "events", "steps", "time / s", f"time per {item} / ms", "peak memory / MB", "error")
        print("\n| " + " | ".join(titles) + " |")
        print("|---|---|---|---|---|---|---|", flush=True)
        rows = []
        for n in sizes[:-1] if quick else sizes:
            row = apart(kind, n)
            rows.append(row)
            error = "" if math.isnan(row.error) else f"{row.error:.1e}"
            cells = [f"{n}", f"{row.events}", f"{row.steps}", f"{row.seconds:.3g}"]
            cells += [f"{1e3 * row.per_item(kind):.3g}", f"{row.memory:.0f}", error]
            print("| " + " | ".join(cells) + " |", flush=True)
            wrong += kind == "wheels" and not row.error < 1e-9
        if len(rows) > 1:
            total = exponent(rows, [row.seconds for row in rows])
            each = exponent(rows, [row.per_item(kind) for row in rows])
            print(f"\n{kind}: time ~ N^{total:.2f}, time per {item} ~ N^{each:.2f}", flush=True)
    if wrong:
        print(f"\n{wrong} chains of wheels did not come to rest at the average of their momenta")
    return wrong


if __name__ == "__main__":
    sys.exit(main())
