"""The promise of `tradeoff`: the call that it recommends for an error has no larger error, on untuned scenes."""

from __future__ import annotations

from functools import partial

import numpy as np

import stickslip
from stickslip import simulate, tradeoff
from validation.random_scenes import STOP, draw
from validation.rows import Row, Tried
from validation.tried import try_each

SCENES = range(900, 910)  # random scenes that no other row runs
ASKED = (1e-1, 1e-3, 1e-5)
BUDGET = 20.0
POINTS = 3001  # the study itself looks at 1001 times, beside events and within steps


def _broken(number: int) -> float:
    """Return the largest error of the recommended calls of a scene, over the error that was asked for."""
    scene = draw(number)
    study, times = tradeoff(scene, (0.0, STOP), budget=BUDGET), np.linspace(0.0, STOP, POINTS)
    bodies = [body.name for body in scene.bodies]
    exact = simulate(scene, (0.0, STOP), t_eval=times, rtol=1e-12, atol=1e-14)
    worst = 0.0
    for error in ASKED:
        if min(row.error for row in study.work.rows if row.failure is None) > error:
            continue  # no call does it within the budget, and none is recommended
        line = str(study.recommend(error=error))
        found = eval(line, {**vars(stickslip), "scene": scene}).sample(times)
        off = max(float(np.abs(found.velocity(b) - exact.velocity(b)).max()) for b in bodies)
        worst = max(worst, off / error)
    return worst


def _runs() -> Tried:
    """Try all scenes."""
    return try_each(((f"scene {n}", partial(_broken, n)) for n in SCENES), limit=15 * BUDGET)


ROWS = [
    Row(
        "Engines against each other",
        "promises",
        f"errors of {len(ASKED)} recommended calls of `tradeoff` over those asked for",
        "runs with rtol 1e-12",
        _runs,
        1.0,
        quick=False,
        limit=400.0 * len(SCENES),
        tries="scenes with recommended calls",
    )
]
