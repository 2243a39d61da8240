"""Which lengths of steps are stable for an explicit method of fixed steps: no decaying state may be made to grow.

A method turns ``y' = lambda y`` into ``y -> R(h lambda) y``; with ``Re lambda <= 0`` it is stable while ``|R| <= 1``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import scipy

from stickslip.equations.algebra.matrices import dense
from stickslip.equations.mode_equations import ModeEquations
from stickslip.equations.motion import Motion
from stickslip.model.arrays import Array, Complex, Mask

_DENSE_LIMIT = 200
_ROUNDOFF = 1e-9
_NEAR_REST = 3.0


class Unstable(Exception):
    """A step is too long for a scene.

    An eigenvalue of the Jacobian in 1/s is the reason; `longest` is the longest step in s that it allows.
    """

    def __init__(self, eigenvalue: complex, longest: float) -> None:
        value = f"{eigenvalue.real:.3g}" if eigenvalue.imag == 0 else f"{eigenvalue:.3g}"
        super().__init__(f"an eigenvalue of {value} /s allows {longest:.4g} s at most there")
        self.longest = longest


class Stability:
    """Judges the steps of a method by the eigenvalues of the Jacobian.

    RK4 is stable up to ``h |lambda| = 2.785`` for real and 2.828 for imaginary eigenvalues, Euler's method up to 2
    for real ones. With Euler's method every undamped oscillation grows, by ``exp(h omega^2 t / 2)``. This growth is
    accepted up to ``h omega = 1``, which is some six steps a period.

    `growth` are the coefficients of ``R(z)``, the highest power first.
    """

    def __init__(self, growth: Sequence[float]) -> None:
        self._growth = growth
        self._longest: WeakKeyDictionary[ModeEquations, float] = WeakKeyDictionary()

    def check(self, motion: Motion, h: float, taus: Array, states: Array) -> None:
        """Check the step at computed points (rows) of a motion.

        Raise `Unstable` if it is too long at the last point, at the rest of a contact with a smooth law that passes
        through rest between points (there its slope is steepest), or where bristles relax fastest.
        """
        if not motion.has_law and motion.dependence is None:
            # without such laws a mode set has one Jacobian: a step found stable once stays stable
            if h > self._longest.get(motion.equations, 0.0):
                self._judge(motion.equations.jacobian(), h)
                self._longest[motion.equations] = h
            return
        steepest = [(k, states[k]) for k in self._relaxing(motion, taus, states)]
        for k, y in [*self._at_rest(motion, taus, states), *steepest, (-1, states[-1])]:
            self._judge(motion.jacobian(float(taus[k]), y), h)

    @staticmethod
    def _relaxing(motion: Motion, taus: Array, states: Array) -> set[int]:
        """Return the points at which the bristles relax fastest."""
        law = motion.equations.law if motion.has_law else None
        if law is None or not law.bristles.size:
            return set()
        w, normal, _, _ = motion.law_arguments(taus, states.T)
        # the last point is checked anyway
        return set(law.relaxation(w, normal).argmax(axis=1).tolist()) - {taus.size - 1}

    def _at_rest(self, motion: Motion, taus: Array, states: Array) -> list[tuple[int, Array]]:
        """Return the points at which contacts with smooth laws are nearest to rest, and the states moved to rest."""
        free, laws = motion.equations.free, motion.system.laws
        smooth = free[np.isfinite(laws.resolution[free])]
        if not smooth.size:
            return []
        w = motion.system.relative_velocity(states.T, motion.loads(taus))[smooth]
        near = np.abs(w) <= _NEAR_REST * laws.resolution[smooth][:, None]
        near[:, 1:] |= w[:, 1:] * w[:, :-1] < 0
        n, size = motion.system.n, states.shape[1]
        rows = scipy.sparse.csr_array(motion.system.G)[smooth]
        rows = scipy.sparse.hstack([rows, scipy.sparse.csr_array((smooth.size, size - n))], format="csr")
        found: dict[int, list[int]] = {}
        for j in np.flatnonzero(near.any(axis=1)).tolist():
            found.setdefault(int(np.where(near[j], np.abs(w[j]), np.inf).argmin()), []).append(j)
        return [(k, states[k] - scipy.sparse.linalg.lsqr(rows[js], w[js, k], atol=1e-12)[0]) for k, js in found.items()]

    def _judge(self, jacobian: Any, h: float) -> None:
        """Raise `Unstable` if a step is too long for a Jacobian."""
        # no eigenvalue is larger than this norm; up to ``h |lambda| = 1`` every step is accepted
        if h * float(abs(jacobian).sum(axis=1).max()) <= 1.0:
            return
        values = _eigenvalues(jacobian)
        bad = values[(values.real <= _ROUNDOFF * np.abs(values)) & self._grows(h * values)]
        if bad.size:
            limits = self._limits(bad, h)
            worst = int(limits.argmin())
            raise Unstable(complex(bad[worst]), float(limits[worst]))

    def _grows(self, z: Complex) -> Mask:
        growing: Mask = np.abs(np.polyval(self._growth, z)) > 1.0 + _ROUNDOFF
        return growing & (np.abs(z) > 1.0 + _ROUNDOFF)

    def _limits(self, values: Complex, h: float) -> Array:
        """Return the longest stable steps for eigenvalues for which `h` is too long, by bisection."""
        low, high = 1.0 / np.abs(values), np.full(values.size, h)
        for _ in range(50):
            middle = 0.5 * (low + high)
            grows = self._grows(middle * values)
            low, high = np.where(grows, low, middle), np.where(grows, middle, high)
        return low


def _eigenvalues(jacobian: Any) -> Complex:
    """Return the eigenvalues; of a large matrix only those largest in magnitude."""
    size = jacobian.shape[0]
    if size <= _DENSE_LIMIT:
        return np.asarray(np.linalg.eigvals(dense(jacobian)), dtype=np.complex128)
    start = np.cos(np.arange(size))  # ARPACK's own start vector would differ from run to run
    try:
        return np.asarray(
            scipy.sparse.linalg.eigs(scipy.sparse.csc_array(jacobian), k=4, v0=start, return_eigenvectors=False)
        )
    except scipy.sparse.linalg.ArpackError:
        return np.empty(0, dtype=np.complex128)
