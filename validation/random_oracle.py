"""Rows against the oracle: random scenes in families, event by event, in every formulation."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache, partial
from typing import Any

from stickslip import Contact, Scene, position, relative_velocity, simulate, stretch, velocity
from validation.comparison import (
    Truth,
    compare_events,
    compare_forces,
    compare_velocities,
    law_of,
    over_family,
    scene_with,
    signal_of,
    spring_of,
    truth_of,
)
from validation.oracle import solve
from validation.oracle_scenes import FAMILIES
from validation.rows import Row

oracle_row = partial(Row, "Oracle")
GROUPS: dict[str, dict[str, Any]] = {
    "contact-force": {"rtol": 1e-10, "atol": 1e-13},
    "merged": {"formulation": "merged", "method": "Adams", "rtol": 1e-10, "atol": 1e-13},
    "multiplier": {"formulation": "multiplier", "rtol": 1e-9, "atol": 1e-12},
}
"""What is run of each family: every formulation, and Adams as well as BDF."""
TIMES = {"multiplier": 1e-6}
TIME = 1e-7
"""Largest errors of event times over the span."""
FORCES = 1e-4
"""Largest error of friction forces over the largest: they follow stiff springs and steep Stribeck curves."""
BOUNDS = {"multiplier": 1e-5}
BOUND = 1e-6
"""Largest errors of velocities over the largest."""
BEFORE = 0.9995
"""Part of the time up to which the answer is unique that is compared."""
POINTS = 100
QUANTITIES = {
    "position": position,
    "velocity": velocity,
    "stretch": stretch,
    "relative_velocity": relative_velocity,
}


@cache
def truth(family: str, number: int) -> Truth:
    """Return what the oracle finds."""
    data = FAMILIES[family][0](number)
    found = solve(data)
    return truth_of(found, data, found.system.breaks, BEFORE, POINTS)


def scene_of(data: Mapping[str, Any], order: int | None = 0) -> Scene:
    """Return a scene of plain data, its elements in another order for each number, as they stand for None."""
    springs = [spring_of(s, s["a"], s["b"]) for s in data.get("springs", ())]
    return scene_with(data, map(_contact, data["contacts"]), springs, order)


def _contact(data: Mapping[str, Any]) -> Contact:
    normal, rested = signal_of(data["normal"]), data.get("rested", 0.0)
    for quantity, name, factor in data.get("pressed_by", []):
        normal = normal + factor * QUANTITIES[quantity](name)
    return Contact(data["name"], data["a"], data["b"], law_of(data), normal=normal, rested=rested)


def difference(family: str, group: str, number: int) -> float:
    """Return the largest error of velocities over the largest; events and forces that differ are wrong."""
    right, data = truth(family, number), FAMILIES[family][0](number)
    if not right.stop:
        # the oracle doubts from the start on: there is nothing to compare
        return 0.0
    scene = scene_of(data, order=number + list(GROUPS).index(group))
    result = simulate(scene, (0.0, right.stop), t_eval=right.t, **GROUPS[group])
    compare_events(right, result, TIMES.get(group, TIME))
    compare_forces(right, result, FORCES, 1e-9)
    return compare_velocities(right, result)


def rows(count: int) -> list[Row]:
    """Return the rows: `count` scenes of each family in each formulation."""
    return [
        oracle_row(
            f"oracle-{family}/{group}",
            f"{count} scenes of {what}: events, forces; velocities over the largest ({group})",
            "an independent simulator of the model; validation.oracle",
            partial(over_family, truth, difference, family, group, count),
            BOUNDS.get(group, BOUND),
            limit=60.0 + 10.0 * count,
            tries="runs against the oracle",
        )
        for family, (_, what) in FAMILIES.items()
        for group in GROUPS
    ]
