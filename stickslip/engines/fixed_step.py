"""Fixed steps, as real-time simulators take them: modes change at the ends of steps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stickslip.engines.base import Method, Task
from stickslip.engines.stability import Stability, Unstable
from stickslip.engines.work import LOOK_AT_SCENE, Interrupted, SolverFailure, Work
from stickslip.equations.guards.guards import Guards
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.model.arrays import Array

# Steps taken before the guards are looked at, all at once: few after an event, more as the modes last.
_FEWEST, _MOST = 4, 64


@dataclass(frozen=True)
class Scheme:
    """A method of fixed steps."""

    name: str
    # ``take(rates, stage, y, h)`` returns the state after a step of length h
    take: Callable[[_Rates, int, Array, float], Array]
    stages: int  # rates per step
    times: int  # 2 where a stage lies in the middle of the step, else 1
    # coefficients of ``R(z)``, the highest power first: a step h turns ``y' = z y / h`` into ``R(z) y``
    growth: tuple[float, ...]


class FixedStep:
    """The classical Runge-Kutta method of order 4, or Euler's, with a given step."""

    def __init__(self, task: Task, scheme: Scheme) -> None:
        self._scheme, self._step, self._interruption = scheme, task.step, task.interruption
        self._stability = Stability(scheme.growth)
        self.work = Work()

    def advance(self, motion: Motion, guards: Guards, horizon: float) -> Path:
        """Step until a guard is violated, a contact opens or closes, or local time `horizon` is reached."""
        count = max(1, math.ceil(horizon / self._step * (1 - 1e-12)))
        taken = _Taken(motion)
        done, some, hit, over = 0, _FEWEST, False, False
        self._check(motion, min(self._step, horizon), taken)
        while done < count and not over:
            ends: Array = self._step * np.arange(done, min(done + some, count) + 1, dtype=np.float64)
            if done + some >= count:
                ends[-1] = horizon
            ys = self._try_steps(motion, ends, taken)
            kept, hit, over = self._until_a_change(motion, guards, ends, ys)
            taken.add(ends[1 : kept + 1], ys[:kept])
            self.work.steps += kept
            if not over and kept < ends.size - 1:
                raise self._failure("the states grow without limit", taken)
            self._check(motion, min(self._step, horizon), taken)
            done, some = done + kept, min(2 * some, _MOST)
        return taken.path(hit)

    def _check(self, motion: Motion, h: float, taken: _Taken) -> None:
        """Raise an error where the step is too long for the points computed last."""
        try:
            self._stability.check(motion, h, *taken.last_points())
        except Unstable as reason:
            raise self._failure(str(reason), taken) from reason

    def _failure(self, reason: str, taken: _Taken) -> SolverFailure:
        sentence = f"the {self._scheme.name} step of {self._step:g} s is unstable: {reason}"
        return SolverFailure(sentence, "shorten the step, or use BDF", taken.path(False))

    def _try_steps(self, motion: Motion, ends: Array, taken: _Taken) -> Array:
        """Take some steps; where that fails or is interrupted, hand over what was computed before."""
        if self._interruption.show is not None:
            self._interruption.show(float(ends[0]))
        if self._interruption.pressed:
            raise Interrupted(taken.path(False))
        try:
            return self._steps(motion, ends, taken.states[-1][-1])
        except (ArithmeticError, ValueError) as fault:
            raise SolverFailure(str(fault), LOOK_AT_SCENE, taken.path(False)) from fault

    def _steps(self, motion: Motion, ends: Array, y: Array) -> Array:
        """Return the states (rows) at the ends of steps in fixed modes."""
        count, times = ends.size - 1, self._scheme.times
        stages = np.empty(times * count + 1)
        stages[::times] = ends
        if times == 2:
            stages[1::2] = 0.5 * (ends[:-1] + ends[1:])
        rates = _Rates(motion, stages)
        ys = np.empty((count, y.size))
        with np.errstate(over="ignore", invalid="ignore"):
            for k, h in enumerate(np.diff(ends).tolist()):
                y = ys[k] = self._scheme.take(rates, times * k, y, h)
            ys = np.ascontiguousarray(motion.exact(ends[1:], ys.T).T)
        self.work.rate_calls += self._scheme.stages * count
        return ys

    def _until_a_change(self, motion: Motion, guards: Guards, ends: Array, ys: Array) -> tuple[int, bool, bool]:
        """Return how many steps are valid, whether a guard ended them, and whether anything did."""
        sound = int(np.append(np.isfinite(ys).all(axis=1), False).argmin())
        taus, ys = ends[1 : sound + 1], ys[:sound]
        self.work.guard_calls += sound
        values = guards.values(taus, ys.T)
        # an open row that turns over counts, too: then its label changes
        violated = values.min(axis=0, initial=np.inf) < 0
        changed = violated | motion.has_left(taus, ys.T)
        if guards.in_band.size:
            changed |= (guards.beyond_bands(taus, ys.T) > 0).any(axis=0)
        if not motion.segment.is_straight:
            alive = motion.system.alive[:, None]
            now = (motion.loads(0.0)[: motion.system.m] > 0)[:, None] & alive
            later = motion.loads(taus)[: motion.system.m] > 0
            changed |= np.any((later & alive) != now, axis=0)
        if changed.any():
            first = int(changed.argmax())
            return first + 1, bool(violated[first]), True
        return sound, False, False


class _Taken:
    """Points taken so far."""

    def __init__(self, motion: Motion) -> None:
        self._motion = motion
        self.taus, self.states = [np.zeros(1)], [motion.y[None, :]]

    def add(self, taus: Array, states: Array) -> None:
        self.taus.append(taus)
        self.states.append(states)

    def last_points(self) -> tuple[Array, Array]:
        """Return the points added last, and the one before: between two points a contact may pass through rest."""
        if not self.taus[1:]:
            return self.taus[0], self.states[0]
        return (
            np.concatenate([self.taus[-2][-1:], self.taus[-1]]),
            np.concatenate([self.states[-2][-1:], self.states[-1]]),
        )

    def path(self, hit: bool) -> Path:
        """Return the path of cubics that have the states and rates at both ends of each step."""
        motion = self._motion
        taus, states = np.concatenate(self.taus), np.concatenate(self.states)
        fine = np.isfinite(states).all(axis=1)
        rates = np.zeros_like(states)
        with np.errstate(over="ignore", invalid="ignore"):
            rates[fine] = motion.rate(taus[fine], states[fine].T).T
        h = np.diff(taus)[:, None]
        rise = np.diff(states, axis=0)
        first, second = h * rates[:-1], h * rates[1:]
        coefficients = np.stack([states[:-1], first, 3 * rise - 2 * first - second, first + second - 2 * rise], axis=1)
        return Path(taus, coefficients, states[-1], hit)


class _Rates:
    """The rates at times known beforehand: inputs are evaluated for all of them at once."""

    def __init__(self, motion: Motion, taus: Array) -> None:
        self._motion, self._taus, self._inputs = motion, taus, None
        depends = motion.has_law or motion.dependence is not None
        self._in_floats = motion.in_floats if depends else None
        if not depends:
            responses = motion.equations.respond(motion.inputs(taus, motion.y))[: motion.y.size]
            self._inputs = list(np.ascontiguousarray(responses.T))

    def __call__(self, stage: int, y: Array) -> Array:
        """Return the rates at the time of a stage."""
        if self._inputs is not None:
            return np.asarray(self._motion.equations.apply(y)[: y.size] + self._inputs[stage])
        if self._in_floats is None:
            return self._motion.rate(float(self._taus[stage]), y)
        found = np.empty(y.size)
        self._in_floats(float(self._taus[stage]), y, found)
        return found


def _euler(rate: _Rates, stage: int, y: Array, h: float) -> Array:
    return y + h * rate(stage, y)


def _runge_kutta(rate: _Rates, stage: int, y: Array, h: float) -> Array:
    half = 0.5 * h
    k1 = rate(stage, y)
    k2 = rate(stage + 1, y + half * k1)
    k3 = rate(stage + 1, y + half * k2)
    k4 = rate(stage + 2, y + h * k3)
    return y + h / 6 * (k1 + 2 * (k2 + k3) + k4)


_RK4 = Scheme("RK4", _runge_kutta, 4, 2, (1 / 24, 1 / 6, 1 / 2, 1.0, 1.0))
_EULER = Scheme("Euler", _euler, 1, 1, (1.0, 1.0))
RK4 = Method("RK4 with fixed steps", lambda task: FixedStep(task, _RK4), takes_steps=True)
EULER = Method("Euler with fixed steps", lambda task: FixedStep(task, _EULER), takes_steps=True)
