"""Radau's collocation (IIA): Hairer and Wanner, Solving ordinary differential equations II, section IV.5."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from stickslip.model.arrays import Array

STAGES = 8


@lru_cache(maxsize=1)
def radau() -> tuple[Array, Array, Array]:
    """Return nodes and weights of Radau's collocation (IIA), and the map from values at 0 and the nodes to powers."""
    legendre = np.polynomial.Legendre
    shifted = legendre.basis(STAGES) - legendre.basis(STAGES - 1)
    nodes = np.sort(0.5 + 0.5 * np.real(shifted.roots()))
    nodes[-1] = 1.0
    powers = np.arange(STAGES)
    vandermonde = nodes[:, None] ** powers
    integrals = nodes[:, None] ** (powers + 1) / (powers + 1)
    places = np.concatenate([[0.0], nodes])
    to_powers = np.linalg.inv(places[:, None] ** np.arange(STAGES + 1))
    return nodes, integrals @ np.linalg.inv(vandermonde), to_powers
