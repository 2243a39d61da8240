"""Where velocities have passed 0, told only once they are beyond what the tolerances leave uncertain.

A velocity that touches 0 and turns, as that of a body which a sine moves from rest and back, dips below it by the
solver's errors. So the solver goes on until a velocity has passed 0 by more than these. Then the motion ends at the
time at which it did.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stickslip.equations.guards import Guards
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.model.crossings import root_between

__all__ = ["back_to_zero"]

Array = NDArray[np.float64]

_FULLY = 0.999
"""Part of what is uncertain by which a velocity that was found beyond 0 has passed it at least."""


def back_to_zero(motion: Motion, guards: Guards, path: Path) -> Path:
    """Return the path up to where the first of the velocities that have passed 0 at its end was 0."""
    taus = path.taus
    if not (guards.uncertain and path.hit and taus.size > 1):
        return path

    def values(taus: Array, late: bool = False) -> Array:
        return guards.values(taus, motion.exact(taus, path.at(taus).T), late)

    rows = guards.passing
    rows = rows[values(taus[-1:], late=True)[rows, 0] <= (1 - _FULLY) * guards.uncertain]
    if not rows.size:
        return path
    found, ends = float(taus[-1]), values(taus)
    for row in rows.tolist():
        before = (ends[row, :-1] >= 0).nonzero()[0]
        if not before.size:
            # it was beyond 0 from the start
            continue
        left, right = (float(taus[before[-1] + k]) for k in (0, 1))

        def beyond(tau: float, row: int = row) -> float:
            return float(values(np.array([tau]))[row, 0])

        if beyond(right) < 0:
            found = min(found, root_between(beyond, left, right))
    if not 0 < found < taus[-1]:
        return path
    cut = path.cut(found)
    return replace(cut, last=motion.exact(found, cut.last), hit=True)
