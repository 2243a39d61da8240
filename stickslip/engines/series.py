"""The series engine: linear motions as Taylor series cut at roundoff, events as roots of polynomials.

In one set of modes ``y' = A y + B q(t)`` with inputs that are lines, sines and exponentials: the Taylor coefficients
follow from small products, and so do those of the guards. No step error, nothing is sampled.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip.engines.roots import first_root, may_vanish
from stickslip.engines.work import Interruption, Work
from stickslip.equations.guards import NEVER, Guards
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path

__all__ = ["Series"]

Array = NDArray[np.float64]

_ORDER, _POLYNOMIAL = 18, 2
_REMAINDER = 1e-17
_MOST_STEPS = 1_000_000
_TINY = np.finfo(float).tiny


class Series:
    """Follow linear motions exactly.

    Parameters
    ----------
    max_step : float
        Longest step in s.
    work : Work
    interruption : Interruption
    """

    def __init__(self, max_step: float, work: Work, interruption: Interruption) -> None:
        self._max_step, self.work, self._interruption = max_step, work, interruption
        self._guess = math.inf

    @staticmethod
    def can(motion: Motion) -> bool:
        """Tell whether the motion has a Taylor series: no law or load of it is a mere function."""
        return motion.is_linear

    def advance(self, motion: Motion, guards: Guards, horizon: float) -> Path:
        """Follow a motion to its first event or to local time `horizon`, whichever comes first."""
        work, system = self.work, motion.system
        work.starts += 1
        tau, y = 0.0, motion.y
        ends, pieces = [0.0], []
        watched = (guards.order < NEVER).nonzero()[0]
        first = True
        polynomial = motion.is_polynomial
        order = _POLYNOMIAL if polynomial else _ORDER
        hit = False
        while tau < horizon and not hit:
            if self._interruption.pressed:
                break
            rest = horizon - tau
            longest = min(rest, self._max_step)
            if polynomial and first:
                h, scale, expansion = longest, 1.0, motion.start
            else:
                scale = longest if math.isinf(self._guess) else min(longest, self._guess)
                expansion = motion.expand(tau, y, order, scale)
                h = longest
            g = guards.series(expansion)
            if not polynomial:
                h = min(longest, scale * self._reach(expansion.y, g, guards, system.n))
                self._guess = 1.2 * h
            stretched = (h / scale) ** np.arange(order + 1)
            c = expansion.y * stretched[:, None]
            s = 1.0
            if watched.size:
                g = g[:, watched] * stretched[:, None]
                if first and not guards.is_plain:
                    g = _divided(g, guards.order[watched])
                root = self._first(g)
                if root is not None:
                    s, hit = root, True
            work.steps += 1
            work.rate_calls += order
            if hit:
                c = c * (s ** np.arange(order + 1))[:, None]
                tau += s * h
            else:
                tau = horizon if h >= rest else tau + h
            pieces.append(c)
            ends.append(tau)
            y = c.sum(axis=0)
            y = motion.exact(tau, y)
            first = False
            if len(pieces) > _MOST_STEPS:
                raise ArithmeticError("the series needs too many steps; use method='BDF'")
        return Path(np.array(ends), np.array(pieces), y, hit)

    @staticmethod
    def _reach(y: Array, g: Array, guards: Guards, n: int) -> float:
        """Return the step, in units of that of the coefficients, whose remainder is below roundoff.

        The last two terms are compared with the largest one over the step; at most the step of the coefficients.
        """
        order = y.shape[0] - 1
        absolute = np.abs(y)
        groups = [absolute[:, :n].max(axis=1)]
        if y.shape[1] > n:
            groups.append(absolute[:, n:].max(axis=1))
        held = ~guards.is_velocity
        if held.any():
            size = np.abs(g[:, held])
            scale = guards.scale[held]
            scale = np.where(scale > 0, scale, np.maximum(size.max(axis=0), _TINY))
            groups.append((size / scale).max(axis=1))
        sizes = np.array(groups)
        if held.any():
            sizes[-1, 0] = max(sizes[-1, 0], 1.0)
        powers, reach = np.arange(order + 1), 1.0
        for _ in range(30):
            terms = sizes * reach**powers
            part = (terms[:, order - 1 :].max(axis=1) / np.maximum(terms.max(axis=1), _TINY)).max()
            if part <= 2 * _REMAINDER:
                break
            reach *= 0.99 * (_REMAINDER / part) ** (1.0 / order)
        return float(reach)

    def _first(self, g: Array) -> float | None:
        """Return the first root in (0, 1] of any column of power coefficients."""
        close = may_vanish(g)
        self.work.guards_excluded += g.shape[1] - close.size
        found: float | None = None
        for i in close.tolist():
            c = g[:, i]
            if found is not None:
                # only what comes before is of interest
                c = c * found ** np.arange(c.size)
            root = first_root(c)
            self.work.guards_isolated += 1
            if root is not None:
                found = root if found is None else found * root
        return found


def _divided(g: Array, order: NDArray[np.intp]) -> Array:
    """Return polynomials with their zeros at the start divided out."""
    g = g.copy()
    for k in set(order[order > 0].tolist()):
        columns = (order == k).nonzero()[0]
        g[: g.shape[0] - k, columns] = g[k:, columns]
        g[g.shape[0] - k :, columns] = 0.0
    return g
