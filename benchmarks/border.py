"""Where series end and CVODE begins: one scene, whose damper becomes stiffer by factors of 1.5.

    python -m benchmarks.border

A block rubs on a belt, and a light body hangs on it by a damper. For every rate at which that body's velocity decays:
CPU time and error of both engines, and of what is taken by itself. No step of the rate may cost ten times the time or
ten times the error of the one before: the program returns how many do.
"""

from __future__ import annotations

import sys
import time as clock

import numpy as np

from stickslip import GROUND, Body, Contact, Damper, Drive, DryFriction, Result, Scene, Spring, simulate

RATES = 10.0 * 1.5 ** np.arange(29)
STOP, OUTPUTS, RUNS = 10.0, 200, 3
LONGEST_BY_SERIES = 1e4
CLIFF = 10.0
FLOOR = 1e-7  # errors below are as good as none beside the tolerance of CVODE


def scene(rate: float) -> Scene:
    """Return the scene in which the light body's velocity decays with `rate` in 1/s."""
    law, inertia = DryFriction(0.35, 0.2), 0.1
    return Scene(
        Drive("belt", velocity=0.3),
        Body("block", inertia=1.0, velocity=0.3, position=0.5),
        Body("light", inertia=inertia, velocity=0.3, position=0.5),
        Contact("c", "block", "belt", law, normal=5.0),
        Spring("block", GROUND, stiffness=4.0, damping=0.05),
        Spring("light", GROUND, stiffness=0.5),
        Damper("light", "block", damping=inertia * rate),
    )


def timed(rate: float, method: str) -> tuple[float, Result]:
    """Return the least CPU time of a few runs in s, and the result."""
    best, made = np.inf, scene(rate)
    for _ in range(RUNS):
        start = clock.process_time()
        result = simulate(made, (0.0, STOP), t_eval=np.linspace(0.0, STOP, OUTPUTS), method=method)  # type: ignore[arg-type]
        best = min(best, clock.process_time() - start)
    return best, result


def main() -> int:
    """Print the table; return how many cliffs there are."""
    print("| rate / (1/s) | series / ms | BDF / ms | by itself | time / ms | error | events |")
    print("|---|---|---|---|---|---|---|", flush=True)
    times, errors = [], []
    for rate in RATES.tolist():
        exact = simulate(
            scene(rate),
            (0.0, STOP),
            t_eval=np.linspace(0.0, STOP, OUTPUTS),
            method="BDF",
            rtol=1e-12,
            atol=1e-14,
        )
        series = f"{1e3 * timed(rate, 'series')[0]:.0f}" if rate < LONGEST_BY_SERIES else ""
        seconds, found = timed(rate, "auto")
        error = float(np.abs(found.y - exact.y).max() / np.abs(exact.y).max())
        times.append(seconds)
        errors.append(max(error, FLOOR))
        cells = [f"{rate:.3g}", series, f"{1e3 * timed(rate, 'BDF')[0]:.0f}", str(found.stats["engine"])]
        cells += [f"{1e3 * seconds:.0f}", f"{error:.0e}", f"{len(found.events)}"]
        print("| " + " | ".join(cells) + " |", flush=True)
    steps = [np.exp(np.abs(np.diff(np.log(x)))) for x in (times, errors)]
    print(f"\nlargest factors from one rate to the next: time {steps[0].max():.1f}, error {steps[1].max():.1f}")
    return int(sum(np.count_nonzero(step >= CLIFF) for step in steps))


if __name__ == "__main__":
    sys.exit(main())
