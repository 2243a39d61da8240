"""How contacts that lock the same motion share it in the oracle: rule 8 of the model, by cuts and least distances.

Forces within all limits exist exactly where no cut is overloaded: where for each set of bodies the contacts that join
it to the rest can together carry what it needs (max-flow min-cut). Those given are of least norm.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import nnls

from validation.oracle_system import Array, Balance, Doubt, System

MOST_BODIES = 10


class Cut(NamedTuple):
    """Contacts that join some bodies to the rest, and the sign of each in the force between these."""

    contacts: tuple[int, ...]
    signs: tuple[int, ...]


def cuts(system: System, stuck: Sequence[int]) -> list[Cut]:
    """Return the smallest cuts of the stuck contacts, in both directions; single ones where nothing is shared."""
    if system.independent(stuck):
        return [Cut((j,), (sign,)) for j in stuck for sign in (1, -1)]
    rows = system.incidence[list(stuck)]
    bodies = [i for i in range(system.size) if system.mobility[i] > 0 and rows[:, i].any()]
    if len(bodies) > MOST_BODIES:
        raise Doubt(system.start, "too many bodies to look at all cuts")
    found: dict[frozenset[int], Array] = {}
    for size in range(1, len(bodies) + 1):
        for chosen in combinations(bodies, size):
            signs = rows[:, list(chosen)].sum(axis=1)
            support = frozenset(np.flatnonzero(signs).tolist())
            if support:
                found.setdefault(support, signs)
    smallest = [s for s in found if not any(other < s for other in found)]
    return [
        Cut(tuple(stuck[k] for k in sorted(s)), tuple(int(way * found[s][k]) for k in sorted(s)))
        for s in smallest
        for way in (1, -1)
    ]


def need(cut: Cut, held: dict[int, float]) -> float:
    """Return the force that a cut has to carry, in its direction."""
    return sum(sign * held[j] for j, sign in zip(cut.contacts, cut.signs, strict=True))


def capacity(system: System, cut: Cut, time: float, since: dict[int, float], normal: Array) -> float:
    """Return the force that the contacts of a cut can carry together, in its direction."""
    return float(
        sum(
            system.breakaway(j, sign, time - since[j]) * normal[j]
            for j, sign in zip(cut.contacts, cut.signs, strict=True)
        )
    )


def shared(system: System, balance: Balance, time: float, since: dict[int, float]) -> dict[int, float]:
    """Return the forces of least norm within all limits, by the method of least distances (Lawson and Hanson)."""
    stuck = list(balance.held)
    least = np.array([balance.held[j] for j in stuck])
    if system.independent(stuck):
        return balance.held
    high, low = (
        np.array([sign * system.breakaway(j, sign, time - since[j]) * balance.normal[j] for j in stuck])
        for sign in (1, -1)
    )
    # forces that move nothing: the forces of least norm plus some of these must be within the limits
    idle = null_space(system.incidence[list(stuck)].T * (system.mobility > 0)[:, None])
    scale = max(float(np.abs(least).max()), 1e-300)
    # forces outside loops cannot be changed: if roundoff puts one beyond its limit, the others need not change
    some = np.abs(idle).max(axis=1, initial=0.0) > 1e-9
    rows = np.vstack([idle[some], -idle[some]])
    needed = np.concatenate([(low - least)[some], (least - high)[some]]) / scale
    if needed.max(initial=0.0) <= 0:
        return balance.held
    wide = np.vstack([rows.T, needed])
    target = np.zeros(wide.shape[0])
    target[-1] = 1.0
    weights, _ = nnls(wide, target)
    rest = wide @ weights - target
    if abs(rest[-1]) < 1e-9:
        return balance.held
    found = least - scale * (idle @ rest[:-1]) / rest[-1]
    return dict(zip(stuck, found.tolist(), strict=True))
