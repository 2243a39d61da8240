"""The laws of all rows side by side: their coefficients as arrays, and the forces that depend on velocity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from stickslip.model.arrays import Array, Indices, Modes
from stickslip.model.laws.base import Kernel
from stickslip.model.laws.dry_friction import Law
from stickslip.model.laws.kinetic import Slipping


class LawTable:
    """Coefficients and facts of the laws of all rows, as arrays.

    In arrays with two lines, line 0 is for forward and line 1 for backward slip. `least` are the coefficients from
    which the static ones rise with the dwell.
    """

    def __init__(self, laws: Sequence[Law]) -> None:
        self.laws = laws
        cores, sides = [law.core for law in laws], (1, -1)
        self.mu_s = np.array([[c.mu_s(s) for c in cores] for s in sides]).reshape(2, -1)
        self.mu_c = np.array([[c.mu_c(s) for c in cores] for s in sides]).reshape(2, -1)
        self.least = np.array([[c.least(s) for c in cores] for s in sides]).reshape(2, -1)
        self.dwell = np.array([c.dwell for c in cores])
        self.curved = np.array([c.curved for c in cores], dtype=bool)
        self.characters = [law.character for law in laws]
        self.sticks = np.array([c.sticks for c in self.characters], dtype=bool)
        self.has_slip_state = np.array([c.has_slip_state for c in self.characters], dtype=bool)
        self.has_state = np.array([c.stiffness is not None for c in self.characters], dtype=bool)
        self.slips_beyond = np.array([c.slips_beyond for c in self.characters])
        self.rests_below = np.array([c.rests_below for c in self.characters])
        self.resolution = np.array([c.resolution for c in self.characters])


class VelocityDependentForces:
    """Friction forces that depend on velocity, in one set of modes.

    `sign` is the direction of each contact that slips in a known direction, and 0 for a contact whose forces its kernel
    gives. `bristles` are the places of the contacts with states of their own.
    """

    def __init__(self, laws: Sequence[Law], sign: Modes) -> None:
        self._count = sign.size
        slips = sign.nonzero()[0]
        kinds: dict[type[Kernel], list[int]] = {}
        for place in (sign == 0).nonzero()[0].tolist():
            kinds.setdefault(laws[place].kernel, []).append(place)
        sorted_out: list[tuple[Indices, Kernel]] = []
        if slips.size:
            sorted_out.append((slips, Slipping([laws[k].core for k in slips.tolist()], sign[slips].astype(float))))
        sorted_out += [(np.array(places), kind([laws[k] for k in places])) for kind, places in kinds.items()]
        stateful = [places for places, kernel in sorted_out if kernel.has_state]
        self.bristles: Indices = np.sort(np.concatenate(stateful)) if stateful else np.empty(0, dtype=np.intp)
        self._parts = [
            (places, self.bristles.searchsorted(places) if kernel.has_state else places[:0], kernel)
            for places, kernel in sorted_out
        ]
        self._stateful = [part for part in self._parts if part[2].has_state]

    def forces(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        """Return the forces (k,) or (k, times); the arguments are those of `Kernel`, `z` the states of the bristles."""
        if len(self._parts) == 1:
            return self._parts[0][2].forces(w, normal, lag, z)
        r = np.empty_like(w)
        for rows, own, kernel in self._parts:
            r[rows] = kernel.forces(w[rows], normal[rows], lag[rows], z[own])
        return r

    def in_floats(self) -> list[Callable[..., Any]] | None:
        """Return each contact's force as a function of plain floats; None if any contact has no such function."""
        found = {
            place: kernel.in_floats(k) for places, _, kernel in self._parts for k, place in enumerate(places.tolist())
        }
        functions = [function for _, function in sorted(found.items()) if function is not None]
        return functions if len(functions) == self._count else None

    def slopes(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        """Return the derivatives of the forces with respect to `w`, at fixed states; all are (k,) or (k, times)."""
        d = np.empty_like(w)
        for rows, own, kernel in self._parts:
            d[rows] = kernel.slopes(w[rows], normal[rows], lag[rows], z[own])
        return d

    def slope_cut(self, w: Array, normal: Array) -> Array:
        """Return the true derivatives minus `slopes`, where those are flatter than the true ones to help a solver."""
        d = np.empty_like(w)
        for rows, _, kernel in self._parts:
            d[rows] = kernel.slope_cut(w[rows], normal[rows])
        return d

    def bristle_rates(self, w: Array, normal: Array, z: Array) -> Array:
        """Return the rates of the contacts' own states."""
        rates = np.empty_like(z)
        for rows, own, kernel in self._stateful:
            rates[own] = kernel.rates(w[rows], normal[rows], z[own])
        return rates

    def bristle_slopes(self, w: Array, normal: Array, z: Array) -> tuple[Array, Array]:
        """Return the derivatives of these rates with respect to `w` and `z`."""
        by_w, by_z = np.empty_like(z), np.empty_like(z)
        for rows, own, kernel in self._stateful:
            by_w[own], by_z[own] = kernel.rate_slopes(w[rows], normal[rows], z[own])
        return by_w, by_z

    def relaxation(self, w: Array, normal: Array) -> Array:
        """Return the rates at which the contacts' own states relax, columns where the arguments have columns."""
        found = np.empty((self.bristles.size, *w.shape[1:]))
        for rows, own, kernel in self._stateful:
            found[own] = kernel.relaxation(w[rows], normal[rows])
        return found

    def by_normal(self, w: Array, normal: Array, lag: Array, z: Array) -> tuple[Array, Array]:
        """Return the derivatives of the forces and of the bristles' rates with respect to the normal forces."""
        of_forces, of_rates = np.empty_like(w), np.empty_like(z)
        for rows, own, kernel in self._parts:
            of_forces[rows], of_rates[own] = kernel.by_normal(w[rows], normal[rows], lag[rows], z[own])
        return of_forces, of_rates

    def by_bristle(self, w: Array, normal: Array, z: Array) -> Array:
        """Return the derivatives of the forces with respect to the contacts' own states."""
        found = np.empty_like(z)
        for rows, own, kernel in self._stateful:
            found[own] = kernel.by_state(w[rows], normal[rows], z[own])
        return found


def steady_forces(law: Law, w: Array, normal: float) -> Array:
    """Return the forces of one law in steady motion at several relative velocities, none of them 0."""
    character = law.character
    slips = character.sticks | (character.has_slip_state & (np.abs(w) > character.slips_beyond))
    sign = np.where(slips, np.sign(w), 0).astype(np.int8)
    forces, pressed = VelocityDependentForces([law] * w.size, sign), np.full(w.size, normal)
    # bristles in steady motion: ``z' = 0``
    z = w[forces.bristles] / forces.relaxation(w, pressed)
    return forces.forces(w, pressed, np.zeros_like(w), z)
