"""Which held rows give way where drives that move apart tear them.

Whatever the rows hold otherwise, forces grow until the weakest of them slip: of all motions that follow the drives it
is the one that takes the least from the limits, ``min sum B |w|`` over ``w = G a + D u'``. This is the upper bound
theorem of limit analysis (Drucker, Prager and Greenberg, "Extended limit design theorems for continuous media", 1952),
and it asks of rows that lock the same motion that they let go together, at the sum of their limits (MODEL rule 8).
"""

from __future__ import annotations

import numpy as np
import scipy

from stickslip.equations.guards import Guards
from stickslip.equations.matrices import dense
from stickslip.equations.motion import Motion
from stickslip.model.arrays import Array, Indices, Mask

_SOME = 1e-9
"""Part of what adds up, or of the largest, below which a force or a rate is roundoff."""


def collapse(motion: Motion, guards: Guards) -> tuple[Indices, Array] | None:
    """Return rows that give way, those of one loop after another, and the directions in which they move.

    None where no drives tear them, or each in a single loop: there the largest ratio of force to level decides.

    All rows that may hold are held in this motion.
    """
    system, balance = motion.system, motion.equations.balance
    held = motion.equations.held
    if (found := _torn(motion)) is None:
        return None
    torn, rate = found
    for number in np.unique(balance.loop[torn]).tolist():
        rows = held[balance.loop == number]
        G, D = dense(system.G[rows]), dense(system.D[rows])
        G = G[:, np.abs(G).any(axis=0)]
        # the forces of a single loop are unique
        if rows.size - np.linalg.matrix_rank(G) > 1:
            return _weakest(rows, G, D @ rate, _limits(motion, guards, rows))
    return None


def pressed_together(motion: Motion) -> Indices:
    """Return held rows that drives tear though none of them can give way: ties, one-way clutches and stops."""
    held, found = motion.equations.held, _torn(motion)
    rows: Indices = held[:0] if found is None else held[found[0]]
    return rows[:0] if motion.system.is_friction[rows].any() else rows


def _torn(motion: Motion) -> tuple[Mask, Array] | None:
    """Tell which held rows drives tear that move apart, and return the lowest derivative of velocities that does."""
    system, balance = motion.system, motion.equations.balance
    if balance.parting is None:
        return None
    for q in motion.start.q:
        rate = system.drive_accelerations(q)
        torn = np.abs(balance.parting @ rate) > _SOME * (abs(balance.parting) @ np.abs(rate))
        if torn.any():
            return np.asarray(torn), rate
    return None


def _limits(motion: Motion, guards: Guards, rows: Indices) -> Array:
    """Return the limits of some rows forward and backward, infinite where there is none."""
    found = np.full((2, motion.system.m), np.inf)
    of_force = guards.direction != 0
    side = np.where(guards.direction[of_force] > 0, 0, 1)
    levels = guards.raw(np.zeros_like(motion.start.z[0]), motion.start_inputs)
    found[side, guards.row[of_force]] = levels[of_force]
    return np.asarray(found[:, rows])


def _weakest(rows: Indices, G: Array, led: Array, limits: Array) -> tuple[Indices, Array] | None:
    """Return the rows that move in the motion that takes least, and where to."""
    size = np.abs(led).max()
    count, unit = rows.size, np.eye(rows.size)
    # accelerations of bodies are free; relative ones have a part forward and a part backward
    may = np.isfinite(limits).ravel()
    largest = limits.ravel()[may].max(initial=0.0) or 1.0
    cost = np.concatenate([np.zeros(G.shape[1]), limits.ravel()[may] / largest])
    equal = np.hstack([G, np.hstack([-unit, unit])[:, may]])
    bounds = [(None, None)] * G.shape[1] + [(0, None)] * int(may.sum())
    found = scipy.optimize.linprog(cost, A_eq=equal, b_eq=-led / size, bounds=bounds)
    if found.status != 0:
        return None
    relative = np.zeros(2 * count)
    relative[may] = found.x[G.shape[1] :]
    w = relative[:count] - relative[count:]
    some = np.abs(w) > _SOME
    return rows[some], np.sign(w[some])
