"""The computed points of a motion, segment by segment, and what is read off between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from stickslip.assembly import System
from stickslip.mode_set import FREE, OPEN
from stickslip.segment import Segment

__all__ = ["Piece", "interpolant", "interpolate"]

Array = NDArray[np.float64]

_LOOKS, _ROUNDOFF = 65, 1e-12
_GAINED = 1e3
"""A velocity that changes by this many times the solver's errors crosses 0 for certain."""


@dataclass(frozen=True)
class Piece:
    """The computed points of one segment, from which the segment can be built again."""

    system: System = field(repr=False)
    start: float
    stop: float
    modes: NDArray[np.int8]
    labels: NDArray[np.int8]
    since: Array
    at_rest: NDArray[np.bool_]
    taus: Array
    states: Array
    complete: bool = True
    multipliers: tuple[Array, Array] | None = None

    @classmethod
    def of(
        cls,
        segment: Segment,
        stop: float,
        labels: NDArray[np.int8],
        taus: Array,
        states: Array,
        complete: bool = True,
        multipliers: tuple[Array, Array] | None = None,
    ) -> Piece:
        """Return the computed points (rows) of a segment."""
        modes = segment.mode_set.modes
        since, at_rest = segment.since, segment.at_rest
        return cls(
            segment.system,
            segment.t,
            stop,
            modes,
            labels,
            since,
            at_rest,
            taus,
            states,
            complete,
            multipliers,
        )

    def segment(self) -> Segment:
        """Return the segment again."""
        mode_set = self.system.mode_set(self.modes.tobytes())
        return Segment(self.system, mode_set, self.start, self.states[0], self.since, self.at_rest, self.stop)

    def times(self) -> Array:
        """Return the times of the computed points."""
        t = self.start + self.taus
        t[-1] = self.stop
        return t

    def forces(self, segment: Segment, taus: Array, y: Array) -> Array:
        """Return the friction forces of all contacts (rows) at local times, from the states (columns) there."""
        system = self.system
        mode_set = segment.mode_set
        forces = np.zeros((system.m, taus.size))
        normals = segment.normals(taus)
        forces[mode_set.slip] = mode_set.kinetic[mode_set.slip][:, None] * normals[mode_set.slip]
        if mode_set.acting.size:
            forces[mode_set.acting] = segment.acting_forces(taus, y)
        if self.multipliers is not None and mode_set.stuck.size:
            forces[mode_set.stuck] = CubicHermiteSpline(self.taus, *self.multipliers)(taus).T
        elif mode_set.stuck.size:
            first = mode_set.slip.size
            forces[mode_set.stuck] = segment.watched(taus, y)[first : first + mode_set.stuck.size]
        return forces

    def mode(self, segment: Segment, j: int, taus: Array, y: Array) -> Array:
        """Return the modes of a contact at local times, from the states (columns) there."""
        if self.modes[j] < OPEN:
            return np.full(taus.size, self.labels[j])
        w = segment.relative_velocity(taus, y)
        if self.modes[j] == FREE:
            return segment.system.sign_of(w)[j]
        sign = np.sign(w[j])
        sign[taus == 0.0] = self.labels[j]
        near = (np.abs(w[j]) <= segment.system.quiet) & (taus > 0.0)
        if near.any():
            sign[near] = self._mode_near_rest(segment, j, taus, w[j], y)[near]
        return sign

    def _mode_near_rest(self, segment: Segment, j: int, taus: Array, w: Array, y: Array) -> Array:
        """Return the modes of an open contact whose velocity the solver's errors hide at some of the times.

        It keeps its mode, also where its velocity dies away: only one that comes out on the other side has changed.
        """
        known, velocity = [taus, self.taus], [w, segment.relative_velocity(self.taus, self.states.T)[j]]
        if self.complete:
            known.append(np.linspace(0.0, float(self.taus[-1]), _LOOKS))
            states = interpolate(segment, self.taus, self.states, known[-1])
            velocity.append(segment.relative_velocity(known[-1], states.T)[j])
        times, values = np.concatenate(known), np.concatenate(velocity)
        order = np.argsort(times, kind="stable")
        times, values = times[order], values[order]
        sure = np.abs(values) > segment.system.quiet
        times, signs = times[sure], np.sign(values[sure])
        signs = np.concatenate([[self.labels[j]], signs, [0.0]])
        place = np.searchsorted(times, taus, side="right")
        before, after = signs[place], signs[place + 1]
        crossing = (before * after < 0) | ((before == 0) & (place < times.size))
        modes = np.where(crossing, np.sign(w), before)
        # at the crossing itself it is named after the acceleration
        system = segment.system
        rates = np.column_stack([segment.rate(float(tau), y[:, i]) for i, tau in enumerate(taus)])
        driven = np.column_stack([segment.drive_acceleration(float(tau)) for tau in taus])
        acceleration = (system.W @ rates + system.D @ driven)[j]
        gained = np.abs(acceleration) * (self.stop - self.start)
        at = (np.abs(w) <= _ROUNDOFF * np.maximum(gained, np.abs(values).max())) & (
            gained > _GAINED * system.quiet
        )
        return np.where(at, np.sign(acceleration), modes)

    def displacement(self, segment: Segment, i: int, taus: Array) -> Array:
        """Return the integral of body i's velocity from the start, by three-point Gauss on each step."""
        knots, system = self.taus, self.system
        if segment.has_curved:
            # a quadratic motion has few computed points, whatever a curved drive does between them
            knots = np.union1d(knots, segment.looks(float(knots[-1]), 1))
        nodes, weights = np.polynomial.legendre.leggauss(3)

        def integral(left: Array, right: Array) -> Array:
            middle, half = 0.5 * (left + right), 0.5 * (right - left)
            points = np.clip(middle[:, None] + half[:, None] * nodes, 0.0, knots[-1])
            flat = points.ravel()
            if i < system.n:
                velocity = interpolate(segment, self.taus, self.states, flat)[:, i]
            else:
                velocity = segment.inputs(flat)[system.first_drive + i - system.n]
            return half * (velocity.reshape(points.shape) @ weights)

        whole = np.concatenate([[0.0], np.cumsum(integral(knots[:-1], knots[1:]))])
        step = np.clip(np.searchsorted(knots, taus, side="right") - 1, 0, max(knots.size - 2, 0))
        return whole[step] + integral(knots[step], taus)


def interpolate(segment: Segment, knots: Array, states: Array, taus: Array) -> Array:
    """Return the states (rows) of a segment at local times `taus`, from its computed points."""
    return interpolant(segment, knots, states)(taus)


def interpolant(segment: Segment, knots: Array, states: Array) -> Callable[[Array], Array]:
    """Return the states (rows) of a segment as a function of local times, from its computed points."""
    between = segment.states if segment.quadratic else segment.between(knots, states)

    def at(taus: Array) -> Array:
        found = between(taus)
        if taus.size:
            segment.exact_velocities(taus, found)
        return found

    return at
