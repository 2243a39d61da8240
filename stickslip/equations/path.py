"""How a motion went: a polynomial in each step, and why it ended."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Path"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Path:
    """The states of one motion as a polynomial in each step.

    Attributes
    ----------
    taus : array (k + 1,)
        Ends of the steps in s since the start of the motion, the first 0.
    coefficients : array (k, order + 1, size)
        In step i the state is ``sum_j coefficients[i, j] s^j`` with s from 0 to 1 over the step.
    last : array (size,)
        The state at the end.
    hit : bool
        Whether a guard came to 0 at the end.
    forces : array (k, order + 1, held), optional
        Forces of the held rows, where the engine has them as unknowns of their own.
    """

    taus: Array
    coefficients: Array
    last: Array
    hit: bool
    forces: Array | None = None

    @property
    def points(self) -> Array:
        """The states at the ends of the steps, one row each."""
        return np.concatenate([self.coefficients[:, 0], self.last[None, :]])

    def at(self, taus: Array) -> Array:
        """Return the states at local times, one row each."""
        return self._evaluate(self.coefficients, taus)

    def forces_at(self, taus: Array) -> Array:
        """Return the forces of the held rows at local times, one row each."""
        assert self.forces is not None
        return self._evaluate(self.forces, taus)

    def _evaluate(self, coefficients: Array, taus: Array) -> Array:
        if not self.coefficients.shape[0]:
            if coefficients is self.coefficients:
                return np.repeat(self.last[None, :], taus.size, axis=0)
            return np.zeros((taus.size, coefficients.shape[2]))
        if coefficients.shape[0] == 1:
            s = (taus / self.taus[1])[:, None] if self.taus[1] > 0 else np.zeros((taus.size, 1))
            one = coefficients[0]
            found = np.repeat(one[-1][None, :], taus.size, axis=0)
            for j in range(one.shape[0] - 2, -1, -1):
                found *= s
                found += one[j]
            return found
        i = np.clip(np.searchsorted(self.taus, taus, side="right") - 1, 0, coefficients.shape[0] - 1)
        s = ((taus - self.taus[i]) / (self.taus[i + 1] - self.taus[i]))[:, None]
        found = coefficients[i, -1]
        for j in range(coefficients.shape[1] - 2, -1, -1):
            found *= s
            found += coefficients[i, j]
        return found

    def until(self, count: int) -> Path:
        """Return the first `count` steps."""
        forces = None if self.forces is None else self.forces[:count]
        last = self.last if count >= self.coefficients.shape[0] else self.coefficients[count, 0]
        return Path(self.taus[: count + 1], self.coefficients[:count], last, False, forces)

    def cut(self, tau: float) -> Path:
        """Return the path up to local time `tau`, within it."""
        i = int(np.clip(np.searchsorted(self.taus, tau, side="left") - 1, 0, self.coefficients.shape[0] - 1))
        part = (tau - self.taus[i]) / (self.taus[i + 1] - self.taus[i])
        powers = part ** np.arange(self.coefficients.shape[1])
        pieces = self.coefficients[: i + 1].copy()
        pieces[i] *= powers[:, None]
        forces = None
        if self.forces is not None:
            forces = self.forces[: i + 1].copy()
            forces[i] *= (part ** np.arange(forces.shape[1]))[:, None]
        return Path(np.append(self.taus[: i + 1], tau), pieces, pieces[i].sum(axis=0), False, forces)
