"""How the oracle settles contacts at rest: all together, by the rules of the model and nothing else."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from validation.oracle_system import Array, Balance, Doubt, System

TIE, NEAR_TIE = 1e-10, 1e-6
"""Loads over levels that differ by less than the first tie; by less than the second, nobody can tell."""
AT_LEVEL, BELOW_LEVEL = 1e-7, 1e-9
"""How far below its level a contact that has just reached it counts as overloaded; how far above it another holds."""

SOON = 1e-6
"""Part of the span after which an acceleration that starts at 0 is looked at."""


@dataclass(frozen=True)
class Instant:
    """All contacts at one instant.

    Parameters
    ----------
    start, later : float
        Time in s, and how much later the loads are looked at where they are 0 and grow.
    x, v : array
        Positions and velocities of all bodies.
    moving : dict
        +1 or -1 of each contact with w other than 0, by number.
    resting : list of int
        Contacts with w = 0.
    since : dict
        t_start of each contact with w = 0.
    reached : set of int
        Contacts that end the piece of motion before: their w or their level was reached.
    """

    start: float
    later: float
    x: Array
    v: Array
    moving: dict[int, int]
    resting: list[int]
    since: dict[int, float]
    reached: set[int]


def settle(system: System, now: Instant) -> dict[int, int | None]:
    """Return the modes of the contacts with w = 0; None where nothing presses them together.

    All are tried stuck. While some |lambda| > B, the one with the largest |lambda|/B is let go with the sign of its
    lambda, those that tie with it too, and lambda is solved again. One let go whose relative acceleration points
    against its mode is tried stuck again.
    """
    slipping: dict[int, int] = {}
    tried: set[frozenset[tuple[int, int]]] = set()
    x = now.x + now.v * now.later
    while True:
        normal = system.loads(now.start, now.later).normal
        stuck = tuple(j for j in now.resting if j not in slipping and normal[j] > 0)
        balance = system.balance(now.start, now.later, x, now.v, now.moving | slipping, stuck)
        let_go = _let_go(system, now, balance)
        if let_go:
            slipping |= let_go
            continue
        against = _against(system, now, balance, slipping)
        if not against:
            break
        if frozenset(slipping.items()) in tried:
            raise Doubt(now.start, "no consistent modes")
        tried.add(frozenset(slipping.items()))
        for j in against:
            del slipping[j]
    return {j: slipping.get(j, 0 if normal[j] > 0 else None) for j in now.resting}


def _let_go(system: System, now: Instant, balance: Balance) -> dict[int, int]:
    """Return the contacts with the largest load beyond their level, and the signs of their forces."""
    loads = {j: _load(system, now, balance, j) for j in balance.held}
    beyond = {
        j: load for j, load in loads.items() if load > (1 - AT_LEVEL if j in now.reached else 1 + BELOW_LEVEL)
    }
    if not beyond:
        return {}
    largest = max(beyond.values())
    if any(largest * (1 - NEAR_TIE) < load < largest * (1 - TIE) for load in loads.values()):
        raise Doubt(now.start, "a near tie")
    return {j: _sign(balance.held[j]) for j, load in beyond.items() if load >= largest * (1 - TIE)}


def _load(system: System, now: Instant, balance: Balance, j: int) -> float:
    """Return |lambda|/B."""
    held = balance.held[j]
    dwelt = now.start + now.later - now.since[j]
    level = system.breakaway(j, _sign(held), dwelt) * balance.normal[j]
    if level > 0:
        return abs(held) / level
    return math.inf if abs(held) > 1e-13 * system.force_scale else 0.0


def _against(system: System, now: Instant, balance: Balance, slipping: dict[int, int]) -> list[int]:
    """Return the contacts let go that accelerate against their modes; one that never accelerates is in doubt."""
    relative = system.incidence @ balance.acceleration
    roundoff = 1e-12 * system.force_scale * system.mobility.max()
    nothing = 1e-9 * np.abs(balance.acceleration).max(initial=0.0) + roundoff
    against = [j for j, mode in slipping.items() if relative[j] * mode < -nothing]
    still = [j for j in slipping if abs(relative[j]) <= nothing]
    if against or not still:
        return against
    # where slipping friction starts at the breakaway level, acceleration starts at 0: its rate decides
    soon = now.later + SOON * system.span
    stuck = tuple(balance.held)
    coming = system.balance(now.start, soon, now.x + now.v * soon, now.v, now.moving | slipping, stuck)
    relative = system.incidence @ coming.acceleration
    if any(relative[j] * slipping[j] <= roundoff for j in still):
        raise Doubt(now.start, "a contact let go that does not accelerate")
    return []


def _sign(force: float) -> int:
    return 1 if force > 0 else -1
