"""Which held rows give way where drives that move apart tear them.

The forces of the rows grow until the weakest rows slip. Of all motions that follow the drives, the one to come takes
the least from the limits B: ``min sum B |w| - F a`` over ``w = G a + D u'``, with the other forces F on the bodies.
This is the upper bound theorem of limit analysis (Drucker, Prager and Greenberg, "Extended limit design theorems for
continuous media", 1952). By it, rows that lock the same motion let go together, at the sum of their limits (MODEL
rule 8).
"""

from __future__ import annotations

import numpy as np
import scipy

from stickslip.equations.algebra.matrices import dense
from stickslip.equations.guards.guards import Guards
from stickslip.equations.motion import Motion
from stickslip.model.arrays import Array, Indices, Mask
from stickslip.model.slopes import SLOPES_STEP

_ROUNDOFF = 1e-14  # part of the terms of an acceleration below which it is 0
_SOME = 1e-9  # part of the majorant, or of the largest, below which a force or a rate is roundoff

# Parts of a motion. After the first one drives have begun to move, if they begin at its start.
_SOON = np.array([1e-8, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2])


def collapse(motion: Motion, guards: Guards) -> list[tuple[Indices, Array]]:
    """Return for each loop that drives tear the rows that give way, and the directions in which they move.

    All rows that may hold are held in this motion.
    """
    system, balance = motion.system, motion.equations.balance
    held = motion.equations.held
    found = _first_tear(motion)
    if found is None or balance.parting is None:
        return []
    torn, rate = found
    give_way = []
    growing = balance.parting @ rate
    # the forces of the rows without the part that drives add by moving apart
    together = Motion(motion.equations.together, motion.segment, motion.t, motion.y, motion.since)
    forces = together.start.z[0, system.m : system.m + held.size]
    for number in np.unique(balance.loop[torn]).tolist():
        own = balance.loop == number
        rows = held[own]
        G, D, limits = dense(system.G[rows]), dense(system.D[rows]), _limits(motion, guards, rows)
        bodies = np.flatnonzero(np.abs(G).any(axis=0))
        G = G[:, bodies]
        # the other forces on the bodies of the loop: what its rows hold, and what accelerates the bodies
        push = G.T @ forces[own] + system.inertia[bodies] * motion.start.y[1, bodies]
        if rows.size - np.linalg.matrix_rank(G) > 1:
            found_there = _weakest(rows, G, D @ rate, push, limits)
        else:
            found_there = _first(rows, G, growing[own], push, limits)
        if found_there is not None:
            give_way.append(found_there)
    return give_way


def torn_apart(motion: Motion) -> Indices:
    """Return the held rows that drives tear."""
    held, found = motion.equations.held, _first_tear(motion)
    return held[:0] if found is None else np.asarray(held[found[0]])


def pressed_together(motion: Motion) -> Indices:
    """Return held rows that drives tear though none of them can give way: ties, one-way clutches and stops."""
    rows = torn_apart(motion)
    return rows[:0] if motion.system.is_friction[rows].any() else rows


def beginnings_of_drives(motion: Motion) -> list[tuple[Array, Array]]:
    """Return by what drives begin to move, and how uncertain each of these is. What decides first comes first.

    The Taylor coefficients of their accelerations at the start, without those that are roundoff, precede the
    accelerations shortly after it of drives led by functions that begin to move there.
    """
    system, segment = motion.system, motion.segment
    patterns, rough = system.accelerations_of_drives(segment)
    roundoff = _ROUNDOFF * np.abs(patterns).max(axis=1)
    of_functions = np.where(rough > roundoff, rough, 0.0)
    # slopes of slopes are rough, and their differences are nothing else
    by_order = of_functions, of_functions / SLOPES_STEP, np.where(of_functions > 0, np.inf, 0.0)
    rates = [
        np.where(np.abs(rate) > np.maximum(roundoff, least), rate, 0.0)
        for rate, least in zip(map(system.drive_accelerations, motion.start.q), by_order, strict=True)
    ]
    if of_functions.any():
        # drives that begin so slowly that their derivatives are roundoff have moved all the same, however little
        step = min(SLOPES_STEP, motion.horizon * _SOON[-1])
        soon = segment.sampled(motion.t + np.append([0.0, step], _SOON * motion.horizon))
        velocities, accelerations = system.drive_velocities(soon), system.drive_accelerations(soon)
        # a slope that its difference does not resolve is none
        change = accelerations[:, 1] - rates[0]
        is_none = (of_functions > 0) & (np.abs(change - step * rates[1]) > 0.5 * np.abs(change))
        rates[1] = np.where(is_none, 0.0, rates[1])
        slow = (velocities[:, 2] != velocities[:, 0])[:, None] & (np.abs(accelerations) > of_functions[:, None])
        rates.extend(np.where(slow, accelerations, 0.0).T[3:])
    # where a velocity touches 0, an acceleration turns before it has changed the velocity by its roundoff
    (first, second), speeds = rates[:2], system.drive_velocities(segment.roughness)
    rates[0] = np.where((first * second < 0) & (first**2 <= 2 * np.abs(second) * speeds), 0.0, first)
    return [(rate, rough / SLOPES_STEP if order == 1 else rough) for order, rate in enumerate(rates)]


def _first_tear(motion: Motion) -> tuple[Mask, Array] | None:
    """Tell which held rows are torn first by drives that move apart, and return by what these begin to do so."""
    balance = motion.equations.balance
    if balance.parting is None:
        return None
    for rate, rough in beginnings_of_drives(motion):
        torn = balance.torn(rate, rough)
        if torn.any():
            return torn, rate
    return None


def _limits(motion: Motion, guards: Guards, rows: Indices) -> Array:
    """Return the limits of some rows forward and backward, infinite where there is none."""
    found = np.full((2, motion.system.m), np.inf)
    of_force = guards.direction != 0
    side = np.where(guards.direction[of_force] > 0, 0, 1)
    levels = guards.raw(np.zeros_like(motion.start.z[0]), motion.start_inputs)
    found[side, guards.row[of_force]] = levels[of_force]
    return np.asarray(found[:, rows])


def _first(rows: Indices, G: Array, growing: Array, push: Array, limits: Array) -> tuple[Indices, Array] | None:
    """Return the rows of a single loop that reach their limits first where forces grow as given, and their sides."""
    forces = np.linalg.lstsq(G.T, push, rcond=None)[0]
    side = np.sign(growing)
    limit = np.where(side > 0, limits[0], limits[1])
    some = np.isfinite(limit)
    if not some.any():
        return None
    left = (limit[some] - (side * forces)[some]) / np.abs(growing[some])
    size = ((limit + np.abs(forces))[some] / np.abs(growing[some])).max()
    goes = left <= left.min() + _SOME * size
    return rows[some][goes], side[some][goes]


def _weakest(rows: Indices, G: Array, led: Array, push: Array, limits: Array) -> tuple[Indices, Array] | None:
    """Return the rows that move in the motion that takes least, and their directions."""
    size = np.abs(led).max()
    count, unit = rows.size, np.eye(rows.size)
    # accelerations of bodies are free; relative ones have a part forward and a part backward
    may = np.isfinite(limits).ravel()
    largest = limits.ravel()[may].max(initial=0.0) or 1.0
    pushes, levels = -push / largest, limits.ravel()[may] / largest
    equal = np.hstack([G, np.hstack([-unit, unit])[:, may]])
    bounds = [(None, None)] * G.shape[1] + [(0, None)] * int(may.sum())
    # if the other forces alone are beyond the limits, no motion takes least: then the limits alone decide
    for of_bodies in (pushes, np.zeros(G.shape[1])):
        cost = np.concatenate([of_bodies, levels])
        found = scipy.optimize.linprog(cost, A_eq=equal, b_eq=-led / size, bounds=bounds)
        if found.status == 0:
            break
    else:
        return None
    relative = np.zeros(2 * count)
    relative[may] = found.x[G.shape[1] :]
    w = relative[:count] - relative[count:]
    some = np.abs(w) > _SOME
    return rows[some], np.sign(w[some])
