"""What happened by the end of a segment: pure functions of the segment and its computed points."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from stickslip.pieces import interpolate
from stickslip.scan import between_points
from stickslip.segment import Segment
from stickslip.solving import Reached

__all__ = ["at_limit", "jumped", "regained", "relaxed", "turned_over"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Modes = NDArray[np.int8]

_ROUNDOFF_AT_END, _TIE = 1e-9, 1e-7
_LOOKS, _CLOSE = 64, 1e-9


def at_limit(segment: Segment, reached: Reached, relaxed_ones: list[int]) -> tuple[Mask, Mask]:
    """Return the contacts whose relative velocity, and those whose guard, has just come to 0."""
    m = segment.system.m
    touching, fired = np.zeros(m, dtype=bool), np.zeros(m, dtype=bool)
    touching[relaxed_ones] = fired[relaxed_ones] = True
    if reached.hit:
        values = segment.guards(float(reached.taus[-1]), reached.states[-1])
        reach = np.full(values.size, max(0.0, float(values.min())))
        if reached.multipliers is not None:
            # these forces are known within tolerances only: what ties may not seem to
            k = segment.slips
            reach[k:] = np.maximum(reach[k:], _TIE * segment.guard_scales[0][k:])
        at = np.flatnonzero(values <= reach)
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
    mode_set, system = segment.mode_set, segment.system
    if not mode_set.loose.size or not reached.taus[-1] > 0:
        return modes, []
    turned = modes.copy()
    if mode_set.free.size:
        w = segment.relative_velocity(float(reached.taus[-1]), reached.states[-1])
        turned[mode_set.free] = system.sign_of(w)[mode_set.free]
    turns = [(segment.t + tau, *turn) for tau, turn in _turns(segment, reached, modes)]
    for _, j, _, after in turns:
        turned[j] = after
    return (turned if np.any(turned != modes) else modes), turns


def _turns(segment: Segment, reached: Reached, modes: Modes) -> Iterator[tuple[float, tuple[int, int, int]]]:
    """Yield when the relative velocities of open contacts change their signs: local time, contact and its modes."""
    contacts = segment.mode_set.open
    if not contacts.size:
        return
    velocity, taus = _open_velocity(segment, reached)
    w = velocity(taus)
    if not np.count_nonzero(w * modes[contacts, None] <= 0):
        return
    # what is roundoff at the end is for the modes to settle
    largest = np.abs(np.column_stack([velocity(np.zeros(1)), w])).max(axis=1)
    rough = np.maximum(_ROUNDOFF_AT_END * largest, 10 * segment.system.quiet)
    w[np.abs(w[:, -1]) <= rough, -1] = 0.0
    for row, j in enumerate(contacts.tolist()):

        def one(tau: float, row: int = row) -> float:
            return float(velocity(np.array([tau]))[row, 0])

        mode, left = int(modes[j]), 0.0
        for tau, value in zip(taus.tolist(), w[row].tolist(), strict=True):
            # a velocity that dies away keeps its sign, whatever the solver's errors make of it
            if value * mode <= 0 and abs(value) > segment.system.quiet:
                after = 1 if value > 0 else -1
                yield _turn_time(one, left, tau), (j, mode, after)
                mode = after
            if value * mode > 0 or (mode == 0 and value != 0):
                left = tau


def _open_velocity(segment: Segment, reached: Reached) -> tuple[Callable[[Array], Array], Array]:
    """Return the relative velocities of open contacts as functions of local time, and where to look at them."""
    contacts, taus = segment.mode_set.open, reached.taus
    if segment.quadratic and not segment.has_curved:
        w0, w1, w2 = segment.open_velocity
        looks = taus[1:]
        turning = (w1 * w2 < 0).nonzero()[0]
        if turning.size:
            vertices = -0.5 * w1[turning, 0] / w2[turning, 0]
            looks = np.union1d(looks, vertices[vertices < taus[-1]])
        return (lambda x: w0 + x * (w1 + x * w2)), looks

    def velocity(x: Array) -> Array:
        states = interpolate(segment, taus, reached.states, x)
        return segment.relative_velocity(x, states.T)[contacts]

    if segment.quadratic:
        return velocity, segment.looks(float(taus[-1]), 16)[1:]
    return velocity, between_points(taus)


def _turn_time(w: Callable[[float], float], left: float, right: float) -> float:
    """Return when a relative velocity passes 0."""
    if w(left) * w(right) >= 0:
        return left
    return float(brentq(w, left, right, xtol=1e-15 * right, rtol=1e-14))


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


def regained(segment: Segment, reached: Reached) -> tuple[float, int] | None:
    """Return the local time at which a contact that carries its level could carry its share again, and the contact.

    Contacts that lock the same motion share a load by the least norm. Where the share is beyond the level of one, it
    carries its level; as soon as its share is within it, all are to be settled again.
    """
    at_level = segment.mode_set.at_level
    if not at_level.size:
        return None
    found = min((_regains(segment, reached, j), j) for j in at_level.tolist())
    return found if found[0] < reached.taus[-1] else None


def _regains(segment: Segment, reached: Reached, j: int) -> float:
    """Return when the share of one contact comes within its level from beyond, infinite if it does not."""
    modes = segment.mode_set.modes.copy()
    side, modes[j] = int(modes[j]), 0
    trial = segment.with_modes(modes)
    row = trial.slips + int(np.flatnonzero(trial.held == j)[0]) + (0 if side > 0 else trial.helds)

    def spare(taus: Array) -> Array:
        states = interpolate(segment, reached.taus, reached.states, taus)
        return trial.raw_guards(taus, trial.watched(taus, states.T))[row]

    taus = segment.looks(float(reached.taus[-1]), _LOOKS)
    values, limit = spare(taus), trial.levels(0.0).max() + np.abs(trial.watched(0.0, segment.y)).max()
    beyond = np.logical_or.accumulate(values < -_CLOSE * limit)
    within = beyond & (values >= 0)
    if not within.any():
        return np.inf
    k = int(within.argmax()) - 1
    return float(brentq(lambda tau: float(spare(np.array([tau]))[0]), taus[k], taus[k + 1], rtol=1e-14))
