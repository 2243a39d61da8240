"""Rows that come to rest without an event of a guard: by relaxation (MODEL rule 6), or too near to 0 for a solver."""

from __future__ import annotations

import numpy as np

from stickslip.equations.guards.at_start import AT_LIMIT
from stickslip.equations.guards.guards import FULLY, Guards
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.model.arrays import Array, Indices, Mask
from stickslip.model.crossings import root_between

_CONSTANT = 1e-7  # a velocity is constant if this part is left of the acceleration by the breakaway force, or less
_DRIVEN = 1e-3  # part of the majorant of an acceleration beyond which it is certainly not 0


def until_rest(motion: Motion, guards: Guards, path: Path, margin: Array) -> tuple[Path, list[int]]:
    """Return the path up to where rows have come to rest unseen, and the rows that have relaxed to rest there.

    Rows may have relaxed if they are inside the `margin`. Velocities that leave 0 are ignored while they are roundoff.
    """
    uncertain = guards.velocity_uncertainty
    rows = motion.equations.sticks_at_zero
    may_relax = bool(np.count_nonzero(margin[rows]))
    if not (rows.size and (uncertain is not None or may_relax)) or path.taus.size < 2:
        return path, []
    if uncertain is None and path.has_event and path.taus.size == 2:
        # relaxation needs two points without an event, between which the velocity falls
        return path, []
    points = path.points.T
    w = _signed(motion, path.taus, points, rows)
    cut = path if uncertain is None else _until_unseen_crossing(motion, guards, path, uncertain[rows], rows, w)
    if cut is not path:
        points = cut.points.T
        w = _signed(motion, cut.taus, points, rows)
    return _relaxed(motion, guards, cut, margin[rows], rows, points, w) if may_relax else (cut, [])


def _until_unseen_crossing(
    motion: Motion, guards: Guards, path: Path, uncertain: Array, rows: Indices, w: Array
) -> Path:
    """Return the path up to the first time at which a row passed 0 that came to rest before the solver noticed.

    A solver notices a crossing once the velocity is beyond 0 by more than its errors. A strong damper, or a normal
    force that follows the velocity, may stop a row nearer to 0. The acceleration that drove the row on at ``w = 0`` has
    vanished there: that is a crossing, and no touch of 0.
    """
    found = float(path.taus[-1])
    passed = w < 0
    if not np.count_nonzero(passed):
        return path
    passed &= path.taus > guards.roundoff_until(rows)[:, None]
    # a row that comes to 0 with the event at the end is part of that event
    passed[:, -1] &= (w[:, -1] < (FULLY - 1) * uncertain) | (not path.has_event)
    for k in np.flatnonzero(passed.any(axis=1)).tolist():
        row, beyond = rows[[k]], passed[k].astype(np.int8)
        for left, right in np.flatnonzero(np.diff(beyond, prepend=0, append=0)).reshape(-1, 2).tolist():
            # where it is farthest beyond 0 the velocity is constant
            at = left + int(np.argmin(w[k, left:right]))
            tau = float(path.taus[at])
            if not tau or w[k, at] <= -uncertain[k] or not _stopped(motion, tau, path.state(tau), int(row[0])):
                continue

            def signed(tau: float, row: Indices = row) -> float:
                at = np.array([tau])
                return float(_signed(motion, at, path.at(at).T, row)[0, 0])

            before, after = path.taus[[max(left - 1, 0), left]].tolist()
            if not left:
                zero = tau
            elif signed(before) > 0 > signed(after):
                zero = root_between(signed, before, after)
            else:
                # where a velocity is 0 at a point but for roundoff, its polynomial may have either sign
                zero = before if signed(before) <= 0 else after
            found = min(found, zero)
            break
    if not 0 < found < path.taus[-1]:
        return path
    return motion.until(path, found, hit=True)


def _stopped(motion: Motion, tau: float, y: Array, row: int) -> bool:
    """Tell whether a moving row has lost most of the acceleration that drove it beyond ``w = 0``."""
    sign = float(motion.equations.modes[row])
    equal = _brought_to_rest(motion, tau, y, row)
    driven, left = (sign * motion.relative_acceleration(tau, state, row) for state in (equal, y))
    rates, _ = motion.equations.majorants(np.abs(equal), np.abs(motion.inputs(tau, equal)))
    majorant = float((motion.system.abs_G[[row]] @ rates[: motion.system.n])[0])
    return driven < -_DRIVEN * majorant and left > 0.5 * driven


def _relaxed(
    motion: Motion, guards: Guards, path: Path, margin: Array, rows: Indices, points: Array, w: Array
) -> tuple[Path, list[int]]:
    """Return the path up to the first time at which rows have relaxed to rest without crossing 0, and these rows.

    Where the velocities have become constant and a relative velocity is inside the margin, the contact is stuck;
    only there, because the margin alone would spoil the accuracy of true crossings (Breedveld 2000, section 6.2).
    """
    count = path.taus.size - path.has_event
    points, w = points[:, :count], w[:, :count]
    near = (w <= margin[:, None]) & (w > 0)
    if not np.count_nonzero(near):
        return path, []
    near &= path.taus[:count] > guards.roundoff_until(rows)[:, None]
    # a velocity that has left rest only grows: such rows are excluded without computing rates
    falls = w[:, 1:] <= w[:, :-1]
    edge = np.zeros((rows.size, 1), dtype=bool)
    near &= np.concatenate([falls, edge], axis=1) | np.concatenate([edge, falls], axis=1)
    some = np.flatnonzero(near.any(axis=0))
    if not some.size:
        return path, []
    near[:, some] &= _signed_rates(motion, path.taus[some], points[:, some], rows) <= 0
    found: tuple[float, list[int]] | None = None
    for k in np.flatnonzero(near.any(axis=1)).tolist():
        tau = _first_rest(motion, path, int(rows[k]), near[k], float(margin[k]))
        if tau is None:
            continue
        if found is None or tau < found[0]:
            found = (tau, [int(rows[k])])
        elif tau == found[0]:
            found[1].append(int(rows[k]))
    if found is None:
        return path, []
    tau, ones = found
    end = motion.until(path, tau) if tau < path.taus[-1] else path
    # further rows that rest by then
    last = _signed(motion, np.array([tau]), end.last[:, None], rows)[:, 0]
    for k in ((last > 0) & (last <= margin)).nonzero()[0].tolist():
        row = int(rows[k])
        if row not in ones and _at_rest(motion, tau, end.last, row):
            ones.append(row)
    return end, sorted(ones)


def _signed(motion: Motion, taus: Array, states: Array, rows: Indices) -> Array:
    system = motion.system
    q = motion.loads(taus) if system.drives else np.empty(0)
    w = system.relative_velocity(motion.exact(taus, states), q)[rows]
    return np.asarray(w * motion.equations.modes[rows].astype(float)[:, None])


def _signed_rates(motion: Motion, taus: Array, states: Array, rows: Indices) -> Array:
    """Return how fast relative velocities grow away from 0."""
    rates = [motion.segment.rate(motion.t + tau) for tau in taus.tolist()] if motion.system.drives else []
    w = motion.system.relative_velocity(motion.rate(taus, states), np.array(rates).T)[rows]
    return np.asarray(w * motion.equations.modes[rows].astype(float)[:, None])


def _first_rest(motion: Motion, path: Path, row: int, near: Mask, margin: float) -> float | None:
    """Return the first time at which a row is within the margin and would stay at rest, there and at the next point."""
    rows = np.array([row])
    ends = near.nonzero()[0]
    for k in ends.tolist():
        tau = float(path.taus[k])
        if not _at_rest(motion, tau, path.state(tau), row):
            continue
        if k and not near[k - 1]:

            def beyond(x: float) -> float:
                at = np.array([x])
                return float(_signed(motion, at, path.at(at).T, rows)[0, 0]) - (1 - 1e-12) * margin

            left = float(path.taus[k - 1])
            entry = root_between(beyond, left, tau) if beyond(left) > 0 > beyond(tau) else tau
            if _at_rest(motion, entry, path.state(entry), row):
                return entry if entry > 0 else tau
            continue
        if k:
            return tau
    return None


def _at_rest(motion: Motion, tau: float, y: Array, row: int) -> bool:
    """Tell whether a moving row near rest would stay there: its relative acceleration is zero at ``w = 0``.

    A velocity that falls to 0 exponentially never crosses it; one that crosses has a relative acceleration of the order
    of its breakaway force (Breedveld 2000, section 6.2).
    """
    system, equations = motion.system, motion.equations
    sign = float(equations.modes[row])
    w = float(motion.watched(tau, y)[row])
    if sign * motion.relative_acceleration(tau, y, row) > 0:
        return False
    equal = _brought_to_rest(motion, tau, y, row)
    q = motion.inputs(tau, y)
    scale = float(system.mu_s[:, row].max() * max(q[row], 0.0)) * equations.mobility(row)
    if scale == 0:
        # no friction could hold the row: constant means that no acceleration is left of what the velocity causes
        scale = abs(w) * np.finfo(float).eps
    try:
        driven = sign * motion.relative_acceleration(tau, equal, row)
    except (ArithmeticError, ValueError):
        # with a force that is infinite at w = 0, such as the logarithm of the speed, the row never comes to rest
        return False
    # an acceleration that drives the row on at w = 0 cannot be held
    return -_CONSTANT * scale <= driven <= AT_LIMIT * scale


def _brought_to_rest(motion: Motion, tau: float, y: Array, row: int) -> Array:
    """Return the state in which a moving row is at rest, too."""
    held = motion.equations.is_held.copy()
    held[row] = True
    return motion.system.with_held(y, motion.system.drive_velocities(motion.loads(tau)), held)
