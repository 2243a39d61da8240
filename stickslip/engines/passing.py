"""Where the guards have come to 0 that a path has left negative.

A solver stops behind the first point at which a guard is negative; the event is where that guard was 0. A velocity
that touches 0 and turns, as that of a body which a sine moves from rest and back, dips below it by the solver's errors.
So the solver goes on until a velocity has passed 0 by more than these.
"""

from __future__ import annotations

from collections.abc import Callable
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

_FEW = 4
"""Points that are looked at together, the last first: a velocity is not beyond 0 for long."""


def back_to_zero(motion: Motion, guards: Guards, path: Path) -> Path:
    """Return the path up to where the first of the guards that are negative at its end was 0."""
    taus = path.taus
    if not path.hit or taus.size < 2:
        return path

    def values(taus: Array) -> Array:
        return guards.values(taus, motion.exact(taus, path.at(taus).T))

    late = guards.values(float(taus[-1]), path.last, late=True)
    rows = (late <= (1 - _FULLY) * guards.leeway).nonzero()[0]
    found = float(taus[-1])
    for row in rows.tolist():
        last = _last_before(row, taus, values)
        if last is None:
            continue
        left, right = (float(taus[last + k]) for k in (0, 1))

        def beyond(tau: float, row: int = row) -> float:
            return float(guards.values(tau, motion.exact(tau, path.state(tau)))[row])

        # at the ends of a step signs may be roundoff
        if beyond(left) <= 0:
            found = min(found, left)
        else:
            found = min(found, root_between(beyond, left, right) if beyond(right) < 0 else right)
    if not 0 < found < taus[-1]:
        return path
    return replace(motion.until(path, found), hit=True)


def _last_before(row: int, taus: Array, values: Callable[[Array], Array]) -> int | None:
    """Return the last point but one at which a guard is not beyond 0, None where it was so from the start."""
    end, count = taus.size - 1, _FEW
    while end:
        first = max(end - count, 0)
        before = (values(taus[first:end])[row] >= 0).nonzero()[0]
        if before.size:
            return first + int(before[-1])
        end, count = first, 2 * count
    return None
