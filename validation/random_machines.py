"""Rows against the oracle of machines: random ties, clutches, gaps and stops, event by event, in every engine."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache, partial
from typing import Any

from stickslip import Contact, Gap, OneWay, Scene, Stop, Tie, simulate
from stickslip.model.signals import as_signal
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
from validation.machine_oracle import solve
from validation.machine_scenes import FAMILIES
from validation.rows import Row

machine_row = partial(Row, "Machines")
GROUPS: dict[str, dict[str, Any]] = {
    "auto": {},
    "BDF": {"method": "BDF", "rtol": 1e-10, "atol": 1e-13},
    "merged": {"formulation": "merged", "method": "Adams", "rtol": 1e-10, "atol": 1e-13},
    "multiplier": {"formulation": "multiplier", "rtol": 1e-9, "atol": 1e-12},
}
"""What is run of each family: the default, and every formulation."""
TIMES = {"auto": 1e-9, "BDF": 1e-7, "merged": 1e-7, "multiplier": 1e-6}
"""Largest errors of event times over the span."""
BOUNDS = {"auto": 1e-9, "BDF": 1e-6, "merged": 1e-6, "multiplier": 1e-5}
"""Largest errors of velocities over the largest."""
FORCES = {"auto": 1e-7}
FORCE = 1e-4
"""Largest errors of forces over the largest: they follow stiff springs."""
BEFORE, POINTS = 0.99, 60
"""Part of the time up to which the answer is unique, and how many times are compared."""


@cache
def truth(family: str, number: int) -> Truth:
    """Return what the oracle finds."""
    data = FAMILIES[family][0](number)
    found = solve(data)
    return truth_of(found, data, found.machine.breaks, BEFORE, POINTS)


def scene_of(data: Mapping[str, Any], order: int | None = 0) -> Scene:
    """Return a scene of plain data, its elements in another order for each number, as they stand for None."""
    springs = []
    for s in data.get("springs", ()):
        a, b, radii = _ends(s["on"])
        springs.append(spring_of(s, a, b, **radii))
    return scene_with(data, map(_element, data["rows"]), springs, order)


def _ends(on: Mapping[str, float]) -> tuple[str, str, dict[str, float]]:
    (a, radius_a), (b, radius_b) = on.items()
    return a, b, {"radius_a": radius_a, "radius_b": -radius_b}


def _element(row: Mapping[str, Any]) -> Any:
    name, kind = row["name"], row["kind"]
    if kind == "tie":
        return Tie(name, row["on"])
    a, b, radii = _ends(row["on"])
    limits = {key: row[key] for key in ("lower", "upper") if key in row}
    if kind == "one-way":
        return OneWay(name, a, b, **radii)
    if kind == "gap":
        return Gap(name, a, b, stiffness=row["k"], damping=row["c"], **limits, **radii)
    if kind == "stop":
        return Stop(name, a, b, restitution=row["e"], **limits, **radii)
    normal, rested = signal_of(row["normal"]), row.get("rested", 0.0)
    return Contact(name, a, b, law_of(row), normal=normal, rested=rested, **radii)


def difference(family: str, group: str, number: int) -> float:
    """Return the largest error of velocities over the largest; events and forces that differ are wrong."""
    right, data = truth(family, number), FAMILIES[family][0](number)
    scene = scene_of(data, order=number + list(GROUPS).index(group))
    result = simulate(scene, (0.0, right.stop), t_eval=right.t, **GROUPS[group])
    compare_events(right, result, TIMES[group])
    loads = [as_signal(signal_of(force["load"]), "load") for force in data["forces"]]
    largest = max([1e-6, *(abs(load(t)) for load in loads for t in right.t.tolist())])
    compare_forces(right, result, FORCES.get(group, FORCE), largest)
    return compare_velocities(right, result)


def rows(count: int) -> list[Row]:
    """Return the rows: `count` scenes of each family in each engine."""
    return [
        machine_row(
            f"machines-{family}/{group}",
            f"{count} scenes of {what}: events, forces; velocities over the largest ({group})",
            "an independent simulator of the model; validation.machine_oracle",
            partial(over_family, truth, difference, family, group, count),
            BOUNDS[group],
            quick=group == "auto",
            limit=60.0 + 10.0 * count,
            tries="runs against the oracle of machines",
        )
        for family, (_, what) in FAMILIES.items()
        for group in GROUPS
    ]
