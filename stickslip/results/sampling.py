"""At which times a trajectory is read: fit for a plot, as the solver stepped, or evenly spaced."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from stickslip.equations.path import Path
from stickslip.equations.system import System
from stickslip.model.arrays import Array, Indices
from stickslip.results.patchwork import Patchwork
from stickslip.results.samples import Samples
from stickslip.results.trajectory import Piece, Trajectory, alike, kind_of

_STRAIGHT = 1e-3
"""How far straight lines between the times may be off, as a part of each quantity's range."""

_NOTHING = 1e-9
"""A range below this part of the largest one is roundoff and no reason for more times."""

_MOST_PARTS = 200


def fit_for_plot(trajectory: Trajectory) -> Samples:
    """Return a trajectory at times so close that straight lines between them look like it.

    Within a step of length 1 a straight line over a part ``1/k`` is off by at most ``max|y''| / (8 k^2)``. The second
    derivative is bounded by the coefficients of the step's polynomial. Velocities and positions are right to 1e-3 of
    their ranges, also positions that are no states. Both limits stand at every event, and all ends of steps are kept.
    """
    return Samples.at_local(trajectory, *_fit(trajectory))


def at_steps(trajectory: Trajectory) -> Samples:
    """Return a trajectory at the ends of the solver's steps, both limits at every event."""
    taus = [trajectory.steps(k) for k in range(len(trajectory.pieces))]
    piece_of = np.repeat(np.arange(len(taus)), [local.size for local in taus]).astype(np.intp)
    return Samples.at_local(trajectory, piece_of, np.concatenate([np.empty(0), *taus]))


def refined(trajectory: Trajectory, points: int = 1500) -> Samples:
    """Return a trajectory at the times fit for a plot and at about `points` more, evenly spaced."""
    durations = trajectory.stops - trajectory.starts
    least = 16 if 16 * durations.size <= points else 1
    counts = np.maximum(np.rint(points * durations / (durations.sum() or 1.0)), least)
    ends = np.column_stack([np.zeros(durations.size), trajectory.ends])
    more = _cut(ends.ravel(), np.repeat(counts.astype(np.intp), 2), np.full(durations.size, 2))
    piece_of, taus = map(np.concatenate, zip(_fit(trajectory), more, strict=True))
    order = np.lexsort((taus, piece_of))
    piece_of, taus = piece_of[order], taus[order]
    is_new = np.append(True, (np.diff(piece_of) > 0) | (np.diff(taus) > 0))[: taus.size]
    return Samples.at_local(trajectory, piece_of[is_new], taus[is_new])


def _fit(trajectory: Trajectory) -> tuple[Indices, Array]:
    """Return the pieces and local times fit for a plot."""
    stored = [part for part in trajectory.parts if isinstance(part, Patchwork) or part.path is not None]
    paths = [part.path for part in stored if isinstance(part, Piece) and part.path is not None]
    patchworks = [part for part in stored if isinstance(part, Patchwork)]
    bends, allowed = _bends(trajectory.system, stored, paths, patchworks)
    counts = np.split(_clipped((bends / allowed).max(axis=1, initial=0.0)), _firsts(paths)[1:])
    steps: list[tuple[Array, Indices, Indices]] = []
    done = 0
    for part in stored:
        if isinstance(part, Patchwork):
            steps.append(_of_patchwork(part, trajectory.system, allowed))
        else:
            taus = paths[done].taus
            steps.append((taus, np.append(counts[done], 1), np.array([taus.size])))
            done += 1
    none = np.empty(0, dtype=np.intp)
    return _cut(*(np.concatenate(parts) for parts in zip((np.empty(0), none, none), *steps, strict=True)))


def _firsts(paths: list[Path]) -> Indices:
    """Return the number of the first step of each path, all in a row, and that of all."""
    return np.cumsum([0, *(path.taus.size - 1 for path in paths)])


def _cut(ends: Array, counts: Indices, sizes: Indices) -> tuple[Indices, Array]:
    """Return pieces and local times: the ends of steps, and evenly spaced times within each.

    `ends` are those of one piece after the other, its start among them, and `sizes` how many each piece has. The step
    from each on is cut into `counts` parts; the last of a piece counts nothing.
    """
    counts, lengths = counts.copy(), np.diff(ends, append=0.0)
    lasts = np.cumsum(sizes) - 1
    counts[lasts] = 1
    step = np.repeat(np.arange(ends.size), counts)
    inner = np.arange(step.size) - np.repeat(np.cumsum(counts) - counts, counts)
    taus = ends[step] + lengths[step] * (inner / counts[step])
    return np.repeat(np.arange(sizes.size), sizes)[step], taus


def _of_patchwork(part: Patchwork, system: System, allowed: Array) -> tuple[Array, Indices, Indices]:
    """Return of what is known part by part what `_cut` asks for."""
    n = system.n
    distance = allowed[system.size :].copy()
    np.minimum.at(distance, system.moved, allowed[system.moved_state])
    begins, piece = part.steps
    # all pieces in one line: the steps of each begin, then it ends
    place = np.arange(begins.size) + piece
    sizes = np.bincount(piece) + 1
    ends, counts = np.empty(begins.size + sizes.size), np.ones(begins.size + sizes.size, dtype=np.intp)
    ends[place], counts[place] = begins - part.starts[piece], _clipped(part.worst(allowed[:n], distance))
    ends[np.cumsum(sizes) - 1] = part.stops - part.starts
    return ends, counts, sizes


def _clipped(worst: Array) -> Indices:
    return np.asarray(np.clip(np.ceil(np.sqrt(worst)), 1, _MOST_PARTS), dtype=np.intp)


def _bends(
    system: System, stored: Sequence[Piece | Patchwork], paths: list[Path], patchworks: list[Patchwork]
) -> tuple[Array, Array]:
    """Return bounds of the second derivatives in each step of all paths, and what is allowed of each quantity.

    Quantities are the states, then the positions of all bodies.
    """
    n, size = system.n, system.size
    first = _firsts(paths)
    bends, moved = np.empty((first[-1], size + n)), np.empty((first[-1], n))
    low, high = np.full(size + n, np.inf), np.full(size + n, -np.inf)
    for block in alike((path, k) for k, path in enumerate(paths) if path.taus.size > 1):
        steps = np.concatenate([np.arange(first[k], first[k + 1]) for _, k in block])
        c = np.concatenate([path.coefficients for path, _ in block])
        h = np.concatenate([np.diff(path.taus) for path, _ in block])[:, None]
        values_and_integral, derivatives = _weights(*kind_of(block[0][0]))
        values = values_and_integral @ c
        moved[steps] = values[:, -1, :n] * h
        low[:size] = np.minimum(low[:size], values[:, :-1].min(axis=(0, 1)))
        high[:size] = np.maximum(high[:size], values[:, :-1].max(axis=(0, 1)))
        sizes = derivatives @ np.abs(c, out=c)
        bends[steps, :size] = sizes[:, 0]
        bends[steps, size:] = sizes[:, 1, :n] * h
    for part in patchworks:
        (slow, near), (fast, far) = part.ranges
        low[:n], high[:n] = np.minimum(low[:n], slow), np.maximum(high[:n], fast)
        low[system.moved_state] = np.minimum(low[system.moved_state], near[system.moved])
        high[system.moved_state] = np.maximum(high[system.moved_state], far[system.moved])
    travel = _travel(n, stored, moved, first)
    low[size:], high[size:] = travel.min(axis=0), travel.max(axis=0)
    ranges = np.where(high >= low, high - low, 0.0)
    low, high = np.where(np.isfinite(low), low, 0.0), np.where(np.isfinite(high), high, 0.0)
    for group in (slice(0, n), slice(n, size), slice(size, None)):
        largest = np.maximum(np.abs(low[group]), np.abs(high[group])).max(initial=0.0)
        ranges[group] = np.maximum(ranges[group], _NOTHING * largest)
    return bends, np.where(ranges > 0, 8 * _STRAIGHT * ranges, np.inf)


def _travel(n: int, stored: Sequence[Piece | Patchwork], moved: Array, first: Indices) -> Array:
    """Return how far the bodies have come by the ends of steps and at the extremes of other parts, a line each."""
    found, base, done = [np.zeros((1, n))], np.zeros(n), 0
    for part in stored:
        if isinstance(part, Patchwork):
            (_, near), (_, far) = part.ranges
            begin, end = part.at_ends
            found.append(base + np.array([near - begin, far - begin]))
            base = base + end - begin
        else:
            own = base + np.cumsum(moved[first[done] : first[done + 1]], axis=0)
            found.append(own)
            base = own[-1] if own.size else base
            done += 1
    return np.concatenate(found)


@lru_cache(maxsize=64)
def _weights(count: int, is_chebyshev: bool) -> tuple[Array, Array]:
    """Return maps from coefficients of polynomials ``p_j(s)``, s from 0 to 1: ``s^j`` or ``T_j(2 s - 1)``.

    The first gives the values at a few places and the integral; the second, of the sizes of the coefficients,
    gives bounds of the second and of the first derivative.
    """
    j = np.arange(count, dtype=float)
    places = np.linspace(0.0, 1.0, 5)
    if is_chebyshev:
        values = np.polynomial.chebyshev.chebvander(2 * places - 1, count - 1)
        whole = np.where(j % 2 == 0, 1 / (1 - np.where(j == 1, 0, j) ** 2), 0.0)
        return np.vstack([values, whole]), np.vstack([4 * j**2 * (j**2 - 1) / 3, 2 * j**2])
    values = np.polynomial.polynomial.polyvander(places, count - 1)
    return np.vstack([values, 1 / (j + 1)]), np.vstack([j * (j - 1), j])
