"""A simulator of machines, slow and plain: ties, radii, one-way clutches, gaps and stops beside friction.

It shares no line with the package, nor its equations. Ties are solved once by an orthonormal basis of the velocities
that they leave (a null space): all else happens in these coordinates. Loads are lines and sines, so the motion in a set
of modes is a matrix exponential of positions, velocities and the loads' own states. One-sided rows (clutches, closed
stops, impacts) are linear complementarity problems, solved by trying every set of active rows. Held rows let go where
a cut of them is overloaded: where some motion is held by rows that together carry less than they would have to. Modes
that are in doubt at an instant are tried, and followed for a moment: those are right whose laws then hold. Where that
leaves more than one answer, or none, the oracle says so and stops.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations, product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space
from scipy.optimize import brentq

from validation.oracle_motion import exponential
from validation.oracle_signals import Sine, just_after, read

Array = NDArray[np.float64]
Data = Mapping[str, Any]
Event = tuple[float, str, int, int]
"""Time in s, row, mode before, mode after."""
OPEN = 2
"""Mode of a gap or stop between its limits."""
RANK = 1e-10
"""Singular values below this part of the largest are 0."""
REST, REACHED = 1e-10, 1e-6
"""Parts of the largest speed below which a row is at rest; where it is what ended the motion before, the second."""
AT_LEVEL, NEAR_TIE, TIE = 1e-7, 1e-5, 1e-9
"""How near loads over levels are to 1 or to each other."""
GRAZE, BOUNCE = 1e-6, 1e-5
"""Parts of the span within which a row that changes twice grazes, and a stop that is hit twice comes to rest."""
MOST_EVENTS, MOST_ROWS = 2000, 9
ROUNDOFF = 1e-11


class Doubt(Exception):
    """From a time on the model has no unique answer, or double precision cannot tell which it is."""

    def __init__(self, time: float, reason: str) -> None:
        super().__init__(f"{reason} at t = {time:.9g} s")
        self.time, self.reason = time, reason


@dataclass(frozen=True)
class Modes:
    """What every row does: slipping contacts by sign, rows held, and the side and branch of gaps pressed.

    Parameters
    ----------
    slips : mapping
        +1 or -1 of contacts by number.
    held : tuple of int
        Stuck contacts, locked clutches, closed stops.
    presses : mapping
        Of gaps by number: +1 or -1 for the limit, and what of the law acts: "twice", "both" or "none".
    sides : mapping
        Of closed stops by number: +1 or -1.
    """

    slips: Mapping[int, int]
    held: tuple[int, ...]
    presses: Mapping[int, tuple[int, str]]
    sides: Mapping[int, int]


class Machine:
    """A scene as matrices. Velocities of all bodies are ``v = Z q + P u``: u of the drives, q what ties leave free.

    Parameters
    ----------
    data : mapping
        `bodies` (a drive has the inertia None and a load for its velocity), `rows` (`kind`, `name`, `on`: coefficients
        by body, and the numbers of its law), `springs` (`on`, `k`, `c`, `rest`), `forces`, `t_end`.
    """

    def __init__(self, data: Data) -> None:
        self.data = data
        bodies = data["bodies"]
        self.stop = float(data["t_end"])
        self.bodies = [b["name"] for b in bodies]
        index = {name: i for i, name in enumerate(self.bodies)}
        self.n = len(bodies)
        self.driven = [i for i, b in enumerate(bodies) if b["inertia"] is None]
        self.free = [i for i in range(self.n) if i not in self.driven]
        self.mass = np.array([b["inertia"] or 0.0 for b in bodies])

        def row(on: Data) -> Array:
            found = np.zeros(self.n)
            for name, coefficient in on.items():
                if name != "ground":
                    found[index[name]] += coefficient
            return found

        self.rows = [r for r in data["rows"] if r["kind"] != "tie"]
        self.ties = [r for r in data["rows"] if r["kind"] == "tie"]
        self.names = [r["name"] for r in self.rows]
        self.kinds = [r["kind"] for r in self.rows]
        self.G = np.array([row(r["on"]) for r in self.rows]).reshape(-1, self.n)
        self.C = np.array([row(r["on"]) for r in self.ties]).reshape(-1, self.n)
        # what ties leave free
        own, led = self.C[:, self.free], self.C[:, self.driven]
        basis = null_space(own, rcond=RANK) if len(self.ties) else np.eye(len(self.free))
        self.Z = np.zeros((self.n, basis.shape[1]))
        self.Z[self.free] = basis
        self.P = np.zeros((self.n, len(self.driven)))
        self.P[self.driven] = np.eye(len(self.driven))
        if len(self.ties):
            self.P[self.free] = -np.linalg.pinv(own, rcond=RANK) @ led
            if self.driven and np.abs(self.C @ self.P).max() > 1e-9:
                raise ValueError("ties that fix drives to each other")
        self.r = basis.shape[1]
        self.inverse = np.linalg.inv((self.Z.T * self.mass) @ self.Z)
        """Of the inertia in the free coordinates."""
        # springs and dampers
        self.K, self.D, self.rest = np.zeros((self.n, self.n)), np.zeros((self.n, self.n)), np.zeros(self.n)
        for spring in data.get("springs", []):
            g = row(spring["on"])
            self.K += spring["k"] * np.outer(g, g)
            self.D += spring.get("c", 0.0) * np.outer(g, g)
            self.rest += spring["k"] * spring.get("rest", 0.0) * g
        # loads
        self.drives = [read(bodies[i]["velocity"]) for i in self.driven]
        self.normals = {
            j: read(r["normal"]).pressed() for j, r in enumerate(self.rows) if r["kind"] == "contact"
        }
        self.forces = [(index[f["body"]], read(f["load"])) for f in data.get("forces", [])]
        signals = [*self.drives, *self.normals.values(), *(load for _, load in self.forces)]
        self.sines = [s for s in signals if isinstance(s, Sine)]
        inside = {t for s in signals for t in s.breaks if 0.0 < t < self.stop}
        self.breaks = sorted(inside | {self.stop})
        self.size = self.n + self.r + 2 + 2 * len(self.sines)
        self.x0 = np.array([float(b.get("position", 0.0)) for b in bodies])
        start = np.array([0.0 if b["inertia"] is None else float(b["velocity"]) for b in bodies])
        u = self.speeds(0.0)
        self.q0 = np.linalg.lstsq(self.Z, start - self.P @ u, rcond=None)[0]
        broken = np.abs(self.C @ (self.Z @ self.q0 + self.P @ u)).max(initial=0.0)
        off = np.abs((self.Z @ self.q0 + self.P @ u - start)[self.free]).max(initial=0.0)
        if max(broken, off) > 1e-8:
            raise ValueError("velocities that break ties")

    def speeds(self, t: float) -> Array:
        """Return the drives' velocities just after a time."""
        return np.array([d.after(t, 0.0)[0] for d in self.drives])

    def velocity(self, q: Array, u: Array) -> Array:
        """Return the velocities of all bodies."""
        return np.asarray(self.Z @ q + self.P @ u)

    def limits(self, j: int) -> tuple[float, float]:
        """Return the limits of a gap or stop."""
        return self.rows[j].get("lower", -math.inf), self.rows[j].get("upper", math.inf)

    def level(self, j: int, sign: int, dwelt: float) -> float:
        """Return the breakaway coefficient, eqs. (8)-(9)."""
        row = self.rows[j]
        back = sign < 0 and "mu_s_back" in row
        static, kinetic = (row["mu_s_back"], row["mu_c_back"]) if back else (row["mu_s"], row["mu_c"])
        tau = row.get("tau", 0.0)
        return static - (static - kinetic) * math.exp(-dwelt / tau) if tau > 0 else static

    def level_rate(self, j: int, sign: int, dwelt: float) -> float:
        """Return the rate of the breakaway coefficient."""
        tau = self.rows[j].get("tau", 0.0)
        return (self.level(j, sign, math.inf) - self.level(j, sign, dwelt)) / tau if tau > 0 else 0.0

    def kinetic(self, j: int, sign: int) -> float:
        """Return the coefficient while slipping."""
        row = self.rows[j]
        return row["mu_c_back"] if sign < 0 and "mu_s_back" in row else row["mu_c"]

    def least(self, found: Array) -> float:
        """Return the roundoff of some numbers."""
        return ROUNDOFF * max(1e-12, float(np.abs(found).max(initial=0.0)))

    # Impacts

    def struck(self, v: Array, u: Array, at: Mapping[int, int], hit: Iterable[int]) -> Array:
        """Return q after an impact, or after a jump of drives to the velocities `u`.

        Newton's law for all one-sided rows that take part, by trying all sets of rows that carry an impulse: ``0 <= P``
        complementary to ``sep+ + e sep- >= 0``. A clutch that this turns forward takes part in a second one.

        Parameters
        ----------
        v, u : array
            Velocities of all bodies before; of the drives after.
        at : mapping
            +1 or -1 of stops at a limit, by number.
        hit : iterable of int
            Those among them that are hit.
        """
        size = max(1e-12, float(np.abs(v).max(initial=0.0)), float(np.abs(u).max(initial=0.0)))
        before = self.G @ v
        clutches = [j for j, kind in enumerate(self.kinds) if kind == "one-way"]
        wanted = {j: self.rows[j].get("e", 0.0) * max(at[j] * before[j], 0.0) for j in hit}
        part = [*at, *(j for j in clutches if before[j] >= -1e-9 * size)]
        q = self._nearest(v, u, part, at, wanted, size)
        after = self.G @ self.velocity(q, u)
        if any(at.get(j, 1) * after[j] > 1e-9 * size for j in (*at, *clutches)):
            q = self._nearest(self.velocity(q, u), u, [*at, *clutches], at, {}, size)
        return q

    def _nearest(
        self,
        v: Array,
        u: Array,
        part: Sequence[int],
        at: Mapping[int, int],
        wanted: Mapping[int, float],
        size: float,
    ) -> Array:
        free = self.inverse @ ((self.Z.T * self.mass) @ (v - self.P @ u))
        turn = np.array([float(at.get(j, 1)) for j in part])
        H = -turn[:, None] * (self.G[list(part)] @ self.Z) if part else np.zeros((0, self.r))
        led = -turn * (self.G[list(part)] @ self.P @ u) if part else np.zeros(0)
        short = np.array([wanted.get(j, 0.0) for j in part]) - led - H @ free
        least = 1e-9 * size * max(1.0, float(np.abs(self.G).max(initial=0.0)))
        for count in range(len(part) + 1):
            for active in combinations(range(len(part)), count):
                A = H[list(active)]
                push = np.linalg.pinv(A @ self.inverse @ A.T, rcond=RANK) @ short[list(active)]
                q = free + self.inverse @ (A.T @ push)
                gap = H @ q - H @ free - short
                if (push >= -1e-9 * np.abs(push).max(initial=0.0)).all() and gap.min(initial=0.0) >= -least:
                    return np.asarray(q)
        raise ValueError("no velocities satisfy the rows")

    def joined(self, q: Array, u: Array, rest: Sequence[int]) -> Array:
        """Return q with the relative velocities of some rows exactly 0, momentum conserved."""
        if not rest:
            return q
        H = self.G[list(rest)] @ self.Z
        w = H @ q + self.G[list(rest)] @ (self.P @ u)
        return np.asarray(
            q - self.inverse @ (H.T @ (np.linalg.pinv(H @ self.inverse @ H.T, rcond=RANK) @ w))
        )


@dataclass(frozen=True)
class Guard:
    """What stays positive while the modes hold: ``k y + sum over contacts of part mu(t) N``, and whose it is."""

    rows: tuple[int, ...]
    k: Array
    levels: tuple[tuple[int, int, float], ...] = ()


class Motion:
    """A piece of motion in given modes: ``y' = A y`` of positions, free velocities, and what the loads are made of.

    Parameters
    ----------
    machine : Machine
    start : float
        Time in s.
    x, q : array
        State there.
    modes : Modes
    since : mapping
        When stuck contacts became so.
    """

    def __init__(
        self, machine: Machine, start: float, x: Array, q: Array, modes: Modes, since: Mapping[int, float]
    ) -> None:
        m = self.machine = machine
        self.start, self.modes, self.since = start, modes, dict(since)
        n, r, size = m.n, m.r, m.size
        self._one = n + r
        # what loads are made of: 1, tau, sines and cosines
        own = np.zeros((size, size))
        own[self._one + 1, self._one] = 1.0
        first = np.zeros(size)
        first[:n], first[n : n + r], first[self._one] = x, q, 1.0
        for k, sine in enumerate(m.sines):
            s, omega = self._one + 2 + 2 * k, 2 * math.pi * sine.frequency
            own[s, s + 1], own[s + 1, s] = omega, -omega
            angle = omega * start + sine.phase
            first[s], first[s + 1] = math.sin(angle), math.cos(angle)
        self.normal = {j: self._signal(load) for j, load in m.normals.items()}
        drives = np.array([self._signal(d) for d in m.drives]).reshape(len(m.drives), size)
        self.V = np.zeros((n, size))
        self.V[:, n : n + r] = m.Z
        self.V += m.P @ drives
        self._X = np.eye(size)[:n]
        led = m.P @ (drives @ own)
        force = -m.K @ self._X - m.D @ self.V
        force[:, self._one] += m.rest
        for i, load in m.forces:
            force[i] += self._signal(load)
        for j, sign in modes.slips.items():
            force -= np.outer(m.G[j], sign * m.kinetic(j, sign) * self.normal[j])
        for j in modes.presses:
            force -= np.outer(m.G[j], self.push(j))
        self.force = force
        rate = m.inverse @ (m.Z.T @ (force - m.mass[:, None] * led))
        pushes = np.abs(m.Z.T) @ (np.abs(force) @ np.abs(first) + m.mass * (np.abs(led) @ np.abs(first)))
        self.swift = float((np.abs(m.G @ m.Z) @ (np.abs(m.inverse) @ pushes)).max(initial=1e-9))
        """The size of what adds up in relative accelerations."""
        held = list(modes.held)
        self.H = m.G[held] @ m.Z
        self.need = np.zeros((len(held), size))
        """The forces of held rows: those of least norm where they are not unique."""
        if held:
            asked = self.H @ rate + m.G[held] @ led
            self.need = np.linalg.pinv(self.H @ m.inverse @ self.H.T, rcond=RANK) @ asked
            left = asked - self.H @ m.inverse @ self.H.T @ self.need
            self.left = float(np.abs(left @ first).max()), float(np.abs(asked @ first).max())
            rate = rate - m.inverse @ (self.H.T @ self.need)
        self.W = m.G @ self.V
        """Relative velocities."""
        self.A = own
        self.A[:n] = self.V
        self.A[n : n + r] = rate
        self.acceleration = m.G @ (m.Z @ rate + led)
        """Relative accelerations."""
        self.y0 = first
        self.guards = self._guards()
        self._k = np.array([g.k for g in self.guards]).reshape(-1, size)
        fastest = float(np.abs(np.linalg.eigvals(self.A)).max(initial=0.0))
        self.step = min(m.stop / 300.0, 0.25 / fastest if fastest > 0 else math.inf)
        self._grid: list[Array] = [first]
        self._once: Array | None = None

    def _signal(self, load: Any) -> Array:
        found = np.zeros(self.machine.size)
        if isinstance(load, Sine):
            place = next(k for k, sine in enumerate(self.machine.sines) if sine is load)
            found[self._one], found[self._one + 2 + 2 * place] = load.offset, load.amplitude
        else:
            found[self._one], found[self._one + 1] = load.after(self.start, 0.0)
        return found

    def depth(self, j: int, side: int) -> Array:
        """Return how far a row is beyond a limit."""
        lower, upper = self.machine.limits(j)
        found = side * (self.machine.G[j] @ self._X)
        found[self._one] -= side * (upper if side > 0 else lower)
        return np.asarray(found)

    def push(self, j: int) -> Array:
        """Return the force of a gap that is pressed."""
        side, branch = self.modes.presses[j]
        row, depth = self.machine.rows[j], self.depth(j, side)
        push, drag = row["k"] * depth, row.get("c", 0.0) * side * (self.machine.G[j] @ self.V)
        return side * {"twice": 2 * push, "both": push + drag, "none": 0 * push}[branch]

    def _guards(self) -> list[Guard]:
        m, found = self.machine, []
        for j, sign in self.modes.slips.items():
            found.append(Guard((j,), sign * self.W[j]))
        for j, kind in enumerate(m.kinds):
            if kind == "one-way" and j not in self.modes.held:
                found.append(Guard((j,), -self.W[j]))
            if kind == "stop" and j not in self.modes.sides or kind == "gap" and j not in self.modes.presses:
                sides = [s for s, limit in zip((-1, 1), m.limits(j), strict=True) if math.isfinite(limit)]
                found += [Guard((j,), -self.depth(j, side)) for side in sides]
            if kind == "gap" and j in self.modes.presses:
                side, branch = self.modes.presses[j]
                depth = self.depth(j, side)
                push, drag = m.rows[j]["k"] * depth, m.rows[j].get("c", 0.0) * side * self.W[j]
                found.append(Guard((j,), depth))
                if m.rows[j].get("c", 0.0) > 0:
                    more = {"twice": [drag - push], "both": [push - drag, push + drag], "none": [-push - drag]}
                    found += [Guard((j,), k) for k in more[branch]]
        held = list(self.modes.held)
        for cut in cuts(self.H):
            for way in (1, -1):
                guard = self._cut(held, way * cut)
                if guard is not None:
                    found.append(guard)
        return found

    def _cut(self, held: Sequence[int], cut: Array) -> Guard | None:
        """Return what a cut can carry in a direction less what it has to, None where it can carry anything."""
        m = self.machine
        levels: list[tuple[int, int, float]] = []
        rows = tuple(j for j, part in zip(held, cut, strict=True) if part)
        for j, part in zip(held, cut, strict=True):
            if part == 0:
                continue
            if m.kinds[j] == "contact":
                levels.append((j, 1 if part > 0 else -1, abs(part)))
            elif self.modes.sides.get(j, 1) * part > 0:
                return None
        return Guard(rows, -cut @ self.need, tuple(levels))

    def capacity(self, guard: Guard, tau: float, y: Array) -> float:
        """Return what the contacts of a cut can carry."""
        t = self.start + tau
        return float(
            sum(
                part * self.machine.level(j, sign, t - self.since[j]) * max(0.0, self.normal[j] @ y)
                for j, sign, part in guard.levels
            )
        )

    def _capacity_rate(self, guard: Guard, tau: float, y: Array) -> float:
        t, rate = self.start + tau, self.A @ y
        found = 0.0
        for j, sign, part in guard.levels:
            dwelt = t - self.since[j]
            found += part * self.machine.level(j, sign, dwelt) * (self.normal[j] @ rate)
            found += part * self.machine.level_rate(j, sign, dwelt) * (self.normal[j] @ y)
        return float(found)

    def at(self, tau: float) -> Array:
        """Return the state after a time."""
        place = int(tau / self.step)
        while len(self._grid) <= place:
            if self._once is None:
                self._once = exponential(self.A * self.step)
            self._grid.append(self._once @ self._grid[-1])
        y, rest = self._grid[place], tau - place * self.step
        total, term, size = y.copy(), y, float(np.abs(y).max())
        for order in range(1, 80):
            term = self.A @ term * (rest / order)
            total = total + term
            if np.abs(term).max() < 1e-19 * size:
                break
        return np.asarray(total)

    def values(self, tau: float, y: Array) -> Array:
        """Return the guards."""
        found = self._k @ y
        for i, guard in enumerate(self.guards):
            if guard.levels:
                found[i] += self.capacity(guard, tau, y)
        return np.asarray(found)

    def rates(self, tau: float, y: Array) -> Array:
        """Return the rates of the guards."""
        found = self._k @ (self.A @ y)
        for i, guard in enumerate(self.guards):
            if guard.levels:
                found[i] += self._capacity_rate(guard, tau, y)
        return np.asarray(found)

    def forces(self, tau: float) -> dict[str, float]:
        """Return the forces of all rows, ties too; nan where they are not unique."""
        m, y = self.machine, self.at(tau)
        found: dict[str, float] = {}
        for j, name in enumerate(m.names):
            if j in self.modes.slips:
                sign = self.modes.slips[j]
                found[name] = sign * m.kinetic(j, sign) * float(self.normal[j] @ y)
            elif j in self.modes.presses:
                found[name] = float(self.push(j) @ y)
            elif j not in self.modes.held:
                found[name] = 0.0
        held = [*(m.names[j] for j in self.modes.held), *(tie["name"] for tie in m.ties)]
        rows = np.vstack([m.G[list(self.modes.held)], m.C])[:, m.free]
        rate = (self.A @ y)[m.n : m.n + m.r]
        led = self.A @ (self.A @ y)
        accelerations = led[: m.n]
        assert rate.size == m.r
        left = (self.force @ y - m.mass * accelerations)[m.free]
        shares = np.linalg.lstsq(rows.T, left, rcond=RANK)[0]
        idle = (
            null_space(rows.T, rcond=RANK) if len(held) else np.zeros((0, 0))
        )  # what moves nothing may be any
        for k, name in enumerate(held):
            unique = not idle.size or np.abs(idle[k]).max() < 1e-9
            found[name] = float(shares[k]) if unique else math.nan
        return found


def cuts(H: Array) -> list[Array]:
    """Return for each motion that as few rows as possible hold how it takes part in them: vectors of least support."""
    count = len(H)
    if not count:
        return []
    rank = int(np.linalg.matrix_rank(H, tol=RANK * np.abs(H).max(initial=1e-300)))
    if rank == 0:
        return []
    if rank == count:
        return list(np.eye(count))
    found: dict[tuple[int, ...], Array] = {}
    left, size, _ = np.linalg.svd(H)
    space = left[:, :rank] * size[:rank]
    for chosen in combinations(range(count), rank - 1):
        part = space[list(chosen)]
        if rank > 1 and np.linalg.matrix_rank(part, tol=RANK * size[0]) < rank - 1:
            continue
        direction = null_space(part, rcond=RANK)[:, 0] if rank > 1 else np.ones(1)
        cut = space @ direction
        cut[np.abs(cut) < 1e-9 * np.abs(cut).max()] = 0.0
        found.setdefault(tuple(np.flatnonzero(cut).tolist()), cut / np.abs(cut).max())
    return list(found.values())


@dataclass(frozen=True)
class Piece:
    """Motion up to a time."""

    stop: float
    motion: Motion


@dataclass
class Solution:
    """What was found: right up to the time `known`, which is the end unless `doubt` says why not."""

    machine: Machine
    known: float
    initial: dict[str, int] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)
    pieces: list[Piece] = field(default_factory=list)
    doubt: str = ""

    def _piece(self, t: float) -> Motion:
        starts = [piece.motion.start for piece in self.pieces]
        return self.pieces[max(int(np.searchsorted(starts, t, side="right")) - 1, 0)].motion

    def velocity(self, t: float) -> Array:
        """Return the velocities of all bodies."""
        motion = self._piece(t)
        return np.asarray(motion.V @ motion.at(t - motion.start))

    def position(self, t: float) -> Array:
        """Return the positions of all bodies."""
        motion = self._piece(t)
        return motion.at(t - motion.start)[: self.machine.n]

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
        self._reached: set[int] = set()
        self._closed: dict[int, int] = {}
        self._changed: dict[int, float] = {}
        # what forces can reach: roundoff of it is rest even where nothing has moved
        largest = max([1e-9, *(load.size for _, load in machine.forces)])
        self._speed = 1e-5 * largest * float(np.abs(machine.inverse).max()) * machine.stop
        self._at_break = True
        self.solution = Solution(machine, machine.stop)

    def to_the_end(self) -> None:
        """Settle, move, settle, ... until the end."""
        m = self.machine
        while self.t < m.stop:
            self._impacts()
            motion = self._settled()
            self._note(motion)
            following = next((b for b in m.breaks if b > just_after(self.t)), m.stop)
            tau, self._reached = self._first(motion, following - self.t)
            self._at_break = not self._reached
            end = following if self._at_break else self.t + tau
            self.solution.pieces.append(Piece(end, motion))
            y = motion.at(tau)
            self.x, self.q = y[: m.n].copy(), y[m.n : m.n + m.r].copy()
            self._speed = max(self._speed, float(np.abs(motion.V @ y).max(initial=0.0)))
            self.t = end
            self._before = m.velocity(self.q, self._speeds_before(motion, y))
            if len(self.solution.events) > MOST_EVENTS:
                raise Doubt(self.t, "events without end")

    def _speeds_before(self, motion: Motion, y: Array) -> Array:
        return np.asarray((motion.V @ y)[self.machine.driven])

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
        least = (REACHED if self._reached else REST) * max(
            self._speed, float(np.abs(v).max(initial=0.0)), 1e-12
        )
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
        self._at = at

    # Settling

    def _settled(self) -> Motion:
        """Return the motion that goes on: of all modes that may be, those whose laws hold for a moment."""
        m = self.machine
        v = m.velocity(self.q, self.u)
        self._speed = max(self._speed, float(np.abs(v).max(initial=0.0)))
        w = m.G @ v
        rest = []
        for j, kind in enumerate(m.kinds):
            slow = abs(w[j]) <= REST * self._speed
            slow |= j in self._reached and abs(w[j]) <= REACHED * self._speed and j not in self._hit
            if (kind == "contact" and slow) or (kind == "one-way" and (slow or w[j] > 0)):
                rest.append(j)
            if kind == "stop" and j in self._at and (slow or self._at[j] * w[j] > 0):
                rest.append(j)
        # what contacts and clutches at rest lock is at rest, too
        self.q = m.joined(self.q, self.u, rest)
        self._since = {j: self._since.get(j, self.t) for j in rest if m.kinds[j] == "contact"}
        if not self._labels:
            self._since = {j: -m.rows[j].get("rested", 0.0) for j in self._since}
        moving = {
            j: 1 if w[j] > 0 else -1
            for j, kind in enumerate(m.kinds)
            if kind == "contact" and j not in rest
        }
        found: list[Motion] = []
        seen = set()
        for presses in self._presses():
            trial = _Trial(self, moving, rest, presses)
            for modes in trial.candidates():
                key = (tuple(sorted(modes.slips.items())), modes.held, tuple(sorted(modes.presses.items())))
                if key in seen:
                    continue
                seen.add(key)
                motion = Motion(m, self.t, self.x, self.q, modes, self._since_of(modes))
                if self._holds(motion):
                    found.append(motion)
        if not found:
            raise Doubt(self.t, "no modes whose laws hold")
        if any(np.abs(other.A - found[0].A).max() > 1e-6 * np.abs(found[0].A).max() for other in found):
            raise Doubt(self.t, "more than one answer")
        # rows at rest that neither push nor part count as held
        return max(found, key=lambda motion: len(motion.modes.held))

    def _since_of(self, modes: Modes) -> dict[int, float]:
        return {j: self._since[j] for j in modes.held if self.machine.kinds[j] == "contact"}

    def _presses(self) -> list[dict[int, tuple[int, str]]]:
        """Return what gaps may do: those at a border one or the other."""
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
        size = np.abs(motion.y0)
        size[: motion.machine.n] = np.maximum(size[: motion.machine.n], 1e-6)
        found = np.abs(motion._k) @ size
        for i, guard in enumerate(motion.guards):
            found[i] += motion.capacity(guard, 0.0, motion.y0) if guard.levels else 0.0
        return np.asarray(np.maximum(found, 1e-9))

    def _zeros(self, motion: Motion) -> tuple[Array, Array]:
        """Return the guards now, and what is 0 for each."""
        now = motion.values(0.0, motion.y0)
        zero = 1e-9 * self._scales(motion)
        for i, guard in enumerate(motion.guards):
            if self._reached.issuperset(guard.rows):
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
                found[j] = modes.presses[j][0] if j in modes.presses else OPEN
        return found

    def _note(self, motion: Motion) -> None:
        m, labels = self.machine, self._labels_of(motion)
        self._closed = dict(motion.modes.sides)
        if not self._labels:
            self.solution.initial = {m.names[j]: mode for j, mode in labels.items()}
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
        """Return when the first guard comes to 0 and whose it is; the length, and nothing, where none does."""
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
                root = self._root(motion, i, tau, following, (values[i], after[i]), (rates[i], slopes[i]), zero[i])
                if root is not None:
                    zeros[i] = root
            tau, values, rates = following, after, slopes
        if not zeros:
            return length, set()
        first = min(zeros.values())
        together = 1e-12 * max(1.0, first)
        rows = {j for i, z in zeros.items() if z - first <= together for j in motion.guards[i].rows}
        for i, z in zeros.items():
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
            return _brent(guard, low, high)
        if rates[0] < 0 < rates[1]:
            lowest = _brent(slope, low, high)
            if abs(value := guard(lowest)) < 10 * zero:
                raise Doubt(self.t + lowest, "a guard that touches 0")
            if value < 0:
                return _brent(guard, low, lowest)
        return None


def _brent(f: Callable[[float], float], low: float, high: float) -> float:
    return float(brentq(f, low, high, xtol=1e-16 * max(1.0, high), rtol=8.9e-16))


class _Trial:
    """Rule 3 of the model, given what gaps do; whatever is in doubt is tried both ways."""

    def __init__(
        self,
        run: _Run,
        moving: Mapping[int, int],
        rest: Sequence[int],
        presses: Mapping[int, tuple[int, str]],
    ) -> None:
        self._run, self._m = run, run.machine
        self._moving, self._presses = moving, presses
        self._stuck = [j for j in rest if self._m.kinds[j] == "contact"]
        self._sided = [j for j in rest if self._m.kinds[j] != "contact"]
        if len(rest) > MOST_ROWS:
            raise Doubt(run.t, "too many rows at rest")

    def candidates(self) -> list[Modes]:
        """Return the modes that may be right: first those where all that is at its level lets go."""
        found: list[Modes] = []
        for eager in (True, False):
            found += self._settle(eager)
        return found

    def _motion(self, slips: Mapping[int, int], sided: Sequence[int]) -> Motion:
        run = self._run
        held = sorted([j for j in self._stuck if j not in slips] + list(sided))
        sides = {j: run._at[j] for j in sided if self._m.kinds[j] == "stop"}
        modes = Modes({**self._moving, **slips}, tuple(held), self._presses, sides)
        return Motion(self._m, run.t, run.x, run.q, modes, run._since_of(modes))

    def _settle(self, eager: bool) -> list[Modes]:
        slips: dict[int, int] = {}
        tried: set[tuple[tuple[int, int], ...]] = set()
        while True:
            motion = self._complementary(slips)
            over = self._over(motion, eager)
            if over:
                slips |= over
                continue
            accelerations = motion.acceleration @ motion.y0
            least = 1e-9 * motion.swift
            against = [j for j, sign in slips.items() if sign * accelerations[j] < -least]
            if not against:
                break
            key = tuple(sorted(slips.items()))
            if key in tried:
                raise Doubt(self._run.t, "no consistent modes")
            tried.add(key)
            for j in against:
                del slips[j]
        # clutches and stops that neither carry anything nor leave: each may be held, or not
        held = list(motion.modes.held)
        accelerations = motion.acceleration @ motion.y0
        least = 1e-9 * motion.swift
        still = [j for j in self._sided if abs(accelerations[j]) <= least]
        forces = motion.need @ motion.y0
        force = 1e-7 * max(float(np.abs(motion.force @ motion.y0).max(initial=0.0)), 1e-9)
        sure = [j for j in still if j in held and abs(forces[held.index(j)]) > force]
        unsure = [j for j in still if j not in sure]
        found = [motion.modes]
        for chosen in product((True, False), repeat=len(unsure)):
            some = sure + [j for j, take in zip(unsure, chosen, strict=True) if take]
            found.append(self._motion(slips, some).modes)
        return found

    def _complementary(self, slips: Mapping[int, int]) -> Motion:
        """Return the motion in which clutches and stops at rest push or part, with what else is held."""
        for count in range(len(self._sided) + 1):
            for active in combinations(self._sided, count):
                motion = self._motion(slips, active)
                accelerations = motion.acceleration @ motion.y0
                least = 1e-9 * motion.swift
                if motion.modes.held and motion.left[0] > max(1e-8 * motion.left[1], 1e-12):
                    continue
                side = self._run._at
                forces = dict(zip(motion.modes.held, motion.need @ motion.y0, strict=True))
                enough = 1e-9 * max(1e-9, float(np.abs(motion.need @ motion.y0).max(initial=0.0)))
                pulls = any(self._turn(j, side) * forces[j] < -enough for j in active)
                passes = any(self._turn(j, side) * accelerations[j] > least for j in self._sided)
                if not pulls and not passes:
                    # what is neither pushed nor leaves stays with it
                    also = [j for j in self._sided if abs(accelerations[j]) <= least]
                    return self._motion(slips, also)
        raise Doubt(self._run.t, "no set of clutches and stops that can be held")

    def _turn(self, j: int, side: Mapping[int, int]) -> int:
        return side[j] if self._m.kinds[j] == "stop" else 1

    def _over(self, motion: Motion, eager: bool) -> dict[int, int]:
        """Return the contacts of the cuts loaded most beyond their level."""
        loads: dict[int, float] = {}
        scale = 1e-10 * max(float(np.abs(motion.force @ motion.y0).max(initial=0.0)), 1e-9)
        for i, guard in enumerate(motion.guards):
            if not guard.levels:
                continue
            capacity = motion.capacity(guard, 0.0, motion.y0)
            need = -float(guard.k @ motion.y0)
            loads[i] = need / capacity if capacity > scale else (math.inf if need > scale else 0.0)
        beyond = {}
        for i, load in loads.items():
            limit = 1 + 1e-9
            if abs(load - 1) < AT_LEVEL and self._run._reached.issuperset(motion.guards[i].rows):
                limit = -math.inf if eager else math.inf
            if load > limit:
                beyond[i] = load
        if not beyond:
            return {}
        largest = max(beyond.values())
        if any(largest * (1 - NEAR_TIE) < x < largest * (1 - TIE) for x in loads.values() if x < math.inf):
            raise Doubt(self._run.t, "a near tie")
        if len(beyond) > 1 and any(len(motion.guards[i].levels) > 1 for i in beyond):
            raise Doubt(self._run.t, "several sets of rows that let go at once")
        if any(len(motion.guards[i].rows) > len(motion.guards[i].levels) for i in beyond) and len(beyond) > 1:
            raise Doubt(self._run.t, "several sets of rows that let go at once")
        return {
            j: sign
            for i, load in beyond.items()
            if load >= largest * (1 - TIE)
            for j, sign, _ in motion.guards[i].levels
        }
