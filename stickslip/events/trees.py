"""Which modes come next where one row is at its limit and its neighbours form a tree (MODEL rules 2 and 3).

The same decisions as `settle` takes for a whole scene, wherever they are clear: where rows tie, or a force is within
roundoff of its level, no decision is made here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stickslip.equations.forest import Forest
from stickslip.model.arrays import Array, Indices, Modes

CLEAR = 1e-9  # forces nearer to their levels than this part of them are settled with the whole scene
_MOVES = 1e-7  # relative accelerations below this part of what the level would cause are, too


class Tree(NamedTuple):
    """Bodies that held rows, and the row at its limit, join."""

    bodies: Indices  # (k,): in order of their places
    # (k,): their inertias, and the forces on them, all but those of the rows
    inertia: Array
    force: Array
    rows: Indices  # (h,): the rows, the one at its limit first
    # (h,): levels that they hold forward and backward
    upper: Array
    lower: Array
    # (h,): forces while they slip
    forward: Array
    backward: Array
    # acceleration of the ground or drive that one of the rows joins to, None where none does
    lead: float | None


class TreeModes(NamedTuple):
    """The modes in which a tree goes on."""

    mode: Modes  # (h,): of the rows of the tree
    group: Indices  # (k,): bodies with the same number stay together


def settle_tree(forest: Forest, tree: Tree, side: int) -> TreeModes | None:
    """Return the modes in which a tree goes on, None where that is not clear.

    `side` is the direction in which the first row lets go, 0 where it has come to rest.
    """
    if tree.bodies.size == 1 and tree.rows.size == 1:
        # most events of a chain such as an earthquake fault are of this kind: the general way takes a tenth longer
        return _settle_one(forest, tree, side)
    rows = tree.rows
    mode = np.zeros(rows.size, dtype=np.int8)
    at = forest.first[tree.bodies]
    child, parent = forest.child[rows], forest.parent[rows]
    place = np.searchsorted(at, forest.first[child])
    beyond = np.searchsorted(at, forest.last[child], side="right")
    above = np.where(parent >= 0, np.searchsorted(at, forest.first[np.maximum(parent, 0)]), -1)
    force = tree.force.copy()
    group = np.zeros(tree.bodies.size, dtype=np.intp)
    if side:
        _release(tree, forest, mode, force, 0, side, place, above)
    for _ in range(rows.size + 1):
        group, a = _move(tree, mode, force, place, beyond, parent)
        held = (mode == 0).nonzero()[0]
        if not held.size:
            break
        rest = force - tree.inertia * a
        shares = _shares(forest, rows, held, rest, group, place, beyond)
        level = np.where(shares > 0, tree.upper[held], tree.lower[held])
        if (level <= 0).any():
            return None
        ratio = np.abs(shares) / level
        order = np.argsort(ratio)
        worst = int(order[-1])
        if ratio[worst] < 1 - CLEAR:
            break
        if (np.abs(ratio - 1) <= CLEAR).any() or (order.size > 1 and ratio[order[-2]] >= ratio[worst] * (1 - CLEAR)):
            return None
        _release(tree, forest, mode, force, int(held[worst]), 1 if shares[worst] > 0 else -1, place, above)
    moving = mode.nonzero()[0]
    if moving.size:
        back = np.where(above[moving] >= 0, a[above[moving]], tree.lead or 0.0)
        apart = forest.sign[rows[moving]] * (a[place[moving]] - back) * mode[moving]
        level = np.maximum(tree.upper[moving], tree.lower[moving])
        if (apart <= _MOVES * level / tree.inertia.sum()).any():
            return None
    return TreeModes(mode, group)


def _settle_one(forest: Forest, tree: Tree, side: int) -> TreeModes | None:
    """Settle one body on the ground or on a drive."""
    sign = float(forest.sign[tree.rows[0]])
    lead, inertia = tree.lead or 0.0, float(tree.inertia[0])
    share = sign * (float(tree.force[0]) - inertia * lead)
    level = float(tree.upper[0] if share > 0 else tree.lower[0])
    if level <= 0:
        return None
    if not side:
        ratio = abs(share) / level
        if ratio < 1 - CLEAR:
            return TreeModes(np.zeros(1, dtype=np.int8), np.zeros(1, dtype=np.intp))
        if ratio <= 1 + CLEAR:
            return None
        side = 1 if share > 0 else -1
    friction = float(tree.forward[0] if side > 0 else tree.backward[0])
    if side * (share - side * friction) <= _MOVES * level:
        return None
    return TreeModes(np.full(1, side, dtype=np.int8), np.zeros(1, dtype=np.intp))


def _release(
    tree: Tree,
    forest: Forest,
    mode: Modes,
    force: Array,
    k: int,
    side: int,
    place: Indices,
    above: Indices,
) -> None:
    """Let a row slip: its friction is one of the forces from now on."""
    mode[k] = side
    friction = forest.sign[tree.rows[k]] * side * (tree.forward[k] if side > 0 else tree.backward[k])
    force[place[k]] -= friction
    if above[k] >= 0:
        force[above[k]] += friction


def _move(
    tree: Tree, mode: Modes, force: Array, place: Indices, beyond: Indices, parent: Indices
) -> tuple[Indices, Array]:
    """Return which bodies stay together, and the accelerations of all."""
    group = np.zeros(tree.bodies.size, dtype=np.intp)
    cuts = mode.nonzero()[0]
    for k in cuts[np.argsort(place[cuts])].tolist():
        group[place[k] : beyond[k]] = place[k] + 1
    total, inertia = np.bincount(group, force), np.bincount(group, tree.inertia)
    a = total / np.where(inertia > 0, inertia, 1.0)
    if tree.lead is not None:
        for k in ((mode == 0) & (parent < 0)).nonzero()[0].tolist():
            a[group[place[k]]] = tree.lead
    return group, a[group]


def _shares(
    forest: Forest, rows: Indices, held: Indices, rest: Array, group: Indices, place: Indices, beyond: Indices
) -> Array:
    """Return the forces of held rows: sums of the forces on their far sides that accelerate no body, the `rest`."""
    found = np.empty(held.size)
    own = group[place[held]]
    for one in np.unique(own).tolist():
        some = (own == one).nonzero()[0]
        sums = np.concatenate([[0.0], np.cumsum(np.where(group == one, rest, 0.0))])
        k = held[some]
        found[some] = forest.sign[rows[k]] * (sums[beyond[k]] - sums[place[k]])
    return found
