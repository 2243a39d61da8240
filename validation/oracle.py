"""A second simulator of dry friction, slow and plain, that implements the model to the letter and nothing else.

It shares no line with the package. Scenes are plain data; motion between events is a matrix exponential or a
Runge-Kutta integration of order 8; the forces of stuck contacts come from a pseudo-inverse; events are bracketed on a
grid and found by Brent's method. Where the model leaves more than one answer, or double precision cannot tell which it
is, it says so and stops. What it returns up to there should be right to about 1e-12.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from validation.oracle_motion import Exponential, Integrated, State
from validation.oracle_settling import Instant, settle
from validation.oracle_sharing import capacity, cuts, need, shared
from validation.oracle_signals import just_after
from validation.oracle_system import Array, Data, Doubt, System

Event = tuple[float, str, int, int]  # time in s, contact, mode before, mode after
MOST_EVENTS, MOST_STALLS = 5000, 20
NOTHING = 1e-11  # part of the largest load within which a normal force that depends on the state is 0
TRIAL = 1e-3  # part of the span that is tried to see whether a normal force that is 0 rises or falls

# Part of the span within which a contact that changes twice grazes: no tolerance can tell whether it changes at all.
GRAZE = 1e-6
PARTS_OF_SPAN = 20  # integrated one by one: what is integrated beyond an event is in vain


@dataclass(frozen=True)
class Piece:
    """Motion between two events or breaks of loads."""

    start: float
    motion: Exponential | Integrated
    modes: tuple[int, ...]
    stuck: tuple[int, ...]
    since: Mapping[int, float]
    opened: frozenset[int]


@dataclass
class Solution:
    """The motion found. It is right up to the time `known`: the end, or earlier for the reason in `doubt`."""

    system: System
    known: float
    initial: tuple[int, ...] = ()
    events: list[Event] = field(default_factory=list)
    pieces: list[Piece] = field(default_factory=list)
    doubt: str = ""

    def velocity(self, t: float) -> Array:
        """Return the velocities of all bodies at a time in s."""
        piece = self._piece(t)
        return piece.motion.at(t - piece.start)[1]

    def friction(self, t: float) -> Array:
        """Return the friction forces of all contacts at a time in s: those of least norm where they are not unique."""
        piece = self._piece(t)
        x, v = piece.motion.at(t - piece.start)
        slipping = {j: mode for j, mode in enumerate(piece.modes) if mode}
        balance = self.system.balance(piece.start, t - piece.start, x, v, slipping, piece.stuck, piece.opened)
        w = self.system.incidence @ v
        force = np.zeros(len(piece.modes))
        for j, mode in slipping.items():
            force[j] = mode * self.system.slipping(j, mode, w[j]) * balance.normal[j]
        for j, held in shared(self.system, balance, t, dict(piece.since)).items():
            force[j] = held
        return force

    def forces(self, t: float) -> dict[str, float]:
        """Return the friction forces by the names of the contacts."""
        return dict(zip(self.system.names, self.friction(t).tolist(), strict=True))

    def _piece(self, t: float) -> Piece:
        starts = [piece.start for piece in self.pieces]
        return self.pieces[max(int(np.searchsorted(starts, t, side="right")) - 1, 0)]


def solve(data: Data) -> Solution:
    """Return the motion of a scene given as plain data, see `System`."""
    run = _Run(System(data))
    try:
        run.to_the_end()
    except Doubt as doubt:
        run.solution.known, run.solution.doubt = min(run.t, doubt.time), doubt.reason
    return run.solution


class _Run:
    """A simulation under way: time, state, modes, and how long each stuck contact has been so."""

    def __init__(self, system: System) -> None:
        self._system = system
        self.t, self._x, self._v = system.start, system.x0.copy(), system.v0.copy()
        self._modes: list[int] = []
        self._since: dict[int, float] = {}
        self._reached: set[int] = set()
        self._opened: frozenset[int] = frozenset()
        self._changed: dict[str, float] = {}
        self._speed = max(1e-300, 1e-5 * system.force_scale * system.mobility.max() * system.span)
        self.solution = Solution(system, system.stop)

    @property
    def _kind(self) -> type[Exponential | Integrated]:
        return Exponential if self._system.linear else Integrated

    def to_the_end(self) -> None:
        """Settle, move, settle, ... until the end."""
        system, stalls = self._system, 0
        while self.t < system.stop:
            before = self.t
            settled = self._settle()
            following = next((b for b in system.breaks if b > just_after(self.t)), system.stop)
            self._move(settled, following if system.linear else min(following, self.t + system.span / PARTS_OF_SPAN))
            stalls = stalls + 1 if self.t - before < 1e-14 * max(1.0, self.t) else 0
            if stalls > MOST_STALLS or len(self.solution.events) > MOST_EVENTS:
                raise Doubt(self.t, "events without end")

    # Settling

    def _settle(self) -> dict[int, int | None]:
        """Return the modes of all contacts just after now; None for an open contact at rest."""
        system, first = self._system, not self._modes
        self._v = system.driven(self._v, system.loads(self.t, 0.0))
        resting = self._resting()
        self._v = system.joined(self._v, resting)
        w = system.incidence @ self._v
        moving = {j: 1 if w[j] > 0 else -1 for j in range(len(w)) if j not in resting}
        if first:
            since = {j: system.start - system.contacts[j].get("rested", 0.0) for j in resting}
        else:
            since = {j: self._since.get(j, self.t) for j in resting}
        self._since = since
        still = np.zeros(system.size)
        now = Instant(self.t, 0.0, self._x, self._v, moving, resting, since, self._reached, frozenset(), still)
        if system.pressed:
            now = self._pressed(now)
            self._opened = now.opened
        now = replace(now, later=self._later(now))
        return {**moving, **settle(system, now)}

    def _pressed(self, now: Instant) -> Instant:
        """Return the instant with the contacts that the state opens, and with the accelerations of the bodies.

        A contact whose normal force is 0 now carries no force now. The motion without it shows whether it closes.
        """
        system = self._system
        normal = now.balance(system, {}, (), 0.0).normal
        zero = [j for j in system.pressed if abs(normal[j]) <= NOTHING * system.force_scale]
        opened = frozenset(j for j in system.pressed if normal[j] < 0 or j in zero)
        if not zero:
            return replace(now, opened=opened)
        now = replace(now, opened=opened)
        settled = {**now.moving, **settle(system, now)}
        slipping = {j: mode for j, mode in settled.items() if mode}
        stuck = tuple(j for j, mode in sorted(settled.items()) if mode == 0)
        a = now.balance(system, slipping, stuck, 0.0).acceleration
        length = TRIAL * system.span
        motion = self._kind(system, self.t, length, (self._x, self._v), slipping, stuck, opened)
        closing = set()
        for tau in length * 10.0 ** np.arange(-6.0, 0.1, 0.5):
            x, v = motion.at(tau)
            coming = system.normals(system.loads(self.t, tau), x, v)
            for j in [j for j in zero if abs(coming[j]) > 100 * NOTHING * system.force_scale]:
                zero.remove(j)
                if coming[j] > 0:
                    closing.add(j)
        return replace(now, opened=opened - closing, a=a)

    def _resting(self) -> list[int]:
        """Return the contacts with w = 0: within roundoff, or less exactly if their guard ended the last piece."""
        w = np.abs(self._system.incidence @ self._v)
        now = float(np.abs(self._v).max(initial=1e-300))
        self._speed = max(self._speed, now)
        zero = 1e-10 * self._speed if self._modes else 1e-12 * now
        return [j for j in range(len(w)) if w[j] <= zero or (j in self._reached and w[j] <= 1e-6 * self._speed)]

    def _later(self, now: Instant) -> float:
        """Return how long after now to read the loads: a moment if a contact at rest is pressed from 0 on, else 0."""
        system = self._system
        rising = now.balance(system, {}, (), 1e-9 * system.span).normal > 0
        normal = now.balance(system, {}, (), 0.0).normal
        zero = normal == 0
        zero[system.pressed] = np.abs(normal[system.pressed]) <= NOTHING * system.force_scale
        if any(zero[j] and rising[j] for j in now.resting):
            return 1e-9 * system.span
        return 0.0

    # Moving

    def _move(self, settled: Mapping[int, int | None], stop: float) -> None:
        """Go on to the first event, or to `stop`."""
        system, length = self._system, stop - self.t
        stuck = tuple(j for j, mode in sorted(settled.items()) if mode == 0)
        slipping = {j: mode for j, mode in settled.items() if mode}
        opened = self._opened
        motion = self._kind(system, self.t, length, (self._x, self._v), slipping, stuck, opened)
        start = length * 10.0 ** np.arange(-9.0, -2.4, 0.5)
        grid = np.unique(np.concatenate([[0.0], start, np.linspace(0.0, length, motion.count + 1)]))
        states = [motion.at(tau) for tau in grid]
        largest = np.maximum.accumulate([float(np.abs(v).max(initial=0.0)) for _, v in states])
        speed = max(self._speed, float(largest[-1]))
        modes = [self._to_come(j, states, speed) if mode is None else mode for j, mode in sorted(settled.items())]
        if closing := self._closing(settled, modes, stuck):
            # their normal forces are 0 now, but press from now on
            self._move({**settled, **closing}, stop)
            return
        self._note(modes)
        self._since = {j: t for j, t in self._since.items() if modes[j] == 0}
        while True:
            watch = _Watch(system, motion, self.t, modes, stuck, self._since, speed, opened)
            tau, self._reached = watch.first(grid, states, length)
            self._speed = max(self._speed, float(largest[np.searchsorted(grid, tau, side="right") - 1]))
            if self._speed > 1e-3 * speed:
                break
            # The motion would have grown beyond the event: look again, with speeds before the event as the scale.
            speed = self._speed
        end = stop if tau >= length else self.t + tau
        self.solution.pieces.append(Piece(self.t, motion, tuple(modes), stuck, self._since, opened))
        self._x, self._v = (part.copy() for part in motion.at(tau))
        self.t = end

    def _closing(self, settled: Mapping[int, int | None], modes: Sequence[int], stuck: Sequence[int]) -> dict[int, int]:
        """Return the modes of contacts that leave rest, and whose normal force rises from 0 more slowly than a line."""
        system = self._system
        found = {j: modes[j] for j in system.pressed if settled[j] is None and j not in self._opened and modes[j]}
        if found:
            slipping = {j: mode for j, mode in settled.items() if mode}
            a = system.balance(self.t, 0.0, self._x, self._v, slipping, stuck, self._opened).acceleration
            if any(abs(system.incidence[j] @ a) < 1e-9 * system.force_scale * system.mobility.max() for j in found):
                raise Doubt(self.t, "a contact at rest whose force and level both start at 0")
        return found

    def _to_come(self, j: int, states: Sequence[State], speed: float) -> int:
        """Return the mode of an open contact at rest: the direction in which it moves next."""
        for _, v in states[1:]:
            w = float(self._system.incidence[j] @ v)
            if abs(w) > 1e-12 * speed:
                return 1 if w > 0 else -1
        return 0

    def _note(self, modes: list[int]) -> None:
        if not self._modes:
            self.solution.initial = tuple(modes)
        else:
            for name, before, after in zip(self._system.names, self._modes, modes, strict=True):
                if before != after:
                    last = self._changed.get(name, -np.inf)
                    if self.t - last < GRAZE * self._system.span:
                        raise Doubt(last, "a graze")
                    self._changed[name] = self.t
                    self.solution.events.append((self.t, name, before, after))
        self._modes = modes


class _Watch:
    """The guards, which must stay positive: w times mode of slipping contacts, B - lambda and B + lambda of stuck ones.

    If stuck contacts are redundant, their guards are what each cut can carry, less what it has to. If normal forces
    depend on the state, N of closed contacts and -N of open ones are guards, too.
    """

    def __init__(
        self,
        system: System,
        motion: Exponential | Integrated,
        start: float,
        modes: Sequence[int],
        stuck: Sequence[int],
        since: Mapping[int, float],
        speed: float,
        opened: frozenset[int],
    ) -> None:
        self._opened = opened
        self._system, self._motion, self._start = system, motion, start
        self._slipping, self._stuck, self._since = {j: m for j, m in enumerate(modes) if m}, stuck, since
        self._cuts = cuts(system, stuck)
        self._owners = [*((j,) for j in self._slipping), *(cut.contacts for cut in self._cuts)]
        # guards of normal forces end the motion; which contacts are open then is decided anew
        self._owners += [() for _ in system.pressed]
        slips = len(self._slipping)
        self._zero = np.full(len(self._owners), 1e-13 * system.force_scale)
        self._zero[:slips] = 1e-14 * speed

    def _guards(self, tau: float, state: State) -> Array:
        x, v = state
        balance = self._system.balance(self._start, tau, x, v, self._slipping, self._stuck, self._opened)
        w = self._system.incidence @ v
        found = [mode * w[j] for j, mode in self._slipping.items()]
        time, since = self._start + tau, dict(self._since)
        for cut in self._cuts:
            spare = capacity(self._system, cut, time, since, balance.normal)
            found.append(spare - need(cut, balance.held))
        if self._system.pressed:
            normal = self._system.normals(self._system.loads(self._start, tau), x, balance.velocity)
            found += [-normal[j] if j in self._opened else normal[j] for j in self._system.pressed]
        return np.array(found)

    def first(self, grid: Array, states: Sequence[State], length: float) -> tuple[float, set[int]]:
        """Return when the first guard falls to 0, or the end if none does, and the contacts whose guards are 0 then."""
        guards = np.array([self._guards(tau, y) for tau, y in zip(grid, states, strict=True)])
        zeros: dict[int, float] = {}
        for k in range(len(self._owners)):
            zero = self._zero_of(k, grid, guards[:, k], min(zeros.values(), default=length))
            if zero is not None:
                zeros[k] = zero
        if zeros:
            tau = min(zeros.values())
            together = 1e-12 * max(1.0, length)
            return tau, {j for k, zero in zeros.items() if zero - tau <= together for j in self._owners[k]}
        last = length * (1 - 1e-15)
        at_end = np.abs(self._guards(last, self._motion.at(last))) <= 1e3 * self._zero
        was_not = np.abs(guards).max(axis=0) > 1e5 * self._zero
        ended = zip(self._owners, at_end & was_not, strict=True)
        return length, {j for owners, reached in ended if reached for j in owners}

    def _zero_of(self, k: int, grid: Array, values: Array, before: float) -> float | None:
        """Return where a guard first falls through 0, unless that is later than `before`."""
        zero, last = self._zero[k], len(grid) - 1
        away = np.flatnonzero(np.abs(values) > 100 * zero)
        if not away.size:
            return None  # the guard stays at 0
        if values[away[0]] < 0:
            raise Doubt(self._start, "a contact that leaves its mode at once")
        guard = lambda tau: float(self._guards(tau, self._motion.at(tau))[k])  # noqa: E731
        for i in range(away[0], last):
            if grid[i] > before:
                return None
            if values[i + 1] < 0:
                if i + 1 == last and values[last] > -zero:
                    return None  # the guard comes to 0 at the end
                return root(guard, grid[i], grid[i + 1])
            if i > away[0] and _dips(*values[i - 1 : i + 2]):
                lowest = minimize_scalar(
                    guard,
                    bounds=(grid[i - 1], grid[i + 1]),
                    method="bounded",
                    options={"xatol": 1e-12 * grid[-1]},
                )
                if lowest.fun < 0:
                    return root(guard, grid[i - 1], float(lowest.x))
        return None


def _dips(left: float, middle: float, right: float) -> bool:
    """Whether a guard turns so low that it may have crossed 0 between points."""
    return middle < min(left, right) and middle < 0.5 * max(left - middle, right - middle)


def root(guard: Callable[[float], float], low: float, high: float) -> float:
    """Return where a function comes to 0 between two times."""
    return float(brentq(guard, low, high, xtol=1e-16 * max(1.0, high), rtol=8.9e-16))
