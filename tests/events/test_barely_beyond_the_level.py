"""A force that is barely beyond its level for a moment: the contact lets go, and sticks again at once."""

from __future__ import annotations

import math
from typing import Any

import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    DryFriction,
    Force,
    Mode,
    Scene,
    Stop,
    feedback,
    piecewise_linear,
    position,
    signal,
    simulate,
    sine,
)
from stickslip.model.laws import Law
from stickslip.model.quantities import Load

NORMAL, OMEGA, PEAK = 17.1, 6.7, 0.5428
LEVEL = 0.3 * NORMAL
CURVES = {
    "Stribeck": DryFriction(0.3, 0.2, stribeck_velocity=0.2),
    "kinetic": DryFriction(0.3, 0.2, kinetic=lambda w: 0.3 + 0.1 * w),
    "Coulomb": DryFriction(0.3, 0.3),
}
SOLVERS: list[dict[str, Any]] = [
    {},
    {"method": "Adams", "formulation": "merged"},
    {"formulation": "multiplier"},
]
START, MOST_RESTARTS = 0.3, 30


def swing(t: float) -> float:
    return math.cos(OMEGA * (t - PEAK))


def pushed(law: Law, load: Load) -> Scene:
    return Scene(
        Body("clock", inertia=1.0, velocity=1.0, position=START),
        Body("block", inertia=1.9),
        Contact("rub", "block", GROUND, law, normal=NORMAL),
        Force("block", load),
    )


def pressed(law: Law, normal: Load) -> Scene:
    return Scene(
        Body("clock", inertia=1.0, velocity=1.0, position=START),
        Body("block", inertia=1.9),
        Contact("rub", "block", GROUND, law, normal=normal),
        Force("block", piecewise_linear([0.0, 0.1], [0.0, LEVEL])),
    )


def scene(law: Law, kind: str, excess: float) -> Scene:
    """At `PEAK` the load is `excess` of the level beyond it: the load is higher, or the normal force lower."""
    high, low, period = LEVEL * (1 + excess), NORMAL * (1 - excess), 2 * math.pi / OMEGA
    if kind == "sine":
        return pushed(law, sine(high, 1 / period, math.pi / 2 - OMEGA * PEAK))
    if kind == "function":
        return pushed(law, signal(lambda t: high * swing(t), period=period))
    if kind == "feedback":
        return pushed(law, feedback(lambda x: high * swing(x), position("clock")))
    if kind == "normal sine":
        return pressed(law, sine(2 * low, 1 / period, -math.pi / 2 - OMEGA * PEAK, 3 * low))
    return pressed(law, signal(lambda t: low * (3 - 2 * swing(t)), period=period))


@pytest.mark.slow
@pytest.mark.parametrize("excess", [1e-9, 1e-10, 1e-11, 1e-12, 1e-14])
@pytest.mark.parametrize("kind", ["sine", "function", "feedback", "normal sine", "normal function"])
@pytest.mark.parametrize("name", CURVES)
def test_a_contact_lets_go_and_sticks_again(name: str, kind: str, excess: float) -> None:
    for options in SOLVERS:
        result = simulate(scene(CURVES[name], kind, excess), (START, 0.9), rtol=1e-9, atol=1e-11, **options)
        found = [(int(event.before), int(event.after)) for event in result.events]
        assert found == [(0, 1), (1, 0)] or (excess < 1e-11 and not found)
        # cos x = 1 / (1 + excess), or of the normal force 3 - 2 cos x = 1 / (1 - excess)
        half = math.sqrt((1 if "normal" in kind else 2) * excess) / OMEGA
        if found:
            assert result.events[0].t == pytest.approx(PEAK - half, abs=0.02 * half + 1e-7)
            # the velocity in between is far below the errors of the solvers
            assert result.events[1].t - PEAK < 5e-3
        assert abs(result.position("block")[-1]) < 1e-10
        assert result.stats["restarts"] < MOST_RESTARTS


@pytest.mark.slow
@pytest.mark.parametrize("lift", [1e-9, 1e-10, 1e-11, 1e-12])
def test_a_stop_is_lifted_twice_and_closes_again(lift: float) -> None:
    """A load presses a body against its stop, but for a moment of each period; an open contact hangs on the body."""
    omega, first, pressing = 7.906, 0.56474, 2.616
    for options in SOLVERS:
        for kind in ("function", "feedback"):
            if kind == "function":
                load: Load = signal(
                    lambda t: pressing * (1 - (1 + 2 * lift) * math.cos(omega * (t - first))),
                    period=2 * math.pi / omega,
                )
            else:
                load = feedback(
                    lambda x: pressing * (1 - (1 + 2 * lift) * math.cos(omega * (x - first))),
                    position("clock"),
                )
            machine = Scene(
                Body("clock", inertia=1.0, velocity=1.0),
                Body("lid", inertia=1.243, position=1.0),
                Stop("seat", "lid", GROUND, upper=1.0),
                Force("lid", load),
                Contact("rub", "lid", GROUND, CURVES["Stribeck"], normal=0.0),
            )
            result = simulate(machine, (0.0, 1.6), rtol=1e-9, atol=1e-11, **options)
            lifts = [event.t for event in result.events if event.contact == "seat" and event.after == Mode.OPEN]
            period, half = 2 * math.pi / omega, math.sqrt(4 * lift) / omega
            expected = [first - half, first - half + period]
            assert lifts == pytest.approx(expected, abs=0.02 * half + 1e-7)
            assert result.mode("seat")[-1] == Mode.FORWARD
            assert abs(result.position("lid")[-1] - 1.0) < 1e-9
            assert result.stats["restarts"] < MOST_RESTARTS


@pytest.mark.parametrize("slope", [2.0, 12.0, 50.0])
@pytest.mark.parametrize("beyond", [1e-11, 3e-10, 1e-9, 2e-9, 8e-9, 1e-7])
def test_rest_under_a_load_just_beyond_the_level_that_falls_back(slope: float, beyond: float) -> None:
    """At rest at 1 s under ``-1 - d + s (t - 1)`` N, level 1 N: backward for ``2 d / s``, or not at all."""
    load = piecewise_linear([0.0, 1.5], [-1.0 - beyond - slope, -1.0 - beyond + 0.5 * slope])
    scene = Scene(
        Body("block", inertia=1.0, velocity=2.0 + beyond + slope / 2),
        Contact("rub", "block", GROUND, DryFriction(1.0, 1.0), normal=1.0),
        Force("block", load),
    )
    for way in ({}, *SOLVERS[1:], {"method": "BDF"}):
        result = simulate(scene, (0.0, 1.03), **way)
        first, last = result.events[0], result.events[-1]
        assert first.t == pytest.approx(1.0, abs=1e-7) and last.after == 0
        longest = 2.2 * beyond / slope
        if way == SOLVERS[2]:
            # IDA knows a velocity from 0 beyond 100 times its tolerance, here a part of the speed at the start
            longest += math.sqrt(2.2e-6 * (2.0 + slope / 2) / slope)
        assert 0.0 <= last.t - first.t <= longest
        assert result.velocity("block")[-1] == 0.0
