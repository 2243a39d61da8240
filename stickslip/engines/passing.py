"""Where the guards have come to 0 that a path has left negative.

A solver stops behind the first point at which a guard is negative; the event is where that guard was 0. A velocity
that touches 0 and turns, as that of a body which a sine moves from rest and back, dips below it by the solver's errors.
So the solver goes on until a velocity has passed 0 by more than these.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stickslip.engines.along import Along
from stickslip.equations.guards import FULLY
from stickslip.equations.path import Path

_FEW = 4
"""Points that are looked at together, the last first: a velocity is not beyond 0 for long."""


def back_to_zero(along: Along, end: float) -> Path:
    """Return the path up to where the first of the guards was 0 that are negative at local time `end`."""
    guards, path, found = along.guards, along.path, end
    late = along.values(np.arange(guards.size), np.array([end]), late=True)[:, 0]
    for row in (late <= (1 - FULLY) * guards.leeway).nonzero()[0].tolist():
        # what begins beyond 0 is told where it has passed what is uncertain
        for beyond in (False, True):
            step = _last_before(along, row, end, beyond)
            if step is not None:
                found = min(found, along.root(row, step, min(float(path.taus[step + 1]), end), beyond))
                break
    if found <= 0:
        found = end
    return replace(path, hit=True) if found >= path.taus[-1] else along.motion.until(path, found, hit=True)


def _last_before(along: Along, row: int, end: float, late: bool) -> int | None:
    """Return the last point before `end` at which a guard is not negative, None where it was so from the start."""
    taus, rows = along.path.taus, np.array([row])
    last, count = int(taus.searchsorted(end)) - 1, _FEW
    # mostly it is the nearest
    if last >= 0 and along.value(row, float(taus[last]), late) >= 0:
        return last
    while last > 0:
        first = max(last - count, 0)
        before = (along.values(rows, taus[first:last], late)[0] >= 0).nonzero()[0]
        if before.size:
            return first + int(before[-1])
        last, count = first, 2 * count
    return None
