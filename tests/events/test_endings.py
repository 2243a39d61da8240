"""What ends a motion: which row is at its limit then."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    DryFriction,
    Force,
    Scene,
    Stop,
    piecewise_linear,
    simulate,
)
from stickslip.equations.guards.guards import Guards
from stickslip.equations.mode_equations import equations_in
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.equations.system import System
from stickslip.events.endings import alone_at_limit, at_limit

UNCERTAIN = 1e-6


def ending(*velocities: float) -> tuple[Motion, Guards, Path]:
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
    guards = Guards(motion, forward, none, none, np.full(system.m, UNCERTAIN))
    last = np.array(velocities)
    return motion, guards, Path(np.array([0.0, 0.5]), np.array([[y, last - y]]), last, True)


@pytest.mark.parametrize(
    ("beyond", "has_passed"), [(0.0, True), (5e-10, True), (5e-7, False), (9.999e-7, True), (2e-6, True)]
)
def test_what_is_beyond_0_by_errors_only_has_not_passed_it(beyond: float, has_passed: bool) -> None:
    motion, guards, path = ending(0.0, 0.3, -beyond)
    at = at_limit(motion, guards, path, [])
    assert at.touching.tolist() == at.fired.tolist() == [True, False, has_passed]
    # two are near 0: none is alone there
    assert alone_at_limit(guards, path) is None


@pytest.mark.parametrize(
    ("beyond", "alone"), [(0.0, (1, 0)), (5e-10, (1, 0)), (5e-7, None), (9.999e-7, (1, 0)), (2e-6, (1, 0))]
)
def test_the_only_row_near_0_is_alone_there_once_it_has_passed_it(beyond: float, alone: tuple[int, int] | None) -> None:
    _, guards, path = ending(0.5, -beyond, 0.3)
    assert alone_at_limit(guards, path) == alone
    assert alone_at_limit(guards, replace(path, hit=False)) is None


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}, {"formulation": "multiplier"}])
def test_the_contact_that_is_at_its_level_at_the_end_lets_go(options: dict[str, Any]) -> None:
    """Both hold 3 N. One is loaded with 1 N/s, the other with 2.5 N and 0.01 N/s: that one is nearer before."""
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
