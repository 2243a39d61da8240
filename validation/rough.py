"""Rows over loose tolerances: the errors of CVODE and IDA on the random scenes of the oracle.

A tolerance bounds the error of single steps. The error of a whole run depends on the scene; where a velocity nearly
touches 0, no multiple of the tolerance bounds it. So the rows ask that nearly all runs are within a bound, and that
none fails.
"""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import numpy as np

from stickslip import Result, simulate
from validation.against_oracles import scene_of
from validation.oracle_scenes import FAMILIES
from validation.rows import Row, Wrong

TOLERANCES = (1e-3, 1e-5, 1e-7)
ENGINES: dict[str, dict[str, Any]] = {
    "BDF": {"method": "BDF"},
    "merged Adams": {"formulation": "merged", "method": "Adams"},
    "IDA": {"formulation": "multiplier"},
}
NEARLY_ALL = 95  # per cent of the runs that have to be within the bound
BOUND = 10.0  # in units of rtol: errors of single steps add up along a run
POINTS = 300


@cache
def _exact(family: str, number: int) -> Result:
    """Return the run by the default engine, which other rows compare with the oracle."""
    data = FAMILIES[family][0](number)
    return simulate(scene_of(data, number), (0.0, data["t_end"]), rtol=1e-11, atol=1e-13)


def _error(family: str, number: int, engine: str, rtol: float) -> float:
    """Return the largest error of velocities over the largest, in units of rtol."""
    exact = _exact(family, number)
    bodies, span = len(exact.scene.bodies), (float(exact.t[0]), float(exact.t[-1]))
    found = simulate(exact.scene, span, rtol=rtol, atol=1e-2 * rtol, **ENGINES[engine])
    times = np.linspace(*span, POINTS)
    right = exact(times)[:bodies]
    largest = float(np.abs(right).max())
    # if nothing moves but by roundoff, there is nothing to compare
    return float(np.abs(found(times)[:bodies] - right).max()) / rtol / max(largest, 1e-12)


def _nearly_all(rtol: float, count: int) -> tuple[float, str]:
    """Return the error within which nearly all runs of `count` scenes of each family are; a failed run is `Wrong`."""
    errors: dict[str, float] = {}
    for family in FAMILIES:
        for number in range(1, count + 1):
            for engine in ENGINES:
                name = f"{family} {number} by {engine}"
                try:
                    errors[name] = _error(family, number, engine, rtol)
                except Exception as fault:
                    raise Wrong(f"{name}: {type(fault).__name__}: {fault}") from fault
    half, nearly = np.percentile(list(errors.values()), [50, NEARLY_ALL])
    worst = max(errors, key=lambda name: errors[name])
    return float(nearly), f"{len(errors)} runs, half within {half:.2g}, worst {worst}: {errors[worst]:.2g}"


def rows(count: int) -> list[Row]:
    """Return the rows: `count` scenes of each family, each by three engines."""
    return [
        Row(
            "Engines against each other",
            f"rough-{rtol:.0e}",
            f"velocities of {NEARLY_ALL} of 100 random runs with rtol = {rtol:.0e}, in rtol of the largest",
            "the default engine",
            partial(_nearly_all, rtol, count),
            BOUND,
            quick=False,
            limit=120.0 + 120.0 * count,
        )
        for rtol in TOLERANCES
    ]
