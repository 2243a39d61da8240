"""How runs are held against an oracle: scenes of plain data, events of each row in order, velocities and forces."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from random import Random
from typing import Any, Protocol

import numpy as np

from stickslip import (
    Body,
    Damper,
    Drive,
    DryFriction,
    Force,
    Result,
    Scene,
    Signal,
    Spring,
    piecewise_linear,
    sine,
)
from validation.oracle import Event
from validation.rows import Array, Tried, Wrong, changes, require, story
from validation.tried import try_each

AT_THE_END = 2e-7
"""Part of the span before its end in which events are not compared: whether they come before it is roundoff."""

PATIENCE = 60.0
"""Time in s after which a scene counts as hanging."""


@dataclass(frozen=True)
class Truth:
    """What an oracle finds of a scene: up to `stop`, at times `t`; `doubt` says why that is not the whole scene."""

    stop: float  # in s
    events: list[Event]  # before that
    t: Array  # times in s away from events and breaks of loads
    velocities: dict[str, Array]  # of bodies, at these times
    forces: dict[str, Array]  # of rows; nan where one is not unique
    doubt: str  # empty where the answer is unique to the end


class Answer(Protocol):
    """What an oracle returns."""

    known: float
    events: list[Event]
    doubt: str

    def velocity(self, t: float) -> Array:
        """Return the velocities of all bodies at a time in s."""
        ...

    def forces(self, t: float) -> Mapping[str, float]:
        """Return the forces of all rows by name."""
        ...


def truth_of(
    found: Answer, data: Mapping[str, Any], breaks: Iterable[float], before: float, points: int
) -> Truth:
    """Return what is compared of an answer: where there is doubt, up to a part `before` of what is known."""
    stop = before * found.known if found.doubt else found.known
    events = [event for event in found.events if event[0] < stop * (1 - AT_THE_END)]
    jumps = np.array([*breaks, *(event[0] for event in events)])
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


def scene_with(
    data: Mapping[str, Any], rows: Iterable[Any], springs: Iterable[Any], order: int | None = None
) -> Scene:
    """Return a scene of bodies, drives and forces as plain data, its elements in another order for each number."""
    elements: list[Any] = [
        Body(**body)
        if body["inertia"] is not None
        else Drive(body["name"], velocity=signal_of(body["velocity"]))
        for body in data["bodies"]
    ]
    elements += [*rows, *springs]
    elements += [Force(force["body"], signal_of(force["load"])) for force in data.get("forces", ())]
    if order is not None:
        Random(order).shuffle(elements)
    return Scene(*elements)


def law_of(data: Mapping[str, Any]) -> DryFriction:
    """Return the law of a contact given as plain data."""
    more: dict[str, Any] = {}
    if "mu_s_back" in data:
        more = {"mu_static_backward": data["mu_s_back"], "mu_coulomb_backward": data["mu_c_back"]}
    if data.get("vs"):
        more |= {"stribeck_velocity": data["vs"], "stribeck_exponent": data["delta"]}
    return DryFriction(data["mu_s"], data["mu_c"], dwell=data["tau"], **more)


def spring_of(data: Mapping[str, Any], a: str, b: str, **radii: float) -> Spring | Damper:
    """Return a spring given as plain data, or a damper where it has no stiffness."""
    if data["k"]:
        return Spring(a, b, stiffness=data["k"], damping=data["c"], rest=data.get("rest", 0.0), **radii)
    return Damper(a, b, damping=data["c"], **radii)


def signal_of(data: Any) -> Signal | float:
    """Return a load given as plain data: a number, a sine, or points of straight lines."""
    if isinstance(data, Mapping):
        return sine(**data)
    if isinstance(data, (int, float)):
        return float(data)
    return piecewise_linear(*zip(*data, strict=True))


def compare_events(right: Truth, result: Result, tolerance: float) -> None:
    """Compare the events of each row, in order; those of different rows may come in any order.

    Raises
    ------
    Wrong
        If a row has other events, or one is late by more than `tolerance` as a part of the span.
    """
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


def compare_velocities(right: Truth, result: Result) -> float:
    """Return the largest error of velocities over the largest."""
    largest = float(np.abs(list(right.velocities.values())).max(initial=1e-3))
    errors = [result.velocity(name) - wanted for name, wanted in right.velocities.items()]
    return float(np.abs(errors).max(initial=0.0)) / largest


def compare_forces(right: Truth, result: Result, bound: float, least: float) -> None:
    """Compare the forces of rows where they are unique, as parts of the largest, or of `least` where that is larger.

    Raises
    ------
    Wrong
        If one is wrong by more than `bound`.
    """
    largest = float(np.nanmax(np.abs(list(right.forces.values())), initial=least))
    for name, wanted in right.forces.items():
        found = result.force(name)
        # not a number is wrong, too, but where none is wanted
        wrong = ~(np.abs(found - wanted) <= bound * largest) & ~np.isnan(wanted)
        for k in wrong.nonzero()[0].tolist():
            raise Wrong(f"{name}: force {found[k]:.9g} instead of {wanted[k]:.9g} at t = {right.t[k]:.6g} s")


def over_family(
    truth: Callable[[str, int], Truth],
    difference: Callable[[str, str, int], float],
    family: str,
    group: str,
    count: int,
) -> Tried:
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
