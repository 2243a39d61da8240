"""Piecewise-linear functions of the stretch of a row and of its rate: what elastic gaps and rigid stops are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip.model.arrays import Array

# Linear expressions: factors of the stretch of a row, of its rate, and of 1.
STRETCH, RATE, ONE = np.eye(3)


@dataclass(frozen=True)
class Region:
    """A part of the state space in which a piecewise-linear function is linear."""

    value: Array  # the function there, a linear expression
    # expressions that are positive inside, and the number of the region beyond each
    borders: tuple[tuple[Array, int], ...] = ()
    mode: int = 0  # the mode that a row shows while its function is in this region: OPEN, FORWARD or BACKWARD
