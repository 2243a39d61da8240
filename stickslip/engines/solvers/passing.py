"""Find where guards that are negative at the end of a path were 0.

A solver stops behind the first point at which a guard is negative; the event is where that guard was 0. A velocity
that touches 0 and turns, as that of a body which a sine moves from rest and back, dips below 0 by the solver's errors.
So the solver goes on until a velocity has passed 0 by more than these.

A body that hardly leaves rest before it comes back is lost in the errors, too: for example if a force is beyond its
level by 1e-10 of it for a moment. The solver may find its velocity beyond 0 while it is still driven away from 0.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stickslip.engines.solvers.guards_along import GuardsAlong
from stickslip.equations.guards.at_start import ROUNDOFF
from stickslip.equations.guards.guards import FULLY
from stickslip.equations.path import Path
from stickslip.model.arrays import Indices
from stickslip.model.crossings import root_between

_FEW = 4  # points that are looked at together, backwards from the end: a velocity is not negative for long


def back_to_zero(along: GuardsAlong, end: float) -> Path:
    """Return the path up to the first place where a guard that is negative at local time `end` was 0."""
    guards = along.guards
    values = along.values(np.arange(guards.size), np.array([end]), with_leeway=True)[:, 0]
    return _up_to_first(along, (values <= (1 - FULLY) * guards.leeway).nonzero()[0], end)


def back_from_end(along: GuardsAlong, path: Path) -> Path:
    """Return a path, cut where a velocity came to 0 that at the end is driven on beyond 0.

    Such a velocity is beyond 0 by no more than its uncertainty. But the next motion, as after a sample, would not know
    that it was ever positive. If motions are short, it would never be beyond 0 by more than its uncertainty.
    """
    guards, end = along.guards, float(path.taus[-1])
    rows = guards.passing[guards.passing < guards.rows.slips]
    if not rows.size or guards.velocity_uncertainty is None:
        return path
    low = along.values(rows, np.array([end]))[:, 0] < -ROUNDOFF * guards.majorant[0, rows]
    beyond = [i for i in rows[low].tolist() if guards.first[0, i] >= 0 and _rising(along, i, end) < 0]
    return _up_to_first(along, np.array(beyond), end) if beyond else path


def _up_to_first(along: GuardsAlong, rows: Indices, end: float) -> Path:
    """Return the path up to the first place where one of some guards, negative at local time `end`, was 0."""
    path, found, guard = along.path, end, None
    for row in rows.tolist():
        # a guard that is negative from the start on counts as 0 where it passes its leeway
        for with_leeway in (False, True):
            step = _last_before(along, row, end, with_leeway)
            if step is not None:
                root = along.root(row, step, min(float(path.taus[step + 1]), end), with_leeway)
                root = _once_driven_back(along, row, root, end)
                if root < found or guard is None:
                    found, guard = root, row
                break
    if found <= 0:
        found, guard = end, None
    ended = path if found >= path.taus[-1] else along.motion.until(path, found)
    return replace(ended, hit=True, guard=guard)


def _once_driven_back(along: GuardsAlong, i: int, root: float, end: float) -> float:
    """Return the first time from a root of a guard on at which the motion drives its velocity down.

    A velocity that comes to 0 falls. If it does not fall, it is at 0 by errors only, and has never been farther from 0
    than these.
    """
    guards, path = along.guards, along.path
    if i not in guards.passing or not 0 < root < end:
        return root

    def rising(tau: float) -> float:
        return _rising(along, i, tau)

    left = root
    if rising(left) < 0:
        return root
    for right in [*path.taus[(path.taus > root) & (path.taus < end)].tolist(), end]:
        if rising(right) < 0:
            return root_between(rising, left, right)
        left = right
    return root


def _rising(along: GuardsAlong, i: int, tau: float) -> float:
    """Return how fast the motion makes a velocity grow, plus the roundoff of that."""
    motion, guards = along.motion, along.guards
    row, sign = int(guards.row[i]), float(guards.rows.sign[i])
    grows = sign * motion.relative_acceleration(tau, along.path.state(tau), row)
    return grows + ROUNDOFF * float(guards.majorant[1, i])


def _last_before(along: GuardsAlong, row: int, end: float, with_leeway: bool) -> int | None:
    """Return the last point before `end` at which a guard is not negative, None if there is none."""
    taus, rows = along.path.taus, np.array([row])
    last, count = int(taus.searchsorted(end)) - 1, _FEW
    while last >= 0:
        first = max(last - count + 1, 0)
        before = (along.values(rows, taus[first : last + 1], with_leeway)[0] >= 0).nonzero()[0]
        if before.size:
            return first + int(before[-1])
        last, count = first - 1, 2 * count
    return None
