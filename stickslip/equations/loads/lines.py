"""Piecewise-linear signals that are read together."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from stickslip.model.arrays import Array
from stickslip.model.signals import PiecewiseLinear


class Lines:
    """Many piecewise-linear signals: at a break of one of them, only its own line is looked up anew."""

    def __init__(self, signals: Sequence[PiecewiseLinear]) -> None:
        self._signals = signals
        # Of the line of each signal: from when until when it holds, time and value where it begins, rise, and length.
        # Threads may read the same loads: a table of lines is replaced as a whole.
        self._latest = np.full((6, len(signals)), math.inf)

    def at(self, t: float) -> tuple[Array, Array]:
        """Return the values of all signals from time `t` on, after their jumps, and their slopes."""
        lines = self._latest
        left = ((t < lines[0]) | (t >= lines[1])).nonzero()[0].tolist()
        if left:
            lines = lines.copy()
            for k in left:
                lines[:, k] = self._signals[k].line(t)
            self._latest = lines
        _, _, start, value, rise, length = lines
        return value + rise * ((t - start) / length), rise / length
