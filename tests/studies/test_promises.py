"""The promises of `recommend` hold in a random scene, measured against a tighter run at other times."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np
import pytest
from clocks import count_work

from stickslip import Result, simulate, tradeoff
from validation.random_scenes import draw

SPAN = (0.0, 2.0)


@pytest.mark.slow
def test_a_recommended_call_is_as_exact_as_promised(monkeypatch: pytest.MonkeyPatch) -> None:
    # any scene will do: each takes some seconds
    count_work(monkeypatch)
    scene = draw(1003)
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
