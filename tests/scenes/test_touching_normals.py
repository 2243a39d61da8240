"""A normal force that touches 0 while its contact is at rest: what the load leaves over there decides.

With ``N = A (1 + sin)``, near a touch at t_0 ``N = A omega^2 (t - t_0)^2 / 2``. A load F lets the contact go at
``t_0 - a``, ``a = sqrt(2 F / (mu_s A omega^2))``. With x the time since t_0, in units of a, the velocity is
``F a (x + 1 - mu_c / mu_s (x^3 + 1) / 3) / m``: it is 0 again at the root x > 1 of a cubic polynomial.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stickslip import GROUND, Body, Contact, DryFriction, Force, Result, Scene, piecewise_linear, simulate, sine

MU_S, MU_C, SIZE, FREQUENCY, PHASE = 0.24, 0.13, 10.0, 0.5, 0.2
TOUCH = (1.5 * np.pi - PHASE) / (2 * np.pi * FREQUENCY)
WAYS: list[dict[str, Any]] = [
    {"method": "series"},
    {"method": "BDF"},
    {"method": "Adams"},
    {"formulation": "multiplier"},
]


def run(loads: tuple[float, ...], dwell: float = 0.0, late: float = 0.0, idle: int = 0, **options: Any) -> Result:
    """Return a run over the touch; `late` is how fast a load grows from 0.05 s after it, `idle` the bodies beside."""
    rises = piecewise_linear([TOUCH + 0.05, TOUCH + 0.25], [0.0, 0.2 * late])
    scene = Scene(
        Body("block", inertia=1.2),
        *(Force("block", load) for load in loads),
        Force("block", rises),
        Contact(
            "base",
            "block",
            GROUND,
            DryFriction(MU_S, MU_C, dwell=dwell),
            normal=sine(SIZE, FREQUENCY, phase=PHASE, offset=SIZE),
            rested=10.0,
        ),
        *(Body(f"idle{k}", inertia=1.0, velocity=0.1 * k) for k in range(idle)),
    )
    return simulate(scene, (0.0, TOUCH + 0.3), **options)


@pytest.mark.parametrize("options", WAYS, ids=lambda one: next(iter(one.values())))
@pytest.mark.parametrize("loads", [(0.1, 0.2, -0.3), (7.1, 3.2, -10.3), (-10.3, 7.1, 3.2), (100.1, -100.0, -0.1)])
def test_loads_that_cancel_but_for_roundoff_hold(options: dict[str, Any], loads: tuple[float, ...]) -> None:
    """Without a load the dwell goes on over the touch: the load that grows later meets the level of a long rest."""
    result = run(loads, dwell=0.5, late=20.0, **options)
    (event,) = result.events
    tau = event.t - TOUCH
    level = MU_S * SIZE * (1 - np.cos(2 * np.pi * FREQUENCY * tau))
    assert event.cause == "breakaway"
    assert 20.0 * (tau - 0.05) == pytest.approx(level, rel=1e-6)


@pytest.mark.parametrize("options", WAYS, ids=lambda one: next(iter(one.values())))
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("load", [1e-15, 1e-14])
def test_a_load_near_roundoff_slips_its_way_or_holds(options: dict[str, Any], sign: int, load: float) -> None:
    """Which of both is decided by roundoff: the sum of the sizes of the terms of the level is 4.8 N."""
    events = run((sign * load,), **options).events
    assert [int(event.after) for event in events] in ([], [sign, 0])


@pytest.mark.parametrize("options", WAYS, ids=lambda one: next(iter(one.values())))
@pytest.mark.parametrize("load", [1e-9, 1e-6, -1e-3])
def test_a_small_load_slips_for_the_time_of_the_closed_form(options: dict[str, Any], load: float) -> None:
    begins, ends = run((load,), **options).events
    half = np.sqrt(2 * abs(load) / (MU_S * SIZE)) / (2 * np.pi * FREQUENCY)
    ratio = MU_C / MU_S / 3
    (longer,) = (x.real for x in np.roots([-ratio, 0, 1, 1 - ratio]) if abs(x.imag) < 1e-9 and x.real > 1)
    # N is a parabola up to terms of fourth order
    assert begins.t - TOUCH == pytest.approx(-half, rel=max(1e-6, half**2))
    assert ends.t - TOUCH == pytest.approx(longer * half, rel=max(1e-6, 10 * half**2))
    assert int(begins.after) == np.sign(load)


def test_bodies_beside_change_nothing() -> None:
    """With 20 idle bodies the scene is followed part by part."""
    for loads in ((), (0.1, 0.2, -0.3), (100.1, -100.0, -0.1)):
        assert not run(loads, idle=20).events
