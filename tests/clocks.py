"""Clocks that show the work done instead of the time, so that no study depends on how fast the machine is."""

from __future__ import annotations

import importlib
from types import SimpleNamespace

import pytest

from stickslip import Result, Scene
from stickslip.studies import work_precision
from stickslip.studies.tradeoff_setups import Call

# the package has a function of the same name
tradeoff = importlib.import_module("stickslip.studies.tradeoff")


def count_work(patch: pytest.MonkeyPatch) -> None:
    """Let the clocks of both studies go on by 10 us for each evaluation of the rates, and by 1 ms for each run.

    A study tries each call and then measures it, here once. The result of the trial serves for the measured run, whose
    work is the same.
    """
    now = 0.0
    run = Call.run
    tried: dict[tuple[str, int], Result] = {}

    def counted(self: Call, scene: Scene, span: tuple[float, float]) -> Result:
        nonlocal now
        key = self.text(span), id(scene)
        if key in tried:
            result = tried.pop(key)
        else:
            result = tried[key] = run(self, scene, span)
        now += 1e-3 + 1e-5 * result.stats["rate_calls"]
        return result

    patch.setattr(Call, "run", counted)
    patch.setattr(tradeoff, "_REPEATS", 1)
    for timed in (tradeoff, work_precision):
        patch.setattr(timed, "clock", SimpleNamespace(perf_counter=lambda: now))
