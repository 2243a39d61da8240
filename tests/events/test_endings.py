"""The end of a motion: which row is at its limit there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stickslip import (
    GROUND,
    Body,
    Contact,
    DryFriction,
    Force,
    OneWay,
    Scene,
    Spring,
    Stop,
    piecewise_linear,
    simulate,
    sine,
)
from stickslip.equations.guards.guards import Guards
from stickslip.equations.mode_equations import equations_in
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.equations.system import System
from stickslip.events.endings import alone_at_limit, at_limit

UNCERTAIN = 1e-6


def ending(*velocities: float, uncertain: float = UNCERTAIN) -> tuple[Motion, Guards, Path]:
    """Blocks that slide with 1 m/s, and have these velocities where the first of them ends the motion."""
    names = [f"b{i}" for i in range(len(velocities))]
    law = DryFriction(0.2, 0.2)
    scene = Scene(
        *(Body(name, inertia=1.0, velocity=1.0) for name in names),
        *(Contact(f"of {name}", name, GROUND, law, normal=10.0) for name in names),
    )
    system = System(scene)
    forward, none = np.ones(system.m, dtype=np.int8), np.zeros(system.m, dtype=bool)
    y = system.at_start()
    motion = Motion(equations_in(forward, system), system.loads(0.0, 2.0).after(0.0), 0.0, y, np.zeros(system.m))
    guards = Guards(motion, forward, none, none, np.full(system.m, uncertain))
    last = np.array(velocities)
    return motion, guards, Path(np.array([0.0, 0.5]), np.array([[y, last - y]]), last, True)


@pytest.mark.parametrize(
    ("beyond", "has_passed"), [(0.0, True), (5e-10, True), (5e-7, False), (9.999e-7, True), (2e-6, True)]
)
def test_what_is_beyond_0_by_errors_only_has_not_passed_it(beyond: float, has_passed: bool) -> None:
    motion, guards, path = ending(0.0, 0.3, -beyond)
    at = at_limit(motion, guards, path, [])
    assert at.touching.tolist() == at.fired.tolist() == [True, False, has_passed]
    # two rows are near 0: neither is alone there
    assert alone_at_limit(guards, path) is None


def test_a_velocity_that_falls_past_0_within_the_roundoff_of_the_time_is_at_0() -> None:
    """It falls by 1e-15 m/s in the roundoff of 0.5 s: 1 part in 1e15 of it, at 2 m/s^2."""
    for beyond, is_at_0 in [(5e-16, True), (5e-15, False)]:
        motion, guards, path = ending(0.0, -beyond, uncertain=1e-14)
        assert at_limit(motion, guards, path, []).touching.tolist() == [True, is_at_0]


@pytest.mark.parametrize(
    ("beyond", "alone"), [(0.0, (1, 0)), (5e-10, (1, 0)), (5e-7, None), (9.999e-7, (1, 0)), (2e-6, (1, 0))]
)
def test_the_only_row_near_0_is_alone_there_once_it_has_passed_it(beyond: float, alone: tuple[int, int] | None) -> None:
    _, guards, path = ending(0.5, -beyond, 0.3)
    assert alone_at_limit(guards, path) == alone
    assert alone_at_limit(guards, replace(path, hit=False)) is None


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}, {"formulation": "multiplier"}])
def test_the_contact_that_is_at_its_level_at_the_end_lets_go(options: dict[str, Any]) -> None:
    """Both hold 3 N. One is loaded with 1 N/s, the other with 2.5 N and 0.01 N/s: at first it is nearer."""
    law = DryFriction(0.3, 0.2)
    scene = Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=1.0),
        Contact("fast", "a", GROUND, law, normal=10.0),
        Contact("near", "b", GROUND, law, normal=10.0),
        Force("a", piecewise_linear([0.0, 10.0], [0.0, 10.0])),
        Force("b", piecewise_linear([0.0, 10.0], [2.5, 2.6])),
    )
    (event,) = simulate(scene, (0.0, 5.0), **options).events
    assert (event.contact, event.cause) == ("fast", "breakaway")
    assert event.t == pytest.approx(3.0, abs=1e-9)


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}])
def test_nothing_is_struck_where_another_contact_has_its_event(options: dict[str, Any]) -> None:
    """A ball falls 1 m at 2 m/s2 and strikes after 1 s; a block at 1 m/s on friction of 2 N stops after 0.5 s."""
    scene = Scene(
        Body("ball", inertia=1.0, position=1.0),
        Stop("floor", "ball", GROUND, lower=0.0, restitution=0.5),
        Force("ball", -2.0),
        Body("block", inertia=1.0, velocity=1.0),
        Contact("c", "block", GROUND, DryFriction(0.2, 0.2), normal=10.0),
    )
    result = simulate(scene, (0.0, 1.5), **options)
    assert [event.contact for event in result.events] == ["c", "floor"]
    assert [event.t for event in result.events] == pytest.approx([0.5, 1.0], abs=1e-6)
    struck = [piece.t for piece in result.trajectory.pieces if piece.impulses is not None]
    assert struck == [result.events[1].t]


SLIDER = Body("slider", inertia=1.0, velocity=4.0), Contact("rub", "slider", GROUND, DryFriction(0.2, 0.1), normal=5.0)
"""Joined to nothing: ``v = 4 - 0.5 t``."""

WAYS: list[dict[str, Any]] = [{}, {"method": "BDF"}, {"formulation": "merged"}, {"formulation": "multiplier"}]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("held", [OneWay("end", "b", GROUND), Stop("end", "b", GROUND, upper=0.0)])
def test_what_is_loaded_from_0_and_unloaded_stops_nobody_else(held: OneWay | Stop, way: dict[str, Any]) -> None:
    """A force without a level that is 0 at the start and at the end of a motion gives no scale for being near 0."""
    scene = Scene(
        Body("b", inertia=2.0),
        Body("m", inertia=1.0),
        Spring("b", "m", stiffness=40.0, damping=0.5),
        Force("m", sine(5.0, 0.8)),
        held,
        *SLIDER,
    )
    result = simulate(scene, (0.0, 4.0), **way)
    assert result.velocity("slider")[-1] == pytest.approx(2.0, abs=1e-6)
    assert not [event for event in result.events if event.contact == "rub"]
    assert result.energy().relative_error < 1e-5


def test_whatever_the_numbers_are() -> None:
    random = np.random.default_rng(0)
    for _ in range(40):
        force = sine(float(random.uniform(2, 8)), float(random.uniform(0.3, 1.2)))
        spring, anchor = random.uniform(10, 80, 2).tolist()
        scene = Scene(
            Body("b", inertia=2.47),
            Body("m", inertia=1.14),
            Spring("b", "m", stiffness=spring, damping=float(random.choice([0.0, 0.5, 0.9]))),
            Spring("b", GROUND, stiffness=anchor),
            OneWay("free", "b", GROUND),
            Force("m", force),
            *SLIDER,
        )
        assert simulate(scene, (0.0, 4.0)).velocity("slider")[-1] == pytest.approx(2.0, abs=1e-12)


def test_a_stop_that_leaves_its_limit_0_and_comes_back_is_the_one_that_is_hit() -> None:
    """Two slides on a spring, one between walls; the play between both is far from its limits (against DOP853)."""
    m_a, m_b, k, c, v = 0.58, 2.61, 33.04, 0.64, 0.5248229102743392
    scene = Scene(
        Body("a", inertia=m_a, velocity=v),
        Body("b", inertia=m_b, velocity=v),
        Spring("a", "b", stiffness=k, damping=c),
        Stop("wall", "a", GROUND, lower=0.0, upper=0.3, radius_a=1.1),
        Stop("play", "b", "a", lower=-0.47, upper=0.3, restitution=0.3),
    )

    def pull(y: Any) -> float:
        return float(k * (y[1] - y[0]) + c * (y[3] - y[2]))

    t, y, side = 0.0, np.array([0.0, 0.0, v, v]), 0
    while t < 3.0:

        def rates(t: float, y: Any, side: int = side) -> list[float]:
            return [y[2], y[3], 0.0 if side else pull(y) / m_a, -pull(y) / m_b]

        def upper(t: float, y: Any, side: int = side) -> float:
            return -side * pull(y) if side else y[0] - 0.3 / 1.1

        def lower(t: float, y: Any, side: int = side) -> float:
            return 1.0 if side else -y[0]

        for event in (upper, lower):
            event.terminal, event.direction = True, 1.0  # type: ignore[attr-defined]
        found = solve_ivp(rates, (t, 3.0), y, "DOP853", rtol=1e-12, atol=1e-14, events=[upper, lower], max_step=0.01)
        t, y = float(found.t[-1]), found.y[:, -1].copy()
        if found.status == 1:
            if side:
                side = 0
            else:
                side = 1 if found.t_events[0].size else -1
                y[0], y[2] = 0.3 / 1.1 if side > 0 else 0.0, 0.0
                side = side if side * pull(y) > 0 else 0
    result = simulate(scene, (0.0, 3.0))
    last = [result.position("a")[-1], result.position("b")[-1], result.velocity("a")[-1], result.velocity("b")[-1]]
    assert last == pytest.approx(y, abs=1e-9)
    assert not [event for event in result.events if event.contact == "play"]


def by_roundoff() -> Scene:
    """A body that an end stop holds swings there by roundoff; its guards end motions of the others."""
    push = piecewise_linear([0.37, 1.62, 1.7, 2.69, 3.31], [-9.75, 8.83, -5.53, -9.86, -7.69])
    normal = piecewise_linear([0.34, 0.41, 0.87, 3.47], [9.54, 7.58, 0.0, 2.07])
    return Scene(
        Body("a", inertia=1.48),
        Body("b", inertia=1.11),
        Body("c", inertia=0.42),
        Contact("rub", "b", GROUND, DryFriction(0.234, 0.18), normal=normal),
        Spring("a", GROUND, stiffness=57.76, damping=0.3),
        Stop("play", "c", "a", lower=0.0, upper=0.3, radius_a=1.2, radius_b=0.9),
        Stop("end", GROUND, "a", lower=0.0, upper=0.3),
        Force("c", push),
    )


def test_stops_are_hit_at_their_limits_only() -> None:
    scene = by_roundoff()
    result = simulate(scene, (0.0, 3.0))
    stops = {stop.name: stop for stop in scene.stops}
    hits = [event for event in result.events if event.cause == "impact" and event.contact in stops]
    assert hits
    for event in hits:
        stop, stretch = stops[event.contact], result.sample([event.t]).stretch(event.contact)[0]
        assert min(abs(stretch - stop.lower), abs(stretch - stop.upper)) < 1e-9, event
