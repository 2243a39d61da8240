"""Machines of the oracle as matrices, and their motion in given modes: a matrix exponential."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from validation.oracle_motion import exponential
from validation.oracle_signals import Sine, read

Array = NDArray[np.float64]
Data = Mapping[str, Any]
RANK = 1e-10  # singular values below this part of the largest are 0


@dataclass(frozen=True)
class Modes:
    """What every row does, by number."""

    slips: Mapping[int, int]  # +1 or -1 of contacts
    held: tuple[int, ...]  # stuck contacts, locked clutches, closed stops
    # of gaps beyond a limit: its side, and the force: "twice" the spring's, "both" spring's and damper's, or "none"
    gap_regions: Mapping[int, tuple[int, str]]
    sides: Mapping[int, int]  # of closed stops: +1 or -1


class Machine:
    """A scene as matrices: velocities ``v = Z q + P u``, u those of the drives, q the coordinates that ties leave free.

    Its data are `bodies` (a drive has the inertia None and a load for its velocity), `rows` (`kind`, `name`, `on`:
    coefficients by body, and the numbers of its law), `springs` (`on`, `k`, `c`, `rest`), `forces`, `t_end`.
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
        self._free_coordinates()
        # springs and dampers
        self.K, self.D, self.rest = np.zeros((self.n, self.n)), np.zeros((self.n, self.n)), np.zeros(self.n)
        for spring in data.get("springs", []):
            g = row(spring["on"])
            self.K += spring["k"] * np.outer(g, g)
            self.D += spring.get("c", 0.0) * np.outer(g, g)
            self.rest += spring["k"] * spring.get("rest", 0.0) * g
        self._loads(index)
        self._start()

    def _free_coordinates(self) -> None:
        """Find the coordinates that ties leave free."""
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
        self.J = self.G @ self.Z
        """Relative velocities in the free coordinates; rows that ties lock are 0, not roundoff."""
        self.J[np.abs(self.J) < 1e-12 * np.abs(self.G).max(initial=1.0)] = 0.0
        self.inverse = np.linalg.inv((self.Z.T * self.mass) @ self.Z)
        """The inverse of the inertia in the free coordinates."""

    def _loads(self, index: Mapping[str, int]) -> None:
        data, bodies = self.data, self.data["bodies"]
        self.drives = [read(bodies[i]["velocity"]) for i in self.driven]
        self.normals = {j: read(r["normal"]).pressed() for j, r in enumerate(self.rows) if r["kind"] == "contact"}
        self.forces = [(index[f["body"]], read(f["load"])) for f in data.get("forces", [])]
        signals = [*self.drives, *self.normals.values(), *(load for _, load in self.forces)]
        self.sines = [s for s in signals if isinstance(s, Sine)]
        inside = {t for s in signals for t in s.breaks if 0.0 < t < self.stop}
        self.breaks = sorted(inside | {self.stop})
        self.size = self.n + self.r + 2 + 2 * len(self.sines)

    def _start(self) -> None:
        bodies = self.data["bodies"]
        self.x0 = np.array([float(b.get("position", 0.0)) for b in bodies])
        start = np.array([0.0 if b["inertia"] is None else float(b["velocity"]) for b in bodies])
        u = self.speeds(0.0)
        self.q0 = np.asarray(np.linalg.lstsq(self.Z, start - self.P @ u, rcond=None)[0], dtype=np.float64)
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

    # Impacts

    def struck(self, v: Array, u: Array, at: Mapping[int, int], hit: Iterable[int]) -> Array:
        """Return q after an impact, or after a jump of drives to the velocities `u`.

        Newton's law for all one-sided rows that take part, by trying all sets of rows that carry an impulse: ``0 <= P``
        complementary to ``sep+ + e sep- >= 0``. Rows that already part do not take part; if the impact drives such a
        clutch or stop against its limit, a second impact follows. `v` are all velocities before, `at` is +1 or -1 of
        stops at a limit, by number, and `hit` are those among them that are hit.
        """
        size = max(1e-12, float(np.abs(v).max(initial=0.0)), float(np.abs(u).max(initial=0.0)))
        before = self.G @ v
        clutches = [j for j, kind in enumerate(self.kinds) if kind == "one-way"]
        wanted = {j: self.rows[j].get("e", 0.0) * max(at[j] * before[j], 0.0) for j in hit}
        part = [j for j in (*at, *clutches) if at.get(j, 1) * before[j] >= -1e-9 * size]
        q = self._impact(v, u, part, at, wanted, size)
        after = self.G @ self.velocity(q, u)
        if any(at.get(j, 1) * after[j] > 1e-9 * size for j in (*at, *clutches)):
            q = self._impact(self.velocity(q, u), u, [*at, *clutches], at, {}, size)
        return q

    def _impact(
        self,
        v: Array,
        u: Array,
        part: Sequence[int],
        at: Mapping[int, int],
        wanted: Mapping[int, float],
        size: float,
    ) -> Array:
        free = self.inverse @ ((self.Z.T * self.mass) @ (v - self.P @ u))
        sign = np.array([float(at.get(j, 1)) for j in part])
        H = -sign[:, None] * self.J[list(part)] if part else np.zeros((0, self.r))
        led = -sign * (self.G[list(part)] @ self.P @ u) if part else np.zeros(0)
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
        H = self.J[list(rest)]
        w = H @ q + self.G[list(rest)] @ (self.P @ u)
        return np.asarray(q - self.inverse @ (H.T @ (np.linalg.pinv(H @ self.inverse @ H.T, rcond=RANK) @ w)))


@dataclass(frozen=True)
class Guard:
    """``k y + sum over contacts of part mu(t) N``, which is positive while the modes hold, and the rows it watches."""

    rows: tuple[int, ...]
    k: Array
    levels: tuple[tuple[int, int, float], ...] = ()


class Motion:
    """A piece of motion in given modes: ``y' = A y``, with y positions, free velocities, and the states of loads.

    It begins at the time `start` in s in the state `x`, `q`. Contacts have been stuck `since` these times.
    """

    def __init__(
        self, machine: Machine, start: float, x: Array, q: Array, modes: Modes, since: Mapping[int, float]
    ) -> None:
        m = self.machine = machine
        self.start, self.modes, self.since = start, modes, dict(since)
        n, r, size = m.n, m.r, m.size
        self._one = n + r
        own, first = self._of_loads()
        first[:n], first[n : n + r] = x, q
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
        for j in modes.gap_regions:
            force -= np.outer(m.G[j], self.push(j))
        self.force = force
        rate = m.inverse @ (m.Z.T @ (force - m.mass[:, None] * led))
        self.size = np.abs(first)
        """The sizes of the states, 1 for sines: these may be 0 for a moment."""
        self.size[self._one + 2 :] = 1.0
        pushes = np.abs(m.Z.T) @ (np.abs(force) @ self.size + m.mass * (np.abs(led) @ self.size))
        self.swift = float((np.abs(m.J) @ (np.abs(m.inverse) @ pushes)).max(initial=1e-9))
        """The size of what adds up in relative accelerations."""
        held = list(modes.held)
        self.H = m.J[held]
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
        self.acceleration = m.J @ rate + m.G @ led
        """Relative accelerations."""
        self.y0 = first
        self.guards = self._guards()
        self.k = np.array([g.k for g in self.guards]).reshape(-1, size)
        fastest = float(np.abs(np.linalg.eigvals(self.A)).max(initial=0.0))
        self.step = min(m.stop / 300.0, 0.25 / fastest if fastest > 0 else math.inf)
        self._grid: list[Array] = [first]
        self._once: Array | None = None

    def _of_loads(self) -> tuple[Array, Array]:
        """Return the rates and the first values of the states of loads: 1, tau, sines and cosines."""
        size, one = self.machine.size, self._one
        own, first = np.zeros((size, size)), np.zeros(size)
        own[one + 1, one] = first[one] = 1.0
        for k, sine in enumerate(self.machine.sines):
            s, omega = one + 2 + 2 * k, 2 * math.pi * sine.frequency
            own[s, s + 1], own[s + 1, s] = omega, -omega
            angle = omega * self.start + sine.phase
            first[s], first[s + 1] = math.sin(angle), math.cos(angle)
        return own, first

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
        side, branch = self.modes.gap_regions[j]
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
            if (kind == "stop" and j not in self.modes.sides) or (kind == "gap" and j not in self.modes.gap_regions):
                sides = [s for s, limit in zip((-1, 1), m.limits(j), strict=True) if math.isfinite(limit)]
                found += [Guard((j,), -self.depth(j, side)) for side in sides]
            if kind == "gap" and j in self.modes.gap_regions:
                side, branch = self.modes.gap_regions[j]
                depth = self.depth(j, side)
                push, drag = m.rows[j]["k"] * depth, m.rows[j].get("c", 0.0) * side * self.W[j]
                found.append(Guard((j,), depth))
                if m.rows[j].get("c", 0.0) > 0:
                    more = {
                        "twice": [drag - push],
                        "both": [push - drag, push + drag],
                        "none": [-push - drag],
                    }
                    found += [Guard((j,), k) for k in more[branch]]
        held = list(self.modes.held)
        for cut in cuts(self.H):
            for way in (1, -1):
                guard = self._cut(held, way * cut)
                if guard is not None:
                    found.append(guard)
        return found

    def _cut(self, held: Sequence[int], cut: Array) -> Guard | None:
        """Return the guard of a cut in a direction: what it can carry less what it has to; None if it can carry all."""
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
        """Return the force that the contacts of a cut can carry."""
        t = self.start + tau
        return sum(
            part * self.machine.level(j, sign, t - self.since[j]) * max(0.0, float(self.normal[j] @ y))
            for j, sign, part in guard.levels
        )

    def _capacity_rate(self, guard: Guard, tau: float, y: Array) -> float:
        t, rate = self.start + tau, self.A @ y
        found = 0.0
        for j, sign, part in guard.levels:
            dwelt = t - self.since[j]
            found += part * self.machine.level(j, sign, dwelt) * float(self.normal[j] @ rate)
            found += part * self.machine.level_rate(j, sign, dwelt) * float(self.normal[j] @ y)
        return found

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
        found = self.k @ y
        for i, guard in enumerate(self.guards):
            if guard.levels:
                found[i] += self.capacity(guard, tau, y)
        return np.asarray(found)

    def rates(self, tau: float, y: Array) -> Array:
        """Return the rates of the guards."""
        found = self.k @ (self.A @ y)
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
            elif j in self.modes.gap_regions:
                found[name] = float(self.push(j) @ y)
            elif j not in self.modes.held:
                found[name] = 0.0
        held = [*(m.names[j] for j in self.modes.held), *(tie["name"] for tie in m.ties)]
        rows = np.vstack([m.G[list(self.modes.held)], m.C])[:, m.free]
        accelerations = (self.A @ (self.A @ y))[: m.n]
        left = (self.force @ y - m.mass * accelerations)[m.free]
        shares = np.linalg.lstsq(rows.T, left, rcond=RANK)[0]
        idle = null_space(rows.T, rcond=RANK) if held else np.zeros((0, 0))  # combinations of forces that move nothing
        for k, name in enumerate(held):
            unique = not idle.size or np.abs(idle[k]).max() < 1e-9
            found[name] = float(shares[k]) if unique else math.nan
        return found


def cuts(H: Array) -> list[Array]:
    """Return the cuts: relative velocities `H` q of held rows that are not 0 in as few rows as possible."""
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
