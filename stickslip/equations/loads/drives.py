"""How drives move between two breaks of their loads: steadily accelerated, with sines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip.equations.loads.sines import Sines
from stickslip.model.arrays import Array, Indices


@dataclass(frozen=True)
class Drives:
    """Positions of drives at time `since`, velocities there and accelerations, and the sines of their velocities."""

    start: Array  # (d,)
    velocity: Array  # (d, 2): without the sines
    since: float
    sines: Sines  # their entries are the numbers of the drives

    def velocities(self, numbers: Indices, t: Array) -> Array:
        """Return the velocity of one drive at one time each."""
        u = self.velocity[numbers]
        found = u[:, 0] + u[:, 1] * (t - self.since)
        for k, drive in enumerate(self.sines.entry.tolist()):
            own = (numbers == drive).nonzero()[0]
            found[own] += self.sines.values(k, t[own])
        return np.asarray(found)

    def positions(self, numbers: Indices, t: Array) -> Array:
        """Return the positions of some drives at some times, a row for each drive."""
        u, d = self.velocity[numbers], t - self.since
        found = self.start[numbers, None] + d * (u[:, :1] + 0.5 * d * u[:, 1:])
        for k, drive in enumerate(self.sines.entry.tolist()):
            found[numbers == drive] += self.sines.some(np.array([k])).integrals(self.since, t)
        return np.asarray(found)

    def moved(self, numbers: Indices, t: float, step: float, order: int) -> Array:
        """Return how far some drives come from time `t` on: Taylor coefficients over `step` s, a row for each."""
        u, found = self.velocity[numbers], np.zeros((numbers.size, order + 1))
        found[:, 1] = step * (u[:, 0] + (t - self.since) * u[:, 1])
        found[:, 2] = 0.5 * step * step * u[:, 1]
        integrals = self.sines.taylor_of_integrals(self.since, t, order, step)
        for k, drive in enumerate(self.sines.entry.tolist()):
            found[numbers == drive, 1:] += integrals[1:, k]
        return found
