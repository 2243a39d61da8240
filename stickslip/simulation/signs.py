"""The signs that quantities take along a path, found on polynomials through their values at Chebyshev points."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial import chebyshev

from stickslip.equations.path import from_nodes
from stickslip.model.arrays import Array
from stickslip.model.crossings import root_between

DEGREE = 20  # order of the polynomial that stands for a quantity within a step
ROUGH = 1e-11  # part of its majorant below which a quantity counts as 0 at the start
TINY = 1e-14  # the same part once its sign is known: roundoff


def signs_along(
    left: float, right: float, values: Array, exact: Callable[[float], float], rough: float, noise: float
) -> list[tuple[float, int]]:
    """Return where a quantity takes a sign between two times, and which: at `left`, and after each of its roots.

    `values` are those at the Chebyshev points between the times, `exact` is the quantity itself. Below `rough` it
    counts as 0 before its sign is known, below `noise` after.
    """
    signs = np.sign(np.where(np.abs(values) > rough, values, 0.0)).astype(int)
    c = from_nodes(values.size - 1) @ values
    some = int(signs[signs != 0][0]) if signs.any() else 0
    if abs(c[0]) > np.abs(c[1:]).sum() or not some:
        return [(left, some)] if some else []
    c = np.where(np.abs(c) > TINY * np.abs(c).max(), c, 0.0)
    inner = chebyshev.chebroots(np.trim_zeros(c, "b"))
    real = np.sort(inner[np.abs(inner.imag) < 1e-6].real)
    marks = np.unique(np.concatenate([[-1.0], real[(real > -1.0) & (real < 1.0)], [1.0]]))
    middles = 0.5 * (marks[1:] + marks[:-1])
    found: list[tuple[float, int]] = []
    before: tuple[float, int] | None = None
    for x in [-1.0, *middles.tolist(), 1.0]:
        tau = left + 0.5 * (x + 1.0) * (right - left)
        value = exact(tau)
        if abs(value) <= (rough if before is None else noise):
            continue
        sign = 1 if value > 0 else -1
        if before is None:
            found.append((left, sign))
        elif sign != before[1]:
            root = root_between(exact, before[0], tau)
            found.append((root, sign))
        before = tau, sign
    return found
