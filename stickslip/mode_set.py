"""The equations of a scene in one set of modes."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from stickslip.friction import HARD, LINEAR, ActingForces

if TYPE_CHECKING:
    from stickslip.assembly import System

__all__ = ["FREE", "OPEN", "Expansion", "ModeSet"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

OPEN, FREE = 2, 3
"""States of contacts that carry no force and of those whose law knows no modes; the others have -1, 0 or +1."""

_NEAR = 1e-5
"""A stuck contact this near its breakaway level, as a part of it, deserves a closer look."""


class Expansion(NamedTuple):
    """Taylor coefficients at the start of a motion that no curved load or law bends.

    Rates are ``f0 + f1 tau``, and exactly so where their next derivatives `bends` are 0; what guards watch is
    ``z0 + z1 tau + z2 tau^2``, the guards are ``c0 + c1 tau + c2 tau^2`` once all static coefficients have risen.
    """

    f0: Array
    f1: Array
    bends: Array
    z0: Array
    z1: Array
    z2: Array
    c0: Array
    c1: Array
    c2: Array


class ModeSet:
    """The equations of a scene in one set of modes.

    With ``v' = M^-1 (F - G^T r)`` and all members of a stuck group accelerating as one body
    (Breedveld 2000, eqs. 5 to 7), the rates are ``y' = A y + B q + K e`` and the watched quantities
    ``z = E y + H q + L e``: relative velocities times mode of the slipping contacts, then forces of the stuck ones.
    ``e`` are the friction forces of the contacts that act through their velocity: slipping with a curved kinetic law,
    in pre-slip, smooth, or with bristles. A contact in pre-slip is watched by its relative velocity.

    Parameters
    ----------
    system : System
    modes : array (m,)
        -1, 0, +1 or OPEN for each contact.
    """

    A: Any
    B: Any
    K: Any
    E: Any
    H: Any
    L: Any

    def __init__(self, system: System, modes: NDArray[np.int8]) -> None:
        self.system, self.modes = system, modes
        kind = system.coefficients.kind
        self.stuck = np.flatnonzero((modes == 0) & (kind == HARD))
        self.pre = np.flatnonzero((modes == 0) & (kind == LINEAR))
        self.slip = np.flatnonzero((modes == 1) | (modes == -1))
        self.loose = np.flatnonzero(modes >= OPEN)
        self.open, self.free = np.flatnonzero(modes == OPEN), np.flatnonzero(modes == FREE)
        self.sign = modes[self.slip].astype(float)
        stuck = np.zeros(system.m, dtype=bool)
        stuck[self.stuck] = True
        self.groups = system.groups(stuck.tobytes())
        self.direction = (modes < 0).astype(np.intp)
        at_level = np.zeros(system.m, dtype=bool)
        at_level[self.at_level] = True
        # a level that still rises is no constant coefficient
        rising = at_level & (system.coefficients.dwell > 0)
        curved = (system.coefficients.curved & (np.abs(modes) == 1) & ~at_level) | rising
        self.acting = np.flatnonzero(curved | (modes == FREE) | ((modes == 0) & (kind == LINEAR)))
        self.held_contacts = np.concatenate([self.stuck, self.pre])
        self._place_levels()
        self.law = ActingForces(system.coefficients, self.acting, modes, at_level)
        self.bristle_places = np.array(
            [system.bristle_state[j] for j in self.acting[self.law.bristles]], dtype=np.intp
        )
        n = system.n
        everyone = np.arange(n)
        held = ~self.groups.free
        self.follow = np.flatnonzero((self.groups.leader != everyone) & ~held)
        self.lead = self.groups.leader[self.follow]
        self.held = np.flatnonzero(held)
        self.holder = self.groups.holder[self.held]
        self.driven = bool(np.any(self.holder < n + system.drives))
        self.kinetic = np.zeros(system.m)
        plain = self.slip[~curved[self.slip]]
        mu = np.where(at_level, system.mu_s, system.mu_c)
        self.kinetic[plain] = modes[plain] * mu[self.direction[plain], plain]
        self._assemble()

    def _place_levels(self) -> None:
        """Breakaway coefficients of the held contacts, upper levels first, then lower ones."""
        c = self.system.coefficients
        both = np.tile(self.held_contacts, 2)
        side = np.repeat([0, 1], self.held_contacts.size)
        self.guard_contacts = np.concatenate([self.slip, both])
        slips, helds = self.slip.size, self.held_contacts.size
        self._source = np.concatenate([np.arange(slips + helds), slips + np.arange(helds)])
        self._turn = np.repeat([1.0, -1.0, 1.0], [slips, helds, helds])
        self.is_pre = np.tile(np.arange(self.held_contacts.size) >= self.stuck.size, 2)
        mu_s = np.where(self.is_pre, c.velocity[both], c.mu_s[side, both])
        dwells = (c.dwell[both] > 0) & ~self.is_pre
        rise = np.where(dwells, mu_s - np.maximum(c.mu_c, c.mu_0)[side, both], 0.0)
        rate = np.divide(1.0, c.dwell[both], out=np.zeros(both.size), where=dwells)
        self.levels = (both, mu_s, rise, rate)
        self.has_dwell = bool(dwells.any())
        self.has_threshold = bool(c.threshold[self.slip].any())
        # a contact in pre-slip is held by its pre-slip velocity, whatever presses it together: by the input 1
        one = self.system.inputs - 1
        self.pressed_by = np.where(self.is_pre, one, both)
        self.guard_inputs = np.concatenate([np.full(slips, one), self.pressed_by])
        self.guard_levels = np.concatenate([np.zeros(slips), mu_s])
        # a level may be 0 one way, where the other tells what is near, or both ways, where nothing does
        larger = np.tile(mu_s.reshape(2, -1).max(axis=0), 2)
        near = np.where(larger > 0, _NEAR * larger, np.inf)
        self.nearness = np.concatenate([np.zeros(slips), near])

    def expand(self, y: Array, q0: Array, q1: Array) -> Expansion:
        """Return the Taylor coefficients of the motion from the state `y` under the inputs ``q0 + q1 tau``."""
        size = self.system.size
        values = self.apply(y) + self.respond(q0)
        slopes = self.apply(values[:size]) + self.respond(q1)
        bends = self.apply(slopes[:size])
        z = values[size:], slopes[size:], 0.5 * bends[size:]
        c0, c1, c2 = ((part[self._source].T * self._turn).T for part in z)
        c0 += (self.guard_levels * q0[self.guard_inputs].T).T
        c1 += (self.guard_levels * q1[self.guard_inputs].T).T
        return Expansion(values[:size], slopes[:size], bends[:size], *z, c0, c1, c2)

    def magnitudes(self, values: Array) -> Array:
        """Return what adds up in each guard, from absolute values of states and inputs: rows of speeds, then of forces.

        Their roundoff is that of the guards. The first rows are the speeds of both ends, of slipping contacts
        only; then follow, for each guard, the accelerations of both ends or the forces on both groups.
        """
        system = self.system
        body = system.magnitudes @ values
        acceleration = system.at_ends((body.T / system.inertia).T, self.slip)
        if system.drives:
            acceleration += (abs(system.D) @ system.drive_accelerations(values[system.size :]))[self.slip]
        speed = system.at_ends(values[: system.n], self.slip)
        force = system.at_ends(self.groups.totals(body), self.held_contacts)
        return np.concatenate([speed, acceleration, force, force])

    def _assemble(self) -> None:
        raise NotImplementedError

    def apply(self, y: Array) -> Array:
        """Return ``A y`` and ``E y`` in one array."""
        raise NotImplementedError

    def respond(self, q: Array) -> Array:
        """Return ``B q`` and ``H q`` in one array."""
        raise NotImplementedError

    def _folded(self, matrix: Any) -> Any:
        """Let followers' velocities be read from their leaders, so that nothing feeds back within a group."""
        raise NotImplementedError

    def _parting(self, held: Array, drives: Array) -> Array | None:
        """Return by how much the ends of stuck contacts part, from the accelerations of held bodies and of drives."""
        if not (self.groups.redundant and self.system.drives):
            return None
        ground = np.zeros((1, *held.shape[1:]))
        ends = np.concatenate([held, drives, ground])
        return ends[self.system.a[self.stuck]] - ends[self.system.b[self.stuck]]

    def law_jacobian(self, slopes: Array) -> Any:
        """Return what the acting contacts add to ``d y' / d y``: ``K diag(dr/dw) W``."""
        rows = self.acting_rows
        return self.K @ (
            slopes[:, None] * rows if isinstance(rows, np.ndarray) else sparse.diags_array(slopes) @ rows
        )

    @cached_property
    def held_together(self) -> NDArray[np.bool_]:
        """The contacts whose ends stuck contacts hold together."""
        system, groups = self.system, self.groups
        whole = np.where(groups.free, groups.leader, groups.holder)
        whole = np.concatenate([whole, np.arange(system.n, system.n + system.drives + 1)])
        together: NDArray[np.bool_] = whole[system.a] == whole[system.b]
        return together

    @cached_property
    def locked(self) -> NDArray[np.bool_]:
        """Which slipping contacts cannot move, because others hold both their ends together."""
        return self.held_together[self.slip]

    @cached_property
    def at_level(self) -> Indices:
        """The contacts that carry exactly their breakaway level, while others hold their ends together.

        They are written as slipping ones: their forces are known, and the others carry the rest.
        """
        return self.slip[self.locked & (self.system.coefficients.kind[self.slip] == HARD)]

    @cached_property
    def open_rows(self) -> Any:
        """Rows that give the relative velocities of the open contacts."""
        return self.system.W[self.open]

    @cached_property
    def acting_rows(self) -> Any:
        """Rows that give the relative velocities of the acting contacts."""
        return self._folded(self.system.W)[self.acting]
