"""Guards stay positive while modes hold: their values, how they leave 0 at the start, their zeros divided out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from reading import LAW, block

from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Scene,
    Spring,
    Stop,
    piecewise_linear,
    signal,
    sine,
)
from stickslip.equations.guards.at_start import NEVER
from stickslip.equations.guards.guards import Guards
from stickslip.equations.mode_equations import APART, OPEN, equations_in
from stickslip.equations.motion import Motion
from stickslip.equations.system import System

STOP = 2.0


def started(
    scene: Scene, modes: Sequence[int], t: float = 0.0, labels: Sequence[int] | None = None, **options: Any
) -> tuple[Motion, Guards]:
    """A motion in given modes from the scene's start, and its guards; contacts at rest are found there."""
    system = System(scene)
    y = np.zeros(system.size)
    y[: system.n] = [body.velocity for body in scene.bodies]
    for i, state in system.position_state.items():
        y[state] = [*scene.bodies, *scene.drives][i].position
    numbers = np.array(modes, dtype=np.int8)
    stretch = system.loads(0.0, STOP).after(t)
    since = np.zeros(system.m)
    equations = equations_in(numbers, system, np.zeros(system.piecewise.count, dtype=np.int16))
    motion = Motion(equations, stretch, t, y, since)
    w = system.relative_velocity(y, stretch.at(t))
    at_rest = options.get("at_rest", w == 0)
    shown = np.where(np.abs(numbers) <= 1, numbers, 0) if labels is None else np.array(labels)
    fired = np.zeros(system.m, dtype=bool) | options.get("fired", False)
    return motion, Guards(motion, shown.astype(np.int8), at_rest, fired)


def values(motion: Motion, guards: Guards, tau: float) -> list[float]:
    """The guards on the exact motion at local time tau, from its series."""
    expansion = motion.expand(0.0, motion.y, 18)
    y = sum(part * tau**k for k, part in enumerate(expansion.y))
    found: list[float] = guards.values(tau, motion.exact(tau, np.asarray(y))).tolist()
    return found


# What is watched


def test_a_held_contact_has_two_limits() -> None:
    """5 N either way, and it carries 2 N: 3 N are left forwards, 7 N backwards."""
    motion, guards = started(block(2.0), [0])
    assert sorted(values(motion, guards, 0.0)) == pytest.approx([3.0, 7.0])
    assert guards.row.tolist() == [0, 0] and not guards.is_velocity.any()
    assert sorted(guards.direction.tolist()) == [-1.0, 1.0]
    assert not guards.violated.any() and guards.is_plain and guards.armed == 2


@pytest.mark.parametrize(("mode", "velocity"), [(1, 0.3), (-1, -0.3)])
def test_a_slipping_contact_has_one(mode: int, velocity: float) -> None:
    motion, guards = started(block(velocity=velocity), [mode])
    assert values(motion, guards, 0.0) == pytest.approx([0.3])
    # it decelerates with 4 m/s^2
    assert values(motion, guards, 0.05) == pytest.approx([0.1])
    assert guards.is_velocity.all() and not guards.violated.any()


def test_a_level_rises_with_the_time_at_rest() -> None:
    """``B = N (mu_s - (mu_s - mu_c) exp(-t / tau))``, eqs. (8) and (9): 4 N at once, 5 - 1/e after tau = 0.5 s."""
    motion, guards = started(block(1.0, law=DryFriction(0.5, 0.4, dwell=0.5)), [0])
    assert sorted(values(motion, guards, 0.0)) == pytest.approx([3.0, 5.0])
    assert sorted(values(motion, guards, 0.5)) == pytest.approx([4.0 - math.exp(-1), 6.0 - math.exp(-1)])


def test_levels_follow_the_normal_force() -> None:
    motion, guards = started(block(1.0, piecewise_linear([0, 2], [10, 0])), [0])
    # it lets go of 1 N at B = 5 - 2.5 t = 1
    assert min(values(motion, guards, 1.6)) == pytest.approx(0.0, abs=1e-14)


def test_an_open_contact_is_watched_where_it_moves() -> None:
    """It carries nothing, but shows the sign of its velocity."""
    scene = block(1.0, 0.0, velocity=-1.0)
    motion, guards = started(scene, [OPEN], labels=[-1])
    assert values(motion, guards, 0.25) == pytest.approx([0.75])
    _, guards = started(block(0.0, 0.0), [OPEN], labels=[0])
    assert guards.size == 0


def test_series_are_the_values() -> None:
    scene = Scene(*block(sine(2.0, 1.0, phase=0.4)).elements, Spring("a", GROUND, stiffness=3.0))
    for mode, velocity in ((0, 0.0), (1, 1.0)):
        scene = scene.replace("a", velocity=velocity)
        motion, guards = started(scene, [mode])
        series = guards.series(motion.expand(0.0, motion.y, 18))
        for tau in (0.0, 0.03, 0.1):
            powers = tau ** np.arange(19)
            np.testing.assert_allclose(powers @ series, values(motion, guards, tau), rtol=1e-12)


# How it leaves 0


def rising(level: float, size: float, order: int) -> Any:
    """A force that leaves its level as ``size t^order``, order 0 to 2."""
    if order == 0:
        return level + size
    if order == 1:
        return piecewise_linear([0.0, STOP], [level, level + size * STOP])
    # 1 - cos(2 pi t) begins as 2 pi^2 t^2
    part = size / (2 * math.pi**2)
    return sine(part, 1.0, phase=-0.5 * math.pi, offset=level + part)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_body_set_moving_leaves_rest_with_one_order_more_than_what_pushes_it(order: int, sign: int) -> None:
    """Slipping takes 4 N: beyond them ``w = t``, ``t^2 / 2``, ``t^3 / 3``."""
    motion, guards = started(block(sign * rising(4.0, 1.0, order)), [sign])
    assert guards.order.tolist() == [order + 1] and not guards.violated.any()
    assert not guards.is_plain and guards.armed == 1
    # its zeros are divided out, two at most: the quotient is positive from the start on
    for tau in (0.0, 1e-9, 1e-3, 0.1):
        assert values(motion, guards, tau)[0] > 0
    power = min(order + 1, 2)
    w = {0: 0.1, 1: 0.1**2 / 2, 2: (0.1 - math.sin(0.2 * math.pi) / (2 * math.pi)) / (2 * math.pi**2)}[order]
    assert values(motion, guards, 0.1)[0] == pytest.approx(w / 0.1**power, rel=1e-9)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_body_pushed_with_less_than_friction_violates_its_guard(order: int, sign: int) -> None:
    _, guards = started(block(sign * rising(4.0, -1.0, order)), [sign])
    assert guards.violated.tolist() == [True]


@pytest.mark.parametrize("sign", [1, -1])
def test_a_body_that_just_balances_stays_at_rest(sign: int) -> None:
    motion, guards = started(block(4.0 * sign), [sign])
    assert guards.order.tolist() == [NEVER] and guards.armed == 0
    assert guards.stays_zero.tolist() == [0] and not guards.violated.any()
    assert values(motion, guards, 1.0)[0] > 0


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("order", [1, 2])
def test_a_force_at_its_level_that_rises_breaks_loose(order: int, side: int) -> None:
    _, guards = started(block(side * rising(5.0, 1.0, order)), [0])
    assert guards.direction[guards.violated].tolist() == [side]


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("order", [1, 2])
def test_a_force_at_its_level_that_falls_is_held(order: int, side: int) -> None:
    motion, guards = started(block(side * rising(5.0, -1.0, order)), [0])
    assert not guards.violated.any()
    assert guards.order[guards.direction == side].tolist() == [order]
    assert guards.order[guards.direction == -side].tolist() == [0]
    # both quotients begin at 1: t / t and (1 - cos(2 pi t)) / (2 pi^2 t^2)
    chosen = int(np.flatnonzero(guards.direction == side)[0])
    exact = 1.0 if order == 1 else (1 - math.cos(0.2 * math.pi)) / (2 * math.pi**2 * 0.01)
    assert values(motion, guards, 0.1)[chosen] == pytest.approx(exact, rel=1e-12)


def test_a_force_that_stays_at_its_level_is_held_for_ever() -> None:
    _, guards = started(block(5.0), [0])
    assert not guards.violated.any() and sorted(guards.order.tolist()) == [0, NEVER]
    assert guards.armed == 1 and guards.stays_zero.size == 0


def test_a_force_beyond_its_level_is_violated_at_once() -> None:
    _, guards = started(block(5.1), [0])
    assert guards.direction[guards.violated].tolist() == [1.0]


@pytest.mark.parametrize("fired", [False, True])
def test_a_row_that_has_just_fired_is_at_its_level_though_roundoff_is_left(fired: bool) -> None:
    """The force is short of its level by 5e-8 of it, and rises."""
    _, guards = started(block(rising(5.0 * (1 - 5e-8), 1.0, 1)), [0], fired=fired)
    assert guards.violated.any() == fired


@pytest.mark.parametrize("beyond", [1e-12, 1e-11, 1e-8])
def test_what_a_solver_left_beyond_a_stop_is_no_touch(beyond: float) -> None:
    """A body is drawn off its stop: the distance is ``t^2 / 2 - beyond``, and it has left from the start on."""
    scene = Scene(Body("a", inertia=1.0, position=beyond), Force("a", -1.0), Stop("stop", "a", GROUND, upper=0.0))
    motion, guards = started(scene, [APART], labels=[1])
    assert guards.order.tolist() == [2] and not guards.violated.any()
    for tau in (0.0, 1e-9, 1e-7, 1.5e-6, 4e-6, 1e-3, 1.0):
        assert guards.smallest(tau, motion.exact(tau, np.array([-tau, beyond - tau**2 / 2]))) > 0
    # later it falls back
    assert guards.smallest(1.0, motion.exact(1.0, np.array([1.0, 0.1]))) < 0


def test_a_stop_whose_force_has_come_to_nothing_but_roundoff_lets_go() -> None:
    """Its force is ``1 - t``: 1e-11 s before 1 s this is roundoff, and then the load draws the body off."""
    pressed = piecewise_linear([0.0, STOP], [1.0, -1.0])
    scene = Scene(Body("a", inertia=1.0, position=1.0), Force("a", pressed), Stop("stop", "a", GROUND, upper=1.0))
    _, guards = started(scene, [APART], t=1.0 - 1e-11, labels=[1], fired=True)
    assert guards.order.tolist() == [3] and not guards.violated.any()


@pytest.mark.parametrize("order", [0, 1])
def test_functions_without_a_series_leave_by_differences(order: int) -> None:
    """``4 + 1`` and ``4 + t`` as Python functions: the same orders, from differences."""
    load = signal(lambda t: 5.0 if order == 0 else 4.0 + t)
    motion, guards = started(block(load), [1])
    assert not motion.is_linear
    assert guards.order.tolist() == [order + 1] and not guards.violated.any()


def test_a_row_that_others_lock_never_moves() -> None:
    """Two contacts on one motion: while the first holds, nothing moves the second."""
    scene = Scene(*block(1.0).elements, Contact("d", "a", GROUND, LAW, normal=1.0))
    _, guards = started(scene, [0, 1])
    (moving,) = np.flatnonzero(guards.is_velocity)
    assert guards.order[moving] == NEVER and guards.stays_zero.tolist() == [1]


def test_a_drive_that_accelerates_takes_along_what_it_holds() -> None:
    """The body has no degree of freedom, but the drive moves it: ``w = t`` on the ground."""
    scene = Scene(
        Body("a", inertia=1.0),
        Drive("d", velocity=piecewise_linear([0.0, STOP], [0.0, STOP])),
        Contact("c", "a", GROUND, LAW, normal=1.0),
        Contact("held", "a", "d", LAW, normal=10.0),
    )
    _, guards = started(scene, [1, 0])
    (moving,) = np.flatnonzero(guards.is_velocity)
    assert guards.order[moving] == 1 and guards.stays_zero.size == 0


def test_a_velocity_that_is_not_at_rest_has_nothing_divided_out() -> None:
    motion, guards = started(block(5.0, velocity=1e-9), [1])
    assert guards.order.tolist() == [0]
    assert values(motion, guards, 0.0) == [1e-9]
    _, guards = started(block(5.0, velocity=-1e-9), [1])
    assert guards.violated.tolist() == [True]


def test_many_times_at_once() -> None:
    _, guards = started(block(rising(4.0, 1.0, 1)), [1])
    taus = np.array([0.0, 1e-4, 0.1, 1.0])
    states = np.array([[0.5 * tau**2 for tau in taus]])
    many = guards.values(taus, states)
    np.testing.assert_allclose(many[0], 0.5, rtol=1e-9)
    assert guards.smallest(1.0, np.array([0.5])) == pytest.approx(0.5)


def test_nothing_to_watch() -> None:
    _, guards = started(Scene(Body("a", inertia=1.0)), [])
    assert guards.size == 0 and guards.armed == 0 and guards.is_plain
    assert guards.smallest(0.0, np.zeros(1)) == math.inf
