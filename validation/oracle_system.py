"""The equations of the oracle: bodies, friction and forces of a scene in given modes (Breedveld 2000)."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from validation.oracle_signals import read

Array = NDArray[np.float64]
Data = Mapping[str, Any]
SINGULAR = 1e-12  # singular values below this part of the largest are 0


class Doubt(Exception):
    """From a time on the model has no unique answer, or double precision cannot tell which it is."""

    def __init__(self, time: float, reason: str) -> None:
        super().__init__(f"{reason} at t = {time:.9g} s")
        self.time, self.reason = time, reason


class Loads(NamedTuple):
    """Normal forces (a row per contact), forces on bodies, and velocities and accelerations of drives."""

    normal: Array
    force: Array
    velocity: dict[int, float]
    acceleration: dict[int, float]


class Balance(NamedTuple):
    """Velocities, accelerations, forces of stuck contacts by number, normal forces, modes of slipping contacts.

    A normal force that depends on the state may be negative here, as long as its contact counts as closed.
    """

    velocity: Array
    acceleration: Array
    held: dict[int, float]
    normal: Array
    slipping: Mapping[int, int]


class System:
    """A scene as matrices: G has a row per contact, +1 at body a and -1 at body b; the ground has no column.

    Its data are `bodies`, `contacts`, `springs`, `forces` and `t_end`, as in `tests/reference`. Beyond these, contacts
    may have `mu_s_back`, `mu_c_back`, `rested`, and `vs` and `delta` of the Stribeck curve, loads may be sines, and
    `max_step` bounds the steps of an integration. `pressed_by` of a contact is a list of `[quantity, name, factor]`
    that add to its normal force: `position` or `velocity` of a body, `stretch` or `relative_velocity` of a contact.
    """

    def __init__(self, data: Data) -> None:
        bodies = data["bodies"]
        self.data, self.contacts = data, data["contacts"]
        self.start, self.stop = float(data.get("t_start", 0.0)), float(data["t_end"])
        self.span = self.stop - self.start
        self.bodies = [body["name"] for body in bodies]
        self.names = [contact["name"] for contact in self.contacts]
        self._index = {name: i for i, name in enumerate(self.bodies)}
        self.size = len(bodies)
        self.mobility = np.array([1.0 / b["inertia"] if b["inertia"] else 0.0 for b in bodies])
        """1/m of each body, 0 for drives: the limit of eq. (2)."""
        self.x0 = np.array([float(b.get("position", 0.0)) for b in bodies])
        self.v0 = np.array([float(b["velocity"]) if b["inertia"] else 0.0 for b in bodies])
        self._drives = {i: read(b["velocity"]) for i, b in enumerate(bodies) if not b["inertia"]}
        self.incidence = np.array([self._row(c) for c in self.contacts]).reshape(-1, self.size)
        self.by_position, self.by_velocity = (np.zeros((len(self.contacts), self.size)) for _ in range(2))
        self._press()
        self.pressed = [j for j, c in enumerate(self.contacts) if c.get("pressed_by")]
        """Contacts whose normal force depends on the state; the rows `by_position` and `by_velocity` say how."""
        normals = [read(c["normal"]) for c in self.contacts]
        self._normals = [n if j in self.pressed else n.pressed() for j, n in enumerate(normals)]
        self._forces = [(self._index[f["body"]], read(f["load"])) for f in data.get("forces", [])]
        self.stiffness = np.zeros((self.size, self.size))
        self.damping = np.zeros((self.size, self.size))
        self.rest = np.zeros(self.size)
        for spring in data.get("springs", []):
            row = self._row(spring)
            self.stiffness += spring["k"] * np.outer(row, row)
            self.damping += spring.get("c", 0.0) * np.outer(row, row)
            self.rest += spring["k"] * spring.get("rest", 0.0) * row
        loads = [*self._normals, *(load for _, load in self._forces)]
        signals = [*loads, *self._drives.values()]
        inside = {t for s in signals for t in s.breaks if self.start < t < self.stop}
        self.breaks = sorted(inside | {self.stop})
        self.linear = all(hasattr(s, "points") for s in signals) and not any(c.get("vs") for c in self.contacts)
        """Whether the motion between events solves linear equations."""
        sizes = [abs(factor) for c in self.contacts for *_, factor in c.get("pressed_by", [])]
        # the size of a normal force that depends on the state is its change by a position or velocity of 1
        self.force_scale = max((*(s.size for s in loads), *sizes), default=0.0) or 1e-300
        self._inverses: dict[tuple[int, ...], Array] = {}
        self._independent: dict[tuple[int, ...], bool] = {}

    def _row(self, element: Data) -> Array:
        row = np.zeros(self.size)
        for end, sign in (("a", 1.0), ("b", -1.0)):
            if element[end] != "ground":
                row[self._index[element[end]]] += sign
        return row

    def _press(self) -> None:
        """Enter the factors of positions and velocities in normal forces."""
        rows = dict(zip(self.names, self.incidence, strict=True))
        for j, contact in enumerate(self.contacts):
            for quantity, name, factor in contact.get("pressed_by", []):
                of_velocity = quantity in ("velocity", "relative_velocity")
                into = self.by_velocity if of_velocity else self.by_position
                along = rows[name] if name in rows else np.eye(self.size)[self._index[name]]
                into[j] += factor * along

    # Friction

    def _coefficients(self, j: int, direction: int) -> tuple[float, float]:
        contact = self.contacts[j]
        if direction < 0 and "mu_s_back" in contact:
            return contact["mu_s_back"], contact["mu_c_back"]
        return contact["mu_s"], contact["mu_c"]

    def slipping(self, j: int, direction: int, w: float) -> float:
        """Return mu_k = mu_c, or mu_c + (mu_s - mu_c) exp(-(|w|/v_s)^delta)."""
        static, kinetic = self._coefficients(j, direction)
        contact = self.contacts[j]
        if not contact.get("vs"):
            return kinetic
        return kinetic + (static - kinetic) * math.exp(-((abs(w) / contact["vs"]) ** contact["delta"]))

    def breakaway(self, j: int, direction: int, dwelt: float) -> float:
        """Return mu_st = mu_s - (mu_s - mu_c) exp(-(t - t_start)/tau), eqs. (8)-(9); mu_s without a dwell time."""
        static, kinetic = self._coefficients(j, direction)
        tau = self.contacts[j].get("tau", 0.0)
        return static - (static - kinetic) * math.exp(-dwelt / tau) if tau > 0 else static

    # Forces

    def loads(self, start: float, tau: float) -> Loads:
        """Return all loads at start + tau, on the pieces that begin at or before `start`.

        For a normal force that depends on the state, only the part that does not; it may be negative.
        """
        normal = np.array([n.after(start, tau)[0] for n in self._normals])
        fixed = [j for j in range(normal.size) if j not in self.pressed]
        normal[fixed] = np.maximum(normal[fixed], 0.0)
        force = np.zeros(self.size)
        for i, load in self._forces:
            force[i] += load.after(start, tau)[0]
        moves = {i: drive.after(start, tau) for i, drive in self._drives.items()}
        return Loads(normal, force, {i: v for i, (v, _) in moves.items()}, {i: a for i, (_, a) in moves.items()})

    def normals(self, loads: Loads, x: Array, v: Array, opened: Collection[int] = ()) -> Array:
        """Return the normal forces, 0 for `opened` contacts; others that depend on the state may be negative."""
        found = loads.normal + self.by_position @ x + self.by_velocity @ v
        found[list(opened)] = 0.0
        return found

    def driven(self, v: Array, loads: Loads) -> Array:
        """Return velocities with those of the drives put in."""
        v = v.copy()
        for i, velocity in loads.velocity.items():
            v[i] = velocity
        return v

    def balance(
        self,
        start: float,
        tau: float,
        x: Array,
        v: Array,
        modes: Mapping[int, int],
        stuck: Sequence[int],
        opened: Collection[int] = (),
    ) -> Balance:
        """Return accelerations and holding forces in given modes.

        Slipping contacts carry r = sign(w) mu_k N. All stuck ones together solve G_S M^-1 G_S^T lambda = G_S M^-1 F:
        eq. (1) for one contact of two bodies. Where they are redundant, lambda is the one of least norm.

        The pieces of the loads begin at the time `start`, `tau` ago. `modes` are +1 or -1 of slipping contacts by
        number; `opened` contacts are open, whatever normal force the state would give them.
        """
        loads = self.loads(start, tau)
        v = self.driven(v, loads)
        normal = self.normals(loads, x, v, opened)
        force = loads.force - self.stiffness @ x - self.damping @ v + self.rest
        w = self.incidence @ v
        for j, mode in modes.items():
            if normal[j]:
                force -= self.incidence[j] * (mode * self.slipping(j, mode, w[j]) * normal[j])
        a = self.mobility * force
        for i, acceleration in loads.acceleration.items():
            a[i] = acceleration
        if not stuck:
            return Balance(v, a, {}, normal, modes)
        held = self.holding(stuck) @ a
        before = np.abs(self.incidence[list(stuck)] @ a).max()
        roundoff = 1e-12 * np.abs(a).max()
        a = a - self.mobility * (self.incidence[list(stuck)].T @ held)
        left = np.abs(self.incidence[list(stuck)] @ a).max()
        if left > max(1e-7 * before, roundoff):
            raise Doubt(start + tau, "contacts that cannot all stay stuck")
        return Balance(v, a, dict(zip(stuck, held.tolist(), strict=True)), normal, modes)

    def holding(self, stuck: Sequence[int]) -> Array:
        """Return (G_S M^-1 G_S^T)^+ G_S: the forces that take away relative accelerations, or impulses velocities."""
        key = tuple(stuck)
        if key not in self._inverses:
            rows = self.incidence[list(key)]
            inverse = np.linalg.pinv((rows * self.mobility) @ rows.T, rcond=SINGULAR, hermitian=True)
            self._inverses[key] = inverse @ rows
        return self._inverses[key]

    def independent(self, stuck: Sequence[int]) -> bool:
        """Whether the forces of stuck contacts are unique."""
        key = tuple(stuck)
        if key not in self._independent:
            rows = self.incidence[list(key)]
            # older numpy has no rank for a matrix without entries
            rank = np.linalg.matrix_rank((rows * self.mobility) @ rows.T, hermitian=True) if key else 0
            self._independent[key] = bool(rank == len(key))
        return self._independent[key]

    def joined(self, v: Array, contacts: Sequence[int]) -> Array:
        """Return velocities with those of joined bodies set equal, conserving momentum."""
        if not contacts:
            return v
        return v - self.mobility * (self.incidence[list(contacts)].T @ (self.holding(contacts) @ v))
