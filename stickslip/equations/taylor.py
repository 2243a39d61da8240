"""The Taylor coefficients of a small linear motion from one product.

Between two breaks the inputs are lines and sines, and dwells are exponentials times lines. Together with the states,

    x = (y, q, q', e, e', s, c),    y' = A y + B (q + s, e),    e = exp(-age / dwell) N,    s' = omega c,

they obey ``x' = N x`` with a constant matrix N. The coefficient of order k is ``N^k x / k!``: one matrix gives all of
them, for every motion in the same modes. Inputs that depend linearly on the state are part of N.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import accumulate

import numpy as np

from stickslip.equations.loads.loads import SineTurns
from stickslip.equations.system import System
from stickslip.model.arrays import Array

ORDER = 18  # order up to which motions that are no polynomials are expanded
# Entries for each order up to which a map is made: modes of larger scenes seldom come back often enough to pay for it.
_MOST_ENTRIES = 1_000
_QUICKLY_MADE = 10_000  # entries of a matrix that takes no longer to make than to do without it a few times
# Products of rate and step up to which a map is good. It gives each coefficient by a sum of its own: where the terms
# cancel, as in an equilibrium, coefficients are roundoff times the powers of this product over k!, and no motion.
_LONGEST = 8.0
_LARGEST_PRODUCT = 1e12  # the same product, but with the unit of time, beyond which powers of it may overflow


def is_small(system: System, rows: int, sines: int) -> bool:
    """Tell whether a map to the coefficients of so many quantities (`rows`) is worth making."""
    columns = system.size + 2 * (system.inputs_and_dwells + sines)
    return not system.sparse and columns * rows <= _MOST_ENTRIES


def is_quickly_made(system: System, columns: int, rows: int) -> bool:
    """Tell whether a matrix pays though modes may not come back: it takes no longer to make than to do without it."""
    return not system.sparse and columns * rows <= _QUICKLY_MADE


class TaylorMap:
    """The map from states, inputs and dwells to the Taylor coefficients in one set of modes.

    `of_states` and `of_inputs` are the maps from states, and from inputs and dwells, to rates, watched quantities and
    guards. `consistent` writes dependent velocities through the independent ones, given those of the drives; `link`
    enters the inputs that depend linearly on the state into columns of inputs, from columns of states. Where it is
    `frozen`, static coefficients keep their values.
    """

    def __init__(
        self,
        system: System,
        of_states: Array,
        of_inputs: Array,
        consistent: Callable[[Array, Array], Array],
        order: int,
        frozen: bool,
        link: Callable[[Array, Array], None] | None,
        sine_turns: SineTurns,
    ) -> None:
        size, inputs, dwelling = system.size, system.inputs, system.dwelling
        entries, turns = (np.array(x, dtype=kind) for x, kind in zip(sine_turns, (np.intp, float), strict=True))
        sizes = [size, inputs, inputs, dwelling.size, dwelling.size, entries.size, entries.size]
        x = np.eye(sum(sizes))
        y, q, slopes, dwells, dwell_slopes, sines, cosines = (
            x[last - count : last] for count, last in zip(sizes, accumulate(sizes), strict=True)
        )
        given = np.concatenate([q, dwells])
        if entries.size:
            np.add.at(given, entries, sines)
        own = given.copy()
        if link is not None:
            link(own[:inputs], y)
        rates = of_states[:size] @ y + of_inputs[:size] @ own
        fall = np.zeros(dwelling.size) if frozen else -1.0 / system.dwell[dwelling]
        # the unit of time is such that no coefficient grows from order to order
        paces = np.abs(rates[:, :size]).sum(axis=1), np.abs(fall), np.abs(turns)
        self._pace = max(float(pace.max(initial=0.0)) for pace in paces) or 1.0
        N = np.concatenate(
            [
                rates,
                slopes,
                np.zeros(slopes.shape),
                fall[:, None] * dwells + dwell_slopes,
                fall[:, None] * dwell_slopes,
                turns[:, None] * cosines,
                -turns[:, None] * sines,
            ]
        )
        later = _terms(N / self._pace, order)
        # the root of a high power hardly depends on units
        power = np.abs(later[:size].reshape(size, order, -1)[:, -1]).sum(axis=1).max(initial=0.0)
        self._rate = self._pace * (float(power) * math.factorial(order)) ** (1.0 / order)
        q = given @ later
        y = consistent(later[:size], system.drive_velocities(q))
        y, q = np.hstack([x[:size], y]), np.hstack([given, q])
        if link is not None:
            link(q[:inputs], y)
        found = np.concatenate([y, of_states[size:] @ y + of_inputs[size:] @ q])
        in_orders = found.reshape(found.shape[0], order + 1, -1).transpose(1, 0, 2)
        self._matrix = np.ascontiguousarray(in_orders).reshape(-1, x.shape[0])
        self.order, self._orders = order, np.arange(order + 1)

    def reaches(self, scale: float) -> bool:
        """Tell whether roundoff stays small in the coefficients for steps of this length in s."""
        return self._rate * scale <= _LONGEST and self._pace * scale < _LARGEST_PRODUCT

    def coefficients(self, x: Array, scale: float, order: int) -> Array:
        """Return the coefficients ``scale^k f^(k) / k!`` of states, watched quantities and guards side by side.

        They are linear in `x`: states, inputs, their slopes, dwells, their slopes, and sines with their cosines.
        """
        count = order + 1
        found: Array = (self._matrix @ x).reshape(self.order + 1, -1)[:count]
        found *= ((self._pace * scale) ** self._orders[:count])[:, None]
        return found


def _terms(N: Array, order: int) -> Array:
    """Return ``N^k / k!`` for the orders from 1 on, side by side; each product doubles the number of known powers."""
    size = N.shape[0]
    powers = np.empty((size, order, size))
    powers[:, 0] = N
    known = 1
    while known < order:
        more = min(known, order - known)
        following = powers[:, known - 1] @ powers[:, :more].reshape(size, -1)
        powers[:, known : known + more] = following.reshape(size, more, size)
        known += more
    powers /= np.cumprod(np.arange(1.0, order + 1))[:, None]
    return powers.reshape(size, -1)
