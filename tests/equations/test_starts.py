"""Taylor coefficients at the start of a motion that is no linear one, against derivatives by hand."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip import GROUND, Body, Contact, DryFriction, Scene, sine
from stickslip.equations.mode_equations import equations_in
from stickslip.equations.motion import Motion
from stickslip.equations.system import System


def test_a_kinetic_curve_under_a_normal_force_that_oscillates() -> None:
    """``m v' = -mu(v) N`` with ``mu = 0.2 + 0.1/(1 + v)`` and ``N = 10 + 2 sin(2 pi 0.3 t + 0.4)``."""
    law = DryFriction(0.4, 0.2, kinetic=lambda v: 0.2 + 0.1 / (1.0 + v))
    normal = 10.0 + sine(2.0, 0.3, phase=0.4)
    system = System(
        Scene(Body("m", inertia=2.0, velocity=0.5), Contact("c", "m", GROUND, law, normal=normal))
    )
    stretch = system.loads(0.0, 1.0).after(0.0)
    equations = equations_in(np.ones(1, dtype=np.int8), system)
    start = Motion(equations, stretch, 0.0, system.at_start(), np.zeros(1)).start
    turn = 2 * np.pi * 0.3
    N, rate, bend = 10 + 2 * np.sin(0.4), 2 * turn * np.cos(0.4), -2 * turn**2 * np.sin(0.4)
    assert start.q[:, 0] == pytest.approx([N, rate, bend / 2], rel=1e-3)
    mu, slope = 0.2 + 0.1 / 1.5, -0.1 / 1.5**2
    a = -mu * N / 2
    jerk = -(slope * a * N + mu * rate) / 2
    assert start.y[:, 0] == pytest.approx([0.5, a, jerk / 2], rel=1e-5)
