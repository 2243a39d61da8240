"""Taylor coefficients by one matrix, against the recursion and against a closed form."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Scene,
    Spring,
    piecewise_linear,
    sine,
)
from stickslip.equations import mode_equations
from stickslip.equations.guards.guards import Guards
from stickslip.equations.mode_equations import equations_in
from stickslip.equations.motion import Motion
from stickslip.equations.system import System

DRY = DryFriction(0.3, 0.2, dwell=0.4)


def motion_of(scene: Scene, modes: list[int], t: float = 0.3, since: float = 0.1) -> tuple[Motion, Guards]:
    system = System(scene)
    y = np.linspace(0.5, 1.5, system.size)
    equations = equations_in(np.array(modes, dtype=np.int8), system)
    loads = system.loads(0.0, 2.0)
    equations.consistent(y, system.drive_velocities(loads.after(t).at(t)))
    motion = Motion(equations, loads.after(t), t, y, np.full(system.m, since))
    none = np.zeros(system.m, dtype=bool)
    return motion, Guards(motion, np.array(modes, dtype=np.int8), none, none)


def pulled() -> Scene:
    return Scene(
        Drive("belt", velocity=piecewise_linear([0, 1], [0.2, 0.7])),
        Body("a", inertia=1.0),
        Body("b", inertia=2.0),
        Contact("lower", "a", "belt", DRY, normal=piecewise_linear([0, 2], [3, 5])),
        Contact("upper", "b", "a", DRY, normal=2.0),
        Spring("a", GROUND, stiffness=40.0, damping=0.3),
        Damper("b", GROUND, damping=1.5),
        Force("b", piecewise_linear([0, 2], [0, 1])),
    )


def swung() -> Scene:
    """Sines of several frequencies move a drive, push a body and press a contact whose level does not rise."""
    return Scene(
        Drive("belt", velocity=sine(0.2, 3.0, offset=0.4) + sine(0.1, 0.7)),
        Body("a", inertia=1.0),
        Body("b", inertia=2.0),
        Contact("lower", "a", "belt", DRY, normal=piecewise_linear([0, 2], [3, 5])),
        Contact("upper", "b", "a", DryFriction(0.3, 0.2), normal=sine(0.5, 2.0, 0.3, offset=2.0)),
        Spring("a", GROUND, stiffness=40.0, damping=0.3),
        Force("b", piecewise_linear([0, 2], [0, 1]) + sine(3.0, 5.0, 1.0)),
    )


@pytest.mark.parametrize("made", [pulled, swung])
@pytest.mark.parametrize("modes", [[1, -1], [0, 1], [1, 0], [0, 0]])
@pytest.mark.parametrize("frozen", [False, True])
@pytest.mark.parametrize("tau", [0.0, 0.2])
def test_the_map_is_the_recursion(
    made: Callable[[], Scene], modes: list[int], frozen: bool, tau: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    motion, guards = motion_of(made(), modes)
    found = motion.expand(tau, motion.y, 12, 0.05, frozen)
    assert found.g is not None
    monkeypatch.setattr(mode_equations, "is_small", lambda *_: False)
    slow, slow_guards = motion_of(made(), modes)
    expected = slow.expand(tau, slow.y, 12, 0.05, frozen)
    assert expected.g is None
    for a, b in (
        (found.y, expected.y),
        (found.z, expected.z),
        (guards.series(found), slow_guards.series(expected)),
    ):
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-14 * np.abs(b).max())


@pytest.mark.parametrize("made", [pulled, swung])
@pytest.mark.parametrize("modes", [[1, -1], [0, 1], [1, 0], [0, 0]])
def test_majorants_of_guards_are_those_of_the_recursion(made: Callable[[], Scene], modes: list[int]) -> None:
    """Except for dwells: the product knows their age, the recursion takes them as if they had just begun."""
    motion, guards = motion_of(made(), modes)
    found = motion.guard_majorants(guards.rows, 5)
    expected = np.array([guards.rows.majorants(z, q) for q, z in motion.majorants(5)])
    rising = motion.is_rising(0.0)
    assert (found <= expected * (1 + 1e-12)).all() and (rising or (found >= expected * (1 - 1e-12)).all())
    # no coefficient is larger than its majorant
    series = guards.series(motion.expand(0.0, motion.y, 5))
    assert (np.abs(series) <= found * (1 + 1e-12) + 1e-300).all()


@pytest.mark.parametrize("made", [pulled, swung])
@pytest.mark.parametrize("modes", [[0, 1], [1, 0], [0, 0]])
def test_a_dwell_that_begins_just_now_adds_nothing_in_time(made: Callable[[], Scene], modes: list[int]) -> None:
    """Its age is exact, in the product of small scenes as in the recursion of large ones."""
    motion, guards = motion_of(made(), modes, since=0.3)
    found = motion.guard_majorants(guards.rows, 3, no_new_dwells=True)
    majorants = motion.majorants(3, no_new_dwells=True)
    np.testing.assert_allclose(found, [guards.rows.majorants(z, q) for q, z in majorants], rtol=1e-12)
    if motion.begins_to_rise:
        assert (found < motion.guard_majorants(guards.rows, 3)).any()


def test_an_oscillator_has_the_series_of_the_cosine() -> None:
    scene = Scene(Body("a", inertia=1e-6), Spring("a", GROUND, stiffness=1e8))
    system = System(scene)
    loads = system.loads(0.0, 1.0)
    equations = equations_in(np.empty(0, dtype=np.int8), system)
    motion = Motion(equations, loads.after(0.0), 0.0, np.array([0.0, 1.0]), np.empty(0))
    omega = 1e7
    found = motion.expand(0.0, motion.y, 18, 1 / omega)
    exact = [0 if k % 2 else (-1) ** (k // 2) / math.factorial(k) for k in range(19)]
    np.testing.assert_allclose(found.y[:, 1], exact, rtol=1e-13, atol=1e-300)
