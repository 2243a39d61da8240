"""Rows against the two oracles: random scenes in families, event by event, in every formulation.

Scenes are plain data. Those of machines have `rows` of any kind, the others have `contacts`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
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
    Signal,
    Spring,
    Stop,
    Tie,
    piecewise_linear,
    position,
    relative_velocity,
    simulate,
    sine,
    stretch,
    velocity,
)
from stickslip.model.signals import as_signal
from validation import machine_oracle, machine_scenes, oracle, oracle_scenes
from validation.oracle import Event
from validation.rows import Array, Row, Tried, Wrong, changes, require, story
from validation.tried import try_each

FAMILIES = oracle_scenes.FAMILIES | machine_scenes.FAMILIES
PATIENCE = 60.0  # time in s after which a scene counts as hanging

# Part of the span before its end in which events are not compared: whether they come before it is roundoff.
AT_THE_END = 2e-7
QUANTITIES = {f.__name__: f for f in (position, velocity, stretch, relative_velocity)}


@dataclass(frozen=True)
class Group:
    """How scenes are run, and the largest errors: of event times over the span, velocities and forces over the largest.

    Forces follow stiff springs and steep Stribeck curves.
    """

    options: dict[str, Any]
    time: float
    velocity: float
    force: float = 1e-4


_BDF: dict[str, Any] = {"rtol": 1e-10, "atol": 1e-13}
_MERGED = {"formulation": "merged", "method": "Adams"} | _BDF
_MULTIPLIER: dict[str, Any] = {"formulation": "multiplier", "rtol": 1e-9, "atol": 1e-12}
OF_CONTACTS = {
    "contact-force": Group(_BDF, 1e-7, 1e-6),
    "merged": Group(_MERGED, 1e-7, 1e-6),
    "multiplier": Group(_MULTIPLIER, 1e-6, 1e-5),
}

# What is run of each family: the default, and every formulation.
OF_MACHINES = {"auto": Group({}, 1e-9, 1e-9, 1e-7), "BDF": Group({"method": "BDF"} | _BDF, 1e-7, 1e-6)} | {
    name: OF_CONTACTS[name] for name in ("merged", "multiplier")
}


# Scenes


def scene_of(data: Mapping[str, Any], order: int | None = 0) -> Scene:
    """Return a scene of plain data, its elements in another order for each number, as they stand for None."""
    elements: list[Any] = [
        Body(**body) if body["inertia"] is not None else Drive(body["name"], velocity=signal_of(body["velocity"]))
        for body in data["bodies"]
    ]
    elements += map(_element, data.get("rows", data.get("contacts")))
    elements += map(_spring, data.get("springs", ()))
    elements += [Force(force["body"], signal_of(force["load"])) for force in data.get("forces", ())]
    if order is not None:
        Random(order).shuffle(elements)
    return Scene(*elements)


def signal_of(data: Any) -> Signal | float:
    """Return a load given as plain data: a number, a sine, or points of straight lines."""
    if isinstance(data, Mapping):
        return sine(**data)
    if isinstance(data, (int, float)):
        return float(data)
    return piecewise_linear(*zip(*data, strict=True))


def _element(row: Mapping[str, Any]) -> Any:
    name, kind = row["name"], row.get("kind", "contact")
    if kind == "tie":
        return Tie(name, row["on"])
    a, b, radii = _ends(row)
    limits = {key: row[key] for key in ("lower", "upper") if key in row}
    if kind == "one-way":
        return OneWay(name, a, b, **radii)
    if kind == "gap":
        return Gap(name, a, b, stiffness=row["k"], damping=row["c"], **limits, **radii)
    if kind == "stop":
        return Stop(name, a, b, restitution=row["e"], **limits, **radii)
    normal: Any = signal_of(row["normal"])
    for quantity, of, factor in row.get("pressed_by", ()):
        normal = normal + factor * QUANTITIES[quantity](of)
    return Contact(name, a, b, _law(row), normal=normal, rested=row.get("rested", 0.0), **radii)


def _ends(row: Mapping[str, Any]) -> tuple[str, str, dict[str, Any]]:
    if "on" not in row:
        return row["a"], row["b"], {}
    (a, radius_a), (b, radius_b) = row["on"].items()
    return a, b, {"radius_a": radius_a, "radius_b": -radius_b}


def _law(row: Mapping[str, Any]) -> DryFriction:
    more: dict[str, Any] = {}
    if "mu_s_back" in row:
        more = {"mu_static_backward": row["mu_s_back"], "mu_coulomb_backward": row["mu_c_back"]}
    if row.get("vs"):
        more |= {"stribeck_velocity": row["vs"], "stribeck_exponent": row["delta"]}
    return DryFriction(row["mu_s"], row["mu_c"], dwell=row["tau"], **more)


def _spring(row: Mapping[str, Any]) -> Spring | Damper:
    a, b, radii = _ends(row)
    if row["k"]:
        return Spring(a, b, stiffness=row["k"], damping=row["c"], rest=row.get("rest", 0.0), **radii)
    return Damper(a, b, damping=row["c"], **radii)


# What the oracles find


@dataclass(frozen=True)
class Truth:
    """The answer of an oracle: up to `stop`, at times `t`; `doubt` says why that is not the whole motion."""

    stop: float  # in s
    events: list[Event]  # before `stop`
    t: Array  # times in s away from events and breaks of loads
    velocities: dict[str, Array]  # of bodies, at these times
    forces: dict[str, Array]  # of rows; nan where one is not unique
    doubt: str  # empty where the answer is unique to the end


@cache
def truth(family: str, number: int) -> Truth:
    """Return the part of an oracle's answer that is compared: if there is a doubt, up to shortly before it."""
    data = FAMILIES[family][0](number)
    found: oracle.Solution | machine_oracle.Solution
    if "rows" in data:
        found, before, points = machine_oracle.solve(data), 0.99, 60
    else:
        found, before, points = oracle.solve(data), 0.9995, 100
    stop = before * found.known if found.doubt else found.known
    events = [event for event in found.events if event[0] < stop * (1 - AT_THE_END)]
    jumps = np.array([*found.system.breaks, *(event[0] for event in events)])
    t = stop * (np.arange(points) + 0.37) / points
    t = t[[bool(np.abs(jumps - s).min() > 1e-5 * data["t_end"]) for s in t]]
    if stop < 1e-6 * data["t_end"]:
        t = t[:0]
    bodies = [body["name"] for body in data["bodies"]]
    velocities = np.array([found.velocity(s) for s in t]).reshape(t.size, len(bodies))
    forces = [found.forces(s) for s in t]
    names = forces[0] if forces else ()
    return Truth(
        stop,
        events,
        t,
        dict(zip(bodies, velocities.T, strict=True)),
        {name: np.array([at[name] for at in forces]) for name in names},
        found.doubt,
    )


# How runs are compared with them


def difference(family: str, group: str, number: int) -> float:
    """Return the largest error of velocities over the largest; events and forces that differ are wrong."""
    right, data = truth(family, number), FAMILIES[family][0](number)
    if not right.stop:
        # the oracle doubts from the start on: there is nothing to compare
        return 0.0
    is_machine = "rows" in data
    groups = OF_MACHINES if is_machine else OF_CONTACTS
    how, scene = groups[group], scene_of(data, order=number + list(groups).index(group))
    result = simulate(scene, (0.0, right.stop), t_eval=right.t, **how.options)
    _compare_events(right, result, how.time)
    least = 1e-9
    if is_machine:
        loads = [as_signal(signal_of(force["load"]), "load") for force in data["forces"]]
        least = max([1e-6, *(abs(load(t)) for load in loads for t in right.t.tolist())])
    _compare_forces(right, result, how.force, least)
    largest = float(np.abs(list(right.velocities.values())).max(initial=1e-3))
    errors = [result.velocity(name) - wanted for name, wanted in right.velocities.items()]
    return float(np.abs(errors).max(initial=0.0)) / largest


def _compare_events(right: Truth, result: Result, tolerance: float) -> None:
    """Compare the events of each row, in order; those of different rows may come in any order."""
    last = right.stop * (1 - AT_THE_END)
    found = [event for event in changes(result, opened=True) if event[0] < last]
    for name in sorted({event[1] for event in [*right.events, *found]}):
        wanted = [event for event in right.events if event[1] == name]
        have = [event for event in found if event[1] == name]
        told = f"{name} has {story(have)} instead of {story(wanted)}"
        require([e[2:] for e in have] == [e[2:] for e in wanted], told)
        for a, b in zip(have, wanted, strict=True):
            late = abs(a[0] - b[0]) / right.stop
            require(late <= tolerance, f"{name}: time {a[0]:.12g} s instead of {b[0]:.12g} s")


def _compare_forces(right: Truth, result: Result, bound: float, least: float) -> None:
    """Compare the forces of rows where they are unique, as parts of the largest, or of `least` where that is larger."""
    largest = float(np.nanmax(np.abs(list(right.forces.values())), initial=least))
    for name, wanted in right.forces.items():
        found = result.force(name)
        # a force of NaN is wrong, too, unless the oracle's is NaN
        wrong = ~(np.abs(found - wanted) <= bound * largest) & ~np.isnan(wanted)
        for k in wrong.nonzero()[0].tolist():
            raise Wrong(f"{name}: force {found[k]:.9g} instead of {wanted[k]:.9g} at t = {right.t[k]:.6g} s")


def over_family(family: str, group: str, count: int) -> Tried:
    """Return the worst of scenes 1 to `count` of a family; where the oracle has no answer, nothing is compared."""
    numbers = [n for n in range(1, count + 1) if truth(family, n).t.size]
    tried = try_each(((f"{family} {n}", partial(difference, family, group, n)) for n in numbers), PATIENCE)
    events = sum(len(truth(family, n).events) for n in numbers)
    truncated = sum(bool(truth(family, n).doubt) for n in numbers)
    remark = f"{tried.remark}; {events} events"
    if truncated:
        remark += f"; {truncated} scenes up to where the answer is no longer unique"
    if len(numbers) < count:
        remark += f", {count - len(numbers)} left out where it never is"
    return replace(tried, remark=remark)


def rows(count: int) -> list[Row]:
    """Return the rows: `count` scenes of each family in each group."""
    return [
        Row(
            theme,
            f"{theme.lower()}-{family}/{group}",
            f"{count} scenes of {what}: events, forces; velocities over the largest ({group})",
            f"an independent simulator of the model; {module.__name__}",
            partial(over_family, family, group, count),
            how.velocity,
            quick=module is oracle or group == "auto",
            limit=60.0 + 10.0 * count,
            tries=f"runs against the oracle{' of machines' if module is machine_oracle else ''}",
        )
        for theme, module, families, groups in (
            ("Oracle", oracle, oracle_scenes.FAMILIES, OF_CONTACTS),
            ("Machines", machine_oracle, machine_scenes.FAMILIES, OF_MACHINES),
        )
        for family, (_, what) in families.items()
        for group, how in groups.items()
    ]
