"""The computed points of a motion, segment by segment, and what is read off between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from stickslip.assembly import System
from stickslip.mode_set import FREE, OPEN
from stickslip.segment import Segment
from stickslip.steps import Points, read_off

__all__ = ["Piece", "interpolant", "interpolate"]

Array = NDArray[np.float64]


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
    inner: Array | None = None

    @classmethod
    def of(
        cls,
        segment: Segment,
        stop: float,
        labels: NDArray[np.int8],
        taus: Array,
        states: Array,
        complete: bool = True,
        inner: Array | None = None,
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
            inner,
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
        if mode_set.stuck.size:
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
        return sign

    def displacement(self, segment: Segment, i: int, taus: Array) -> Array:
        """Return the integral of body i's velocity from the start, by Gauss, exact for the polynomials of the steps."""
        knots, system = self.taus, self.system
        if segment.has_curved:
            # a quadratic motion has few computed points, whatever a curved drive does between them
            knots = np.union1d(knots, segment.looks(float(knots[-1]), 1))
        degree = 5 if self.inner is None else self.inner.shape[1] + 1
        nodes, weights = np.polynomial.legendre.leggauss(degree // 2 + 1)

        def integral(left: Array, right: Array) -> Array:
            middle, half = 0.5 * (left + right), 0.5 * (right - left)
            points = np.clip(middle[:, None] + half[:, None] * nodes, 0.0, knots[-1])
            flat = points.ravel()
            if i < system.n:
                velocity = interpolate(segment, self, flat)[:, i]
            else:
                velocity = segment.inputs(flat)[system.first_drive + i - system.n]
            return half * (velocity.reshape(points.shape) @ weights)

        whole = np.concatenate([[0.0], np.cumsum(integral(knots[:-1], knots[1:]))])
        step = np.clip(np.searchsorted(knots, taus, side="right") - 1, 0, max(knots.size - 2, 0))
        return whole[step] + integral(knots[step], taus)


def interpolate(segment: Segment, points: Points, taus: Array) -> Array:
    """Return the states (rows) of a segment at local times `taus`, from its computed points."""
    return interpolant(segment, points)(taus)


def interpolant(segment: Segment, points: Points) -> Callable[[Array], Array]:
    """Return the states (rows) of a segment as a function of local times, from its computed points."""
    if segment.quadratic:
        between: Callable[[Array], Array] = segment.states
    elif points.inner is not None:
        between = partial(read_off, points)
    else:
        between = segment.between(points.taus, points.states)

    def at(taus: Array) -> Array:
        found = between(taus)
        if taus.size:
            segment.exact_velocities(taus, found)
        return found

    return at
