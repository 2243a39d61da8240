"""The times at which a trajectory is read: fit for a plot, as the solver stepped, or evenly spaced."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from stickslip.equations.path import whole_integrals
from stickslip.equations.system import System
from stickslip.model.arrays import Array, Indices
from stickslip.results.patchwork import Patchwork
from stickslip.results.samples import Samples
from stickslip.results.trajectory import Trajectory

_STRAIGHT = 1e-3  # how far straight lines between the times may be off, as a part of each quantity's range
_NOTHING = 1e-9  # a range below this part of the largest value of its kind is roundoff, and needs no more times
_MOST_PARTS = 200


def fit_for_plot(trajectory: Trajectory) -> Samples:
    """Return a trajectory at times so close that straight lines between them look like the motion.

    Within a step of length 1 a straight line over a part ``1/k`` is off by at most ``max|y''| / (8 k^2)``. The second
    derivative is bounded by the coefficients of the step's polynomial. Velocities and positions are right to 1e-3 of
    their ranges, also positions that are no states. Every event stands twice, with its left and its right limit, and
    all ends of steps are kept.
    """
    return Samples.at_local(trajectory, *_fit(trajectory))


def at_steps(trajectory: Trajectory) -> Samples:
    """Return a trajectory at the ends of the solver's steps; every event stands twice, with its two limits."""
    taus = [trajectory.steps(k) for k in range(len(trajectory.pieces))]
    piece_of = np.repeat(np.arange(len(taus)), [local.size for local in taus]).astype(np.intp)
    return Samples.at_local(trajectory, piece_of, np.concatenate([np.empty(0), *taus]))


def refined(trajectory: Trajectory, points: int) -> Samples:
    """Return a trajectory at the times fit for a plot and at about `points` more, evenly spaced."""
    durations = trajectory.stops - trajectory.starts
    least = 16 if 16 * durations.size <= points else 1
    parts = np.maximum(np.rint(points * durations / (durations.sum() or 1.0)), least)
    bounds = np.column_stack([np.zeros(durations.size), trajectory.ends])
    both = np.column_stack([parts, np.ones(parts.size)]).astype(np.intp)
    more = _cut(bounds.ravel(), both.ravel(), np.full(durations.size, 2))
    piece_of, taus = map(np.concatenate, zip(_fit(trajectory), more, strict=True))
    order = np.lexsort((taus, piece_of))
    piece_of, taus = piece_of[order], taus[order]
    is_new = np.append(True, (np.diff(piece_of) > 0) | (np.diff(taus) > 0))[: taus.size]
    return Samples.at_local(trajectory, piece_of[is_new], taus[is_new])


def _fit(trajectory: Trajectory) -> tuple[Indices, Array]:
    """Return the pieces and local times fit for a plot."""
    patchworks = trajectory.patchworks
    steps = _step_ranges(trajectory)
    allowed = _allowed(trajectory, steps, patchworks)
    worst = [(bends / allowed).max(axis=1, initial=0.0) for bends in steps.bends]
    parts = _clipped(np.concatenate([np.empty(0), *worst]))
    if not patchworks:
        return _cut(steps.begins, parts, steps.counts)
    found = [(steps.begins, parts, steps.counts)]
    found += [_of_patchwork(part, trajectory.system, allowed) for part in patchworks]
    piece, taus = _cut(*map(np.concatenate, zip(*found, strict=True)))
    piece = np.concatenate(trajectory.numbers)[piece]
    order = np.argsort(piece, kind="stable")
    return piece[order], taus[order]


def _cut(bounds: Array, parts: Indices, counts: Indices) -> tuple[Indices, Array]:
    """Return pieces and local times: the bounds of steps, and evenly spaced times within each.

    `bounds` are the local times between the steps, one piece after the other, and `counts` how many each piece has.
    The step after each of them is cut into as many parts as `parts` says; it is 1 for the last of a piece, which no
    step follows.
    """
    lengths = np.zeros(bounds.size)
    lengths[:-1] = bounds[1:] - bounds[:-1]
    step = np.arange(bounds.size).repeat(parts)
    inner = np.arange(step.size) - (parts.cumsum() - parts)[step]
    taus = bounds[step] + lengths[step] * (inner / parts[step])
    return np.arange(counts.size).repeat(counts)[step], taus


def _of_patchwork(part: Patchwork, system: System, allowed: Array) -> tuple[Array, Indices, Indices]:
    """Return bounds, parts and counts of a patchwork, as `_cut` needs them."""
    n = system.n
    distance = allowed[system.size :].copy()
    np.minimum.at(distance, system.moved, allowed[system.moved_state])
    begins, piece = part.steps
    # in `bounds`, the begins of the steps of a piece are followed by its end
    place = np.arange(begins.size) + piece
    counts = np.bincount(piece) + 1
    bounds, parts = np.empty(begins.size + counts.size), np.ones(begins.size + counts.size, dtype=np.intp)
    bounds[place], parts[place] = begins - part.starts[piece], _clipped(part.worst(allowed[:n], distance))
    bounds[np.cumsum(counts) - 1] = part.durations
    return bounds, parts, counts


def _clipped(worst: Array) -> Indices:
    return np.minimum(np.maximum(np.ceil(np.sqrt(worst)), 1), _MOST_PARTS).astype(np.intp)


class _StepRanges(NamedTuple):
    """What the choice of times needs to know of the steps of paths.

    Quantities are the states, followed by the positions of all bodies.
    """

    begins: Array  # (k,): local time in s at which each step begins; the last step of a path has length 0
    counts: Indices  # (p,): how many steps each path has
    distances: Array  # (k, n): how far the bodies come in each step
    # (steps, quantities) of each block of steps: bounds of second derivatives, with each step scaled to length 1; they
    # are large, and stay apart
    bends: tuple[Array, ...]
    # (blocks, states): smallest and largest values
    low: Array
    high: Array


def _step_ranges(trajectory: Trajectory) -> _StepRanges:
    """Return ranges and bounds in the steps of all paths."""
    n, size = trajectory.system.n, trajectory.system.size
    none = np.full((1, size), np.inf)
    found, bends = [(np.empty(0), np.empty(0, dtype=np.intp), np.empty((0, n)), none, -none)], []
    for steps in trajectory.whole.steps:
        h = steps.lengths[:, None]
        values_and_integral, derivatives = _weights(steps.coefficients.shape[1], steps.is_chebyshev)
        values = values_and_integral @ steps.coefficients
        sizes = derivatives @ np.abs(steps.coefficients)
        bends.append(np.concatenate([sizes[:, 0], sizes[:, 1, :n] * h], axis=1))
        low, high = (extreme(extreme(values, axis=0)[:-1], axis=0)[None] for extreme in (np.min, np.max))
        found.append((steps.begins, steps.counts, values[:, -1, :n] * h, low, high))
    begins, counts, distances, low, high = map(np.concatenate, zip(*found, strict=True))
    return _StepRanges(begins, counts, distances, tuple(bends), low, high)


def _allowed(trajectory: Trajectory, steps: _StepRanges, patchworks: Sequence[Patchwork]) -> Array:
    """Return for each quantity how large its second derivative may be in a step of length 1."""
    system = trajectory.system
    n, size = system.n, system.size
    travel = _travel(trajectory, steps, patchworks)
    low = np.concatenate([steps.low.min(axis=0), travel.min(axis=0, initial=0.0)])
    high = np.concatenate([steps.high.max(axis=0), travel.max(axis=0, initial=0.0)])
    for part in patchworks:
        (slow, near), (fast, far) = part.ranges
        low[:n], high[:n] = np.minimum(low[:n], slow), np.maximum(high[:n], fast)
        low[system.moved_state] = np.minimum(low[system.moved_state], near[system.moved])
        high[system.moved_state] = np.maximum(high[system.moved_state], far[system.moved])
    # states of which no value is known have a range below 0
    ranges, largest = high - low, np.maximum(-low, high)
    # largest values of three kinds: velocities, other states (there may be none), positions
    of_group = np.maximum.reduceat(largest, [0, n, size]).repeat([n, size - n, n])
    np.maximum(ranges, _NOTHING * of_group, out=ranges)
    return np.where(ranges > 0, 8 * _STRAIGHT * ranges, np.inf)


def _travel(trajectory: Trajectory, steps: _StepRanges, patchworks: Sequence[Patchwork]) -> Array:
    """Return how far the bodies have come by the ends of steps, and their extremes in patchworks, a line each."""
    if not patchworks:
        return steps.distances.cumsum(axis=0)
    # the motion over each patchwork is inserted as one more step
    is_patchwork = np.array([isinstance(part, Patchwork) for part in trajectory.parts])
    before = np.append(0, steps.counts.cumsum())[(~is_patchwork).cumsum()[is_patchwork]]
    gone = np.array([part.at_ends[1] - part.at_ends[0] for part in patchworks])
    distances = np.insert(steps.distances, before, gone, axis=0) if steps.distances.size else gone
    come = distances.cumsum(axis=0)
    starts = come[before + np.arange(before.size)] - gone - [part.at_ends[0] for part in patchworks]
    extremes = np.array([[extreme[1] for extreme in part.ranges] for part in patchworks])
    return np.concatenate([come, *(starts[:, None] + extremes)])


@lru_cache(maxsize=64)
def _weights(count: int, is_chebyshev: bool) -> tuple[Array, Array]:
    """Return two matrices for coefficients of polynomials ``p_j(s)``, s from 0 to 1: ``s^j`` or ``T_j(2 s - 1)``.

    The first one times the coefficients gives the values at a few places and the integral. The second one times their
    absolute values gives bounds of the second and of the first derivative.
    """
    j, places = np.arange(count, dtype=float), np.linspace(0.0, 1.0, 5)
    whole = whole_integrals(count, is_chebyshev)
    if is_chebyshev:
        values = np.polynomial.chebyshev.chebvander(2 * places - 1, count - 1)
        return np.vstack([values, whole]), np.vstack([4 * j**2 * (j**2 - 1) / 3, 2 * j**2])
    values = np.polynomial.polynomial.polyvander(places, count - 1)
    return np.vstack([values, whole]), np.vstack([j * (j - 1), j])
