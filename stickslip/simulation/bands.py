"""Karnopp's dead bands along a run: what has left rest is stuck again only after it has left its band, too."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from stickslip.equations.guards import Guards
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path, chebyshev_nodes
from stickslip.model.arrays import Array, Indices
from stickslip.simulation.signs import DEGREE, ROUGH, TINY, signs_along

_OUT = 1e-5
"""Part of a dead band by which a velocity is beyond its edge for certain."""


def until_out_of_bands(motion: Motion, guards: Guards, path: Path) -> Path:
    """Return the path up to where the first row is out of the dead band in which it starts.

    From there on the edge of the band is a guard, and not before.
    """
    rows, system = guards.in_band, motion.system
    if not rows.size or path.taus.size < 2:
        return path
    limits = (1 + _OUT) * system.laws.rests_below[rows]

    def beyond(taus: Array, some: Indices) -> Array:
        states = motion.exact(taus, path.at(taus).T)
        w = system.relative_velocity(states, motion.loads(taus) if system.drives else np.empty(0))[rows[some]]
        return np.asarray(np.abs(w) - limits[some, None])

    taus = path.taus[:-1, None] + np.diff(path.taus)[:, None] * chebyshev_nodes(DEGREE)
    values = beyond(taus.ravel(), np.arange(rows.size)).reshape(rows.size, *taus.shape)
    found = math.inf
    for k in np.flatnonzero((values > 0).any(axis=(1, 2))).tolist():
        size = float(np.abs(values[k]).max())

        def exact(tau: float, k: int = k) -> float:
            return float(beyond(np.array([tau]), np.array([k]))[0, 0])

        for row, (start, stop) in zip(values[k], pairwise(path.taus.tolist()), strict=True):
            signs = signs_along(start, stop, row, exact, ROUGH * size, TINY * size)
            out = next((tau for tau, sign in signs if sign > 0), None)
            if out is not None:
                found = min(found, out)
                break
    return motion.until(path, found) if 0 < found < path.taus[-1] else path
