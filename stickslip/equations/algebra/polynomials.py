"""Many polynomials at once: power coefficients, a line each."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from stickslip.model.arrays import Array, Indices

_FAR, _BEYOND = 1e12, 1e290  # numbers beyond which powers may overflow, and powers beyond which they count as 0


def powers(s: Array, count: int) -> Array:
    """Return the powers 0 to ``count - 1`` of each number, a line each.

    Powers that nearly overflow are 0: a polynomial that is evaluated so far away has no such terms.
    """
    found = np.empty((s.size, count))
    found[:, 0] = 1.0
    found[:, 1:] = s[:, None]
    if s.size and s.max() > _FAR:
        with np.errstate(over="ignore"):
            np.multiply.accumulate(found, axis=1, out=found)
        found[found > _BEYOND] = 0.0
        return found
    return np.multiply.accumulate(found, axis=1, out=found)


@lru_cache(maxsize=8)
def _binomials(count: int) -> tuple[Array, Indices]:
    """Return binomial coefficients ``(j over k)`` at [k, j], and ``j - k`` where that is not negative."""
    k, j = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    factor = np.array([[float(math.comb(b, a)) for b in range(count)] for a in range(count)])
    return factor, np.maximum(j - k, 0)


def shifted(c: Array, s: Array) -> Array:
    """Return polynomials (power coefficients, a line each) about `s`; lines may be changed in place."""
    if not c[:, 2:].any():
        c[:, 0] += s * c[:, 1]
        return c
    factor, power = _binomials(c.shape[1])
    found: Array = ((factor * powers(s, c.shape[1])[:, power]) @ c[:, :, None])[:, :, 0]
    return found
