"""Rows over the analysis of motions: derivatives, limit cycles and their branches, against independent answers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Gap,
    Result,
    Scene,
    SimulationError,
    Spring,
    Stop,
    continue_cycle,
    feedback,
    fit,
    limit_cycle,
    position,
    saturate,
    sensitivities,
    simulate,
    sine,
    step,
    velocity,
)
from stickslip.model.signals import Signal
from stickslip.studies.derivatives.sensitivities import Sensitivities
from stickslip.studies.parameters import Parameter, named_parameters
from validation import random_scenes
from validation.published import belt
from validation.rows import Array, Row, Tried, Wrong, worst
from validation.tried import try_each

SEED, STOP = 16000, 1.0
_RECORDS = 100  # records with noise that are fitted

# Steps of differences as parts of a parameter, in the order in which they are tried: long ones have truncation errors,
# short ones roundoff. No more are tried after a shorter one that is no better.
_STEPS = (1e-3, 1e-2, 1e-4, 1e-5, 1e-6)

# Weights of differences of eighth and sixth order, four runs to each side.
_EIGHTH = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])

_SIXTH = np.array([0, -1 / 60, 3 / 20, -3 / 4, 0, 3 / 4, -3 / 20, 1 / 60, 0])

_TIGHT: dict[str, Any] = {"rtol": 1e-12, "atol": 1e-14}
_ROUGHER: dict[str, Any] = {"rtol": 1e-11, "atol": 1e-13}

# A difference is settled if its uncertainty is below this part of the size of all; then it is compared with the
# derivative. From one that is not settled a derivative may be off by so many times its uncertainty.
_SETTLED, _DOUBT = 1e-7, 10.0

analysis_row = partial(Row, "Analysis", limit=600.0)


# -- derivatives of random scenes --------------------------------------------------------------------------------


def scene_of(number: int) -> Scene:
    """Return random scene `number`, two in three with a stop, an elastic gap, or a saturated controller as well."""
    scene, random = random_scenes.draw(number), np.random.default_rng([SEED, number])
    body = scene.bodies[int(random.integers(len(scene.bodies)))]
    name, place = body.name, body.position
    kind = int(random.integers(6))
    room = random.uniform(0.05, 0.4)
    extra: list[Any] = []
    if kind == 0:
        e = float(random.uniform(0.0, 0.9))
        extra = [Stop("stop", name, GROUND, lower=place - 2 * room, upper=place + room, restitution=e)]
    elif kind == 1:
        stiffness, damping = random.uniform(20, 200), float(random.uniform(0.0, 2.0))
        extra = [Gap("gap", name, GROUND, upper=place + room, stiffness=stiffness, damping=damping)]
    elif kind == 2:
        push = -random.uniform(5, 40) * position(name) - random.uniform(0, 2) * velocity(name)
        extra = [Force(name, saturate(push, -random.uniform(1, 6), random.uniform(1, 6)))]
    elif kind == 3:
        drive = Drive("shaker", velocity=sine(random.uniform(0.5, 2.0), random.uniform(0.5, 2.0)))
        lower, upper = place - 0.5 * room, place + 0.5 * room
        extra = [drive, Stop("stop", name, "shaker", lower=lower, upper=upper, restitution=0.5)]
    return Scene(*scene.elements, *extra)


def _names(scene: Scene) -> list[str]:
    """Return the names of parameters of a scene, of many kinds."""
    found = [f"{body.name}.{field}" for body in scene.bodies for field in ("inertia", "velocity", "position")]
    for contact in scene.contacts:
        law = contact.law
        assert isinstance(law, DryFriction)
        fields = ["law.mu_coulomb", "law.mu_static", "normal.scale", *["law.dwell"] * (law.dwell > 0)]
        fields += ["law.stribeck_velocity"] * (law.stribeck_velocity is not None)
        found += [f"{contact.name}.{field}" for field in fields]
    for k in range(len(scene.springs)):
        found += [f"springs[{k}].{field}" for field in ("stiffness", "damping", "rest")]
    found += [f"dampers[{k}].damping" for k in range(len(scene.dampers))]
    loads = [k for k, force in enumerate(scene.forces) if isinstance(force.signal, Signal)]
    found += [f"forces[{k}].signal.scale" for k in loads]
    found += [f"{drive.name}.velocity.scale" for drive in scene.drives]
    found += [f"{stop.name}.{field}" for stop in scene.stops for field in ("upper", "lower", "restitution")]
    found += [f"{gap.name}.{field}" for gap in scene.gaps for field in ("upper", "stiffness", "damping")]
    return found


def _all_of(found: Sensitivities) -> Array:
    scene = found.result.scene
    parts = [*found.events, *(found.velocity(body.name) for body in scene.bodies)]
    parts += [found.position(body.name) for body in scene.bodies]
    return np.array(parts + [found.heat(contact.name) for contact in scene.contacts])


def _all_in(result: Result) -> tuple[list[tuple[Any, ...]], Array]:
    """Return the events, and the quantities whose derivatives are compared."""
    scene, heat = result.scene, result.energy().contacts
    parts = [event.t for event in result.events] + [result.velocity(body.name)[-1] for body in scene.bodies]
    parts += [result.position(body.name)[-1] for body in scene.bodies]
    said = [(event.contact, event.before, event.after) for event in result.events]
    return said, np.array(parts + [heat[contact.name][-1] for contact in scene.contacts])


def _difference(scene: Scene, one: Parameter, h: float, said: list[Any], own: Array) -> tuple[Array, Array] | None:
    """Return differences between exact runs and how uncertain they are; None if a run fails or has other events.

    Differences of high order contain both the errors of the runs and those of too long a step, so they measure both
    (More and Wild 2011).
    """
    values = [own] * _EIGHTH.size
    for k in (0, 8, 1, 7, 2, 6, 3, 5):
        try:
            events, values[k] = _all_in(simulate(one.set(scene, one.value + (k - 4) * h), (0.0, STOP), **_TIGHT))
        except (ValueError, TypeError, SimulationError):
            return None
        if events != said:
            return None
    told = np.array(values)
    noise = np.zeros(own.size)
    for order in (6, 7, 8):
        rough = np.diff(told, order, axis=0) / math.sqrt(math.comb(2 * order, order))
        noise = np.maximum(noise, np.sqrt(np.mean(rough**2, axis=0)))
    uncertain = np.abs((_EIGHTH - _SIXTH) @ told) + float(np.linalg.norm(_EIGHTH)) * noise
    return _EIGHTH @ told / h, uncertain / h


def _errors(scene: Scene, said: list[Any], own: Array) -> Array:
    """Return about the error of a run in each quantity: a tenth of its difference from one of ten times its tolerances.

    At a slow impact a small error of a position is a large error of the time. Runs near by have it alike, so that
    differences between them do not show it.
    """
    others, values = _all_in(simulate(scene, (0.0, STOP), **_ROUGHER))
    count = next((k for k, (a, b) in enumerate(zip(said, others, strict=False)) if a != b), len(said))
    count, rest = min(count, len(others)), own.size - len(said)
    found = np.full(own.size, math.inf)
    found[:count] = np.abs(values[:count] - own[:count])
    found[len(said) :] = np.abs(values[values.size - rest :] - own[len(said) :])
    return 0.1 * found


def _differences(
    scene: Scene, one: Parameter, said: list[Any], own: Array, asked: Array, errors: Array
) -> tuple[Array, Array, float]:
    """Return the least uncertain differences of each quantity, their uncertainty, and the size of all."""
    size, scale = abs(one.value) or 1.0, 0.0
    slopes, uncertain = np.zeros(own.size), np.full(own.size, math.inf)
    settled = np.zeros(own.size, dtype=bool)
    for part in _STEPS:
        told = _difference(scene, one, part * size, said, own)
        if told is None:
            continue
        doubt = np.maximum(told[1], errors / (part * size))
        if part < _STEPS[0] and not np.any((doubt < 0.5 * uncertain)[~settled]):
            break
        better = doubt < uncertain
        slopes[better], uncertain[better] = told[0][better], doubt[better]
        # if a parameter hardly changes the motion, derivatives have the roundoff of the motion: its size sets the scale
        scale = max(float(np.abs(slopes).max()), 1e-4 * float(np.abs(own).max()) / size)
        settled = uncertain <= _SETTLED * scale
        if settled[asked].all():
            break
    return slopes, uncertain, scale


def _of_scene(number: int, counts: dict[str, int]) -> float:
    """Return the largest error of some derivatives of a scene; those that do not exist must say why."""
    scene, random = scene_of(number), np.random.default_rng([SEED, number, 1])
    names = [str(name) for name in random.permutation(_names(scene))[:2]]
    named: list[Parameter] = []
    for name in names:
        try:
            named += named_parameters(scene, [name], "validation")
            sensitivities(scene, (0.0, 1e-6), [name])
        except ValueError:
            # a number that is 0 or not set has no derivative to both sides: it is refused by name
            named = [one for one in named if one.name != name]
            counts["refused"] += 1
    if not named:
        return 0.0
    try:
        # with the tolerances of the runs near by: derivatives are as accurate as the run they belong to
        found = sensitivities(scene, (0.0, STOP), [one.name for one in named], **_TIGHT)
    except SimulationError:
        # other rows are about scenes that cannot be simulated
        counts["stopped"] += 1
        return 0.0
    exact, largest = _all_of(found), 0.0
    said, own = _all_in(found.result)
    errors = _errors(scene, said, own)
    relaxed = [k for k, event in enumerate(found.result.events) if event.cause == "relaxation"]
    for k, one in enumerate(named):
        column = exact[:, k]
        missing = np.isnan(column)
        missing[relaxed] = False
        if missing.any():
            if not any(repr(one.name) in reason for reason in found.reasons):
                raise Wrong(f"no derivative by {one.name}, and no reason")
            counts["reasoned"] += 1
        slopes, uncertain, scale = _differences(scene, one, said, own, np.isfinite(column), errors)
        if np.isinf(uncertain).all():
            counts["alone"] += not missing.any()
            continue
        off, settled = np.abs(slopes - column), uncertain <= _SETTLED * scale
        counts["needless"] += bool(np.any(settled & missing))
        known = np.isfinite(column)
        counts["compared"] += int(np.count_nonzero(known & settled))
        counts["unsettled"] += int(np.count_nonzero(known & ~settled))
        largest = max(largest, float(off[known & settled].max(initial=0.0)) / scale)
        doubtful = known & ~settled & (off > np.maximum(_DOUBT * uncertain, 10 * _SETTLED * scale))
        if doubtful.any():
            i = int(np.argmax(doubtful))
            raise Wrong(f"quantity {i} by {one.name}: {column[i]:.9g}, not {slopes[i]:.9g} +- {uncertain[i]:.2g}")
    return largest


def derivatives(numbers: Sequence[int]) -> Tried:
    """Return the worst derivative of random scenes against differences of exact runs."""
    counts = dict.fromkeys(("compared", "unsettled", "reasoned", "needless", "refused", "alone", "stopped"), 0)
    tried = try_each(((f"scene {n}", partial(_of_scene, n, counts)) for n in numbers), limit=300.0)
    said = (
        f"{counts['compared']} derivatives compared, {counts['unsettled']} more with differences that are uncertain "
        f"by more than {_SETTLED:g}; {counts['reasoned']} parameters with a reason why there is none, "
        f"{counts['needless']} of them where there is one; {counts['refused']} refused, {counts['alone']} without "
        f"runs near by that have the same events; {counts['stopped']} scenes that cannot be simulated"
    )
    return replace(tried, remark="; ".join(part for part in (tried.remark, said) if part))


# -- limit cycles and branches -----------------------------------------------------------------------------------


def _duffing() -> tuple[float, str]:
    """x'' + 0.1 x' + x + x^3 = sin(w t) / 2: at its fold the state comes back, and det(monodromy - 1) is 0."""

    def missed(u: Array) -> list[float]:
        x0, v0, w = u.tolist()

        def rate(t: float, y: Array) -> list[float]:
            x, v, a, b, p, q = y.tolist()
            k = -1 - 3 * x * x
            return [v, -0.1 * v - x - x**3 + 0.5 * math.sin(w * t), b, -0.1 * b + k * a, q, -0.1 * q + k * p]

        start = [x0, v0, 1.0, 0.0, 0.0, 1.0]
        end = solve_ivp(rate, (0.0, 2 * math.pi / w), start, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
        x, v, a, b, p, q = end.tolist()
        return [x - x0, v - v0, (a - 1) * (q - 1) - b * p]

    exact = float(fsolve(missed, [-2.3, -0.2, 2.21], xtol=1e-12)[2])
    scene = Scene(
        Body("m", inertia=1.0, position=-2.11320976, velocity=1.90449901),
        Spring("m", GROUND, stiffness=1.0, damping=0.1),
        Force("m", feedback(lambda x: -(x**3), position("m"))),
        Force("m", sine(0.5, 2.15 / (2 * math.pi))),
    )
    at = np.array([2.15, 2.3]) / (2 * math.pi)
    cycle = limit_cycle(scene, period=1 / at[0], transient=0)
    (fold,) = continue_cycle(cycle, "forces[1].signal.frequency", at, period=lambda f: 1 / f).points
    if fold.kind != "fold":
        raise Wrong(f"no fold: {fold}")
    return abs(2 * math.pi * fold.value - exact) / exact, f"at w = {2 * math.pi * fold.value:.12g}"


def _drill_string() -> tuple[float, str]:
    """Beyond the table's speed at which its stick-slip ends a bit has unstable cycles that slip all the time.

    Such a cycle is a periodic motion of ``J v' = k x + c (W - v) - N mu(v)``, ``x' = W - v``, in which small deviations
    grow by ``exp(integral of the trace)``.
    """
    inertia, k, c, speed, normal = 374.0, 473.0, 20.0, 20.0, 1e4
    scene = Scene(
        Body("bit", inertia=inertia),
        Drive("table", velocity=15.0),
        Spring("bit", "table", stiffness=k, damping=c),
        Contact(
            "rock",
            "bit",
            GROUND,
            DryFriction(0.8, 0.5, stribeck_velocity=0.9, stribeck_exponent=1.0),
            normal=normal,
        ),
    )
    branch = continue_cycle(scene, "table.velocity", [15.0, speed, 30.0])
    if branch.beyond is None or (cycle := branch.beyond.cycles[0]) is None or cycle.sequence:
        raise Wrong(f"no cycles beyond the end of stick-slip that slip all the time: {branch}")

    def rate(t: float, y: Array) -> list[float]:
        x, v, _ = y.tolist()
        fall = 0.3 * math.exp(-v / 0.9)
        push = k * x + c * (speed - v) - normal * (0.5 + fall)
        return [speed - v, push / inertia, (-c + normal * fall / 0.9) / inertia]

    first = cycle.result.sample([0.0])
    twist = float(first.position("table")[0] - first.position("bit")[0])
    start = [twist, float(first.velocity("bit")[0]), 0.0]
    end = solve_ivp(rate, (0.0, cycle.period), start, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    apart = worst(end[:2].tolist(), start[:2], 1.0) / speed
    factor = math.exp(float(end[2]))
    return max(apart, abs(float(cycle.multipliers[0].real) / factor - 1)), f"a multiplier of {factor:.9g}"


def _leine_end() -> tuple[float, str]:
    """Stick-slip ends where the block that broke away only just comes to the speed of the belt again."""
    damping = 0.5

    def short(v: float) -> float:
        def rate(_: float, y: Array) -> list[float]:
            return [1 / (1 + 3 * abs(v - y[0])) - damping * y[0] - y[1], y[0]]

        def turns(t: float, y: Array) -> float:
            return rate(t, y)[0]

        turns.direction = -1  # type: ignore[attr-defined]
        found = solve_ivp(rate, (0.0, 12.0), [v, 1 - damping * v], rtol=1e-12, atol=1e-13, events=turns, max_step=0.05)
        return float(next(y[0] for t, y in zip(found.t_events[0], found.y_events[0], strict=True) if t > 1)) - v

    exact = float(brentq(short, 0.6, 0.8, xtol=1e-12))
    error = 0.0
    for speeds, accuracy in (([0.66, 0.67, 0.68], 1e-5), ([0.45, 0.9], 1e-6)):
        branch = continue_cycle(belt(speeds[0], damping), "belt.velocity", speeds, accuracy=accuracy)
        (end,) = branch.points
        if end.kind != "fold" or branch.beyond is None:
            raise Wrong(f"no end of stick-slip with unstable cycles beyond: {branch}")
        error = max(error, abs(end.value - exact) / exact)
        (back, *_) = branch.beyond.cycles
        rest = (math.sqrt(3 / damping) - 1) / 3
        if speeds[0] > rest:
            if back is None or back.sequence:
                raise Wrong(f"no unstable slipping beyond the end of stick-slip: {branch}")
            continue
        # slipping shrinks to rest where rest on the running belt becomes stable
        (hopf,) = branch.beyond.points
        if back is not None or "Hopf" not in hopf.message or abs(hopf.value - rest) > 1e-5 * rest:
            raise Wrong(f"no end at the state of rest: {branch}")
    return (
        error,
        f"at {exact:.8g}, whatever the speeds are; beyond it unstable slipping, down to rest at {rest:.8g}",
    )


# Numbers of random scenes that have a stop, a gap, a stop on a drive, and a saturated controller.
QUICK_SCENES = (12, 33, 39, 47)


# -- fits --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Falling:
    """A kinetic coefficient that falls from 0.45 at rest: with a dwell the static one is above that."""

    coulomb: float
    velocity: float

    def __call__(self, speed: float) -> float:
        """Return the coefficient at a speed."""
        return self.coulomb + (0.45 - self.coulomb) * math.exp(-speed / self.velocity)


def _pulled(static: float, coulomb: float, dwell: float, velocity: float) -> Scene:
    """Return a block that a hand pulls by a spring, first slowly and then faster."""
    law = DryFriction(static, 0.45, dwell=dwell, kinetic=_Falling(coulomb, velocity))
    return Scene(
        Body("block", inertia=1.0),
        Drive("hand", velocity=step(6.5, 0.3, 0.6)),
        Spring("block", "hand", stiffness=10.0, damping=0.1),
        Contact("floor", "block", GROUND, law, normal=10.0),
    )


def _fits(count: int) -> tuple[float, str]:
    """Return the part of records, each with its own noise, whose fit is off a true value by more than 3 errors."""
    true, noise, t = np.array([0.6, 0.3, 1.0, 0.2]), 0.01, np.linspace(0.05, 9.0, 200)
    clean = simulate(_pulled(*true), (0.0, t[-1]), t_eval=t).velocity("block")
    names = [f"floor.law.{one}" for one in ("mu_static", "kinetic.coulomb", "dwell", "kinetic.velocity")]
    off = np.empty((count, true.size))
    for seed in range(count):
        noisy = clean + noise * np.random.default_rng(seed).normal(size=t.size)
        data = {"block.velocity": (t, noisy, noise)}
        found = fit(_pulled(0.57, 0.28, 1.3, 0.25), names, data, rtol=1e-7, atol=1e-9)
        off[seed] = (found.values - true) / found.standard_errors
    outside = int(np.count_nonzero((np.abs(off) > 3).any(axis=1)))
    typical = ", ".join(f"{one:.2f}" for one in np.sqrt(np.mean(off**2, axis=0)))
    return (
        outside / count,
        f"{count - outside} of {count} within; {typical} standard errors off in the mean square",
    )


def rows(numbers: Sequence[int]) -> list[Row]:
    """Return the rows, with the derivatives of these random scenes."""
    return [
        analysis_row(
            "analysis-derivatives",
            f"two derivatives of {len(numbers)} random scenes with stops, gaps and saturations, against differences",
            "differences of eighth order between runs",
            partial(derivatives, numbers),
            1e-6,
            tries="random scenes with derivatives",
            limit=60.0 + 30.0 * len(numbers),
        ),
        analysis_row(
            "analysis-duffing",
            "upper fold of a Duffing oscillator that is driven, frequency",
            "DOP853 and its variations, 1e-13",
            _duffing,
            1e-8,
            quick=False,
        ),
        analysis_row(
            "analysis-drill-string",
            "cycles of a drill string beyond the end of its stick-slip: closure and multiplier",
            "DOP853, 1e-13",
            _drill_string,
            1e-6,
            quick=False,
        ),
        analysis_row(
            "analysis-leine-end",
            "belt speed at which its stick-slip ends with damping 0.5, from speeds near by and far off",
            "DOP853 from breaking away to the next maximum of the velocity",
            _leine_end,
            1e-6,
            quick=False,
        ),
        analysis_row(
            "analysis-fits",
            "fits of four numbers of friction to noisy stick-slip: part with a true value beyond 3 standard errors",
            "the values the records were made with",
            partial(_fits, _RECORDS),
            0.05,
            quick=False,
            limit=60.0 + 20.0 * _RECORDS,
        ),
    ]
