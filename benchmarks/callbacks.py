"""What one call of a right-hand side, of the guards and of a Jacobian costs, beside floats written by hand.

    python -m benchmarks.callbacks

CPU time per call in microseconds, the fastest of several rounds.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.scaling import blocks
from benchmarks.tradeoff import leines_belt
from stickslip import DryFriction, Force, LuGre, PreSlip, Scene, feedback, position, sine
from stickslip.benchmark import flywheel_benchmark
from stickslip.engines.cvode import Selected
from stickslip.equations.guards.guards import Guards
from stickslip.equations.motion import Motion
from stickslip.equations.system import System
from stickslip.events.settle import settle
from stickslip.events.situation import Situation, Uncertainty

ROUNDS, CALLS = 7, 300


def cost(call: Callable[[], Any]) -> float:
    """Return the CPU time of a call in microseconds."""
    best = np.inf
    for _ in range(ROUNDS):
        start = clock.process_time()
        for _ in range(CALLS):
            call()
        best = min(best, clock.process_time() - start)
    return 1e6 * best / CALLS


def stribeck_blocks() -> Scene:
    """Return 50 blocks on a belt whose friction falls along a Stribeck curve."""
    scene, law = blocks(50), DryFriction(0.35, 0.2, stribeck_velocity=0.3)
    return scene.with_laws(lambda _: replace(law))


def variants() -> dict[str, Scene]:
    """Return Leine's belt with more that moves it, and with other laws."""
    belt = leines_belt()
    cubic = feedback(lambda x: -0.1 * x**3, position("block"), derivatives=lambda x: -0.3 * x**2)
    core = DryFriction(1.0, 0.5, stribeck_velocity=0.3)
    return {
        "with a sine": Scene(*belt.elements, Force("block", sine(0.1, 0.3))),
        "with a function of the state": Scene(*belt.elements, Force("block", cubic)),
        "with pre-slip, tanh": belt.with_laws(lambda _: PreSlip(core, 1e-3, "tanh")),
        "with LuGre bristles": belt.with_laws(lambda _: LuGre(core, 1e4, 30.0)),
    }


def by_hand() -> tuple[float, float]:
    """Return the costs of rates and guard of Leine's belt in plain floats."""
    out, y = np.empty(2), np.array([0.3, 0.4])

    def rate() -> None:
        x, v = y.tolist()
        out[0], out[1] = v, -x - 1.0 / (1.0 + 3.0 * abs(v - 0.2))

    def guard() -> None:
        out[0] = float(y[1]) - 0.2

    return cost(rate), cost(guard)


def costs(motion: Motion, guards: Guards, y: np.ndarray) -> list[float]:
    """Return the costs of rates, of the smallest guard, and of the Jacobian, as CVODE asks for them."""
    rate, out = Selected(motion, None, merged=False).writes_rates(), np.empty(y.size)
    return [
        cost(lambda: rate(1e-2, y, out)),
        cost(lambda: guards.smallest(1e-2, y)),
        cost(lambda: motion.jacobian(1e-2, y)),
    ]


def main() -> None:
    """Print the table."""
    print("| scene | states | rates / us | guards / us | Jacobian / us |\n|---|---|---|---|---|")
    scenes = {
        "flywheel benchmark": flywheel_benchmark(),
        "Leine's belt": leines_belt(),
        **{f"Leine's belt {title}": scene for title, scene in variants().items()},
        "50 Stribeck blocks": stribeck_blocks(),
    }
    for title, scene in scenes.items():
        system = System(scene)
        y = np.zeros(system.size)
        y[: system.n] = [body.velocity + 1e-3 * k for k, body in enumerate(scene.bodies)]
        none = np.zeros(system.m, dtype=bool)
        now = settle(
            system,
            system.loads(0.0, 4.0).after(0.0),
            Situation(0.0, y, None, np.zeros(system.m), none, none),
            Uncertainty(np.zeros(system.m), 1e-12, np.zeros(system.m)),
        )
        motion, guards = now.motion, now.guards
        guards.smallest(1e-2, y)
        found = costs(motion, guards, y)
        print(f"| {title} | {system.size} | " + " | ".join(f"{c:.1f}" for c in found) + " |")
    rate, guard = by_hand()
    print(f"| Leine's belt, by hand | 2 | {rate:.1f} | {guard:.1f} | |")


if __name__ == "__main__":
    main()
