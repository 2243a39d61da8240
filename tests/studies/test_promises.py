"""What `recommend` promises holds in scenes that nobody tuned, measured against a tighter run at other times."""

from __future__ import annotations

import math
from contextlib import suppress
from itertools import pairwise
from random import Random

import numpy as np
import pytest
from clocks import count_work

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Result,
    Scene,
    Spring,
    simulate,
    sine,
    tradeoff,
)

SPAN = (0.0, 2.0)


def scene_of(seed: int) -> Scene:
    """One to three blocks on a belt or on the ground, pulled by springs and pushed."""
    random = Random(seed)
    count, on_belt = random.randint(1, 3), random.random() < 0.5
    curve = {"stribeck_velocity": random.uniform(0.1, 0.5)} if random.random() < 0.5 else {}
    law = DryFriction(random.uniform(0.3, 0.5), random.uniform(0.1, 0.3), **curve)  # type: ignore[arg-type]
    names = [f"b{k}" for k in range(count)]
    return Scene(
        Drive("belt", velocity=random.uniform(0.2, 0.6)),
        *(Body(name, inertia=random.uniform(0.5, 2.0), velocity=random.uniform(-0.5, 0.5)) for name in names),
        *(
            Contact(f"c{name}", name, "belt" if on_belt else GROUND, law, normal=random.uniform(2, 8))
            for name in names
        ),
        Spring(names[0], GROUND, stiffness=random.uniform(5, 40), damping=random.uniform(0, 0.5)),
        *(Spring(a, b, stiffness=random.uniform(5, 40)) for a, b in pairwise(names)),
        Force(names[-1], sine(random.uniform(0.5, 4.0), frequency=random.uniform(0.3, 1.5))),
        *([Damper(names[-1], GROUND, damping=0.2)] if random.random() < 0.5 else []),
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_recommended_call_is_as_exact_as_promised(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    # any seed will do: each scene takes some seconds
    count_work(monkeypatch)
    scene = scene_of(seed)
    study = tradeoff(scene, SPAN, budget=0.4)
    exact = simulate(scene, SPAN, rtol=1e-13, atol=1e-15)
    # neither evenly spread nor those of the study
    times = SPAN[1] * np.modf(np.arange(2000) * 0.5 * (math.sqrt(5) - 1))[0]

    def velocities(result: Result) -> np.ndarray:
        return result(np.sort(times))[: len(scene.bodies)]

    promised = 0
    for error in (1e-1, 1e-2, 1e-4, 1e-7):
        for may_creep in (True, False):
            # no call within the budget may be that exact: then nothing is promised
            with suppress(ValueError):
                advice = study.recommend(error=error, may_creep=may_creep)
                found = eval(advice.call, {"simulate": simulate, "scene": scene})
                # between the times of the study a step at an event may be a little larger
                assert np.abs(velocities(found) - velocities(exact)).max() <= 1.2 * error, advice
                promised += 1
    assert promised >= 2
