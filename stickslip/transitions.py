"""Which modes are consistent now: all contacts at rest are settled together (pure functions)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from stickslip.assembly import System
from stickslip.labels import label
from stickslip.mode_set import FREE, OPEN
from stickslip.segment import AS_FIRED, AT_LIMIT, Segment

__all__ = ["Inconsistent", "Settled", "carry_on", "change_one", "settle"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Modes = NDArray[np.int8]

_ROUNDOFF = 1e-12
_STANDING = 1e-9
"""A contact this slow, as a part of the largest speed, is looked at together with all others."""

_ENUMERATED = 6
_SOON = (1e-6, 1e-4)
_BALANCE = 1e4
"""Weight of the balance of forces beside their norm."""
_LOOSEST = 1e-4
"""The largest distance from its limit, as a part of it, at which a contact that comes back at once is there."""


class Inconsistent(Exception):
    """No set of modes satisfies the laws of all contacts at rest.

    Parameters
    ----------
    contacts : array of int
        The contacts concerned.
    """

    def __init__(self, contacts: NDArray[np.intp]) -> None:
        super().__init__("no consistent modes")
        self.contacts = contacts


@dataclass(frozen=True)
class Settled:
    """Consistent modes and the segment that starts with them."""

    modes: Modes
    since: Array
    segment: Segment


def settle(
    system: System,
    t: float,
    y: Array,
    modes: Modes | None,
    since: Array,
    touching: Mask,
    fired: Mask,
    stop: float,
    was: Array | None = None,
    stalls: int = 0,
) -> Settled:
    """Return the modes in which the motion goes on from the state `y` at `t`.

    All contacts whose relative velocity is 0 are tried stuck; while some ``|lambda| > B``, the one with the
    largest ratio is set slipping with the sign of its lambda, ties within roundoff together. Where others lock the
    same motion it carries its level instead, and they carry the rest.

    Parameters
    ----------
    system : System
    t : float
        Time in s; loads count with their right limits.
    y : array (size,)
    modes : array (m,) or None
        Modes before, None at the start.
    since : array (m,)
        When each contact last became stuck.
    touching : array (m,) of bool
        Contacts whose relative velocity an event has found to be 0.
    fired : array (m,) of bool
        Contacts that the event found at their limit.
    stop : float
        The next break.
    was : array (size,), optional
        The state when the modes before began.
    stalls : int
        How many events have come one after another without progress in time. A contact that is let go and comes
        back at once is at its limit, as far as a solver can tell.

    Raises
    ------
    Inconsistent
        If no set of modes is consistent.
    """
    q = system.loads.complete(t)
    closed = _closed(system, t, q)
    w, speed = _relative(system, t, y, q, was)
    # within Karnopp's dead band a contact counts as at rest
    limit = np.maximum(_ROUNDOFF * speed, system.coefficients.threshold)
    resting = system.hard & (touching | (np.abs(w) <= limit))
    before, y = y, project(system, y, q, closed & resting)
    if y is not before:
        # contacts that share a motion come to rest together, though an event may have found only one of them
        w, speed = _relative(system, t, y, q, was)
        also = system.hard & ~resting & (np.abs(w) <= _ROUNDOFF * speed)
        if also.any():
            resting |= also
            y = project(system, before, q, closed & resting)
    trial = np.where(resting, 0, np.sign(w))
    if not system.all_hard:
        trial = np.where(system.hard, trial, _slip_states(system, w, modes, fired))
    trial = np.where(closed, trial, OPEN).astype(np.int8)
    was_stuck = trial == 0 if modes is None else modes == 0
    tried_since = np.where(was_stuck, since, t)
    as_fired = min(AS_FIRED * 10.0 ** max(stalls - 1, 0), _LOOSEST)
    search = _Search(system, t, y, tried_since, closed & resting, fired, stop, as_fired)
    segment = search.run(trial)
    result = segment.mode_set.modes
    if result.max(initial=0) >= OPEN:
        result = label(segment, w, resting, modes)
    locked = segment.mode_set.slip[segment.mode_set.locked]
    if locked.size:
        # at their limit, but held at rest by others: not in motion
        result = result.copy()
        result[locked] = 0
    return Settled(result, np.where(result == 0, tried_since, t), segment)


def _slip_states(system: System, w: Array, modes: Modes | None, fired: Mask) -> Array:
    """Return the modes of contacts with a pre-slip velocity: the binary slip state of eq. (4), with its memory."""
    speed, sign = np.abs(w), np.sign(w)
    velocity, threshold = system.coefficients.velocity, system.coefficients.threshold
    slipped = np.zeros(system.m, dtype=bool) if modes is None else np.abs(modes) == 1
    limit = np.where(slipped, threshold, velocity)
    slips = (speed > limit) | (fired & ~slipped & (speed > 0.5 * limit))
    slips &= ~(fired & slipped)
    return np.where(system.free, FREE, np.where(slips, sign, 0.0))


def carry_on(system: System, t: float, y: Array, now: Settled, stop: float) -> Settled | None:
    """Return the same modes from a load break on, or None where some may change and all must be settled.

    Contacts that are in motion may open and close: they go on slipping as they do.
    """
    q = system.loads.complete(t)
    closed = _closed(system, t, q)
    mode_set = now.segment.mode_set
    modes = mode_set.modes
    changed = closed != (modes != OPEN)
    if np.count_nonzero(changed):
        if np.count_nonzero(changed & ((modes == 0) | (now.modes == 0) | ~system.hard)):
            return None
        # open contacts are labelled with the sign of their relative velocity
        modes = np.where(changed, np.where(closed, now.modes, OPEN), modes).astype(np.int8)
        mode_set = system.mode_set(modes.tobytes())
    nothing = np.zeros(system.m, dtype=bool)
    segment = Segment(system, mode_set, t, y, now.since, nothing, stop)
    slow = _slow(system, y, now.segment.y, q)
    if np.count_nonzero(segment.taylor[0][: segment.slips] <= slow) or _any_loose_at_rest(
        segment, 0.0, y, now.modes, slow
    ):
        return None
    violated, order = segment.classify(nothing)
    if np.count_nonzero(violated):
        return None
    segment.arm(order)
    return Settled(now.modes, np.where(now.modes == 0, now.since, t), segment)


def _slow(system: System, y: Array, was: Array, q: Array) -> float:
    """Return the relative velocity below which a contact is looked at together with all others.

    What comes to rest is slow beside what it was.
    """
    now, before = y[: system.n], was[: system.n]
    square = float(now @ now + before @ before)
    if system.drives:
        drives = q[system.first_drive : system.first_acceleration]
        square += float(drives @ drives)
    return _STANDING * math.sqrt(square)


def _any_loose_at_rest(segment: Segment, tau: float, y: Array, labels: Modes, slow: float) -> bool:
    """Tell whether a contact that carries no force is at rest: it is named after the motion to come, each time."""
    loose = segment.mode_set.loose
    if not loose.size:
        return False
    w = segment.relative_velocity(tau, y)[loose]
    rests = (labels[loose] == 0) | (np.abs(w) <= slow)
    return bool(np.count_nonzero(segment.system.hard[loose] & rests))


def change_one(
    system: System, t: float, tau: float, y: Array, now: Settled, stop: float
) -> tuple[Settled, int] | None:
    """Return how the motion goes on where the guard of one contact alone has come to 0, and this contact.

    All others are far from their limits, so that nothing but the mode of this one is to be tried. None where others
    are near theirs, or its new mode does not hold: then all must be settled together.

    Parameters
    ----------
    system : System
    t, tau : float
        Time in s, and the same since the start of the segment, which ends inside its horizon.
    y : array (size,)
    now : Settled
        The segment that has ended.
    stop : float
        The next break.
    """
    before, mode_set = now.segment, now.segment.mode_set
    if not system.all_hard or before.has_curved or not before.slips + before.helds:
        return None
    q = before.inputs(tau)
    slow = _slow(system, y, before.y, q)
    near = mode_set.near(q)
    near[: before.slips] = slow
    close = (before.raw_at(tau, y) <= near).nonzero()[0]
    if close.size != 1:
        return None
    row, j = int(close[0]), int(mode_set.guard_contacts[close[0]])
    modes, resting = mode_set.modes.copy(), mode_set.modes == 0
    resting[j] = True
    if row < before.slips:
        modes[j] = 0
        y = project(system, y, q, resting)
    else:
        modes[j] = 1 if row < before.slips + before.helds else -1
    if _any_loose_at_rest(before, tau, y, now.modes, slow):
        return None
    since = np.where(modes == 0, now.since, t)
    since[j] = t
    segment = Segment(system, system.mode_set(modes.tobytes()), t, y, since, resting, stop)
    violated, order = segment.classify(resting & (np.arange(system.m) == j))
    if np.count_nonzero(violated) or np.count_nonzero(order > 2):
        return None
    segment.arm(order)
    labels = now.modes.copy()
    labels[j] = modes[j]
    return Settled(labels, since, segment), j


def project(system: System, y: Array, q: Array, joined: Mask) -> Array:
    """Return the state with the velocities across `joined` contacts exactly equal, momentum conserved."""
    if not np.count_nonzero(joined):
        return y
    groups = system.groups(joined.tobytes())
    y = y.copy()
    velocity = y[: system.n]
    if groups.moves_together:
        # the mean of the deviations from the leader: exact where the velocities are equal already
        base = velocity[groups.leader]
        velocity[:] = base + groups.mean(system.inertia * (velocity - base))
        velocity[:] = velocity[groups.leader]
    held = ~groups.free
    if held.any():
        prescribed = np.append(q[system.first_drive : system.first_drive + system.drives], 0.0)
        velocity[held] = prescribed[groups.holder[held] - system.n]
    return y


def _closed(system: System, t: float, q: Array) -> Mask:
    """Tell which contacts are pressed together at `t` or just after it."""
    normal = q[: system.m]
    closed = normal > 0
    edge = (normal == 0) & system.alive
    if np.count_nonzero(edge):
        rising = system.loads.at(t)[1][: system.m] > 0
        for i in system.loads.curved:
            if i < system.m and edge[i]:
                rising[i] = system.normals[i].slope(t) > 0
        closed |= edge & rising
    return closed & system.alive


def _relative(system: System, t: float, y: Array, q: Array, was: Array | None = None) -> tuple[Array, Array]:
    """Return each contact's relative velocity and the larger speed of its two bodies, floored by roundoff.

    What comes to rest has the roundoff of the speed that it had. Roundoff of the time is one of the velocity where a
    drive accelerates, whatever its speed is at the moment.
    """
    drives, accelerations = (
        q[system.first_drive : system.first_acceleration],
        q[system.first_acceleration : -1],
    )
    every = np.concatenate([y[: system.n], drives, [0.0]])
    speed = np.abs(every)
    if was is not None:
        speed[: system.n] = np.maximum(speed[: system.n], np.abs(was[: system.n]))
    speed[system.n : -1] += np.abs(accelerations * t)
    a, b = system.a, system.b
    return every[a] - every[b], np.maximum(np.maximum(speed[a], speed[b]), _ROUNDOFF * speed.max())


class _Search:
    """Try mode sets until one is consistent."""

    def __init__(
        self,
        system: System,
        t: float,
        y: Array,
        since: Array,
        candidates: Mask,
        fired: Mask,
        stop: float,
        as_fired: float,
    ) -> None:
        self._system, self._t, self._y, self._since = system, t, y, since
        self._candidates, self._fired, self._stop, self._as_fired = candidates, fired, stop, as_fired
        self._tried: set[bytes] = set()

    def run(self, trial: Modes) -> Segment:
        """Return the armed segment of the first consistent trial."""
        while True:
            if trial.tobytes() in self._tried:
                shared = (self._shared(trial, soon) for soon in _SOON)
                fresh = [
                    modes for modes in shared if modes is not None and modes.tobytes() not in self._tried
                ]
                if not fresh:
                    return self._enumerate()
                trial = fresh[0]
            self._tried.add(trial.tobytes())
            segment, released, retried = self._check(trial)
            if not released.any() and not retried.size:
                return self._without_idlers(segment)
            trial = trial.copy()
            if released.any():
                trial[released != 0] = released[released != 0]
            else:
                trial[retried] = 0

    def _without_idlers(self, segment: Segment) -> Segment:
        """Let contacts that were released, but stay at rest now that others slip, be stuck again if they can."""
        idlers = segment.idle_slips
        if not idlers.size:
            return segment
        trial = segment.mode_set.modes.copy()
        trial[idlers] = 0
        again, released, retried = self._check(trial)
        return segment if released.any() or retried.size else again

    def _check(self, trial: Modes) -> tuple[Segment, Modes, NDArray[np.intp]]:
        """Return the segment, the contacts to release with their directions, and those to try stuck again."""
        system = self._system
        segment = Segment(
            system,
            system.mode_set(trial.tobytes()),
            self._t,
            self._y,
            self._since,
            self._candidates,
            self._stop,
        )
        violated, order = segment.classify(self._fired, self._as_fired)
        released = np.zeros(system.m, dtype=np.int8)
        for j in segment.mode_set.at_level.tolist():
            if not self._exceeds(segment, j):
                # the others leave it a share that it can carry
                return segment, released, np.array([j], dtype=np.intp)
        if not violated.any():
            segment.arm(order)
            return segment, released, np.empty(0, dtype=np.intp)
        k, s = segment.slips, segment.helds
        over = violated[k:]
        if over.any():
            # a contact beyond its level counts as loaded at least that much
            ratio = np.where(over, np.clip(segment.loads(), 1.0, np.finfo(float).max), 0.0)
            shared = self._others_hold(segment, ratio)
            largest = np.flatnonzero(ratio >= ratio.max() * (1 - AT_LIMIT))
            # it carries its level and the others the rest, whatever else lets go
            first = largest if shared is None else np.array([shared])
            released[segment.held[first % s]] = np.where(first < s, 1, -1)
        retried = segment.mode_set.slip[violated[:k]]
        return segment, released, retried

    def _others_hold(self, segment: Segment, ratio: Array) -> int | None:
        """Return the row of the most loaded contact beyond its level whose motion others lock as well."""
        mode_set = segment.mode_set
        if not mode_set.groups.redundant:
            return None
        for row in np.argsort(-ratio, kind="stable")[: np.count_nonzero(ratio)].tolist():
            j = int(segment.held[row % segment.helds])
            modes = mode_set.modes.copy()
            modes[j] = 1 if row < segment.helds else -1
            if self._system.hard[j] and j in self._system.mode_set(modes.tobytes()).at_level:
                return int(row)
        return None

    def _shared(self, trial: Modes, soon: float) -> Modes | None:
        """Return the modes in which stuck contacts share their loads within all levels, by bounded least squares.

        Limiting one after another may end with forces across a cut that point both ways. Just after the start, at
        a part `soon` of the horizon, shows which of those at their level stay there. None where nothing is shared.
        """
        system, trial = self._system, trial.copy()
        trial[system.mode_set(trial.tobytes()).at_level] = 0
        mode_set = system.mode_set(trial.tobytes())
        if not mode_set.groups.redundant:
            return None
        segment = Segment(system, mode_set, self._t, self._y, self._since, self._candidates, self._stop)
        stuck, k = mode_set.stuck, segment.slips
        tau = soon * segment.horizon
        force = segment.watched(tau, segment.y + tau * segment.f0)[k:]
        high, low = segment.levels(tau).reshape(2, -1)
        force, high, low = force[: stuck.size], high[: stuck.size], low[: stuck.size]
        balance = system.G[stuck].T
        balance = balance if isinstance(balance, np.ndarray) else balance.toarray()
        rows = np.vstack([_BALANCE * balance, np.eye(stuck.size)])
        wanted = np.concatenate([_BALANCE * (balance @ force), np.zeros(stuck.size)])
        wide = np.maximum(high + low, np.finfo(float).tiny)
        found = lsq_linear(rows, wanted, (-low, -low + wide), method="bvls", tol=1e-15, max_iter=1000)
        modes = trial.copy()
        modes[stuck] = found.active_mask
        return modes

    def _exceeds(self, segment: Segment, j: int) -> bool:
        """Tell whether the share of a contact that carries its level would exceed it, were it not limited."""
        modes = segment.mode_set.modes.copy()
        side, modes[j] = int(modes[j]), 0
        trial = segment.with_modes(modes)
        violated, _ = trial.classify(self._fired, self._as_fired)
        row = trial.slips + int(np.flatnonzero(trial.held == j)[0]) + (0 if side > 0 else trial.helds)
        return bool(violated[row])

    def _enumerate(self) -> Segment:
        """Try every combination where releasing one after another ran in a circle."""
        contacts = np.flatnonzero(self._candidates)
        if contacts.size <= _ENUMERATED:
            for trial in self._combinations(contacts):
                segment, released, retried = self._check(trial)
                if not released.any() and not retried.size:
                    return segment
        raise Inconsistent(contacts)

    def _combinations(self, contacts: NDArray[np.intp]) -> Iterator[Modes]:
        base = np.frombuffer(next(iter(self._tried)), dtype=np.int8)
        for values in sorted(product((0, 1, -1), repeat=contacts.size), key=lambda v: sum(map(abs, v))):
            trial = base.copy()
            trial[contacts] = values
            yield trial
