"""Rows against the oracle of machines: random ties, clutches, gaps and stops, event by event, in every engine."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, partial
from random import Random
from typing import Any

import numpy as np

from stickslip import (
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Gap,
    OneWay,
    Result,
    Scene,
    Spring,
    Stop,
    Tie,
    simulate,
)
from stickslip.model.signals import as_signal
from validation.comparison import AT_THE_END, compare_events, over_family, signal_of
from validation.machine_oracle import solve
from validation.machine_scenes import FAMILIES
from validation.oracle import Event
from validation.rows import Array, Row, Wrong

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


@dataclass(frozen=True)
class Truth:
    """What is compared of a machine: up to `stop`, at times `t`; `doubt` says why that is not the whole scene.

    Parameters
    ----------
    stop : float
        Time in s.
    events : list of Event
        Before that.
    t : array
        Times in s away from events and breaks of loads.
    velocities : array
        A row per time, a column per body.
    forces : list of dict
        Of each time, by name of the row; nan where one is not unique.
    doubt : str
        Empty where the answer is unique to the end.
    """

    stop: float
    events: list[Event]
    t: Array
    velocities: Array
    forces: list[dict[str, float]]
    doubt: str


@cache
def truth(family: str, number: int) -> Truth:
    """Return what the oracle finds."""
    data = FAMILIES[family][0](number)
    found = solve(data)
    stop = BEFORE * found.known if found.doubt else found.known
    events = [event for event in found.events if event[0] < stop * (1 - AT_THE_END)]
    t = stop * (np.arange(POINTS) + 0.37) / POINTS
    jumps = np.array([*found.machine.breaks, *(event[0] for event in events)])
    t = t[[bool(np.abs(jumps - s).min() > 1e-5 * data["t_end"]) for s in t]]
    if stop < 1e-6 * data["t_end"]:
        t = t[:0]
    velocities = np.array([found.velocity(s) for s in t]).reshape(t.size, found.machine.n)
    return Truth(stop, events, t, velocities, [found.forces(s) for s in t], found.doubt)


# The same machine for the package


def scene_of(data: Mapping[str, Any], order: int = 0) -> Scene:
    """Return a scene of plain data, its elements in an order of their own for each number."""
    elements: list[Any] = []
    for body in data["bodies"]:
        if body["inertia"] is None:
            elements.append(Drive(body["name"], velocity=signal_of(body["velocity"])))
        else:
            elements.append(Body(**body))
    elements += [_element(row) for row in data["rows"]]
    for s in data["springs"]:
        a, b, radii = _ends(s["on"])
        if s["k"]:
            elements.append(Spring(a, b, stiffness=s["k"], damping=s["c"], **radii))
        else:
            elements.append(Damper(a, b, damping=s["c"], **radii))
    elements += [Force(force["body"], signal_of(force["load"])) for force in data["forces"]]
    Random(order).shuffle(elements)
    return Scene(*elements)


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
    more: dict[str, Any] = {}
    if "mu_s_back" in row:
        more = {"mu_static_backward": row["mu_s_back"], "mu_coulomb_backward": row["mu_c_back"]}
    law = DryFriction(row["mu_s"], row["mu_c"], dwell=row["tau"], **more)
    return Contact(name, a, b, law, normal=signal_of(row["normal"]), rested=row.get("rested", 0.0), **radii)


# Comparison


def difference(family: str, group: str, number: int) -> float:
    """Return the largest error of velocities over the largest; events and forces that differ are wrong."""
    right, data = truth(family, number), FAMILIES[family][0](number)
    scene = scene_of(data, order=number + list(GROUPS).index(group))
    result = simulate(scene, (0.0, right.stop), t_eval=right.t, **GROUPS[group])
    compare_events(right, result, TIMES[group])
    largest = float(np.abs(right.velocities).max(initial=1e-3))
    error = 0.0
    for k, body in enumerate(data["bodies"]):
        off = np.abs(result.velocity(body["name"]) - right.velocities[:, k]) / largest
        error = max(error, float(off.max(initial=0.0)))
    _compare_forces(right, result, data, FORCES.get(group, FORCE))
    return error


def _compare_forces(right: Truth, result: Result, data: Mapping[str, Any], bound: float) -> None:
    """Compare the forces of rows where they are unique, as parts of the largest force or load."""
    found = {row["name"]: result.force(row["name"]) for row in data["rows"]}
    loads = [as_signal(signal_of(force["load"]), "load") for force in data["forces"]]
    sizes = [abs(load(t)) for load in loads for t in right.t.tolist()]
    sizes += [abs(f) for forces in right.forces for f in forces.values() if not math.isnan(f)]
    largest = max([1e-6, *sizes])
    for k, forces in enumerate(right.forces):
        for name, wanted in forces.items():
            have = found[name][k]
            if not math.isnan(wanted) and not abs(have - wanted) <= bound * largest:
                raise Wrong(f"{name}: force {have:.9g} instead of {wanted:.9g} at t = {right.t[k]:.6g} s")


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
