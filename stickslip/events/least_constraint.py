"""Which rows at rest begin to move, by Gauss' principle of least constraint.

Forces ``lambda + delta`` instead of those that hold all rows accelerate them by ``w' = e - W delta``, where
``W = G M^-1 G^T`` and ``e`` are the relative accelerations that drives force upon the rows that they tear apart. Of the
forces within all limits those that follow the laws make ``1/2 delta^T W delta - e^T delta`` as small as possible
(Moreau, "Quadratic programming in mechanics", SIAM Journal on Control 4, 1966). Without drives these are bounded least
squares; with them the proximal point algorithm makes them a few of those (Rockafellar, "Monotone operators and the
proximal point algorithm", SIAM Journal on Control and Optimization 14, 1976). Where static and Coulomb levels are
equal, w' are the accelerations to come. Elsewhere the rows that begin to move carry less than their static level, and
other rows may let go after them.
"""

from __future__ import annotations

import numpy as np
import scipy

from stickslip.equations.algebra.matrices import dense
from stickslip.equations.balance import Balance
from stickslip.equations.guards.guards import Guards
from stickslip.equations.motion import Motion
from stickslip.events.collapse import beginnings_of_drives
from stickslip.events.impact import Jammed
from stickslip.events.sharing import soon
from stickslip.model.arrays import Array, Indices, Mask

_AT_REST = 1e-9  # part of the largest relative acceleration below which a row stays at rest
_ROUNDOFF = 1e-14  # part of its terms below which a relative acceleration is roundoff
_TOLERANCE = 1e-14  # of the least squares
_NEAR = 1e-3  # each step of the proximal point algorithm adds this times the change, squared
_MOST_STEPS = 100
_SLIGHT = 1e-6  # relative acceleration of drives that begin without any, in the unit of the others


def least_constraint(motion: Motion, guards: Guards, part: Mask) -> tuple[Indices, Array]:
    """Return the held rows of a part that have limits, and their relative accelerations; 0 where they stay at rest.

    In this motion all rows of the part are held that may be held, and no other rows are joined to them. Raises `Jammed`
    where drives press rows together that have no limits on this side.
    """
    system, equations = motion.system, motion.equations
    limits = ((~guards.is_velocity) & (guards.direction != 0) & part[guards.row]).nonzero()[0]
    rows, place = np.unique(guards.row[limits], return_inverse=True)
    left, up = soon(motion, guards.start[:, limits]), guards.direction[limits] > 0
    low, high = np.full(rows.size, -np.inf), np.full(rows.size, np.inf)
    low[place[~up]], high[place[up]] = -left[~up], left[up]
    rest = equations.is_held.copy()
    rest[rows] = False
    others = system.balance(rest).together
    per_force = np.asarray(others.accelerations(dense(system.GT[:, rows])))
    root = np.sqrt(system.inertia)[:, None] * per_force  # W = root^T root
    # the tolerance is one of numbers near 1
    force, size = float(np.abs(left).max(initial=0.0)) or 1.0, float(np.abs(root).max(initial=0.0)) or 1.0
    low, high = low / force, high / force
    unit = force * size**2
    led = _led(motion, rows, others, unit)
    x, grows = _least(root / size, led, (low, np.maximum(high, np.nextafter(low, np.inf))))
    if grows.any():
        pushed = -(system.GT[:, rows] @ grows)
        tied = np.abs(others.held_forces(pushed, others.accelerations(pushed))) > _AT_REST * np.abs(grows).max()
        raise Jammed(np.sort(np.append(rows[grows != 0], rest.nonzero()[0][tied])))
    delta = force * x
    accelerations = led * unit - root.T @ (root @ delta)
    roundoff = _ROUNDOFF * (np.abs(root.T) @ (np.abs(root) @ np.abs(delta)))
    moves = np.abs(accelerations) > np.maximum(roundoff, _AT_REST * np.abs(accelerations).max(initial=0.0))
    return rows, np.where(moves, accelerations, 0.0)


def _led(motion: Motion, rows: Indices, others: Balance, unit: float) -> Array:
    """Return in some unit the relative accelerations that drives force upon rows which they tear apart.

    They are those with the forces of the motion that holds all rows, while only the `others` are held. Drives that
    begin without acceleration count with a slight one: they only decide what the loads leave open.
    """
    system, equations, none = motion.system, motion.equations, np.zeros(motion.system.n)
    for order, (rate, _) in enumerate(beginnings_of_drives(motion)):
        if not rate.any():
            continue
        forces = equations.balance.held_forces(none, equations.balance.accelerations(none, rate))
        pushed = -(system.GT[:, rows] @ forces[np.searchsorted(equations.held, rows)])
        found = np.asarray(system.relative(others.accelerations(pushed, rate), rate)[rows])
        found[np.abs(found) <= _AT_REST * np.abs(rate).max()] = 0.0
        if found.any():
            return found * (_SLIGHT / np.abs(found).max() if order else 1.0 / unit)
    return np.zeros(rows.size)


def _least(root: Array, led: Array, bounds: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the x within bounds that makes ``1/2 |root x|^2 - led x`` least, and how it grows if there is none."""
    none, bounded = np.zeros(root.shape[0]), np.zeros(led.size)
    if not led.any():
        return scipy.optimize.lsq_linear(root, none, bounds, method="bvls", tol=_TOLERANCE).x, bounded
    near, x = np.vstack([root, _NEAR * np.eye(led.size)]), np.clip(bounded, *bounds)
    for _ in range(_MOST_STEPS):
        goal = np.concatenate([none, _NEAR * x + led / _NEAR])
        last, x = x, scipy.optimize.lsq_linear(near, goal, bounds, method="bvls", tol=_TOLERANCE).x
        step = x - last
        if np.abs(step).max() <= _TOLERANCE * np.abs(x).max():
            return x, bounded
    # a step that accelerates nothing and is as large as ever leads on for ever
    grows = np.abs(root @ step).max(initial=0.0) <= _AT_REST * np.abs(step).max() and led @ step > 0
    return x, np.where(np.isinf(np.where(step > 0, bounds[1], bounds[0])), step, 0.0) if grows else bounded
