"""Error and time at the ends of every scale, drawn: ``python -m benchmarks.extremes [--figure FILE]``.

Each panel changes one number over many decades, in scenes with answers in closed form (`validation/magnitudes.py`).
Above: the error, relative to the largest value. Below: CPU time. A gap means that the number is refused.
"""

from __future__ import annotations

import argparse
import math
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpmath import mp

from stickslip import GROUND, Body, Contact, Damper, DryFriction, Scene, simulate
from validation import magnitudes
from validation.crowds import many_events
from validation.rows import Answer

__all__ = ["FAMILIES", "Family", "draw", "main", "stiff"]

RUNS, LONG = 2, 1.0  # how often a point is measured, and the CPU time in s from which once is enough


def stiff(rate: float) -> float:
    """A light body and a damper on a block that friction brings to rest: the velocities, and the time of rest.

    The momentum of both falls on a straight line, and the velocity between them exponentially to that with which the
    damper brakes the light body as friction does the block.
    """
    heavy, light, friction = mp.mpf(1), mp.mpf("0.125"), mp.mpf(4)
    damping = float(mp.mpf(rate) / (1 / heavy + 1 / light))
    exact_rate = mp.mpf(damping) * (1 / heavy + 1 / light)
    momentum = heavy * 1 + light * mp.mpf("1.5")

    last = friction / heavy / exact_rate

    def block(t: mp.mpf) -> mp.mpf:
        between = last + (mp.mpf("0.5") - last) * mp.exp(-exact_rate * t)
        return (momentum - friction * t - light * between) / (heavy + light)

    rests = mp.findroot(block, mp.mpf("0.28"))
    times = np.array([0.25, 0.5, 0.75, 0.999]) * float(rests)
    scene = Scene(
        Body("block", inertia=1.0, velocity=1.0),
        Body("light", inertia=0.125, velocity=1.5),
        Contact("floor", "block", GROUND, DryFriction(0.8, 0.4), normal=10.0),
        Damper("light", "block", damping=damping),
    )
    result = simulate(scene, (0.0, 0.35), t_eval=times)
    apart = max(abs(v - float(block(mp.mpf(t)))) for t, v in zip(times, result.velocity("block"), strict=True))
    return max(float(apart), abs(result.events[0].t - float(rests)) / 0.35)


@dataclass(frozen=True)
class Family:
    """One number that changes: its name, its values, and what measures the error at one of them."""

    name: str
    values: Sequence[float]
    measure: Callable[[float], Answer]


def _decades(first: int, last: int, step: int = 1) -> list[float]:
    return [10.0**k for k in range(first, last + 1, step)]


FAMILIES = (
    Family("inertia ratio", _decades(-12, 12, 2), magnitudes.inertia_ratio),
    Family("rate of a damper / (1/s)", _decades(-2, 12), stiff),
    Family(
        "units of force, inertia, time",
        _decades(-12, 12, 4),
        lambda x: magnitudes.units((round(math.log10(x)),)),
    ),
    Family("dwell time / s", _decades(-9, 9, 2), magnitudes.dwell),
    Family("static over Coulomb coefficient", [2.0, *_decades(1, 6)], magnitudes.ratio_pulled),
    Family("pre-slip velocity / (rad/s)", _decades(-10, -2), magnitudes.preslip),
    Family("events", _decades(1, 4), lambda x: many_events(int(x))),
)


@dataclass(frozen=True)
class Point:
    """Error and CPU time in s at one value; not a number where the value is refused."""

    value: float
    error: float
    seconds: float


def measured(family: Family, value: float) -> Point:
    """Measure one value."""
    best, error = math.inf, math.nan
    for _ in range(RUNS):
        start = clock.process_time()
        try:
            answer = family.measure(value)
        except ValueError:
            return Point(value, math.nan, math.nan)
        best = min(best, clock.process_time() - start)
        if isinstance(answer, tuple):
            error, remark = answer
            if remark.startswith("refused"):
                return Point(value, math.nan, math.nan)
        else:
            assert isinstance(answer, float)
            error = answer
        if best > LONG:
            break
    return Point(value, error, best)


def draw(found: Sequence[tuple[Family, Sequence[Point]]], path: Path) -> None:
    """Draw errors above times, a column for each number that is varied, four of them beside each other."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    beside = 4
    lines = -(-len(found) // beside)
    fig, axes = plt.subplots(2 * lines, beside, figsize=(9.0, 4.4 * lines))
    for axis in axes.flat:
        axis.set_visible(False)
    for number, (family, points) in enumerate(found):
        line, column = divmod(number, beside)
        above, below = axes[2 * line, column], axes[2 * line + 1, column]
        x = [p.value for p in points]
        # an error of 0 stands at the floor
        above.loglog(x, [max(p.error, 1e-17) for p in points], "o-", ms=3)
        below.loglog(x, [1e3 * p.seconds for p in points], "s--", ms=3, color="tab:orange")
        above.set_ylim(1e-18, 1.0)
        below.set_ylim(1e-1, 1e6)
        below.set_xlabel(family.name, fontsize=9)
        for axis in (above, below):
            axis.set_visible(True)
            axis.grid(True, alpha=0.3)
            axis.tick_params(labelsize=8)
            refused = [p.value for p in points if math.isnan(p.error)]
            for value in refused:
                axis.axvline(value, color="tab:red", lw=1, ls=":")
        if not column:
            above.set_ylabel("error")
            below.set_ylabel("CPU time in ms")
    fig.tight_layout()
    fig.savefig(path, dpi=150)
    plt.close(fig)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--figure", type=Path, default=Path("extremes.png"), help="file of the figure")
    options = parser.parse_args(arguments)
    found = []
    for family in FAMILIES:
        print(f"\n| {family.name} | error | CPU time / ms |\n|---|---|---|", flush=True)
        points = []
        for value in family.values:
            point = measured(family, value)
            points.append(point)
            said = "refused | " if math.isnan(point.error) else f"{point.error:.1e} | {1e3 * point.seconds:.0f}"
            print(f"| {value:.0e} | {said} |", flush=True)
        found.append((family, points))
    draw(found, options.figure)


if __name__ == "__main__":
    main()
