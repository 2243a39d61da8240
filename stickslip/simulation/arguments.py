"""The arguments of `simulate`, checked before anything runs."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Iterable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from stickslip.engines import METHODS
from stickslip.equations.algebra.matrices import dense, row_maxima
from stickslip.equations.loads.loads import Loads
from stickslip.equations.system import System
from stickslip.model.arrays import Array
from stickslip.model.checks import every_digit, finite, flag, in_order, numbers, rounded_up
from stickslip.model.laws.base import Use
from stickslip.model.scene import Scene
from stickslip.model.when import When
from stickslip.simulation.tolerances import largest_value

Formulation = Literal["contact-force", "merged", "multiplier"]
Times = Sequence[float] | NDArray[Any]

# Part of the largest speed by which velocities at the start may break a tie; they are projected.
_BROKEN = 1e-9

# Distance in m or rad that counts as 0: positions near a limit of 0 may have the roundoff of larger ones.
_NO_DISTANCE = 1e-15

_LONGEST = 1e99  # in s: in this time a body of 1 m/s moves less far than the distance at which a run is stopped
_MOST_STEPS = 1e10  # so many steps take a day; Ctrl-C ends a run with fewer


def span(t_span: Times, what: str = "simulate") -> tuple[float, float]:
    """Return start and end of a time span that runs forward."""
    try:
        start, stop = in_order(t_span, what)
    except (TypeError, ValueError):
        raise ValueError(f"{what}: t_span must be two times (start, end), got {reprlib.repr(t_span)}") from None
    start, stop = finite(start, f"{what}: t_span"), finite(stop, f"{what}: t_span")
    if not start < stop:
        remedy = "swap the two times" if start > stop else "give a later end"
        raise ValueError(f"{what}: t_span must run forward, got ({start:g}, {stop:g}); {remedy}")
    length = finite(stop - start, f"{what}: the length of t_span")
    if length > _LONGEST:
        raise ValueError(f"{what}: t_span must be at most {_LONGEST:g} s long, got {length:g} s; give an earlier end")
    return start, stop


def choice(name: str, value: Any, known: Sequence[str]) -> None:
    """Refuse an option that is not among the known ones."""
    if not isinstance(value, str) or value not in known:
        raise ValueError(f"simulate: unknown {name} {value!r}; choose from {', '.join(map(repr, known))}")


def between(name: str, value: float, low: float, high: float, what: str = "simulate") -> float:
    """Return a number that lies between two others."""
    number = finite(value, f"{what}: {name}")
    if not low < number < high:
        raise ValueError(f"{what}: {name} must lie between {low:g} and {high:g}, neither of them, got {number:g}")
    return number


def checked_max_step(max_step: float, whole: float) -> float:
    """Return the longest step of a run of so many seconds; it may be infinite."""
    if isinstance(max_step, float) and max_step == math.inf:
        return math.inf
    return _not_too_many("max_step", max_step, whole)


def margin(velocity_margin: float | None) -> float | None:
    """Return the velocity margin, None for the default."""
    if velocity_margin is not None and finite(velocity_margin, "simulate: velocity_margin") < 0:
        raise ValueError(f"simulate: velocity_margin must not be negative, got {velocity_margin:g}")
    return velocity_margin


def _not_too_many(name: str, length: Any, whole: float) -> float:
    found = between(name, length, 0.0, math.inf)
    if whole > _MOST_STEPS * found:
        raise ValueError(
            f"simulate: {name}={found:g} s makes {whole / found:.3g} steps in {whole:g} s, and {_MOST_STEPS:g} are "
            "the most; give a longer one, or simulate a shorter time"
        )
    return found


def step_length(method: str, step: float | None, max_step: float, whole: float) -> float | None:
    """Return the step of a fixed-step method in a run of so many seconds, None for the others."""
    fixed = [name for name, known in METHODS.items() if known.takes_steps]
    if method not in fixed:
        if step is not None:
            raise ValueError(
                f"simulate: step={step!r} belongs to the methods {' and '.join(fixed)}; leave it out for {method}"
            )
        return None
    if step is None:
        raise ValueError(f"simulate: method {method!r} needs step=, the length of its steps in s")
    length = _not_too_many("step", step, whole)
    if length > max_step:
        raise ValueError(
            f"simulate: step={length:g} is longer than max_step={max_step:g}; all steps of {method} have the length "
            "step: leave max_step out, or shorten the step"
        )
    return length


def check_laws(scene: Scene, start: float, stop: float) -> None:
    """Refuse contacts in which their law does not work."""
    free = {body.name for body in scene.bodies}
    for contact in scene.contacts:
        ends = contact.a, contact.b
        use = Use(contact.label, ends, free.issuperset(ends), contact.normal, start, stop)
        contact.law.check_use(use)


def check_dwells(system: System, start: float, stop: float) -> None:
    """Refuse dwell times that are below the roundoff of the time."""
    least = 4 * np.finfo(float).eps * max(abs(start), abs(stop))
    for j in ((system.dwell > 0) & (system.dwell < least)).nonzero()[0].tolist():
        raise ValueError(
            f"contact {system.rows[j].name!r}: a dwell time of {system.dwell[j]:g} s cannot be told at times of "
            f"{max(abs(start), abs(stop)):g} s; give 0, or at least {rounded_up(least)} s"
        )


def check_ties(system: System, loads: Loads, start: float, stop: float) -> None:
    """Refuse start velocities that ties or one-way clutches exclude, and drives that ties join to each other."""
    rigid = system.is_tie | system.is_one_way
    if not rigid.any():
        return
    _check_drives(system)
    q = loads.after(start).at(start)
    scene = system.scene
    v = np.array([body.velocity for body in scene.bodies])
    w = system.relative_velocity(v, q)
    # of bodies, drives and the ground
    velocities = [*v.tolist(), *system.drive_velocities(q).tolist(), 0.0]
    # the start velocity of a drive that starts from 0 may be roundoff of its later speeds
    led = (largest_value(drive.velocity, start, stop) for drive in scene.drives)
    largest = max([*np.abs(v).tolist(), *led])
    for j, element in enumerate(scene.rows):
        if not rigid[j]:
            continue
        ends = element.coefficients
        allowed = _BROKEN * largest * max(map(abs, ends.values()))
        if (abs(w[j]) if system.is_tie[j] else w[j]) <= allowed:
            continue
        given = ", ".join(f"{name!r} {velocities[system.index[name]]:.12g}" for name in ends)
        if system.is_tie[j]:
            raise ValueError(
                f"{element.label}: the velocities at the start break it by {w[j]:.12g} ({given}); "
                "give its bodies velocities that satisfy it"
            )
        raise ValueError(
            f"{element.label}: its relative velocity at the start is {w[j]:.12g}, but it cannot turn forward "
            f"({given}); exchange a and b, or give velocities at which b is not slower than a"
        )


def check_stops(system: System, loads: Loads, start: float, step: float | None) -> None:
    """Refuse stops that start beyond a limit, and those that a fixed-step method cannot locate."""
    if not system.has_stops:
        return
    stops = {element.name: element for element in system.scene.stops}
    if step is not None:
        raise ValueError(
            f"{next(iter(stops.values())).label}: a fixed-step method cannot locate impacts; "
            "use method='series' or 'BDF', or a Gap in its place"
        )
    y, functions = system.at_start(), system.piecewise
    upper, lower, size = functions.limits(y, loads.after(start).at(start), y)
    beyond = (np.minimum(upper, lower) < -np.maximum(_BROKEN * size, _NO_DISTANCE)).nonzero()[0]
    for k in beyond.tolist():
        stop = stops[system.rows[functions.row[k]].name]
        limit, side = (stop.upper, "upper") if upper[k] < lower[k] else (stop.lower, "lower")
        stretch = stop.upper - upper[k] if side == "upper" else stop.lower + lower[k]
        raise ValueError(
            f"{stop.label}: at the start its stretch is {stretch:.12g}, beyond its {side} limit {limit:g}; "
            "give its bodies positions within the limits"
        )


def _check_drives(system: System) -> None:
    """Refuse ties that would decide the velocity of a drive."""
    ties = system.is_tie.nonzero()[0]
    if not system.drives or not ties.size:
        return
    G, D = dense(system.G[ties]), dense(system.D[ties])
    scale = system.largest_lever[ties][:, None]
    # what is left of the rows once their bodies are eliminated binds the drives
    left, values, _ = np.linalg.svd(G / scale)
    bound = np.any(np.abs(left[:, (values > _BROKEN).sum() :].T @ (D / scale)) > _BROKEN, axis=0)
    if bound.any():
        names = [system.scene.drives[k].name for k in bound.nonzero()[0].tolist()]
        tie = system.rows[int(ties[row_maxima(D).nonzero()[0][0]])].name
        raise ValueError(
            f"tie {tie!r}: ties alone join {', '.join(map(repr, names))} to each other or to the ground, "
            "but a drive has a velocity of its own; leave a tie out, or make the drive a Body"
        )


def user_events(scene: Scene, events: Iterable[When]) -> list[When]:
    """Return the user's events, with names of their own and quantities that the scene knows."""
    if isinstance(events, When):
        events = [events]
    listed = in_order(events, "simulate: events", "When(...)")
    taken = {row.name for row in scene.rows}
    for event in listed:
        if not isinstance(event, When):
            raise TypeError(f"simulate: events must be When(...), got {event!r}")
        if event.name in taken:
            raise ValueError(f"simulate: {event.label} has the name of another event or of a contact; rename it")
        taken.add(event.name)
        scene.check_quantities(event.quantity, event.label)
    return listed


def outputs(t_eval: Iterable[float] | None, start: float, stop: float, dense: bool) -> Array | None:
    """Return the output times, None for every computed point."""
    kept = flag(dense, "simulate: dense_output")
    if t_eval is None:
        if not kept:
            raise ValueError("simulate: dense_output=False keeps nothing but the outputs; give t_eval")
        return None
    what = "simulate: t_eval"
    times = numbers(t_eval if isinstance(t_eval, np.ndarray) else in_order(t_eval, what, "times"), what)
    back = (~(times[1:] > times[:-1])).nonzero()[0]
    if times.size and (back.size or not (times[0] >= start and times[-1] <= stop)):
        got = times[back[0] : back[0] + 2] if back.size else times[[0, -1]]
        raise ValueError(
            f"simulate: t_eval must be times that increase within [{start:g}, {stop:g}] s, got "
            f"{every_digit(got[0])} {'and then' if back.size else 'to'} {every_digit(got[1])}; "
            "sort them, give each once and cut them"
        )
    return times
