"""Rows against the oracle: random scenes in families, event by event, in every formulation."""

from __future__ import annotations

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
    Result,
    Scene,
    Spring,
    position,
    relative_velocity,
    simulate,
    stretch,
    velocity,
)
from validation.comparison import AT_THE_END, compare_events, over_family, signal_of
from validation.oracle import Event, solve
from validation.oracle_scenes import FAMILIES
from validation.rows import Array, Row, Wrong

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


# The oracle's answer


@dataclass(frozen=True)
class Truth:
    """What is compared of a scene: up to `stop`, at times `t`; `doubt` says why that is not the whole scene.

    Parameters
    ----------
    stop : float
        Time in s.
    events : list of Event
        Before that.
    t : array
        Times in s away from events and breaks of loads, where the friction forces are unique.
    velocities, friction : array
        A row per time, a column per body or contact; nan where a friction force is not unique.
    bodies : list of str
        Names of the columns of velocities.
    doubt : str
        Empty where the answer is unique to the end.
    """

    stop: float
    events: list[Event]
    t: Array
    velocities: Array
    friction: Array
    bodies: list[str]
    doubt: str


@cache
def truth(family: str, number: int) -> Truth:
    """Return what the oracle finds."""
    data = FAMILIES[family][0](number)
    found = solve(data)
    stop = BEFORE * found.known if found.doubt else found.known
    events = [event for event in found.events if event[0] < stop * (1 - AT_THE_END)]
    t = stop * (np.arange(POINTS) + 0.37) / POINTS
    jumps = np.array([*found.system.breaks, *(event[0] for event in events)])
    t = t[[bool(np.abs(jumps - s).min() > 1e-5 * stop) for s in t]]
    if stop < 1e-6 * data["t_end"]:
        t = t[:0]
    velocities = np.array([found.velocity(s) for s in t]).reshape(t.size, found.system.size)
    unknown = np.full(len(data["contacts"]), np.nan)
    forces = [found.friction(s) for s in t]
    friction = np.array([unknown if f is None else f for f in forces]).reshape(t.size, unknown.size)
    return Truth(stop, events, t, velocities, friction, found.system.bodies, found.doubt)


# The same scene for the package


def scene_of(data: Mapping[str, Any], order: int = 0) -> Scene:
    """Return a scene of plain data, its elements in an order of their own for each number."""
    elements: list[Any] = []
    for body in data["bodies"]:
        if body["inertia"] is None:
            elements.append(Drive(body["name"], velocity=signal_of(body["velocity"])))
        else:
            given = {"velocity": body["velocity"], "position": body.get("position", 0.0)}
            elements.append(Body(body["name"], inertia=body["inertia"], **given))
    elements += [_contact(contact) for contact in data["contacts"]]
    for s in data["springs"]:
        if s["k"]:
            more = {"damping": s["c"], "rest": s.get("rest", 0.0)}
            elements.append(Spring(s["a"], s["b"], stiffness=s["k"], **more))
        else:
            elements.append(Damper(s["a"], s["b"], damping=s["c"]))
    elements += [Force(force["body"], signal_of(force["load"])) for force in data["forces"]]
    Random(order).shuffle(elements)
    return Scene(*elements)


def _contact(data: Mapping[str, Any]) -> Contact:
    more: dict[str, Any] = {}
    if "mu_s_back" in data:
        more = {"mu_static_backward": data["mu_s_back"], "mu_coulomb_backward": data["mu_c_back"]}
    if data.get("vs"):
        more |= {"stribeck_velocity": data["vs"], "stribeck_exponent": data["delta"]}
    law = DryFriction(data["mu_s"], data["mu_c"], dwell=data["tau"], **more)
    normal, rested = signal_of(data["normal"]), data.get("rested", 0.0)
    for quantity, name, factor in data.get("pressed_by", []):
        normal = normal + factor * QUANTITIES[quantity](name)
    return Contact(data["name"], data["a"], data["b"], law, normal=normal, rested=rested)


# Comparison


def difference(family: str, group: str, number: int) -> float:
    """Return the largest error of velocities over the largest; events and forces that differ are wrong."""
    right = truth(family, number)
    data = FAMILIES[family][0](number)
    scene = scene_of(data, order=number + list(GROUPS).index(group))
    result = simulate(scene, (0.0, right.stop), t_eval=right.t, **GROUPS[group])
    compare_events(right, result, TIMES.get(group, TIME))
    largest = float(np.abs(right.velocities).max(initial=1e-3))
    free = [k for k, body in enumerate(data["bodies"]) if body["inertia"] is not None]
    found = np.array([result.velocity(right.bodies[k]) for k in free]).T
    error = float(np.abs(found - right.velocities[:, free]).max(initial=0.0)) / largest
    _compare_forces(right, result, [contact["name"] for contact in data["contacts"]])
    return error


def _compare_forces(right: Truth, result: Result, contacts: list[str]) -> None:
    """Compare friction forces where they are unique."""
    largest = float(np.nanmax(np.abs(right.friction), initial=1e-9))
    for k, name in enumerate(contacts):
        wanted = right.friction[:, k]
        error = np.abs(result.force(name) - wanted) / largest
        at = int(np.argmax(np.nan_to_num(error))) if error.size else 0
        if error.size and error[at] > FORCES:
            found = result.force(name)[at]
            raise Wrong(f"{name}: force {found:.6g} instead of {wanted[at]:.6g} at t = {right.t[at]:.6g} s")


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
