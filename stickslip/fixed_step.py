"""Fixed steps, as a real-time simulator takes them: mode changes at step ends, velocities projected there."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip.engine import Engine, Reached, SolverFailure
from stickslip.segment import Segment

__all__ = ["FixedStepEngine"]

Array = NDArray[np.float64]


class FixedStepEngine(Engine):
    """The classical Runge-Kutta method of order 4, or Euler's, with a given step.

    Parameters
    ----------
    size : int
        Number of states.
    method : str
        "RK4" or "Euler".
    step : float
        Step in s.
    """

    def __init__(self, size: int, method: str, step: float) -> None:
        super().__init__(size, method, 1e-8, 1e-8, math.inf)
        self._step = step
        self._advance_one = _runge_kutta if method == "RK4" else _euler
        self._stages = 4 if method == "RK4" else 1

    def advance(self, segment: Segment, horizon: float) -> Reached:
        """Step until a guard is violated, a contact opens or closes, or local time `horizon` is reached."""
        count = max(1, math.ceil(horizon / self._step * (1 - 1e-12)))
        taus, states = [0.0], [segment.y]
        hit = False
        watches_loads = segment.has_curved
        closed = segment.closed(0.0) if watches_loads else None
        for number in range(1, count + 1):
            tau = horizon if number == count else number * self._step
            y = self._advance_one(segment, taus[-1], states[-1], tau - taus[-1])
            if not np.all(np.isfinite(y)):
                raise SolverFailure(taus[-1], -3, f"the {self._method} step of {self._step:g} s is unstable")
            taus.append(tau)
            states.append(y)
            self.work.guard_calls += 1
            if segment.guards(tau, y).min(initial=np.inf) < 0:
                hit = True
                break
            if watches_loads and np.any(segment.closed(tau) != closed):
                break
        self.work.steps += len(taus) - 1
        self.work.rate_calls += self._stages * (len(taus) - 1)
        self.work.starts += 1
        return Reached(np.array(taus), np.array(states), hit)


def _euler(segment: Segment, tau: float, y: Array, h: float) -> Array:
    return y + h * segment.rate(tau, y)


def _runge_kutta(segment: Segment, tau: float, y: Array, h: float) -> Array:
    k1 = segment.rate(tau, y)
    k2 = segment.rate(tau + 0.5 * h, y + 0.5 * h * k1)
    k3 = segment.rate(tau + 0.5 * h, y + 0.5 * h * k2)
    k4 = segment.rate(tau + h, y + h * k3)
    return y + h / 6 * (k1 + 2 * (k2 + k3) + k4)
