"""Positions that are no states: integrals of velocities, exact for the polynomials of the steps."""

from __future__ import annotations

import math

import numpy as np

from stickslip.equations.path import gauss_nodes
from stickslip.model.arrays import Array, Indices
from stickslip.results.trajectory import Trajectory

_PER_PERIOD = 8
_NODES = 10  # Gauss nodes in each part of a period of a drive; exact for polynomials of degree 19


def of_bodies(trajectory: Trajectory, piece_of: Indices, taus: Array, bodies: slice = slice(None)) -> Array:
    """Return how far the bodies have come since the start of the trajectory, in m or rad, a line each.

    ``x(t) - x_0 = integral of v dt``. The polynomials of free bodies are integrated term by term; distances of bodies
    that follow others through held rows are computed from these.
    """
    system = trajectory.system
    if not taus.size:
        return np.zeros((system.n, 0))[bodies]
    if (distances := trajectory.distances_from_start(piece_of, taus, bodies)) is not None:
        return distances
    # distances since the starts of pieces: at the ends of all pieces before the last one needed, then at the times
    before = np.arange(int(piece_of.max()))
    numbers = np.concatenate([before, piece_of])
    local = np.concatenate([trajectory.ends[before], taus])
    steps = trajectory.distances(numbers, local)
    held = list(trajectory.by_held(numbers))
    driven = None
    if system.drives and held:
        starts = trajectory.starts[numbers]
        both = of_drives(trajectory, np.concatenate([starts, starts + local]))
        driven = both[:, numbers.size :] - both[:, : numbers.size]
    trajectory.write_led(held, steps, driven)
    base = np.zeros((system.n, before.size + 1))
    np.cumsum(steps[:, : before.size], axis=1, out=base[:, 1:])
    return np.asarray(base.take(piece_of, axis=1) + steps[:, before.size :])[bodies]


def of_drives(trajectory: Trajectory, times: Array) -> Array:
    """Return how far the drives have come since the start of the trajectory, in m or rad, a line each.

    Their velocities are integrated by Gauss quadrature between breaks and over parts of periods.
    """
    if not times.size:
        return np.zeros((trajectory.system.drives, 0))
    loads = trajectory.loads
    start, stop = float(trajectory.starts[0]), float(times.max())
    marks = [times, loads.periods(start, stop, _PER_PERIOD)]
    marks.append(np.array([b for b in loads.breaks if start < b < stop]))
    if loads.has_functions:
        # how fast functions change is not known: the steps of the solver had to follow them, and are short enough
        ends = [t + trajectory.steps(k) for k, t in enumerate(trajectory.starts.tolist())]
        marks += [end[end <= stop] for end in ends]
    edges = np.sort(np.concatenate(marks))
    # without a period, velocities are straight lines, for which a single node is exact
    x, weights = gauss_nodes(1 if math.isinf(loads.period) else _NODES)
    half = 0.5 * (edges[1:] - edges[:-1])
    nodes = ((0.5 * (edges[1:] + edges[:-1]))[:, None] + half[:, None] * x).ravel()
    piece_of = trajectory.starts.searchsorted(nodes, side="right") - 1
    u = trajectory.drive_velocities(piece_of, nodes - trajectory.starts[piece_of])
    sums = np.zeros((u.shape[0], edges.size))
    np.cumsum((u.reshape(-1, half.size, x.size) @ weights) * half, axis=1, out=sums[:, 1:])
    return sums.take(edges.searchsorted(times), axis=1)
