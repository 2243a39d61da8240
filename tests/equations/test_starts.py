"""Taylor coefficients at the start of a nonlinear motion, against derivatives by hand."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip import GROUND, Body, Contact, Drive, DryFriction, Scene, sine
from stickslip.equations.mode_equations import equations_in
from stickslip.equations.motion import Motion
from stickslip.equations.system import System


def test_a_kinetic_curve_under_a_normal_force_that_oscillates() -> None:
    """``m v' = -mu(v) N`` with ``mu = 0.2 + 0.1/(1 + v)`` and ``N = 10 + 2 sin(2 pi 0.3 t + 0.4)``."""
    law = DryFriction(0.4, 0.2, kinetic=lambda v: 0.2 + 0.1 / (1.0 + v))
    normal = 10.0 + sine(2.0, 0.3, phase=0.4)
    system = System(Scene(Body("m", inertia=2.0, velocity=0.5), Contact("c", "m", GROUND, law, normal=normal)))
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


def test_a_kinetic_curve_on_a_belt_that_swings() -> None:
    """``2 v' = mu(w) 10`` behind a belt at ``u = 0.8 + 0.3 sin(5 t + 0.4)``, with ``w = v - u < 0``."""
    law = DryFriction(0.4, 0.2, kinetic=lambda w: 0.2 + 0.1 / (1.0 + w))
    belt = Drive("belt", velocity=0.8 + sine(0.3, 5 / (2 * np.pi), phase=0.4))
    system = System(Scene(Body("m", inertia=2.0, velocity=0.5), belt, Contact("c", "m", "belt", law, normal=10.0)))
    stretch = system.loads(0.0, 1.0).after(0.0)
    motion = Motion(equations_in(-np.ones(1, dtype=np.int8), system), stretch, 0.0, system.at_start(), np.zeros(1))
    swing, turn = 0.3 * np.sin(0.4), 0.3 * np.cos(0.4)
    w, mu, slope = 0.3 + swing, 0.2 + 0.1 / (1.3 + swing), -0.1 / (1.3 + swing) ** 2
    a = 5.0 * mu
    rate = a - 5 * turn
    jerk = -5.0 * slope * rate
    assert motion.start.z[:, 0] == pytest.approx([-w, rate, (jerk + 25 * swing) / 2], rel=1e-5)
    # later the belt has another acceleration
    later = a - 1.5 * np.cos(5 * 0.07 + 0.4)
    behind = system.at_start() + 0.3 * (np.sin(0.4 + 5 * 0.07) - np.sin(0.4))
    assert motion.relative_acceleration(0.07, behind, 0) == pytest.approx(later, rel=1e-12)
