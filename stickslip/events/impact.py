"""Velocities that jump: impacts at stops, and drives whose velocity jumps, as pure functions.

With ``sep`` the velocities with which the members of one-sided rows part, N their coefficients and P their impulses,

    M (v+ - v-) = N^T P,    0 <= P  complementary to  sep+ + e sep- >= 0,

while ties hold. That is the point of ``{v : ties hold, sep >= -e sep-}`` nearest to ``v-`` in kinetic energy: it is
unique, also where impulses are not. It is found by the least distance programming of Lawson and Hanson (Solving Least
Squares Problems, 1974, ch. 23). Their active set method ends: each step has a smaller residual than all before, and so
no set of rows comes twice.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from stickslip.equations.algebra.matrices import dense, row_maxima
from stickslip.equations.balance import component_numbers
from stickslip.equations.mode_equations import no_body_moves
from stickslip.equations.system import System
from stickslip.events.nonnegative import nonnegative_least_squares
from stickslip.model.arrays import Array, Indices, Mask, Modes

SAME = 1e-12  # part of a speed by which velocities that are equal may differ
_FEW = 50  # rows up to which dense matrices are the faster way to find which are joined
_RANK = 1e-12
_NO_DISTANCE = 1e-8


class Jammed(Exception):
    """No velocities satisfy the rows: drives press rigid ones together."""

    def __init__(self, rows: Indices) -> None:
        super().__init__("no velocities satisfy the rows")
        self.rows = rows


class Struck(NamedTuple):
    """What an impact does."""

    v: Array  # (n,): velocities of the bodies after it
    impulses: Array  # (m,): of all rows; they act with ``-c_i r`` on body i
    # (m,): the energy in J that each row took: over an impulse r its relative velocity goes from w- to w+,
    # and the work is ``r (w- + w+) / 2``
    lost: Array


def roundoff_of_velocities(system: System, v: Array, before: Array, after: Array) -> Array:
    """Return by how much relative velocities (m,) that are equal may differ.

    It is a part of the speeds which the bodies of a row may get from bodies that they are joined to, and from drives
    with the velocities `before` and `after`.
    """
    transmission = system.transmission
    led = transmission.led(np.maximum(np.abs(before), np.abs(after)))
    return SAME * row_maxima(system.abs_G * transmission.handed_on(np.maximum(np.abs(v), led)))


def struck(
    system: System,
    v: Array,
    before: Array,
    after: Array,
    sides: Modes,
    hit: Mask,
    margin: Array | float = 0.0,
) -> Struck:
    """Return the velocities after impacts, and after jumps of drives.

    First ties, locked one-way clutches and stops at a limit take part, those that are hit with their restitution. If
    that turns a free one-way clutch forward, or drives a stop into its limit that has parted or was parting from it,
    all rows take part in a second impact without restitution. So no impact makes energy. Rebounds slower than the
    `margin` do not happen.

    Drives have the velocities `before` and `after`; `sides` are +1 where a stop is at its upper limit and -1 at its
    lower one, and those of `hit` come there now. Raises `Jammed` where no velocities satisfy all rows.
    """
    least = roundoff_of_velocities(system, v, before, after)
    turn = np.where(system.is_one_way, 1, sides).astype(float)
    w = system.relative(v, before)
    wanted = np.where(hit, system.restitution * np.maximum(turn * w, 0.0), 0.0)
    wanted[wanted < margin] = 0.0
    # a row that parts carries no impulse yet: that would add energy
    taking_part = ((sides != 0) | system.is_one_way) & (turn * w >= -least)
    found, impulses = _nearest(system, v, after, taking_part, turn, wanted, least)
    between = system.relative(found, after)
    lost = 0.5 * impulses * (w + between)
    # in the end none of these may move on: clutches forward, stops into their limits
    every = (sides != 0) | system.is_one_way
    if np.any(every & (turn * between > least)):
        found, more = _nearest(system, found, after, every, turn, np.zeros(system.m), least)
        impulses += more
        lost += 0.5 * more * (between + system.relative(found, after))
    ties = system.is_tie.nonzero()[0]
    if ties.size:
        balance = system.balance(system.is_tie)
        impulses[ties] = balance.held_forces(-(system.GT @ impulses), found - v)
    return Struck(found, impulses, lost)


def _nearest(
    system: System, v: Array, u: Array, part: Mask, turn: Array, wanted: Array, least: Array
) -> tuple[Array, Array]:
    """Return the velocities nearest to `v` with which ties hold and rows of `part` separate as fast as `wanted`.

    Also return the impulses of these rows.
    """
    impulses = np.zeros(system.m)
    ties = system.is_tie
    balance = system.balance(ties)
    v = balance.project(v, u)
    rows = part.nonzero()[0]
    sign = -turn[rows]
    short = wanted[rows] - sign * system.relative(v, u)[rows]
    if rows.size and np.count_nonzero(ties):
        # rows that ties lock cannot move: a velocity that they lack is roundoff, or impossible
        locked = no_body_moves(system.G[rows], balance, system.largest_lever[rows])
        if np.any(torn := locked & (short > least[rows])):
            raise Jammed(rows[torn])
        rows, sign, short = rows[~locked], sign[~locked], short[~locked]
    if not np.any(short > least[rows]):
        return v, impulses
    push = dense(system.GT[:, rows]) * sign
    answer = balance.accelerations(push)
    gram = push.T @ answer
    # Joined rows are solved together if one of them is too slow. Other groups are solved by themselves: their speeds
    # may be far smaller.
    number = component_numbers(gram if rows.size < _FEW else scipy.sparse.csr_array(gram))
    impulse = np.zeros(rows.size)
    for one in np.unique(number[short > least[rows]]).tolist():
        some = (number == one).nonzero()[0]
        impulse[some] = _complementary(gram[np.ix_(some, some)], short[some], rows[some])
    impulses[rows] = turn[rows] * impulse
    v = v + answer @ impulse
    # rows that stay together are equally fast to the last bit
    closed = ties.copy()
    closed[rows[(impulse > 0) & (wanted[rows] == 0)]] = True
    return np.asarray(system.balance(closed).project(v, u)), impulses


def _complementary(gram: Array, short: Array, rows: Indices) -> Array:
    """Return ``P >= 0`` complementary to ``gram P - short >= 0``, with `gram` symmetric and positive semidefinite."""
    size = np.sqrt(np.maximum(gram.diagonal(), 0.0))
    stiff = size > 0
    if np.any(~stiff & (short > 0)):
        raise Jammed(rows[~stiff & (short > 0)])
    if rows.size == 1:
        return np.asarray(short / gram[0])
    size[~stiff] = 1.0
    unit, gap = gram / np.multiply.outer(size, size), short / size
    scale = float(np.abs(gap).max())
    values, vectors = np.linalg.eigh(unit)
    kept = values > _RANK * values.max()
    lines = np.sqrt(values[kept])[:, None] * vectors[:, kept].T
    matrix = np.vstack([lines, gap / scale])
    target = np.zeros(matrix.shape[0])
    target[-1] = 1.0
    found = nonnegative_least_squares(matrix, target)
    distance = float(np.linalg.norm(matrix @ found - target))
    if distance <= _NO_DISTANCE:
        raise Jammed(rows[found > 0])
    # once the active rows are known their impulses follow from their equations: without the solver's roundoff
    active = (found > _RANK * found.max(initial=0.0)).nonzero()[0]
    while active.size:
        exact = np.linalg.lstsq(unit[np.ix_(active, active)], gap[active], rcond=_RANK)[0]
        if (exact >= 0).all():
            impulse = np.zeros(rows.size)
            impulse[active] = exact
            return np.asarray(impulse / size)
        active = active[exact >= 0]
    return np.asarray(found * scale / distance**2 / size)
