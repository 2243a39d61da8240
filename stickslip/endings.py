"""What happened by the end of a segment: pure functions of the segment and its computed points."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from stickslip.mode_set import FREE, OPEN
from stickslip.pieces import interpolate
from stickslip.segment import Segment
from stickslip.solving import Reached

__all__ = ["at_limit", "jumped", "relaxed", "turned_over"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Modes = NDArray[np.int8]


def at_limit(segment: Segment, reached: Reached, relaxed_ones: list[int]) -> tuple[Mask, Mask]:
    """Return the contacts whose relative velocity, and those whose guard, has just come to 0."""
    m = segment.system.m
    touching, fired = np.zeros(m, dtype=bool), np.zeros(m, dtype=bool)
    touching[relaxed_ones] = fired[relaxed_ones] = True
    if reached.hit:
        values = segment.guards(float(reached.taus[-1]), reached.states[-1])
        at = np.flatnonzero(values <= max(0.0, float(values.min())))
        fired[segment.guard_contacts[at]] = True
        touching[segment.guard_contacts[at[at < segment.slips]]] = True
    return touching, fired


def jumped(segment: Segment, tau: float, t: float) -> Mask:
    """Return the contacts to a drive whose velocity jumps at `t`, the end of the segment at local time `tau`."""
    system = segment.system
    if not system.drives:
        return np.zeros(system.m, dtype=bool)
    before, after = segment.inputs(tau), system.loads.complete(t)
    size = np.abs(before) + np.abs(after)
    drives = slice(system.first_drive, system.first_acceleration)
    jump = np.zeros_like(before)
    jump[drives] = np.where(np.abs(after - before) > 1e-12 * size, after - before, 0.0)[drives]
    return system.D @ jump != 0


def turned_over(
    segment: Segment, reached: Reached, modes: Modes
) -> tuple[Modes, list[tuple[float, int, int, int]]]:
    """Return the modes at the end, and when contacts that are open turned over on the way.

    Returns
    -------
    modes : array (m,)
        The array given where none did.
    turns : list of (time, contact, mode before, mode after)
    """
    states = segment.mode_set.modes
    loose = segment.mode_set.loose
    if not loose.size or not reached.taus[-1] > 0:
        return modes, []
    w = segment.relative_velocity(reached.taus[1:], reached.states[1:].T)
    if segment.system.all_hard and (w[loose] * modes[loose, None] > 0).all():
        return modes, []
    signs = np.where(states[:, None] == FREE, segment.system.sign_of(w), np.sign(w))
    turns = []
    turned = modes.copy()
    for j in loose.tolist():
        for k, sign in enumerate(signs[j].astype(int).tolist()):
            if sign == turned[j] or (sign == 0 and states[j] == OPEN):
                continue
            if states[j] == OPEN:
                turns.append((_turn_time(segment, reached, j, k), j, int(turned[j]), sign))
            turned[j] = sign
    return (turned if np.any(turned != modes) else modes), turns


def _turn_time(segment: Segment, reached: Reached, j: int, k: int) -> float:
    """Return when an open contact's relative velocity passes 0 between computed points k and k + 1."""

    def w(tau: float) -> float:
        taus = np.array([tau])
        states = interpolate(segment, reached.taus, reached.states, taus)
        return float(segment.relative_velocity(taus, states.T)[j, 0])

    left, right = float(reached.taus[k]), float(reached.taus[k + 1])
    if w(left) * w(right) >= 0:
        return segment.t + left
    return segment.t + float(brentq(w, left, right, xtol=1e-15 * max(right, 1e-300), rtol=1e-14))


def relaxed(segment: Segment, reached: Reached, margin: float) -> tuple[Reached, list[int]]:
    """Return the points up to the first at which contacts have relaxed to rest without crossing 0, and these contacts.

    Where the velocities have become constant and a relative velocity is inside the margin, the contact is stuck;
    only there, because the margin alone would spoil the accuracy of true crossings (Breedveld 2000, section 6.2).
    """
    if not _may_relax(segment, reached, margin):
        return reached, []
    contacts = segment.mode_set.slip
    hard = segment.system.hard[contacts]
    if margin <= 0 or not hard.any():
        return reached, []
    last = reached.taus.size - (1 if reached.hit else 0)
    w = segment.relative_velocity(reached.taus[:last], reached.states[:last].T)[contacts]
    w *= segment.mode_set.sign[:, None]
    near = (w <= margin) & (w > 0) & hard[:, None]
    rests = [_at_rest(segment, reached, near[:, k], k) for k in range(last)] if near.any() else []
    # at one instant alone, a relative acceleration may just be passing through zero
    for k, (before, now) in enumerate(pairwise(rests)):
        resting = sorted(before & now)
        if resting:
            return reached.until(k + 1), [int(contacts[row]) for row in resting]
    return reached, []


def _may_relax(segment: Segment, reached: Reached, margin: float) -> bool:
    """Tell whether a contact is near rest at two computed points: one at a root is none."""
    if not segment.quadratic or reached.taus.size > 2:
        return True
    return not reached.hit and segment.stays_near_rest(margin, float(reached.taus[-1]))


def _at_rest(segment: Segment, reached: Reached, near: Mask, k: int) -> set[int]:
    tau, y = float(reached.taus[k]), reached.states[k]
    return {row for row in np.flatnonzero(near).tolist() if segment.has_come_to_rest(tau, y, row)}
