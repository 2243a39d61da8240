"""The Taylor coefficients of a small linear motion from one product.

Between two breaks the inputs are lines and sines, and dwells are exponentials times lines. Together with the states,

    x = (y, q, q', e, e', s, c),    y' = A y + B (q + s, e),    e = exp(-age / dwell) N,    s' = omega c,

they obey ``x' = N x`` with a constant matrix N. The coefficient of order k is ``N^k x / k!``: one matrix gives all of
them, for every motion in the same modes. Inputs that depend linearly on the state are part of N.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stickslip.equations.loads import Waves
from stickslip.equations.system import System
from stickslip.model.arrays import Array

_MOST_ENTRIES = 1_000
"""Entries for each order: modes of larger scenes seldom come back often enough."""

_QUICKLY_MADE = 10_000
"""Entries of a matrix that takes no longer to make than to do without it a few times."""

_FASTEST = 1e12
"""Products of rate and step beyond which powers of them may overflow."""


def is_small(system: System, rows: int, waves: int) -> bool:
    """Tell whether the matrices of the coefficients of so many quantities are worth making."""
    columns = system.size + 2 * (system.inputs + system.dwelling.size + waves)
    return not system.sparse and columns * rows <= _MOST_ENTRIES


def is_quickly_made(system: System, columns: int, rows: int) -> bool:
    """Tell whether a matrix pays though modes may not come back: it takes no longer to make than to do without it."""
    return not system.sparse and columns * rows <= _QUICKLY_MADE


class TaylorMap:
    """The map from states, inputs and dwells to the Taylor coefficients in one set of modes.

    `of_states` and `of_inputs` are the maps from states, and from inputs and dwells, to rates, `watched` quantities and
    guards. `consistent` writes dependent velocities through the independent ones, given those of the drives; `link`
    enters the inputs that depend linearly on the state into columns of inputs, from columns of states. Where it is
    `frozen`, static coefficients keep their values.
    """

    def __init__(
        self,
        system: System,
        of_states: Array,
        of_inputs: Array,
        watched: int,
        consistent: Callable[[Array, Array], Array],
        order: int,
        frozen: bool,
        link: Callable[[Array, Array], None] | None,
        waves: Waves,
    ) -> None:
        size, inputs, dwelling = system.size, system.inputs, system.dwelling
        dwells = dwelling.size
        self._size, self._watched = size, size + watched
        # time is counted in units in which no coefficient grows
        rates = np.array(of_states[:size])
        if link is not None:
            linked = np.zeros((inputs, size))
            link(linked, np.eye(size))
            rates += of_inputs[:size, :inputs] @ linked
        fastest = float(np.abs(rates).sum(axis=1).max(initial=0.0))
        if dwells and not frozen:
            fastest = max(fastest, float((1.0 / system.dwell[dwelling]).max()))
        entries, turns = (np.array(x, dtype=kind) for x, kind in zip(waves, (np.intp, float), strict=True))
        fastest = max(fastest, float(np.abs(turns).max(initial=0.0)))
        self._pace = fastest if fastest > 0 else 1.0
        fall = np.zeros(dwells) if frozen else -1.0 / (system.dwell[dwelling] * self._pace)
        columns = size + 2 * (inputs + dwells + entries.size)
        value, slope = size, size + inputs
        dwell, dwell_slope = (
            size + 2 * inputs + np.arange(dwells),
            size + 2 * inputs + dwells + np.arange(dwells),
        )
        place = inputs + np.arange(dwells)
        wave, number = size + 2 * (inputs + dwells) + np.arange(entries.size), entries.size
        y = np.eye(size, columns)
        decay, before = np.ones(dwells), np.zeros(dwells)
        swing = np.ones(number)
        blocks = []
        for k in range(order + 1):
            q = np.zeros((inputs + dwells, columns))
            if k == 0:
                q[:inputs, value : value + inputs] = np.eye(inputs)
            elif k == 1:
                q[:inputs, slope : slope + inputs] = np.eye(inputs) / self._pace
            q[place, dwell], q[place, dwell_slope] = decay, before / self._pace
            # sine, cosine, -sine, -cosine
            q[entries, wave + number * (k % 2)] = swing * (-1.0) ** (k // 2)
            swing = swing * turns / ((k + 1) * self._pace)
            if k:
                y = consistent(y, system.drive_velocities(q))
            if link is not None:
                link(q[:inputs], y)
            found = of_states @ y + of_inputs @ q
            blocks.append(np.concatenate([y, found[size:]]))
            y = found[:size] / ((k + 1) * self._pace)
            decay, before = decay * fall / (k + 1), decay
        self._matrix = np.concatenate(blocks)
        self.order, self._orders = order, np.arange(order + 1)

    def reaches(self, scale: float) -> bool:
        """Tell whether the coefficients over steps of this length in s can be told."""
        return self._pace * scale < _FASTEST

    def derivatives(self, x: Array) -> Array:
        """Return from what the coefficients follow over steps of any length, a row per order."""
        found: Array = (self._matrix @ x).reshape(self.order + 1, -1)
        return found

    def over(self, derivatives: Array, scale: float, order: int) -> tuple[Array, Array, Array]:
        """Return the coefficients ``scale^k f^(k) / k!`` of states, watched quantities and guards, a row per order."""
        count = order + 1
        found = derivatives[:count] * ((self._pace * scale) ** self._orders[:count])[:, None]
        return found[:, : self._size], found[:, self._size : self._watched], found[:, self._watched :]
