"""Extremes of inertias, units, pre-slip velocities, dwell times, coefficients, pulses and tolerances."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from functools import partial

import numpy as np

from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Scene,
    Signal,
    Spring,
    piecewise_linear,
    signal,
    simulate,
    step,
    triangle,
)
from validation import analytic
from validation.blocks import DRY, block, extreme_row, mp, power, told
from validation.exact import TIGHT, pulled, pulled_block, two_flywheels
from validation.rows import Answer, Row, changes, event_error, refused, require, worst


def inertia_ratio(ratio: float) -> Answer:
    """Two bodies lock: time, common speed, then the force between them under a load, by eq. (1)."""
    exact = analytic.lock_up(1, ratio, 1, 4)
    stop = 4 * float(exact.time)
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Body("b", inertia=ratio),
        Contact("c", "a", "b", DRY, normal=10.0),
        Force("a", step(0.5 * stop, 0.0, 3.0)),
    )
    result = simulate(scene, (0.0, stop), t_eval=[0.4 * stop, 0.6 * stop])
    times = event_error(changes(result), [(exact.time, "c", 1, 0)], stop)
    common = 1 / (1 + mp.mpf(ratio))
    speeds = [float(common), float(common + 3 * mp.mpf(0.1 * stop) / (1 + mp.mpf(ratio)))]
    v = max(abs(result.velocity(n) - speeds).max() / speeds[1] for n in ("a", "b"))
    lam = worst(result.force("c"), [0.0, float(analytic.stick_phase(3, 0, 1, ratio).force)])
    return max(times, float(v), lam)


def units(decades: tuple[int, ...]) -> Answer:
    """The benchmark in other units of force, inertia and time: the same dimensionless motion."""
    story = two_flywheels()
    errors = []
    for f, m, s in itertools.product(decades, repeat=3):
        force, inertia, second = 10.0**f, 10.0**m, 10.0**s
        speed = force * second / inertia
        law = DryFriction(0.2, 0.1, dwell=0.1 * second)
        slope = 3000.0 * force / second
        first, second_pulse = (
            triangle(a * second, b * second, c * second, slope=slope)
            for a, b, c in ((0.05, 0.1, 0.15), (0.4, 0.5, 0.6))
        )
        scene = Scene(
            Body("wheel1", inertia=inertia, velocity=speed),
            Body("wheel2", inertia=10.0 * inertia, velocity=1.01 * speed),
            Contact("interface", "wheel1", "wheel2", law, normal=100.0 * force),
            Contact("brake", "wheel1", GROUND, law, normal=first + second_pulse),
        )
        result = simulate(scene, (0.0, 4.0 * second), atol=1e-10 * speed, t_eval=story.t * second)
        events = [(t * second, *rest) for t, *rest in story.events]
        errors.append(event_error(changes(result), events, 4.0 * second))
        errors.append(worst(story.seen(result) / speed, story.velocities))
    return max(errors), f"{len(errors) // 2} combinations"


def units_of_spring(decades: tuple[int, ...]) -> Answer:
    """The pulled block in other units: integrated, so that tolerances must be in the new units too."""
    story = pulled_block()
    errors = []
    for f, m, s in itertools.product(decades, repeat=3):
        force, inertia, second = 10.0**f, 10.0**m, 10.0**s
        speed = force * second / inertia
        scene = Scene(
            Body("block", inertia=inertia),
            Drive("plate", velocity=0.1 * speed),
            Contact("floor", "block", GROUND, DryFriction(1.5, 1.0), normal=force),
            Spring("block", "plate", stiffness=2.0 * inertia / second**2),
        )
        atol = 1e-12 * min(speed, speed * second)
        result = simulate(scene, (0.0, 40.0 * second), rtol=1e-10, atol=atol, t_eval=story.t * second)
        events = [(t * second, *rest) for t, *rest in story.events]
        errors.append(event_error(changes(result), events, 40.0 * second))
        errors.append(worst(story.seen(result) / speed, story.velocities))
    return max(errors), f"{len(errors) // 2} combinations"


def creep(velocity: float) -> Answer:
    """A block of 1/v kg in pre-slip under 3 N creeps: w = w1 (1 - exp(-t/T)), w1 = 3 v/5, T = 0.2 s."""
    scene = block(3.0).replace("block", inertia=1.0 / velocity).regularized(velocity)
    result = simulate(scene, (0.0, 4.0), rtol=1e-8, atol=1e-10 * velocity, t_eval=[0.1, 0.2, 0.4, 0.8, 4.0])
    exact = 0.6 * velocity * (1 - np.exp(-5.0 * result.t))
    return worst(result.velocity("block"), exact)


def preslip(velocity: float) -> Answer:
    """The benchmark with a pre-slip velocity: the exact motion is approached in proportion to it.

    Beside speeds of 1 rad/s double precision does not resolve velocities below 1e-10: these must be refused.
    """
    story = two_flywheels()
    if velocity <= 1e-10:
        run = partial(simulate, story.scene.regularized(velocity), (0.0, 4.0))
        return refused(run, "'interface'", "pre-slip velocity"), "refused, as it must be"
    result = simulate(story.scene.regularized(velocity), (0.0, 4.0), t_eval=story.t, **TIGHT)
    return worst(story.seen(result), story.velocities)


def dwell(tau: float) -> Answer:
    """A ramp of 0.1 N/s on a block: it breaks loose where the ramp meets the rising level."""
    scene = block(piecewise_linear([0.0, 100.0], [0.0, 10.0]), law=DryFriction(0.5, 0.4, dwell=tau))
    rate, t = mp.mpf(10) / 100, analytic.exact(tau)
    broken = mp.findroot(lambda s: rate * s - 5 + mp.exp(-s / t), (mp.mpf(40), mp.mpf(50)), solver="anderson")
    stop = 60.0
    gained = mp.mpf(stop) - broken
    speed = (rate * broken - 4) * gained + rate * gained**2 / 2
    return told(scene, stop, [(broken, "floor", 0, 1)], {stop: float(speed)})


def ratio_on_ramp(ratio: float) -> Answer:
    """A ramp on a block: breakaway at mu_s N, then slip against mu_c N."""
    level = 4.0 * ratio
    law = DryFriction(0.4 * ratio, 0.4)
    stop = 2.0 * level
    scene = block(piecewise_linear([0.0, stop], [0.0, stop]), law=law)
    gained = stop - level
    return told(scene, stop, [(level, "floor", 0, 1)], {stop: (level - 4.0) * gained + gained**2 / 2})


def ratio_pulled(ratio: float) -> Answer:
    """Stick-slip of a pulled block: events and velocities over two cycles."""
    motion = analytic.pulled_block(1, 2, 0.1, normal=1, mu_static=ratio, mu_coulomb=1)
    stop = float(motion.first_break + 2 * (motion.slip_time + motion.stick_time)) - 0.01
    t = np.concatenate(
        [np.linspace(0, stop, 50)] + [float(e.time) + np.linspace(-1, 1, 20) for e in motion.events(stop)]
    )
    t = np.unique(t[(t >= 0) & (t <= stop)])
    result = simulate(pulled(ratio), (0.0, stop), t_eval=t, **TIGHT)
    times = event_error(changes(result), motion.events(stop), stop)
    v = [float(motion.state(mp.mpf(s))[1]) for s in t.tolist()]
    return max(times, worst(result.velocity("block"), v))


def equal_coefficients_pulled() -> Answer:
    """With mu_s = mu_c the pulled block slips at v (1 - cos(omega s)), which touches 0 again and again."""
    t = np.linspace(0.0, 40.0, 401)
    result = simulate(pulled(1.0), (0.0, 40.0), t_eval=t, **TIGHT)
    v = np.where(t < 5, 0.0, 0.1 * (1 - np.cos(math.sqrt(2) * (t - 5))))
    require(bool(result.events) and abs(result.events[0].t - 5.0) < 1e-8, "breakaway at 5 s is not found")
    return worst(result.velocity("block"), v), f"{len(result.events)} changes of mode"


# Start, peak and end in s of a short pulse, in a window of 1e4 s.
PULSE = (5000.0, 5000.0 + 5e-7, 5000.0 + 1e-6)


def short_pulse(kind: str) -> Answer:
    """A pulse of 100 N after 5000 s of rest; events and speed in exact arithmetic on the floats."""
    start, top, end = map(mp.mpf, PULSE)
    broken = start + (top - start) * 5 / 100
    speed = (100 - 4 + 1) / mp.mpf(2) * (top - broken) + (end - top) * (mp.mpf(100) / 2 - 4)
    events = [(broken, "floor", 0, 1), (end + speed / 4, "floor", 1, 0)]
    load: Signal = piecewise_linear(PULSE, [0.0, 100.0, 0.0])
    if kind == "function":
        load = signal(lambda t: float(np.interp(t, PULSE, [0.0, 100.0, 0.0])), breaks=PULSE)
    result = simulate(block(load), (0.0, 1e4), t_eval=[4999.0, PULSE[2], 1e4])
    late = event_error(changes(result), events, 1.0)
    allowed = 2e-12 if kind == "triangle" else 5e-11
    require(late <= allowed, f"event times are {late:.1e} s off; doubles lie 9e-13 s apart there")
    return worst(result.velocity("block"), [0.0, float(speed), 0.0]), f"event times within {late:.1e} s"


def short_brake() -> Answer:
    """A brake of 1e-6 s in 1e4 s takes its impulse from a wheel, and nothing else happens."""
    brake = piecewise_linear(PULSE, [0.0, 1e6, 0.0])
    result = simulate(block(0.0, normal=brake, speed=1.0), (0.0, 1e4), t_eval=[4e3, 1e4])
    width = PULSE[2] - PULSE[0]
    return worst(result.velocity("block"), [1.0, 1.0 - 0.4 * 1e6 * width / 2])


def tolerance(rtol: float) -> Answer:
    """The pulled block: error of event times over the span and of velocities over the largest, over rtol."""
    story = pulled_block()
    result = simulate(story.scene, (0.0, 40.0), rtol=rtol, atol=rtol * 1e-2, t_eval=story.t)
    times = event_error(changes(result), story.events, 40.0)
    v = worst(story.seen(result), story.velocities)
    return max(times, v) / rtol, f"error {max(times, v):.1e}"


def _rows() -> Iterator[Row]:
    for k in (-12, -9, -6, -3, 3, 6, 9, 12):
        yield extreme_row(
            f"inertia-ratio-{power(10.0**k)}",
            f"two bodies of inertia ratio {power(10.0**k)}: time of locking, speeds, and the force of eq. (1)",
            "analytic.lock_up and stick_phase",
            partial(inertia_ratio, 10.0**k),
            1e-12,
        )
    yield extreme_row(
        "units",
        "the benchmark with forces, inertias and times times 1e-12, 1 and 1e12 in all combinations",
        "the same dimensionless problem; analytic.two_flywheels",
        partial(units, (-12, 0, 12)),
        1e-12,
    )
    yield extreme_row(
        "units-integrated",
        "the pulled block with forces, inertias and times times 1e-12 and 1e12 in all combinations",
        "the same dimensionless problem; analytic.pulled_block",
        partial(units_of_spring, (-12, 12)),
        1e-7,
    )
    for k in (-2, -4, -6, -8, -10, -12, -14):
        v = 10.0**k
        yield extreme_row(
            f"creep-{power(v)}",
            f"pre-slip velocity {power(v)}: a held block creeps; velocity over the largest",
            "exponential approach in closed form",
            partial(creep, v),
            1e-6,
        )
        yield extreme_row(
            f"pre-slip-{power(v)}",
            f"pre-slip velocity {power(v)}: "
            + (
                "the benchmark approaches its exact motion; velocities over the largest" if k > -10 else "a clear error"
            ),
            "analytic.two_flywheels" if k > -10 else "an error is expected: not resolved beside 1 rad/s",
            partial(preslip, v),
            # Stuck, w/v is known to 1e-13/v, and so is the force over its level: breakaway comes 0.07 s times that
            # early or late, at up to 30 rad/s². No tolerance helps.
            3 * v + 1e-7 + 2e-13 / v if k > -10 else 0.0,
            limit=180.0,
        )
    for k in range(-9, 10, 3):
        yield extreme_row(
            f"dwell-{power(10.0**k)}",
            f"dwell time {power(10.0**k)} s: breakaway under a ramp, and the speed gained",
            "root of a t = (mu_s - (mu_s - mu_c) exp(-t/tau)) N, 40 digits",
            partial(dwell, 10.0**k),
            1e-12,
        )
    for k in (0, 1, 2, 4, 6):
        yield extreme_row(
            f"mu-ratio-ramp-{power(10.0**k)}",
            f"mu_s/mu_c = {power(10.0**k)}: breakaway under a ramp, and the speed gained",
            "t = mu_s N/a, then parabola",
            partial(ratio_on_ramp, 10.0**k),
            1e-12,
        )
        if k:
            yield extreme_row(
                f"mu-ratio-pulled-{power(10.0**k)}",
                f"mu_s/mu_c = {power(10.0**k)}: stick-slip of a pulled block over two cycles",
                "analytic.pulled_block",
                partial(ratio_pulled, 10.0**k),
                # a relative error of the position of 1e-9 shifts the next breakaway: omega x/v = 7 ratio times as much
                max(1e-7, 7e-9 * 10.0**k),
            )
    yield extreme_row(
        "mu-ratio-pulled-1e+0",
        "mu_s = mu_c: a pulled block whose velocity touches 0 without staying there",
        "v (1 - cos(omega s))",
        equal_coefficients_pulled,
        1e-7,
    )
    for kind in ("triangle", "function"):
        yield extreme_row(
            f"pulse-{kind}",
            f"a pulse of 1e-6 s ({kind}) in 1e4 s: event times, velocity over the largest",
            "parabolas in exact arithmetic",
            partial(short_pulse, kind),
            # a function of absolute time sees it in steps of 9e-13 s
            2e-8 if kind == "triangle" else 5e-6,
        )
    yield extreme_row(
        "pulse-brake", "a brake of 1e-6 s in 1e4 s takes its impulse", "mu_c times impulse", short_brake, 1e-9
    )
    for k in range(-3, -14, -1):
        yield extreme_row(
            f"rtol-{power(10.0**k)}",
            f"pulled block at rtol {power(10.0**k)}: errors in units of rtol",
            "analytic.pulled_block",
            partial(tolerance, 10.0**k),
            1e3 if k > -12 else 1e4,
        )


ROWS = list(_rows())
