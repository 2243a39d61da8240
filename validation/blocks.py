"""What the rows at the ends of every scale share: a block on the floor, and how it is judged."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

from stickslip import GROUND, Body, Contact, DryFriction, Force, Scene, Signal, simulate
from validation import analytic
from validation.rows import Answer, Row, changes, event_error, worst

extreme_row = partial(Row, "Extremes")
mp = analytic.mp
DRY = DryFriction(0.5, 0.4)
FLOOR = 10.0  # normal force in N: the block breaks loose at 5 N and slides at 4 N


def block(load: Signal | float, normal: Signal | float = FLOOR, law: DryFriction = DRY, speed: float = 0.0) -> Scene:
    """Return a block of 1 kg on the floor under a load."""
    return Scene(
        Body("block", inertia=1.0, velocity=speed),
        Contact("floor", "block", GROUND, law, normal=normal),
        Force("block", load),
    )


def told(scene: Scene, stop: float, events: Sequence[Any], speeds: dict[float, float], **options: Any) -> Answer:
    """Compare a block's events (over the span) and its velocities at some times (over the largest)."""
    t = sorted(speeds)
    result = simulate(scene, (0.0, stop), t_eval=t, **options)
    times = event_error(changes(result, opened=True), events, stop)
    return max(times, worst(result.velocity("block"), [speeds[s] for s in t]))


def power(x: float) -> str:
    """Return a power of ten as names of rows show it."""
    return f"1e{round(math.log10(x)):+d}"
