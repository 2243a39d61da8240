"""How the oracle settles contacts at rest: all together, by the rules of the model and nothing else."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from validation.oracle_sharing import Cut, capacity, cuts, need
from validation.oracle_system import Array, Balance, Doubt, System

# Loads over levels that differ by less than the first tie. Whether those tie that differ by less than the second is in
# doubt.
TIE, NEAR_TIE = 1e-10, 1e-6

# How far below its level a contact that has just reached it counts as overloaded; how far above it others still hold.
AT_LEVEL, BELOW_LEVEL = 1e-7, 1e-9

JUST_AFTER = 1e-9  # part of the span after which forces and levels that are both 0 are looked at
SOON = 1e-6  # part of the span after which an acceleration that starts at 0 is looked at


@dataclass(frozen=True)
class Instant:
    """All contacts at one instant."""

    start: float  # time in s
    later: float  # how much later in s the loads are looked at where they are 0 and grow
    x: Array  # positions of all bodies
    v: Array  # velocities
    moving: dict[int, int]  # +1 or -1 of each contact with w other than 0, by number
    resting: list[int]  # contacts with w = 0
    since: dict[int, float]  # t_start of each of them
    reached: set[int]  # contacts that end the piece of motion before: their w or their level was reached
    opened: frozenset[int]  # contacts that the state opens: their normal force depends on it
    a: Array  # accelerations for the state at `later`; forces that are 0 now add nothing to them

    def balance(self, system: System, slipping: dict[int, int], stuck: Sequence[int], soon: float) -> Balance:
        """Return forces and accelerations at the time `start` + `soon`, with the state moved on to it."""
        x, v = self.x + self.v * soon, self.v + self.a * soon
        return system.balance(self.start, soon, x, v, slipping, stuck, self.opened)


def settle(system: System, now: Instant) -> dict[int, int | None]:
    """Return the modes of the contacts with w = 0; None where nothing presses them together.

    All are tried stuck. While some |lambda| > B, the one with the largest |lambda|/B is let go with the sign of its
    lambda, those that tie with it too, and lambda is solved again. One let go whose relative acceleration points
    against its mode is tried stuck again. Contacts that lock the same motion are let go together, where they cannot
    carry together what they have to.
    """
    slipping: dict[int, int] = {}
    tried: set[frozenset[tuple[int, int]]] = set()
    while True:
        normal = now.balance(system, now.moving | slipping, (), now.later).normal
        stuck = tuple(j for j in now.resting if j not in slipping and normal[j] > 0)
        balance = now.balance(system, now.moving | slipping, stuck, now.later)
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
    stuck = tuple(balance.held)
    loads = {cut: _load(system, now, balance, cut) for cut in cuts(system, stuck)}
    loads |= _loads_to_come(system, now, balance, [cut for cut in loads if math.isnan(loads[cut])])

    def limit(cut: Cut) -> float:
        return 1 - AT_LEVEL if now.reached.issuperset(cut.contacts) else 1 + BELOW_LEVEL

    beyond = {cut: load for cut, load in loads.items() if load > limit(cut)}
    if not beyond:
        return {}
    largest = max(beyond.values())
    if any(largest * (1 - NEAR_TIE) < load < largest * (1 - TIE) for load in loads.values()):
        raise Doubt(now.start, "a near tie")
    if len(beyond) > 1 and any(len(cut.contacts) > 1 for cut in beyond):
        # the model does not say which of them goes first
        raise Doubt(now.start, "several sets of contacts that let go at once")
    signs: dict[int, int] = {}
    for cut, load in beyond.items():
        if load >= largest * (1 - TIE):
            signs |= dict(zip(cut.contacts, cut.signs, strict=True))
    return signs


def _load(system: System, now: Instant, balance: Balance, cut: Cut, later: float = 0.0) -> float:
    """Return lambda/B, or the sums of both over a cut; nan where both are 0."""
    time = now.start + now.later + later
    held, level = need(cut, balance.held), capacity(system, cut, time, now.since, balance.normal)
    if level > 0:
        return held / level
    if later:
        return math.inf if held > 1e-16 * system.force_scale else 0.0
    return math.nan if abs(held) <= 1e-13 * system.force_scale else math.copysign(math.inf, held)


def _loads_to_come(system: System, now: Instant, balance: Balance, unknown: list[Cut]) -> dict[Cut, float]:
    """Return the loads just after now, where forces and levels are 0."""
    if not unknown:
        return {}
    later = JUST_AFTER * system.span
    soon = now.later + later
    slipping = {**now.moving, **balance.slipping}
    coming = replace(now, a=balance.acceleration).balance(system, slipping, tuple(balance.held), soon)
    return {cut: _load(system, now, coming, cut, later) for cut in unknown}


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
    ahead = replace(now, a=balance.acceleration)
    coming = ahead.balance(system, now.moving | slipping, stuck, soon)
    relative = system.incidence @ coming.acceleration
    if any(relative[j] * slipping[j] <= roundoff for j in still):
        raise Doubt(now.start, "a contact let go that does not accelerate")
    return []
