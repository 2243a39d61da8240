"""At which times a trajectory is read: fit for a plot, as the solver stepped, or evenly spaced."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stickslip.equations.path import Path
from stickslip.results.samples import Samples
from stickslip.results.trajectory import Trajectory, kind_of

__all__ = ["at_steps", "fit_for_plot", "refined"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_STRAIGHT = 1e-3
"""How far straight lines between the times may be off, as a part of each quantity's range."""

_NOTHING = 1e-9
"""A range below this part of the largest one is roundoff and no reason for more times."""

_MOST_PARTS = 200
_AT_ONCE = 2_000_000


def fit_for_plot(trajectory: Trajectory) -> Samples:
    """Return a trajectory at times so close that straight lines between them look like it.

    Within a step of length 1 a straight line over a part ``1/k`` is off by at most ``max|y''| / (8 k^2)``. The second
    derivative is bounded by the coefficients of the step's polynomial. Velocities and positions are right to 1e-3 of
    their ranges, also positions that are no states. Both limits stand at every event, and all ends of steps are kept.

    Parameters
    ----------
    trajectory : Trajectory
    """
    return _of(trajectory, _fit(trajectory))


def at_steps(trajectory: Trajectory) -> Samples:
    """Return a trajectory at the ends of the solver's steps, both limits at every event."""
    return _of(trajectory, [path.taus for path in _paths(trajectory)])


def refined(trajectory: Trajectory, points: int = 1500) -> Samples:
    """Return a trajectory at the times fit for a plot and at about `points` more, evenly spaced."""
    pieces = trajectory.pieces
    span = pieces[-1].stop - pieces[0].t if pieces else 0.0
    least = 16 if 16 * len(pieces) <= points else 1
    taus = []
    for piece, fit in zip(pieces, _fit(trajectory), strict=True):
        count = max(least, round(points * (piece.stop - piece.t) / span)) if span else least
        taus.append(np.union1d(fit, np.linspace(0.0, piece.end, count + 1)))
    return _of(trajectory, taus)


def _of(trajectory: Trajectory, taus: Sequence[Array]) -> Samples:
    piece_of = np.repeat(np.arange(len(taus)), [local.size for local in taus]).astype(np.intp)
    return Samples.at_local(trajectory, piece_of, np.concatenate([np.empty(0), *taus]))


def _fit(trajectory: Trajectory) -> list[Array]:
    """Return for each piece the local times fit for a plot."""
    paths = _paths(trajectory)
    if not paths:
        return []
    parts = _parts(trajectory.system.n, paths)
    firsts = np.cumsum([0, *(path.taus.size - 1 for path in paths)]).tolist()
    taus = []
    for path, first in zip(paths, firsts, strict=False):
        ends, count = path.taus, parts[first : first + path.taus.size - 1]
        if not count.size or count.max() == 1:
            taus.append(ends)
            continue
        step = np.repeat(np.arange(count.size), count)
        inner = np.arange(step.size) - np.repeat(np.cumsum(count) - count, count)
        within = ends[step] + (ends[step + 1] - ends[step]) * (inner / count[step])
        taus.append(np.append(within, ends[-1]))
    return taus


def _paths(trajectory: Trajectory) -> list[Path]:
    return [piece.path for piece in trajectory.pieces if piece.path is not None]


def _parts(n: int, paths: list[Path]) -> Indices:
    """Return into how many parts each step of all paths is cut."""
    size = paths[0].last.size
    first = np.cumsum([0, *(path.taus.size - 1 for path in paths)])
    bends, moved = np.empty((first[-1], size + n)), np.empty((first[-1], n))
    lows, highs = [], []
    for block in _blocks(paths):
        steps = np.concatenate([np.arange(first[k], first[k + 1]) for k in block])
        c = np.concatenate([paths[k].coefficients for k in block])
        h = np.concatenate([paths[k].taus[1:] - paths[k].taus[:-1] for k in block])[:, None]
        values_and_integral, derivatives = _weights(*kind_of(paths[block[0]]))
        values = values_and_integral @ c
        moved[steps] = values[:, -1, :n] * h
        lows.append(values[:, :-1].min(axis=(0, 1)))
        highs.append(values[:, :-1].max(axis=(0, 1)))
        sizes = derivatives @ np.abs(c, out=c)
        bends[steps, :size] = sizes[:, 0]
        bends[steps, size:] = sizes[:, 1, :n] * h
    if not lows:
        return np.empty(0, dtype=np.intp)
    travel = np.cumsum(moved, axis=0)
    low = np.concatenate([np.min(lows, axis=0), np.minimum(travel.min(axis=0), 0.0)])
    high = np.concatenate([np.max(highs, axis=0), np.maximum(travel.max(axis=0), 0.0)])
    ranges = high - low
    for group in (slice(0, n), slice(n, size), slice(size, None)):
        largest = np.maximum(np.abs(low[group]), np.abs(high[group])).max(initial=0.0)
        ranges[group] = np.maximum(ranges[group], _NOTHING * largest)
    allowed = np.where(ranges > 0, 8 * _STRAIGHT * ranges, np.inf)
    worst = (bends / allowed).max(axis=1, initial=0.0)
    return np.asarray(np.clip(np.ceil(np.sqrt(worst)), 1, _MOST_PARTS), dtype=np.intp)


def _blocks(paths: list[Path]) -> Iterator[list[int]]:
    """Yield numbers of paths of the same kind, not too many at once."""
    blocks: dict[tuple[int, bool], list[int]] = {}
    entries: dict[tuple[int, bool], int] = {}
    for k, path in enumerate(paths):
        if path.taus.size < 2:
            continue
        kind = kind_of(path)
        blocks.setdefault(kind, []).append(k)
        entries[kind] = entries.get(kind, 0) + path.coefficients.size
        if entries[kind] > _AT_ONCE:
            yield blocks.pop(kind)
            entries[kind] = 0
    yield from blocks.values()


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
