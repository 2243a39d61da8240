"""Branches of limit cycles: closed forms along them, and where they change and end."""

from __future__ import annotations

import math

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq, minimize_scalar

from stickslip import (
    GROUND,
    Body,
    Contact,
    Cycle,
    Drive,
    DryFriction,
    Force,
    Scene,
    Spring,
    continue_cycle,
    limit_cycle,
    sine,
)

STIFFNESS, STATIC, COULOMB = 2.0, 1.5, 1.0


def belt(v: float = 0.1, damping: float = 0.0) -> Scene:
    return Scene(
        Body("m", inertia=1.0, velocity=v),
        Drive("belt", velocity=v),
        Spring("m", GROUND, stiffness=STIFFNESS, damping=damping),
        Contact("c", "m", "belt", DryFriction(STATIC, COULOMB), normal=1.0),
    )


def forced(friction: float, frequency: float) -> Scene:
    return Scene(
        Body("m", inertia=1.0),
        Spring("m", GROUND, stiffness=1.0),
        Contact("c", "m", GROUND, DryFriction(friction, friction), normal=1.0),
        Force("m", sine(1.0, frequency)),
    )


def test_periods_of_stick_slip_over_the_speed_of_the_belt() -> None:
    """2 (F_s - F_c) / (k v) + (2 pi - 2 atan((F_s - F_c) / (v sqrt(k m)))) sqrt(m / k)."""
    v = np.array([0.1, 0.2, 0.4, 0.8])
    branch = continue_cycle(belt(), "belt.velocity", v)
    fall, w = STATIC - COULOMB, math.sqrt(STIFFNESS)
    exact = 2 * fall / (STIFFNESS * v) + (2 * math.pi - 2 * np.arctan(fall / (v * w))) / w
    assert np.allclose(branch.periods, exact, atol=1e-12)
    assert branch.stable.all() and not branch.multipliers.any() and branch.points == ()
    assert np.allclose(branch.amplitudes("m"), np.hypot(fall / STIFFNESS, v / w), atol=1e-8)
    assert "belt.velocity" in str(branch)


def gap(v: float, damping: float) -> float:
    """By how much the block comes back faster than the belt after it broke away."""
    matrix = np.array([[0.0, 1.0], [-STIFFNESS, -damping]])
    start = np.array([(STATIC - damping * v - COULOMB) / STIFFNESS, v])
    w = math.sqrt(STIFFNESS - damping**2 / 4)
    found = minimize_scalar(
        lambda t: -(expm(matrix * t) @ start)[1],
        bounds=(math.pi / w, 2 * math.pi / w),
        method="bounded",
        options={"xatol": 1e-12},
    )
    return float(-found.fun - v)


@pytest.mark.slow
def test_a_damper_ends_stick_slip_where_the_block_does_not_catch_up_any_more() -> None:
    branch = continue_cycle(belt(damping=0.1), "belt.velocity", [0.1, 0.3, 0.6, 1.0])
    assert [one is None for one in branch.cycles] == [False, False, True, True]
    (end,) = branch.points
    assert end.kind == "end" and "graze 0 at 'c: BACKWARD -> STUCK'" in end.message
    assert end.value == pytest.approx(brentq(gap, 0.2, 1.0, args=(0.1,)), abs=1e-6)
    assert np.isnan(branch.periods[2:]).all() and not branch.stable[2:].any()


@pytest.mark.slow
def test_the_frequency_at_which_a_forced_oscillator_begins_to_stick() -> None:
    """There the spring and the load together push with exactly the friction where the mass turns."""
    branch = continue_cycle(
        forced(0.5, 0.12), "forces[0].signal.frequency", [0.12, 0.1, 0.09], period=lambda f: 1 / f
    )
    (point,) = branch.points
    assert point.kind == "sequence" and "'c'" in point.message
    last, first = branch.cycles[1], branch.cycles[2]
    assert last is not None and first is not None and not last.sticks and first.sticks
    cycle = limit_cycle(forced(0.5, point.value * 1.00001), period=1 / (point.value * 1.00001))
    t = np.array([event.t for event in cycle.result.events])
    push = np.sin(2 * math.pi * point.value * t) - cycle.result.sample(t).position("m")
    assert not cycle.sticks and np.abs(push) == pytest.approx(0.5, abs=1e-4)


def test_a_cycle_is_a_start_too() -> None:
    cycle = limit_cycle(belt())
    branch = continue_cycle(cycle, "springs[0].stiffness", [2.0, 1.9])
    assert isinstance(branch.cycles[1], Cycle)
    again = limit_cycle(branch.cycles[1].scene)
    assert again.period == pytest.approx(branch.periods[1], abs=1e-12)


def test_the_bifurcation_diagram() -> None:
    branch = continue_cycle(belt(), "belt.velocity", [0.1, 0.2])
    ax = branch.plot("m")
    assert ax.get_xlabel() == "belt.velocity" and "amplitude of m" in ax.get_ylabel()
    assert np.allclose(ax.lines[0].get_ydata(), branch.amplitudes("m"))
    assert "period" in branch.plot().get_ylabel()
    plt.close("all")


def test_bad_arguments_are_refused() -> None:
    with pytest.raises(ValueError, match="rise or fall"):
        continue_cycle(belt(), "belt.velocity", [0.1, 0.3, 0.2])
    with pytest.raises(ValueError, match="where a motion starts"):
        continue_cycle(belt(), "m.velocity", [0.1, 0.3])
    with pytest.raises(TypeError, match="Scene or a Cycle"):
        continue_cycle(1.0, "m.velocity", [0.1, 0.3])  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="has name, velocity"):
        continue_cycle(belt(), "belt.speed", [0.1, 0.3])
