"""Steps taken once more: the same to the last bit, and the polynomials that CVODE's own interpolation gives."""

from __future__ import annotations

from math import exp
from typing import Any

import numpy as np
import pytest
import scipy

from stickslip import GROUND, Body, Contact, DryFriction, Scene, simulate
from stickslip.engines.replay import Replay, first_step
from stickslip.engines.sundials import CVODE

Array = np.ndarray


def rate(tau: float, y: Array, out: Array) -> None:
    out[0], out[1] = y[1], -4.0 * y[0] - 0.1 * y[1] ** 3


def jacobian(tau: float, y: Array, rate: Array, out: Array) -> None:
    out[:] = [[0.0, 1.0], [-4.0, -0.3 * y[1] ** 2]]


def solvers(replay: Replay, method: str, watched: bool) -> tuple[Any, Any]:
    options: dict[str, Any] = {"method": method, "rtol": 1e-8, "atol": 1e-10, "first_step": 1e-6}

    def first(tau: float, y: Array, out: Array) -> None:
        replay.rate(tau, y, out)

    def second(tau: float, y: Array, out: Array) -> None:
        replay.known_rate(tau, y, out)

    def again(tau: float, y: Array, rate: Array, out: Array) -> None:
        replay.known_jacobian(tau, y, rate, out)

    def guard(tau: float, y: Array, out: Array) -> None:
        out[0] = y[0] + 0.5 if watched else 1.0

    return (
        CVODE(first, jacfn=jacobian, eventsfn=guard, num_events=1, **options),
        CVODE(second, jacfn=again, **options),
    )


@pytest.mark.parametrize("method", ["BDF", "Adams"])
@pytest.mark.parametrize("watched", [False, True])
def test_the_polynomials_are_those_of_the_steps(method: str, watched: bool) -> None:
    replay, start = Replay(rate, jacobian), np.array([1.0, 0.0])
    solver, second = solvers(replay, method, watched)
    taken = replay.take(solver, second, 3.0, start, method, (1e-8, 1e-10))
    assert (taken.last.status == 2) == watched
    assert taken.taus.size > 20
    # the values at the ends of the steps, and in their middles as CVODE interpolates them
    ends = taken.coefficients.sum(axis=1)
    np.testing.assert_allclose(ends[-1], taken.state, atol=1e-15)
    plain, _ = solvers(Replay(rate, jacobian), method, watched)
    plain.init_step(0.0, start)
    signs = np.cos(0.5 * np.pi * np.arange(taken.coefficients.shape[1]))
    for k in range(min(25, taken.taus.size - 2)):
        assert plain.step(3.0, "onestep", 3.0).t == taken.taus[k + 1]
        middle = plain.step(0.5 * (taken.taus[k] + taken.taus[k + 1]), "normal").y
        np.testing.assert_allclose(signs @ taken.coefficients[k], middle, rtol=0, atol=1e-11)
        plain.step(taken.taus[k + 1], "normal")


def test_the_first_step_bends_by_less_than_the_tolerance() -> None:
    assert first_step(np.array([8.0]), np.array([1.0]), (1e-6, np.array([1e-6])), 1e9) == pytest.approx(5e-5)
    assert first_step(np.array([0.0]), np.array([1.0]), (1e-6, np.array([1e-6])), 2.0) == pytest.approx(2e-3)


@pytest.mark.parametrize("method", ["BDF", "Adams"])
@pytest.mark.parametrize(
    ("velocity", "stribeck", "normal", "stop"),
    [(0.67, 0.0742, 23.3, 0.5), (0.22, 0.0053, 6.1, 0.233), (1.15, 0.0469, 48.6, 0.627)],
)
def test_a_step_that_was_tried_as_far_as_the_end_is_tried_once_more(
    velocity: float, stribeck: float, normal: float, stop: float, method: str
) -> None:
    """1 kg comes to rest after the integral of dv / (0.2 + 0.2 exp(-(v/v_s)^2)) / N."""
    law = DryFriction(0.4, 0.2, stribeck_velocity=stribeck)
    scene = Scene(Body("b", inertia=1.0, velocity=velocity), Contact("c", "b", GROUND, law, normal=normal))
    result = simulate(scene, (0.0, stop), method=method, rtol=1e-7, atol=1e-9)
    exact = scipy.integrate.quad(
        lambda v: 1 / (0.2 + 0.2 * exp(-((v / stribeck) ** 2))) / normal, 0.0, velocity
    )[0]
    assert [(e.contact, int(e.after)) for e in result.events] == [("c", 0)]
    assert result.events[0].t == pytest.approx(exact, rel=1e-5)
