"""A simulator of machines, slow and plain: ties, radii, one-way clutches, gaps and stops beside friction.

It shares no line with the package, nor its equations. Ties are solved once by an orthonormal basis of the velocities
that they leave (a null space): all else happens in these coordinates. Loads are lines and sines, so the motion in a set
of modes is a matrix exponential of positions, velocities and the loads' own states. One-sided rows (clutches, closed
stops, impacts) are linear complementarity problems, solved by trying every set of active rows. A cut is a smallest set
of held rows that hold one motion. Held rows let go where a cut is overloaded: where it has to carry more than its rows
can together. Modes that are in doubt at an instant are tried, and followed for a moment: those are right whose laws
then hold. Where that leaves more than one answer, or none, the oracle says so and stops.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations, product

import numpy as np

from validation.machine_motion import Array, Data, Machine, Modes, Motion
from validation.oracle import Event, root
from validation.oracle_signals import just_after
from validation.oracle_system import Doubt

OPEN = 2  # mode of a gap or stop between its limits

# Parts of the largest speed below which a row is at rest; the second is for rows that ended the motion before.
REST, REACHED = 1e-10, 1e-6
# A load is the force that a cut has to carry over its capacity. A cut is at its level where its load differs from 1 by
# less than the first; loads that differ by less than the second are a near tie, by less than the third a tie.
AT_LEVEL, NEAR_TIE, TIE = 1e-7, 1e-5, 1e-9

# Parts of the span: a row that changes twice within the first grazes, a stop hit twice within the second comes to rest.
GRAZE, BOUNCE = 1e-6, 1e-5
MOST_EVENTS, MOST_STALLS, MOST_ROWS = 2000, 20, 9


@dataclass
class Solution:
    """The motion found. It is right up to the time `known`: the end, or earlier for the reason in `doubt`."""

    system: Machine
    known: float
    events: list[Event] = field(default_factory=list)
    pieces: list[Motion] = field(default_factory=list)
    doubt: str = ""

    def _piece(self, t: float) -> Motion:
        starts = [motion.start for motion in self.pieces]
        return self.pieces[max(int(np.searchsorted(starts, t, side="right")) - 1, 0)]

    def velocity(self, t: float) -> Array:
        """Return the velocities of all bodies."""
        motion = self._piece(t)
        return np.asarray(motion.V @ motion.at(t - motion.start))

    def position(self, t: float) -> Array:
        """Return the positions of all bodies."""
        motion = self._piece(t)
        return motion.at(t - motion.start)[: self.system.n]

    def forces(self, t: float) -> dict[str, float]:
        """Return the forces of all rows, nan where they are not unique."""
        motion = self._piece(t)
        return motion.forces(t - motion.start)


def solve(data: Data) -> Solution:
    """Return the motion of a scene given as plain data, see `Machine`."""
    run = _Run(Machine(data))
    try:
        run.to_the_end()
    except Doubt as doubt:
        run.solution.known, run.solution.doubt = min(run.t, doubt.time), doubt.reason
    return run.solution


class _Run:
    """A simulation under way."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.t, self.x, self.q = 0.0, machine.x0.copy(), machine.q0.copy()
        self.u = machine.speeds(0.0)
        self._labels: dict[int, int] = {}
        self._since: dict[int, float] = {}
        self.reached: set[int] = set()
        self._closed: dict[int, int] = {}
        self._changed: dict[int, float] = {}
        # a speed that forces can cause: a row slower than roundoff of it is at rest, even if nothing has moved yet
        largest = max([1e-9, *(load.size for _, load in machine.forces)])
        self._speed = 1e-5 * largest * float(np.abs(machine.inverse).max()) * machine.stop
        self._at_break = True
        self.solution = Solution(machine, machine.stop)

    def to_the_end(self) -> None:
        """Settle, move, settle, ... until the end."""
        m, stalls = self.machine, 0
        while self.t < m.stop:
            before = self.t
            self._impacts()
            motion = self._settled()
            self._note(motion)
            following = next((b for b in m.breaks if b > just_after(self.t)), m.stop)
            tau, self.reached = self._first(motion, following - self.t)
            self._at_break = not self.reached
            end = following if self._at_break else self.t + tau
            self.solution.pieces.append(motion)
            y = motion.at(tau)
            self.x, self.q = y[: m.n].copy(), y[m.n : m.n + m.r].copy()
            self._speed = max(self._speed, float(np.abs(motion.V @ y).max(initial=0.0)))
            self.t = end
            self._before = m.velocity(self.q, (motion.V @ y)[m.driven])
            stalls = stalls + 1 if self.t - before < 1e-13 * m.stop else 0
            if stalls > MOST_STALLS or len(self.solution.events) > MOST_EVENTS:
                raise Doubt(self.t, "events without end")

    # Impacts

    def _at_limits(self) -> dict[int, int]:
        """Return the stops at a limit, with its side."""
        m, found = self.machine, {}
        for j, kind in enumerate(m.kinds):
            if kind != "stop":
                continue
            stretch = float(m.G[j] @ self.x)
            scale = max(1e-3, float(np.abs(m.G[j] * self.x).max(initial=0.0)))
            for side, limit in zip((-1, 1), m.limits(j), strict=True):
                near = abs(stretch - limit) <= 1e-11 * max(scale, abs(limit) if math.isfinite(limit) else 0)
                if near or self._closed.get(j) == side:
                    found[j] = side
        return found

    def _impacts(self) -> None:
        m = self.machine
        u, first = m.speeds(self.t), not self._labels
        v = m.velocity(self.q, self.u) if first else self._before
        jump = not first and np.abs(u - v[m.driven]).max(initial=0.0) > 1e-9 * self._speed
        at = self._at_limits()
        w = m.G @ v
        least = (REACHED if self.reached else REST) * max(self._speed, float(np.abs(v).max(initial=0.0)), 1e-12)
        hit = [j for j, side in at.items() if side * w[j] > REST * self._speed and j not in self._closed]
        self._hit: dict[int, int] = {}
        if hit or jump:
            if any(abs(w[j]) < least for j in hit):
                raise Doubt(self.t, "an impact at hardly any speed")
            try:
                self.q = m.struck(v, u, at, hit)
            except ValueError as fault:
                raise Doubt(self.t, str(fault)) from None
            self._hit = {j: at[j] for j in hit}
            for j in hit:
                if self.t - self._changed.get(j, -math.inf) < BOUNCE * m.stop:
                    raise Doubt(self._changed[j], "bouncing that ends")
        self.u = u
        self.at = at

    # Settling

    def _settled(self) -> Motion:
        """Return the motion from now on: that in those of all candidate modes whose laws hold for a moment."""
        m = self.machine
        v = m.velocity(self.q, self.u)
        self._speed = max(self._speed, float(np.abs(v).max(initial=0.0)))
        w = m.G @ v
        rest = []
        for j, kind in enumerate(m.kinds):
            slow = abs(w[j]) <= REST * self._speed
            slow |= j in self.reached and abs(w[j]) <= REACHED * self._speed and j not in self._hit
            if (kind == "contact" and slow) or (kind == "one-way" and (slow or w[j] > 0)):
                rest.append(j)
            if kind == "stop" and j in self.at and (slow or self.at[j] * w[j] > 0):
                rest.append(j)
        # make the velocities of rows at rest exactly 0, and so those of rows that these lock
        self.q = m.joined(self.q, self.u, rest)
        self._since = {j: self._since.get(j, self.t) for j in rest if m.kinds[j] == "contact"}
        if not self._labels:
            self._since = {j: -m.rows[j].get("rested", 0.0) for j in self._since}
        moving = {j: 1 if w[j] > 0 else -1 for j, kind in enumerate(m.kinds) if kind == "contact" and j not in rest}
        found: list[Motion] = []
        seen = set()
        for gap_regions in self._gap_regions():
            trial = _Trial(self, moving, rest, gap_regions)
            for modes in trial.candidates():
                key = (tuple(sorted(modes.slips.items())), modes.held, tuple(sorted(modes.gap_regions.items())))
                if key in seen:
                    continue
                seen.add(key)
                motion = Motion(m, self.t, self.x, self.q, modes, self.since_of(modes))
                if self._holds(motion):
                    found.append(motion)
        if not found:
            raise Doubt(self.t, "no modes whose laws hold")
        if any(np.abs(other.A - found[0].A).max() > 1e-6 * np.abs(found[0].A).max() for other in found):
            raise Doubt(self.t, "more than one answer")
        # of equal motions that with most held rows: rows at rest that neither push nor part count as held
        return max(found, key=lambda motion: len(motion.modes.held))

    def since_of(self, modes: Modes) -> dict[int, float]:
        return {j: self._since[j] for j in modes.held if self.machine.kinds[j] == "contact"}

    def _gap_regions(self) -> list[dict[int, tuple[int, str]]]:
        """Return the regions that the gaps may be in, in all combinations; a gap at a border may be on either side."""
        m = self.machine
        v = m.velocity(self.q, self.u)
        choices: list[list[tuple[int, tuple[int, str] | None]]] = []
        for j, kind in enumerate(m.kinds):
            if kind != "gap":
                continue
            stretch, rate = float(m.G[j] @ self.x), float(m.G[j] @ v)
            scale = max(1e-3, float(np.abs(m.G[j] * self.x).max(initial=0.0)))
            lower, upper = m.limits(j)
            own: list[tuple[int, tuple[int, str] | None]] = []
            depths = {side: side * (stretch - limit) for side, limit in ((-1, lower), (1, upper))}
            none = 1e-10 * scale
            if all(d <= none for d in depths.values()):
                own.append((j, None))
            for side, d in depths.items():
                if d < -none or not math.isfinite(d):
                    continue
                k, c = m.rows[j]["k"], m.rows[j].get("c", 0.0)
                if c == 0:
                    own.append((j, (side, "both")))
                    continue
                drag, push = c * side * rate, k * d
                near = 1e-8 * max(abs(push), abs(drag), k * none, c * 1e-10 * self._speed)
                if drag > push - near:
                    own.append((j, (side, "twice")))
                if abs(drag) < push + near:
                    own.append((j, (side, "both")))
                if drag < -push + near:
                    own.append((j, (side, "none")))
            choices.append(own)
        return [{j: how for j, how in choice if how is not None} for choice in product(*choices)]

    def _holds(self, motion: Motion) -> bool:
        """Tell whether the laws of all rows hold for a moment: no guard that is 0 now becomes negative."""
        m = self.machine
        if motion.modes.held and motion.left[0] > max(1e-8 * motion.left[1], 1e-12):
            return False
        following = next((b for b in m.breaks if b > just_after(self.t)), m.stop)
        length = min(following - self.t, motion.step)
        now, zero = self._zeros(motion)
        if (now < -zero).any():
            return False
        small = np.abs(now) <= zero
        if not small.any():
            return True
        for power in (-4.0, -3.0, -2.0, -1.5):
            tau = length * 10.0**power
            values = motion.values(tau, motion.at(tau))
            decided = small & (np.abs(values) > 10 * np.abs(now) + 1e-13 * self._scales(motion))
            if (values[decided] < 0).any():
                return False
            small &= ~decided
        return True

    def _scales(self, motion: Motion) -> Array:
        """Return the sizes of what is added up in each guard."""
        size = motion.size.copy()
        size[: motion.machine.n] = np.maximum(size[: motion.machine.n], 1e-6)
        found = np.abs(motion.k) @ size
        for i, guard in enumerate(motion.guards):
            found[i] += motion.capacity(guard, 0.0, motion.y0) if guard.levels else 0.0
        return np.asarray(np.maximum(found, 1e-9))

    def _zeros(self, motion: Motion) -> tuple[Array, Array]:
        """Return the guards now, and below which size each of them is 0."""
        now = motion.values(0.0, motion.y0)
        zero = 1e-9 * self._scales(motion)
        for i, guard in enumerate(motion.guards):
            if self.reached.issuperset(guard.rows):
                zero[i] *= 1e2
        return now, zero

    def _labels_of(self, motion: Motion) -> dict[int, int]:
        modes, m = motion.modes, self.machine
        found = {}
        for j, kind in enumerate(m.kinds):
            if kind == "contact":
                found[j] = modes.slips.get(j, 0)
            elif kind == "one-way":
                found[j] = 0 if j in modes.held else -1
            elif kind == "stop":
                found[j] = modes.sides.get(j, OPEN)
            else:
                found[j] = modes.gap_regions[j][0] if j in modes.gap_regions else OPEN
        return found

    def _note(self, motion: Motion) -> None:
        m, labels = self.machine, self._labels_of(motion)
        self._closed = dict(motion.modes.sides)
        if not self._labels:
            for j in self._hit:
                self.solution.events.append((self.t, m.names[j], self._hit[j], labels[j]))
        else:
            for j, after in labels.items():
                before = self._labels[j]
                if before == after and j not in self._hit:
                    continue
                if self.t - self._changed.get(j, -math.inf) < GRAZE * m.stop:
                    raise Doubt(self._changed[j], "a graze")
                self._changed[j] = self.t
                self.solution.events.append((self.t, m.names[j], before, after))
        self._labels = labels
        self._since = {j: t for j, t in self._since.items() if labels[j] == 0}

    # Moving

    def _first(self, motion: Motion, length: float) -> tuple[float, set[int]]:
        """Return when the first guard comes to 0, and its rows; `length` and no rows if none does."""
        if not motion.guards:
            return length, set()
        now, zero = self._zeros(motion)
        left = np.abs(now) > zero
        zeros: dict[int, float] = {}
        tau = 0.0
        values, rates = now, motion.rates(0.0, motion.y0)
        early = [motion.step * 10.0**p for p in (-7, -6, -5, -4, -3, -2, -1.5, -1.0, -0.5)]
        while tau < length and not zeros:
            following = next((e for e in early if e > tau), tau + motion.step)
            if tau >= motion.step:
                following = tau + 0.5 * motion.step
            following = min(following, length)
            y = motion.at(following)
            after, slopes = motion.values(following, y), motion.rates(following, y)
            for i in range(len(motion.guards)):
                if not left[i]:
                    left[i] = abs(after[i]) > zero[i]
                    if left[i] and after[i] < 0:
                        raise Doubt(self.t, "a row that leaves its mode at once")
                    continue
                found = self._root(motion, i, tau, following, (values[i], after[i]), (rates[i], slopes[i]), zero[i])
                if found is not None:
                    zeros[i] = found
            tau, values, rates = following, after, slopes
        if not zeros:
            return length, set()
        first = min(zeros.values())
        together = 1e-12 * max(1.0, first)
        rows = {j for i, z in zeros.items() if z - first <= together for j in motion.guards[i].rows}
        for z in zeros.values():
            if together < z - first < 1e-9 * self.machine.stop:
                raise Doubt(self.t + first, "events nearly at once")
        return first, rows

    def _root(
        self,
        motion: Motion,
        i: int,
        low: float,
        high: float,
        values: tuple[float, float],
        rates: tuple[float, float],
        zero: float,
    ) -> float | None:
        def guard(tau: float) -> float:
            return float(motion.values(tau, motion.at(tau))[i])

        def slope(tau: float) -> float:
            return float(motion.rates(tau, motion.at(tau))[i])

        if values[0] <= 0:
            raise Doubt(self.t, "a row that leaves its mode")
        if values[1] < 0:
            return root(guard, low, high)
        if rates[0] < 0 < rates[1]:
            lowest = root(slope, low, high)
            if abs(value := guard(lowest)) < 10 * zero:
                raise Doubt(self.t + lowest, "a guard that touches 0")
            if value < 0:
                return root(guard, low, lowest)
        return None


class _Trial:
    """Rule 3 of the model, with given regions of the gaps; rows in doubt are tried both ways."""

    def __init__(
        self,
        run: _Run,
        moving: Mapping[int, int],
        rest: Sequence[int],
        gap_regions: Mapping[int, tuple[int, str]],
    ) -> None:
        self._run, self._m = run, run.machine
        self._moving, self._gap_regions = moving, gap_regions
        self._stuck = [j for j in rest if self._m.kinds[j] == "contact"]
        self._sided = [j for j in rest if self._m.kinds[j] != "contact"]
        if len(rest) > MOST_ROWS:
            raise Doubt(run.t, "too many rows at rest")

    def candidates(self) -> list[Modes]:
        """Return the modes that may be right: first those in which all cuts at their level let go."""
        return [modes for eager in (True, False) for modes in self._settle(eager, {}, frozenset())]

    def _motion(self, slips: Mapping[int, int], sided: Sequence[int]) -> Motion:
        run = self._run
        held = sorted([j for j in self._stuck if j not in slips] + list(sided))
        sides = {j: run.at[j] for j in sided if self._m.kinds[j] == "stop"}
        modes = Modes({**self._moving, **slips}, tuple(held), self._gap_regions, sides)
        return Motion(self._m, run.t, run.x, run.q, modes, run.since_of(modes))

    def _settle(self, eager: bool, slips: dict[int, int], tried: frozenset[tuple[tuple[int, int], ...]]) -> list[Modes]:
        """Return the modes in which no held rows carry more than they can, and none slips the wrong way."""
        while True:
            motion = self._complementary(slips)
            ways = self._over(motion, eager)
            if len(ways) > 1:
                return self._each_way(eager, [slips | over for over in ways], tried)
            if ways:
                slips = slips | ways[0]
                continue
            accelerations = motion.acceleration @ motion.y0
            least = 1e-9 * motion.swift
            against = [j for j, sign in slips.items() if sign * accelerations[j] < -least]
            if not against:
                break
            key = tuple(sorted(slips.items()))
            if key in tried:
                raise Doubt(self._run.t, "no consistent modes")
            tried |= {key}
            slips = {j: sign for j, sign in slips.items() if j not in against}
        # clutches and stops that neither carry anything nor leave: each may be held, or not
        held = list(motion.modes.held)
        accelerations = motion.acceleration @ motion.y0
        least = 1e-9 * motion.swift
        still = [j for j in self._sided if abs(accelerations[j]) <= least]
        forces = motion.need @ motion.y0
        force = 1e-7 * max(float((np.abs(motion.force) @ motion.size).max(initial=0.0)), 1e-9)
        sure = [j for j in still if j in held and abs(forces[held.index(j)]) > force]
        unsure = [j for j in still if j not in sure]
        found = [motion.modes]
        for chosen in product((True, False), repeat=len(unsure)):
            some = sure + [j for j, take in zip(unsure, chosen, strict=True) if take]
            found.append(self._motion(slips, some).modes)
        return found

    def _each_way(
        self,
        eager: bool,
        ways: Sequence[dict[int, int]],
        tried: frozenset[tuple[tuple[int, int], ...]],
    ) -> list[Modes]:
        """Return the modes to which each of several ways leads."""
        found: list[Modes] = []
        doubts = []
        for slips in ways:
            try:
                found += self._settle(eager, slips, tried)
            except Doubt as doubt:
                doubts.append(doubt)
        if not found:
            raise doubts[0]
        return found

    def _complementary(self, slips: Mapping[int, int]) -> Motion:
        """Return the motion in which each clutch or stop at rest either pushes or parts, beside the other held rows."""
        for count in range(len(self._sided) + 1):
            for active in combinations(self._sided, count):
                motion = self._motion(slips, active)
                accelerations = motion.acceleration @ motion.y0
                least = 1e-9 * motion.swift
                if motion.modes.held and motion.left[0] > max(1e-8 * motion.left[1], 1e-12):
                    continue
                side = self._run.at
                forces = dict(zip(motion.modes.held, motion.need @ motion.y0, strict=True))
                enough = 1e-9 * max(1e-9, float(np.abs(motion.need @ motion.y0).max(initial=0.0)))
                pulls = any(self._turn(j, side) * forces[j] < -enough for j in active)
                passes = any(self._turn(j, side) * accelerations[j] > least for j in self._sided)
                if not pulls and not passes:
                    # clutches and stops that neither push nor part are held, too
                    also = [j for j in self._sided if abs(accelerations[j]) <= least]
                    return self._motion(slips, also)
        raise Doubt(self._run.t, "no set of clutches and stops that can be held")

    def _turn(self, j: int, side: Mapping[int, int]) -> int:
        return side[j] if self._m.kinds[j] == "stop" else 1

    def _over(self, motion: Motion, eager: bool) -> list[dict[int, int]]:
        """Return sets of contacts that may let go: of the most overloaded cuts, and of each if rows share loads."""
        loads: dict[int, float] = {}
        scale = 1e-10 * max(float((np.abs(motion.force) @ motion.size).max(initial=0.0)), 1e-9)
        for i, guard in enumerate(motion.guards):
            if not guard.levels:
                continue
            capacity = motion.capacity(guard, 0.0, motion.y0)
            need = -float(guard.k @ motion.y0)
            loads[i] = need / capacity if capacity > scale else (math.inf if need > scale else 0.0)
        beyond = {}
        for i, load in loads.items():
            limit = 1 + 1e-9
            if abs(load - 1) < AT_LEVEL and self._run.reached.issuperset(motion.guards[i].rows):
                limit = -math.inf if eager else math.inf
            if load > limit:
                beyond[i] = load
        if not beyond:
            return []
        largest = max(beyond.values())
        shares = any(max(len(motion.guards[i].levels), len(motion.guards[i].rows)) > 1 for i in beyond)
        first = [i for i, load in beyond.items() if load >= largest * (1 - TIE)]
        sets = [first]
        if shares and len(beyond) > 1:
            # the model gives an order of single rows only: each cut is tried, and `_holds` decides
            sets += [[i] for i in beyond if [i] != first]
        elif any(largest * (1 - NEAR_TIE) < x < largest * (1 - TIE) for x in loads.values() if x < math.inf):
            raise Doubt(self._run.t, "a near tie")
        return [{j: sign for i in some for j, sign, _ in motion.guards[i].levels} for some in sets]
