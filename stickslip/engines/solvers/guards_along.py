"""The guards along a path: polynomials where they are linear in states and time, else computed from the states."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from stickslip.equations.guards.guards import Guards
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path, chebyshev_values
from stickslip.model.arrays import Array, Indices, Mask
from stickslip.model.crossings import root_between


class GuardsAlong:
    """The guards of a motion along its path.

    `low` are lower bounds of the guards in each step, -inf where none is known; `are_exact` says which guards are
    polynomials.
    """

    def __init__(self, motion: Motion, guards: Guards, path: Path) -> None:
        self.motion, self.guards, self.path = motion, guards, path
        self._coefficients, self.are_exact, self.low = guards.along(path)

    @cached_property
    def _roundoff_until(self) -> Array:
        """The local time until which the sign of each guard is roundoff, -1 for none.

        Forces wait for all guards that leave 0. A velocity has its own time: it may begin beyond 0 by less than errors.
        """
        guards = self.guards
        return np.where(guards.is_velocity, guards.each_roundoff_until, guards.any_roundoff_until)

    def falls_at_end(self, rows: Mask) -> bool:
        """Tell whether some guards certainly fall throughout the last step.

        The derivative of the Chebyshev polynomial of degree k is at most k^2 in size.
        """
        if not self.are_exact[rows].all():
            return False
        terms = self._coefficients[rows, -1, 1:]
        squares = np.arange(1.0, terms.shape[1] + 1) ** 2
        return bool((terms[:, 0] + np.abs(terms[:, 1:]) @ squares[1:] < 0).all())

    def is_exact(self, rows: Indices) -> bool:
        """Tell whether some guards are polynomials."""
        return bool(self.are_exact[rows].all())

    def values(self, rows: Indices, taus: Array, with_leeway: bool = False) -> Array:
        """Return some guards at local times, one row each; zeros at the start are not divided out.

        If `with_leeway`, the leeway is added: a guard has passed 0 once it is beyond 0 by more than that.
        """
        path, guards = self.path, self.guards
        if self.is_exact(rows):
            ends = path.taus
            step = np.minimum(np.maximum(ends.searchsorted(taus, "right") - 1, 0), ends.size - 2)
            places = 2 * (taus - ends[step]) / (ends[step + 1] - ends[step]) - 1
            basis = chebyshev_values(places, self._coefficients.shape[2] - 1)
            found: Array = np.einsum("nj,rnj->rn", basis, self._coefficients[rows][:, step])
        else:
            found = guards.undivided(taus, self.motion.exact(taus, path.at(taus).T))[rows]
        if with_leeway:
            found += guards.leeway[rows, None]
        if guards.any_roundoff_until >= 0:
            found[taus <= self._roundoff_until[rows, None]] = np.inf
        return found

    def root(self, row: int, step: int, right: float, with_leeway: bool) -> float:
        """Return where in a step a guard falls through 0: at its start it is not negative, and at `right` it is."""
        left, end = (float(self.path.taus[step + k]) for k in (0, 1))
        if self.are_exact[row] and left > self._roundoff_until[row]:
            coefficients = self._coefficients[row, step].tolist()
            coefficients[0] += float(self.guards.leeway[row]) if with_leeway else 0.0

            def value(tau: float) -> float:
                return _clenshaw(coefficients, 2 * (tau - left) / (end - left) - 1)

        else:

            def value(tau: float) -> float:
                return float(self.values(np.array([row]), np.array([tau]), with_leeway)[0, 0])

        # the signs at both ends may be roundoff
        if value(left) <= 0:
            return left
        return root_between(value, left, right) if value(right) < 0 else right


def _clenshaw(coefficients: list[float], x: float) -> float:
    """Return the value of a Chebyshev series."""
    now = later = 0.0
    for c in coefficients[:0:-1]:
        now, later = c + 2 * x * now - later, now
    return coefficients[0] + x * now - later
