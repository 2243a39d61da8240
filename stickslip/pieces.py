"""The computed points of a motion, segment by segment, and what is read off between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stickslip.assembly import System
from stickslip.mode_set import FREE, OPEN
from stickslip.segment import Segment

__all__ = ["Piece", "interpolant", "interpolate", "mode_shown"]

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
    multipliers: tuple[Array, Array] | None = None
    parabola: tuple[Array, Array] | None = None
    """First and second derivatives of the states, where the motion is exactly quadratic in time."""

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
            (segment.f0, segment.f1) if segment.quadratic and complete else None,
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

    def states_at(self, taus: Array) -> Array:
        """Return the states (rows) at local times; a quadratic motion needs no equations for it."""
        if self.parabola is not None and not self._is_driven:
            f0, f1 = self.parabola
            tau = taus[:, None]
            return self.states[0] + tau * (f0 + (0.5 * tau) * f1)
        return interpolate(self.segment(), self.taus, self.states, taus)

    @property
    def _is_driven(self) -> bool:
        """Whether any contact is stuck to a drive, so that velocities are read from that."""
        system, stuck = self.system, self.modes == 0
        ends = np.maximum(system.a[stuck], system.b[stuck])
        return bool(np.any((ends >= system.n) & (ends < system.n + system.drives)))

    def mode(self, segment: Segment, j: int, taus: Array, y: Array) -> NDArray[np.int8]:
        """Return the modes of a contact at local times, from the states (columns) there."""
        codes, labels = (np.full(taus.size, values[j]) for values in (self.modes, self.labels))
        w = segment.relative_velocity(taus, y)[j]
        return mode_shown(codes, labels, w, float(self.system.coefficients.velocity[j]), taus)

    def displacements(self, bodies: NDArray[np.intp], taus: Array) -> tuple[Array, Array]:
        """Return how far bodies go within the piece, and how far (columns) by local times: three-point Gauss."""
        segment, last = self.segment(), float(self.taus[-1])
        wanted = np.minimum(taus, last)
        # a quadratic motion has few computed points, whatever a curved drive does between them
        edges = np.unique(np.concatenate([self.taus, segment.looks(last, 1), wanted]))
        nodes, weights = np.polynomial.legendre.leggauss(3)
        middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
        points = (middle[:, None] + half[:, None] * nodes).ravel()
        velocity = interpolate(segment, self.taus, self.states, points)[:, bodies]
        steps = half[:, None] * np.einsum("skb,k->sb", velocity.reshape(-1, nodes.size, bodies.size), weights)
        sums = np.concatenate([np.zeros((1, bodies.size)), np.cumsum(steps, axis=0)])
        return sums[-1], sums[np.searchsorted(edges, wanted)].T


def mode_shown(
    codes: NDArray[np.int8], labels: NDArray[np.int8], w: Array, limit: float, taus: Array
) -> NDArray[np.int8]:
    """Return the modes of a contact at many times, from the states of its equations and its relative velocity.

    Parameters
    ----------
    codes, labels : array (n,)
        Modes with OPEN and FREE among them, and the modes shown at the start of each time's segment.
    w : array (n,)
        Relative velocity in m/s or rad/s.
    limit : float
        Relative velocity up to which a law without modes counts as stuck.
    taus : array (n,)
        Times in s since the start of each time's segment.
    """
    shown = labels.astype(np.int8)
    free, turning = codes == FREE, (codes == OPEN) & (taus != 0.0)
    shown[free] = np.where(np.abs(w[free]) > limit, np.sign(w[free]), 0.0)
    shown[turning] = np.sign(w[turning])
    return shown


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
