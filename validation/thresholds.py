"""Extremes of loads: normal forces that vanish, short pulses, loads that graze breakaway, nonsense."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from stickslip import (
    GROUND,
    Body,
    Contact,
    DryFriction,
    Force,
    Scene,
    Signal,
    Spring,
    piecewise_linear,
    signal,
    simulate,
    sine,
)
from validation.blocks import DRY, FLOOR, block, extreme_row, mp, told
from validation.rows import Answer, Row, changes, event_error, refused, require, worst


def no_normal_force() -> Answer:
    """N = 0 all the time: free motion."""
    result = simulate(block(2.0, normal=0.0), (0.0, 2.0), t_eval=[0.5, 2.0])
    require(not result.force("floor").any(), "an open contact has a force")
    return worst(result.velocity("block"), [1.0, 4.0])


def normal_crosses_zero(load: float) -> Answer:
    """N = 10 - t while the block is stuck: it breaks at N = 2 F, slides at 0.4 N, and is free from 10 s on."""
    normal = piecewise_linear([0.0, 20.0], [10.0, -10.0])
    scene = block(load, normal=normal)
    if load == 0:
        result = simulate(scene, (0.0, 20.0), t_eval=np.linspace(0, 20, 81))
        require(
            not [e for e in result.events if e.after not in (e.before, 0)],
            "a block at rest starts to move",
        )
        return float(np.abs(result.velocity("block")).max() + np.abs(result.force("floor")).max())
    broken = 10 - 2 * load
    speed = {
        t: load * (t - broken) - 0.4 * ((10 - broken) ** 2 - max(10 - t, 0) ** 2) / 2
        for t in (broken, 9.5, 10.0, 20.0)
    }
    return told(scene, 20.0, [(broken, "floor", 0, 1)], speed)


def normal_jumps() -> Answer:
    """N drops from 10 to 1 N at 1 s: the block breaks; at 2 s it jumps to 20 N: it stops, and is held."""
    normal = piecewise_linear([0.0, 1.0, 1.0, 2.0, 2.0, 3.0], [10.0, 10.0, 1.0, 1.0, 20.0, 20.0])
    stops = 2 + (3 - 0.4) / (8 - 3)
    events = [(1.0, "floor", 0, 1), (stops, "floor", 1, 0)]
    return told(block(3.0, normal=normal), 4.0, events, {1.5: 1.3, 2.0: 2.6, 2.26: 1.3, 2.6: 0.0, 4.0: 0.0})


def normal_returns() -> Answer:
    """N is gone between 1 and 2 s: a block at rest under 3 N flies off, lands again with 4 N of friction."""
    normal = piecewise_linear([0.0, 1.0, 1.0, 2.0, 2.0, 3.0], [10.0, 10.0, 0.0, 0.0, 10.0, 10.0])
    result = simulate(block(3.0, normal=normal), (0.0, 6.0), t_eval=[1.0, 2.0, 3.5, 5.0, 6.0])
    stop = [e.t for e in result.events if int(e.after) == 0]
    require(len(stop) == 1, f"stuck {len(stop)} times after landing instead of once")
    return max(abs(stop[0] - 5.0) / 6, worst(result.velocity("block"), [0.0, 3.0, 1.5, 0.0, 0.0]))


def _pulse(times: tuple[float, float, float], peak: float) -> tuple[list[Any], Any]:
    """Break and stop time, and the speed of the block of 1 kg, under a triangle; in exact arithmetic on the floats."""
    start, top, end = map(mp.mpf, times)
    up, down = peak / (top - start), peak / (end - top)
    broken = start + 5 / up
    at_top = (peak - 4 + 1) / mp.mpf(2) * (top - broken)
    at_end = at_top + (end - top) * (mp.mpf(peak) / 2 - 4)
    require(bool(down > 0 and at_end > 0), "the pulse must move the block to its end")
    stops = end + at_end / 4
    return [(broken, "floor", 0, 1), (stops, "floor", 1, 0)], at_end


def short_pulse(kind: str) -> Answer:
    """A pulse of 1e-6 s and 100 N after 5000 s of rest, in a window of 1e4 s."""
    times = (5000.0, 5000.0 + 5e-7, 5000.0 + 1e-6)
    events, speed = _pulse(times, 100)
    if kind == "function":
        knots, values = np.array(times), np.array([0.0, 100.0, 0.0])
        load = signal(lambda t: float(np.interp(t, knots, values)), breaks=times)
    else:
        load = piecewise_linear(times, [0.0, 100.0, 0.0])
    result = simulate(block(load), (0.0, 1e4), t_eval=[4999.0, times[2], 1e4])
    late = event_error(changes(result), events, 1.0)
    allowed = 2e-12 if kind == "triangle" else 5e-11
    require(late <= allowed, f"event times are {late:.1e} s off; doubles lie 9e-13 s apart there")
    return worst(result.velocity("block"), [0.0, float(speed), 0.0]), f"event times within {late:.1e} s"


def short_brake() -> Answer:
    """A brake of 1e-6 s in 1e4 s takes its impulse from a wheel, and nothing else happens."""
    times = (5000.0, 5000.0 + 5e-7, 5000.0 + 1e-6)
    result = simulate(
        block(0.0, normal=piecewise_linear(times, [0.0, 1e6, 0.0]), speed=1.0), (0.0, 1e4), t_eval=[4e3, 1e4]
    )
    width = float(mp.mpf(times[2]) - mp.mpf(times[0]))
    return worst(result.velocity("block"), [1.0, 1.0 - 0.4 * 1e6 * width / 2])


def graze(kind: str, excess: float, method: str = "auto") -> Answer:
    """A load whose peak is (1 + excess) times the breakaway level: the first breakaway, or none at all."""
    peak = 5.0 * (1 + excess)
    excess = float(mp.mpf(peak) / 5 - 1)
    if kind == "sine":
        load: Signal = sine(peak, 1.0)
        broken = mp.asin(1 / (1 + mp.mpf(excess))) / (2 * mp.pi) if excess > 0 else None
    else:
        load = piecewise_linear([0.0, 1.0, 2.0, 3.0], [0.0, peak, 0.0, 0.0])
        broken = 1 / (1 + mp.mpf(excess)) if excess > 0 else None
    scene = block(load)
    if kind == "spring":
        scene, broken = _spring_graze(peak)
    result = simulate(scene, (0.0, 10.0), method=method, rtol=1e-12, atol=1e-14)
    first = changes(result)[:1]
    if broken is None:
        require(
            not first,
            f"breakaway at {first[0][0] if first else 0:.9g} s under a load that never reaches the level",
        )
        return float(np.abs(result.velocity("block")).max())
    return event_error(first, [(broken, "floor", 0, 1)], 10.0)


def _spring_graze(peak: float) -> tuple[Scene, Any]:
    """A mass swings on a spring that pulls the block: its force is peak sin(t)."""
    scene = Scene(
        Body("block", inertia=1.0),
        Body("mass", inertia=1.0, velocity=peak),
        Contact("floor", "block", GROUND, DRY, normal=FLOOR),
        Spring("block", "mass", stiffness=1.0),
    )
    return scene, mp.asin(5 / mp.mpf(peak)) if peak > 5 else None


def at_threshold(kind: str) -> Answer:
    """A start exactly at the breakaway level, or exactly between two answers."""
    if kind == "constant":
        return told(block(5.0), 10.0, [], {0.0: 0.0, 10.0: 0.0})
    if kind == "backward":
        return told(block(-5.0), 10.0, [], {0.0: 0.0, 10.0: 0.0})
    if kind == "falling":
        return told(block(piecewise_linear([0.0, 10.0], [5.0, 0.0])), 10.0, [], {0.0: 0.0, 10.0: 0.0})
    if kind == "rising":
        result = simulate(
            block(piecewise_linear([0.0, 10.0], [5.0, 15.0])), (0.0, 10.0), t_eval=[0.0, 5.0, 10.0]
        )
        require(
            len(result.events) <= 1 and all(e.t < 1e-12 for e in result.events), f"events {result.events}"
        )
        return worst(result.velocity("block"), [0.0, 17.5, 60.0])
    if kind == "spring":
        scene = Scene(
            Body("block", inertia=1.0, position=0.5),
            Contact("floor", "block", GROUND, DRY, normal=FLOOR),
            Spring("block", GROUND, stiffness=10.0),
        )
        return told(scene, 100.0, [], {0.0: 0.0, 100.0: 0.0})
    if kind == "above":
        result = simulate(block(5.0 * (1 + 1e-9)), (0.0, 1.0), t_eval=[1.0])
        return worst(result.velocity("block"), [1.0 + 5e-9])
    require(kind == "peak", f"unknown kind {kind}")
    return told(block(sine(5.0, 0.25)), 20.0, [], {0.0: 0.0, 1.0: 0.0, 20.0: 0.0}, rtol=1e-10)


def refusals(kind: str) -> Answer:
    """What cannot be simulated ends in an error that says why."""
    runs = {
        "negative inertia": (lambda: Body("a", inertia=-1.0), ("inertia", "-1")),
        "static below Coulomb": (lambda: DryFriction(0.1, 0.2), ("mu_static", "mu_coulomb")),
        "not a number": (
            lambda: simulate(block(signal(lambda t: math.nan if t > 0.5 else 0.0)), (0.0, 1.0)),
            (),
        ),
        "tolerance out of range": (lambda: simulate(block(0.0), (0.0, 1.0), rtol=1e-20), ("rtol",)),
        "time running back": (lambda: simulate(block(0.0), (1.0, 0.0)), ("t_span",)),
        "unknown body": (lambda: Scene(Body("a", inertia=1.0), Force("b", 1.0)), ("'b'",)),
        "load without end": (lambda: simulate(block(signal(lambda t: 1 / max(1 - t, 0.0))), (0.0, 2.0)), ()),
    }
    run, words = runs[kind]
    return refused(run, *words)


def _rows() -> list[Row]:
    rows: list[Row] = []

    def add(name: str, what: str, source: str, check: Any, bound: float, **options: Any) -> None:
        rows.append(extreme_row(name, what, source, check, bound, **options))

    add("normal-zero", "no normal force: free motion", "F t/m", no_normal_force, 1e-15)
    add(
        "normal-crosses-zero-loaded",
        "the normal force falls through 0 while the loaded block is stuck: breakaway, slip, free flight",
        "parabolas",
        partial(normal_crosses_zero, 1.0),
        1e-13,
    )
    add(
        "normal-crosses-zero-idle",
        "the normal force falls through 0 over a block that nothing pushes: it stays at rest",
        "velocity and force 0, exactly",
        partial(normal_crosses_zero, 0.0),
        0.0,
    )
    add(
        "normal-jumps",
        "the normal force jumps down and up: breakaway and stop",
        "straight lines",
        normal_jumps,
        1e-13,
    )
    add("normal-returns", "the normal force is gone for a second", "straight lines", normal_returns, 1e-13)
    for kind in ("triangle", "function"):
        add(
            f"pulse-{kind}",
            f"a pulse of 1e-6 s ({kind}) in 1e4 s: event times, velocity over the largest",
            "parabolas in exact arithmetic",
            partial(short_pulse, kind),
            # a function of absolute time sees it in steps of 9e-13 s
            2e-8 if kind == "triangle" else 5e-6,
        )
    add(
        "pulse-brake", "a brake of 1e-6 s in 1e4 s takes its impulse", "mu_c times impulse", short_brake, 1e-9
    )
    for kind in ("sine", "triangle", "spring"):
        for excess in (-1e-9, 1e-9):
            side = "below" if excess < 0 else "above"
            add(
                f"graze-{kind}-{side}",
                f"a {kind} load whose peak stays 1e-9 {side} breakaway: "
                + ("nothing moves" if excess < 0 else "first breakaway, over the span"),
                "asin, straight line" if excess > 0 else "velocity 0, exactly",
                partial(graze, kind, excess),
                0.0 if excess < 0 else 1e-7,
            )
    for kind in ("sine", "spring"):
        add(
            f"graze-{kind}-integrated",
            f"a {kind} load whose peak is 1e-9 above breakaway, integrated by CVODE: first breakaway, over the span",
            "asin",
            partial(graze, kind, 1e-9, "BDF"),
            1e-7,
        )
    about = {
        "constant": "load exactly at the level: holds for ever",
        "backward": "load exactly at the lower level: holds for ever",
        "falling": "load starts at the level and falls: holds",
        "rising": "load starts at the level and rises: slips from the start",
        "spring": "spring force exactly at the level: holds for ever",
        "above": "load 1e-9 above the level: slips from the start",
        "peak": "sine whose peak touches the level: holds",
    }
    for kind, what in about.items():
        add(
            f"threshold-{kind}",
            what,
            "|lambda| <= B holds, more does not",
            partial(at_threshold, kind),
            1e-13,
        )
    for kind in (
        "negative inertia",
        "static below Coulomb",
        "not a number",
        "tolerance out of range",
        "time running back",
        "unknown body",
        "load without end",
    ):
        name = "refuses-" + kind.lower().replace(" ", "-")
        add(name, f"{kind}: a clear error, no answer", "an error is expected", partial(refusals, kind), 0.0)
    return rows


ROWS = _rows()
