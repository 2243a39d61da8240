"""Fixed steps, as a real-time simulator takes them: mode changes at step ends, velocities projected there."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from stickslip.assembly import System
from stickslip.engine import Engine
from stickslip.segment import Segment
from stickslip.solving import LOOK_AT_SCENE, Interrupted, Reached, SolverFailure
from stickslip.stability import Stability, Unstable

__all__ = ["FixedStepEngine"]

Array = NDArray[np.float64]

_FEWEST, _MOST = 4, 64
"""Steps taken before the guards are looked at, all at once: few after an event, more as the modes last."""


class FixedStepEngine(Engine):
    """The classical Runge-Kutta method of order 4, or Euler's, with a given step.

    Parameters
    ----------
    system : System
    method : str
        "RK4" or "Euler".
    step : float
        Step in s.
    """

    def __init__(self, system: System, method: str, step: float) -> None:
        """Choose the method."""
        super().__init__(system, method, 1e-8, np.full(system.size, 1e-8), math.inf)
        self._step, self._stability = step, Stability(method)
        self._take: Callable[[_Rates, int, Array, float], Array]
        self._take, self._stages, self._times = (_runge_kutta, 4, 2) if method == "RK4" else (_euler, 1, 1)

    def advance(self, segment: Segment, horizon: float) -> Reached:
        """Step until a guard is violated, a contact opens or closes, or local time `horizon` is reached."""
        count = max(1, math.ceil(horizon / self._step * (1 - 1e-12)))
        taus, states = [np.zeros(1)], [segment.y[None, :]]
        done, some, hit, over = 0, _FEWEST, False, False
        self.work.starts += 1
        self._check(segment, min(self._step, horizon), taus, states)
        while done < count and not over:
            ends: Array = self._step * np.arange(done, min(done + some, count) + 1, dtype=np.float64)
            if done + some >= count:
                ends[-1] = horizon
            ys = self._try_steps(segment, ends, taus, states)
            kept, hit, over = self._until_a_change(segment, ends, ys)
            taus.append(ends[1 : kept + 1])
            states.append(ys[:kept])
            self.work.steps += kept
            if not over and kept < ends.size - 1:
                raise self._failure("the states grow without limit", taus, states)
            self._check(segment, min(self._step, horizon), taus, states)
            done, some = done + kept, min(2 * some, _MOST)
        return _joined(taus, states, hit)

    def _check(self, segment: Segment, h: float, taus: list[Array], states: list[Array]) -> None:
        """Raise an error where the step is too long for the points computed last."""
        if not taus[-1].size:
            return
        # the one before belongs to them: between two points a contact may pass through rest
        last = [
            np.concatenate([parts[-2][-1:], parts[-1]]) if parts[1:] else parts[0] for parts in (taus, states)
        ]
        try:
            self._stability.check(segment, h, *last)
        except Unstable as reason:
            raise self._failure(str(reason), taus, states) from reason

    def _failure(self, reason: str, taus: list[Array], states: list[Array]) -> SolverFailure:
        sentence = f"the {self._method} step of {self._step:g} s is unstable: {reason}"
        return SolverFailure(sentence, "shorten the step, or use BDF", _joined(taus, states, hit=False))

    def _try_steps(self, segment: Segment, ends: Array, taus: list[Array], states: list[Array]) -> Array:
        """Take some steps; where that fails or is interrupted, hand over what was computed before."""
        if self.show is not None:
            self.show(float(ends[0]))
        if self.interruption.pressed:
            raise Interrupted(_joined(taus, states, hit=False))
        try:
            return self._steps(segment, ends, states[-1][-1])
        except (ArithmeticError, ValueError) as fault:
            raise SolverFailure(str(fault), LOOK_AT_SCENE, _joined(taus, states, hit=False)) from fault

    def _steps(self, segment: Segment, ends: Array, y: Array) -> Array:
        """Return the states (rows) at the ends of steps in fixed modes."""
        count, times = ends.size - 1, self._times
        stages = np.empty(times * count + 1)
        stages[::times] = ends
        if times == 2:
            stages[1::2] = 0.5 * (ends[:-1] + ends[1:])
        rates = _Rates(segment, stages)
        ys = np.empty((count, y.size))
        with np.errstate(over="ignore", invalid="ignore"):
            for k, h in enumerate(np.diff(ends).tolist()):
                y = ys[k] = self._take(rates, times * k, y, h)
        self.work.rate_calls += self._stages * count
        return ys

    def _until_a_change(self, segment: Segment, ends: Array, ys: Array) -> tuple[int, bool, bool]:
        """Return how many steps hold, whether a guard ended them, and whether anything did."""
        sound = int(np.append(np.isfinite(ys).all(axis=1), False).argmin())
        taus, ys = ends[1 : sound + 1], ys[:sound]
        self.work.guard_calls += sound
        violated = segment.guards(taus, ys.T).min(axis=0, initial=np.inf) < 0
        changed = violated
        if segment.has_curved:
            pressed = (segment.normals(taus) > 0) & segment.system.alive[:, None]
            changed = violated | np.any(pressed != segment.closed(0.0)[:, None], axis=0)
        if changed.any():
            first = int(changed.argmax())
            return first + 1, bool(violated[first]), True
        return sound, False, False


def _joined(taus: list[Array], states: list[Array], hit: bool) -> Reached:
    return Reached(np.concatenate(taus), np.concatenate(states), hit)


class _Rates:
    """The rates at times known beforehand: inputs are evaluated for all of them at once.

    Parameters
    ----------
    segment : Segment
    taus : array (k,)
        Local times of the stages.
    """

    def __init__(self, segment: Segment, taus: Array) -> None:
        """Evaluate the inputs."""
        mode_set = self._mode_set = segment.mode_set
        q = segment.inputs(taus)
        responses = np.array([mode_set.respond(column) for column in np.ascontiguousarray(q.T)])
        self._inputs = list(responses[:, : segment.y.size])
        self._has_law = segment.has_law
        if self._has_law:
            rest = np.zeros((segment.y.size, taus.size))
            w, normal, lag, _ = (
                list(np.ascontiguousarray(term.T)) for term in segment.acting_terms(taus, rest)
            )
            self._w, self._normal, self._lag = w, normal, lag

    def __call__(self, stage: int, y: Array) -> Array:
        """Return the rates at the time of a stage."""
        mode_set = self._mode_set
        rate = mode_set.A @ y
        rate += self._inputs[stage]
        if self._has_law:
            law, places = mode_set.law, mode_set.bristle_places
            w, normal, z = mode_set.acting_rows @ y, self._normal[stage], y[places]
            w += self._w[stage]
            rate += mode_set.K @ law.forces(w, normal, self._lag[stage], z)
            if places.size:
                rate[places] = law.bristle_rates(w, normal, z)
        return rate


def _euler(rate: _Rates, stage: int, y: Array, h: float) -> Array:
    return y + h * rate(stage, y)


def _runge_kutta(rate: _Rates, stage: int, y: Array, h: float) -> Array:
    half = 0.5 * h
    k1 = rate(stage, y)
    k2 = rate(stage + 1, y + half * k1)
    k3 = rate(stage + 1, y + half * k2)
    k4 = rate(stage + 2, y + h * k3)
    return y + h / 6 * (k1 + 2 * (k2 + k3) + k4)
