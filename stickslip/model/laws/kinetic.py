"""Kinetic friction: coefficients that fall along a Stribeck curve or follow a function, and the forces of slip."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from stickslip.model.arrays import Array, Mask, like
from stickslip.model.laws.base import Kernel
from stickslip.model.slopes import slope_by_differences

_UNDERFLOW = 745.0
_NEXT_TO_REST = 1e-100  # part of the Stribeck velocity at which a curve has the slope that it has just beside rest

# Part of the Stribeck velocity below which `Kinetic.slope` of a curve of infinite slope at rest no longer grows.
_STEEPEST = 1e-3


class Kinetic:
    """Kinetic coefficients of some contacts, ``mu_c + (mu_s - mu_c) exp(-(|w|/v_s)^delta)`` or a function.

    `curves` are laws of dry friction, one per contact. `backward` says which contacts slip backward; without it the
    sign of `w` does.
    """

    def __init__(self, curves: Sequence[Any], backward: Mask | None = None) -> None:
        static = np.array([[c.mu_s(side) for c in curves] for side in (1, -1)]).reshape(2, -1)
        level = np.array([[c.mu_c(side) for c in curves] for side in (1, -1)]).reshape(2, -1)
        velocity = [c.stribeck_velocity for c in curves]
        fall = np.where([v is not None for v in velocity], static - level, 0.0)
        if backward is not None:
            level, fall = (np.tile(np.where(backward, x[1], x[0]), (2, 1)) for x in (level, fall))
        self._level, self._fall = level, fall
        self._velocity = np.array([1.0 if v is None else v for v in velocity])
        self.exponent = np.array([c.stribeck_exponent for c in curves])
        # beyond this speed the exponential is 0; the speed is limited to it, because the power may overflow
        with np.errstate(over="ignore"):
            self._speed_limit = self._velocity * _UNDERFLOW ** (1.0 / self.exponent)
        self._steepest = np.where(self.exponent < 1, _STEEPEST * self._velocity, 0.0)
        self._isotropic = all(np.array_equal(x[0], x[1]) for x in (level, fall))
        self._bent, self._is_square = bool(fall.any()), bool((self.exponent == 2).all())
        self._functions: dict[int, Callable[[float], float]] = {
            row: c.kinetic_at for row, c in enumerate(curves) if c.kinetic is not None
        }

    def __call__(self, w: Array) -> Array:
        """Return the coefficients at `w` (k,) or (k, times)."""
        mu = self._of_side(self._level, w)
        if self._bent:
            columns = self._speed_limit, self._velocity, self.exponent
            speed_limit, velocity, exponent = columns if w.ndim == 1 else (x[:, None] for x in columns)
            ratio = np.minimum(np.abs(w), speed_limit) / velocity
            power = ratio * ratio if self._is_square else ratio**exponent
            mu = mu + self._of_side(self._fall, w) * np.exp(-power)
        if self._functions:
            mu = mu + np.zeros(w.shape)
            speeds = np.abs(w)
            for row, kinetic in self._functions.items():
                found = speeds[row]
                mu[row] = [kinetic(v) for v in found.tolist()] if w.ndim == 2 else kinetic(float(found))
        return mu

    def of_one(self, row: int, direction: int) -> Callable[[float], float]:
        """Return the coefficient of one contact in one direction as a function of its speed, in plain floats."""
        side = 1 if direction < 0 else 0
        level, fall = float(self._level[side, row]), float(self._fall[side, row])
        if row in self._functions:
            return self._functions[row]
        if fall == 0:
            return lambda speed: level
        speed_limit, velocity, exponent = (float(x[row]) for x in (self._speed_limit, self._velocity, self.exponent))
        return lambda speed: level + fall * math.exp(-((min(speed, speed_limit) / velocity) ** exponent))

    def slope(self, w: Array) -> Array:
        """Return the derivatives with respect to speed at `w` (k,) or (k, times), limited near rest to help a solver.

        With an exponent below 1 the true derivatives grow without bound towards rest. With these, Newton's method in
        the solver would step back across the rest that a contact has just left, and that would cause a storm of events.
        """
        return self._slope(w, self._steepest, _limited_slope)

    def slope_cut(self, w: Array) -> Array:
        """Return the true derivatives minus `slope`, for the same `w`; at 0 that just beside 0, where it is finite."""
        beside = np.where((w == 0) & like(self.exponent >= 1, w), like(_NEXT_TO_REST * self._velocity, w), w)
        beside[list(self._functions)] = w[list(self._functions)]
        if not (self._functions or ((like(self._steepest, w) > np.abs(w)) | (beside != w)).any()):
            return np.zeros_like(w)
        return self._slope(beside, np.zeros_like(self._steepest), _true_slope) - self.slope(w)

    def _slope(
        self, w: Array, steepest: Array, of_function: Callable[[Callable[[float], float], float], float]
    ) -> Array:
        slope = np.zeros_like(w)
        if self._bent:
            velocity, exponent = like(self._velocity, w), like(self.exponent, w)
            ratio = np.clip(np.abs(w), like(steepest, w), like(self._speed_limit, w)) / velocity
            moving = w != 0
            ratio[~moving] = 1.0
            power = ratio**exponent
            slope = -self._of_side(self._fall, w) * np.exp(-power) * exponent * power / ratio
            slope *= moving / velocity
        for row, kinetic in self._functions.items():
            speeds = np.abs(w[row]).tolist()
            slope[row] = of_function(kinetic, speeds) if w.ndim == 1 else [of_function(kinetic, v) for v in speeds]
        return slope

    def _of_side(self, values: Array, w: Array) -> Array:
        forward: Array = values[0] if w.ndim == 1 else values[0, :, None]
        if self._isotropic:
            return forward
        return np.where(w < 0, values[1] if w.ndim == 1 else values[1, :, None], forward)


def _limited_slope(kinetic: Callable[[float], float], speed: float) -> float:
    """Return the slope of a function by a difference of its values at speeds that are not negative.

    The step limits the slope near rest.
    """
    h = 1e-6 * max(speed, 1e-3)
    left, right = max(speed - h, 0.0), speed + h
    return (kinetic(right) - kinetic(left)) / (right - left)


def _true_slope(kinetic: Callable[[float], float], speed: float) -> float:
    """Return the slope of a function, also within the step of the limited one."""
    h = 1e-6 * max(speed, 1e-3)
    return slope_by_differences(kinetic, speed, -h if speed > h else h, 2 * h)


class Slipping(Kernel):
    """Slip in a known direction, with a kinetic coefficient that depends on speed.

    The solver step in which a contact comes to rest ends beyond rest, where `w` has the other sign. The curve is
    continued there by point reflection at its value at rest, so that it has no kink within the step. A curve that is
    vertical at rest is continued by its value at rest. `sign` (k,) are the directions.
    """

    def __init__(self, curves: Sequence[Any], sign: Array) -> None:
        self._sign, self._mu = sign, Kinetic(curves, sign < 0)
        self._turned = self._mu.exponent >= 1

    def forces(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        """Return ``sign mu_k N``."""
        many = w.ndim == 2
        sign, turned = (self._sign[:, None], self._turned[:, None]) if many else (self._sign, self._turned)
        speed = sign * w
        if not np.count_nonzero(speed < 0):
            return sign * self._mu(speed) * normal
        beyond = (speed < 0) & turned
        mu = self._mu(np.where(beyond, -speed, np.maximum(speed, 0.0)))
        return sign * np.where(beyond, 2 * self._mu(np.zeros_like(w)) - mu, mu) * normal

    def in_floats(self, place: int) -> Callable[[float, float], float]:
        """Return the force of one contact as a function of relative velocity and normal force."""
        sign, turned = float(self._sign[place]), bool(self._turned[place])
        mu = self._mu.of_one(place, int(sign))

        def force(w: float, normal: float) -> float:
            if normal <= 0:
                return 0.0
            speed = sign * w
            if speed >= 0:
                return sign * mu(speed) * normal
            return sign * (2 * mu(0.0) - mu(-speed) if turned else mu(0.0)) * normal

        return force

    def slopes(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        """Return the derivatives with respect to `w`."""
        return self._mu.slope(self._speed(w)) * normal

    def slope_cut(self, w: Array, normal: Array) -> Array:
        """Return the true derivatives minus `slopes`."""
        return self._mu.slope_cut(self._speed(w)) * normal

    def _speed(self, w: Array) -> Array:
        speed = like(self._sign, w) * w
        return np.where(like(self._turned, w), np.abs(speed), np.maximum(speed, 0.0))
