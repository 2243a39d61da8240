"""Derivatives of time integrals: of positions that are no states, and of heats."""

from __future__ import annotations

import numpy as np

from stickslip.equations.path import gauss_nodes
from stickslip.model.arrays import Array
from stickslip.studies.derivatives.nearby import OfMotion
from stickslip.studies.derivatives.variations import Variation

# Steps are halved until that changes an integral by less than the first part of it, plus the second part of the
# integral of the quantity itself; at most so often.
_QUADRATURE, _ROUGH, _REFINED = 1e-10, 1e-12, 6
# A change below so many times what is allowed is roundoff if it does not shrink to this part of the one before.
_MAY_BE_ROUNDOFF, _SHRINKS = 1e3, 0.7
_TINY = np.finfo(float).tiny


def integral(variation: Variation, quantity: OfMotion, times: Array) -> Array:
    """Return the derivatives of time integrals from the start to times in order, (lines, k, directions).

    ``d/dp int f dt = int df/dp dt + sum (f- - f+) dt_event/dp``; the quantity has a line for each integral.
    """
    trajectory = variation.trajectory
    if not times.size:
        lines = quantity(variation.motion_of(0), np.zeros(1), trajectory.pieces[0].y[:, None]).shape[0]
        return np.zeros((lines, 0, variation.count))
    place = trajectory.places(times)
    local = trajectory.local(place, times)
    parts: list[Array] = []
    total: Array | float = 0.0
    for number in range(int(place.max(initial=-1)) + 1):
        piece, varied = trajectory.pieces[number], variation.pieces[number]
        motion = variation.motion_of(number)
        path = piece.kept_path
        wanted = local[place == number]
        edges = np.unique(np.concatenate([varied.taus, path.taus, wanted]))
        ends = np.array([0.0, piece.end])
        limits = quantity(motion, ends, motion.exact(ends, path.at(ends).T))[:, :, None]
        sums = _sums(variation, quantity, number, edges)
        rough = _ROUGH * np.abs(limits).max(initial=0.0) * piece.end / variation.sizes
        least = np.inf
        for _ in range(_REFINED):
            if edges.size < 2:
                break
            middles = 0.5 * (edges[1:] + edges[:-1])
            edges = np.insert(edges, np.arange(1, edges.size), middles)
            finer = _sums(variation, quantity, number, edges)
            # measured by the largest line: one that hardly changes is roundoff of others, and of the quantity itself
            allowed = _QUADRATURE * np.abs(finer).max(axis=(0, 1)) + rough
            changes = np.abs(finer[:, ::2] - sums) / np.maximum(allowed, _TINY)
            off = float(np.nan_to_num(changes, posinf=np.inf).max(initial=0.0))
            sums = finer
            if off <= 1.0 or _SHRINKS * least < off < _MAY_BE_ROUNDOFF:
                break
            least = off
        sums += total - limits[:, :1] * varied.begin_change
        parts.append(sums[:, np.searchsorted(edges, wanted)])
        total = sums[:, -1:] + limits[:, 1:] * varied.end_change
    return np.concatenate(parts, axis=1)


def _sums(variation: Variation, quantity: OfMotion, number: int, edges: Array) -> Array:
    """Return the integrals of the derivatives of a quantity from the start of a piece to some local times."""
    piece, varied = variation.trajectory.pieces[number], variation.pieces[number]
    nodes, weights = gauss_nodes(varied.coefficients.shape[1])
    half = 0.5 * np.diff(edges)
    taus = (0.5 * (edges[1:] + edges[:-1])[:, None] + half[:, None] * nodes).ravel()
    if not half.size:
        motion = variation.motion_of(number)
        lines = quantity(motion, np.zeros(1), piece.y[:, None]).shape[0]
        return np.zeros((lines, edges.size, variation.count))
    slopes = variation.slopes_along(quantity, number, varied, taus)
    slopes = slopes.reshape(-1, half.size, nodes.size, variation.count)
    sums = np.zeros((slopes.shape[0], edges.size, variation.count))
    sums[:, 1:] = np.cumsum(np.einsum("lijk,j,i->lik", slopes, weights, half), axis=1)
    return sums
