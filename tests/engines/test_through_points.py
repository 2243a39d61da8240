"""Polynomials through the points of a solver keep what its tolerances promise between them."""

from __future__ import annotations

from math import exp, pi
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy

from stickslip import (
    GROUND,
    TIME,
    Body,
    Contact,
    Damper,
    DryFriction,
    Force,
    Gap,
    Scene,
    StateSpace,
    feedback,
    output,
    position,
    simulate,
    sine,
)
from stickslip.engines.solvers.follow import LookAhead, Lookout
from stickslip.engines.solvers.sundials import CVODE
from stickslip.engines.solvers.through_points import path_through, through_points

Array = np.ndarray


def between(taus: Array, coefficients: Array) -> tuple[Array, Array]:
    """Return times within the steps, and the values of the polynomials there."""
    places = np.array([0.15, 0.5, 0.85])
    values = np.polynomial.chebyshev.chebvander(2 * places - 1, coefficients.shape[1] - 1) @ coefficients
    return (taus[:-1, None] + np.diff(taus)[:, None] * places).ravel(), values.reshape(-1, values.shape[2])


@pytest.mark.parametrize(("method", "degree"), [("BDF", 6), ("Adams", 12)])
@pytest.mark.parametrize("rtol", [1e-4, 1e-8, 1e-12])
def test_between_the_points_of_cvode_the_error_is_that_of_the_points(method: str, degree: int, rtol: float) -> None:
    """``x'' = -4 x - x'^3 / 10``, against an integration to roundoff."""

    def rate(tau: float, y: Array, out: Array) -> None:
        out[0], out[1] = y[1], -4.0 * y[0] - 0.1 * y[1] ** 3

    tolerance = rtol, 1e-2 * rtol
    found = CVODE(rate, method=method, rtol=rtol, atol=tolerance[1]).solve(np.array([0.0, 6.0]), np.array([1.0, 0.0]))
    exact = scipy.integrate.solve_ivp(
        lambda t, y: [y[1], -4.0 * y[0] - 0.1 * y[1] ** 3],
        (0.0, 6.0),
        [1.0, 0.0],
        method="DOP853",
        rtol=3e-14,
        atol=1e-16,
        dense_output=True,
    ).sol
    coefficients = through_points(found.t, found.y, tolerance, degree)
    np.testing.assert_allclose(coefficients.sum(axis=1), found.y[1:], rtol=0, atol=1e-14)
    times, values = between(found.t, coefficients)
    at_points = np.abs(found.y - exact(found.t).T).max()
    assert np.abs(values - exact(times).T).max() <= 1.1 * at_points + rtol


def test_steps_of_adams_methods_are_foreseen_from_rates() -> None:
    """``x'' = t^5 / 10`` from -3 m/s: the last two steps are long; the points before do not show how v bends."""
    times = np.linspace(0.0, 3.0, 301)
    scene = Scene(
        Body("m", inertia=1.0, velocity=-3.0),
        Force("m", feedback(lambda t, x: 0.1 * t**5, TIME, position("m"))),
    )
    result = simulate(scene, (0.0, 3.0), method="Adams", t_eval=times)
    assert result.stats["steps"] < 100
    np.testing.assert_allclose(result.position("m"), -3.0 * times + times**7 / 420, rtol=0, atol=2e-7)
    np.testing.assert_allclose(result.velocity("m"), -3.0 + times**6 / 60, rtol=0, atol=2e-7)


@pytest.mark.parametrize("rtol", [4e-8, 1e-8, 5e-9, 1e-10])
def test_corners_within_long_steps_of_adams_methods_are_as_exact(rtol: float) -> None:
    """Two limited controllers push a block, against the series: a motion begins exactly at the corner before it."""
    integral = {"A": [[0.0]], "B": [[1.0]], "C": [[1.0]], "D": [[1.0]], "limits": [(-2.0, 2.0)]}
    scene = Scene(
        Body("m", inertia=0.5, velocity=-2.0),
        StateSpace("ramp", inputs=[TIME], **integral),
        StateSpace("pi", inputs=[1.0 - position("m")], **integral),
        Force("m", output("ramp") + output("pi") - 1.0),
        Contact("c", "m", GROUND, DryFriction(0.75, 0.5), normal=1.0),
    )
    times = np.linspace(0.0, 4.0, 401)
    exact = simulate(scene, (0.0, 4.0), method="series", t_eval=times)
    found = simulate(scene, (0.0, 4.0), method="Adams", t_eval=times, rtol=rtol, atol=0.01 * rtol)
    assert np.abs(found.velocity("m") - exact.velocity("m")).max() < 30 * rtol


@pytest.mark.parametrize("count", [2, 3])
def test_rates_make_a_cubic_of_one_step(count: int) -> None:
    taus = np.array([0.0, 1.0, 1.5])[:count]
    points = np.stack([taus**3, 1.0 - taus], axis=1)
    slopes = np.stack([3 * taus**2, -np.ones(count)], axis=1)
    times, values = between(taus, through_points(taus, points, (1e-8, 1e-10), 12, lambda k: slopes[k]))
    np.testing.assert_allclose(values, np.stack([times**3, 1.0 - times], axis=1), rtol=0, atol=1e-14)


def error(taus: Array, function: Any, rtol: float = 1e-8, degree: int = 6) -> Array:
    """Return the largest errors in each step where the points are exact."""
    times, values = between(taus, through_points(taus, function(taus)[:, None], (rtol, 1e-2 * rtol), degree))
    return np.abs(values[:, 0] - function(times)).reshape(-1, 3).max(axis=1)


def test_points_in_a_layer_that_has_ended_say_nothing_of_what_follows() -> None:
    """``cos t + exp(-1e6 t)``: short steps in the layer, then steps that grow tenfold each, up to 0.02."""
    layer = np.linspace(0.0, 2.5e-5, 600)
    after = layer[-1] + np.cumsum(np.minimum(4e-8 * 10.0 ** np.arange(200), 0.02))
    wrong = error(np.append(layer, after), lambda t: np.cos(t) + np.exp(-1e6 * t))
    assert wrong.max() <= 2e-8
    assert wrong[700:].max() <= 1e-10


def test_points_behind_a_kink_say_nothing_of_what_was_before() -> None:
    """``sin t`` up to 1, from there on a parabola is added: a kink in the second derivative."""
    taus = np.linspace(0.0, 2.0, 81)
    wrong = error(taus, lambda t: np.sin(t) + np.maximum(t - 1.0, 0.0) ** 2, degree=12)
    assert wrong[taus[1:] <= 1.0].max() <= 1e-10


def test_where_nothing_happens_two_points_are_enough() -> None:
    taus = np.array([0.0, 1e-9, 1.0])
    assert through_points(taus, np.ones((3, 2)), (1e-8, 1e-10), 6).shape == (2, 2, 2)
    bent = through_points(taus, taus[:, None] ** 2, (1e-8, 1e-10), 6)
    assert bent.shape == (2, 3, 1)
    np.testing.assert_allclose(bent[1].sum(axis=0), 1.0)


@pytest.mark.parametrize("method", ["BDF", "Adams"])
@pytest.mark.parametrize(
    ("velocity", "stribeck", "normal", "stop"),
    [(0.67, 0.0742, 23.3, 0.5), (0.22, 0.0053, 6.1, 0.233), (1.15, 0.0469, 48.6, 0.627)],
)
def test_a_block_that_slides_to_rest(velocity: float, stribeck: float, normal: float, stop: float, method: str) -> None:
    """1 kg comes to rest after the integral of ``dv / (0.2 + 0.2 exp(-(v/v_s)^2)) / N`` over 0 to `velocity`."""
    law = DryFriction(0.4, 0.2, stribeck_velocity=stribeck)
    scene = Scene(Body("b", inertia=1.0, velocity=velocity), Contact("c", "b", GROUND, law, normal=normal))
    result = simulate(scene, (0.0, stop), method=method, rtol=1e-7, atol=1e-9)
    exact = scipy.integrate.quad(lambda v: 1 / (0.2 + 0.2 * exp(-((v / stribeck) ** 2))) / normal, 0.0, velocity)[0]
    assert [(e.contact, int(e.after)) for e in result.events] == [("c", 0)]
    assert result.events[0].t == pytest.approx(exact, rel=1e-5)


@pytest.mark.parametrize("method", ["BDF", "Adams"])
def test_a_step_of_nothing_between_long_ones_does_not_count(method: str) -> None:
    # y = t^2 with errors of 1e-15, at points of which two are 1e-10 s apart
    taus = np.array([0.0, 0.7, 1.5, 2.4, 3.3, 3.3 + 1e-10, 3.9])
    points = (taus**2 + 1e-15 * (-1.0) ** np.arange(taus.size))[:, None]
    motion: Any = SimpleNamespace(exact=lambda tau, y: y, equations=SimpleNamespace(borders=np.empty(0)))
    path = path_through(motion, taus, points, (1e-13, 1e-15), method, False)
    t = np.linspace(0.0, 3.9, 200)
    np.testing.assert_allclose(path.at(t)[:, 0], t**2, rtol=0, atol=1e-13)


def test_a_gap_that_parts_slowly_far_from_zero_parts_once() -> None:
    """Two bodies run by 90 rad at 34 rad/s, and part at 0.013 rad/s: no error of the path closes the gap again."""
    place, pressed, limit, t = 90.75912925132492, 0.05022867368142, 0.05022701370716162, 4.5642

    def swings(amplitude: float, frequency: float, phase: float, offset: float) -> sine:
        return sine(amplitude, frequency, phase=phase + 2 * pi * frequency * t, offset=offset)

    scene = Scene(
        Body("motor", inertia=0.0197180685, velocity=34.200088850567845, position=place + pressed),
        Body("load", inertia=0.0626600492, velocity=34.212815958983605, position=place),
        Gap("play", "motor", "load", lower=-limit, upper=limit, stiffness=1345.56824, damping=1.0767197),
        Contact("brake", "load", GROUND, DryFriction(0.3326, 0.207875), normal=1.26512),
        Damper("motor", GROUND, damping=0.0646031762),
        Force("motor", swings(1.95126845638, 1.72754008864, 4.039376019, 2.43908557)),
        Body("a", inertia=11.0259, velocity=-1.59e-4),
        Body("b", inertia=22.05188, velocity=-1.59e-4),
        Contact("between", "a", "b", DryFriction(0.2805926, 0.2805926), normal=492.6133),
        Contact("below", "b", GROUND, DryFriction(0.379, 0.379), normal=246.306667),
        Force("b", swings(210.35646, 3.03014677, 4.3886997, -62.093032)),
    )
    result = simulate(scene, (0.0, 1.35e-4), method="BDF")
    assert result.stats["restarts"] <= 3


def test_where_a_solver_places_a_root_that_it_is_told_of_is_no_end_of_a_step() -> None:
    """The root is 1.4e-17 s behind a point: the slope of a step so short would be roundoff."""
    values = {0.0: 1.0, 0.1: 1.0, 0.2: -1.0}
    motion = SimpleNamespace(has_left=lambda tau, y: False, has_left_in_floats=None, t=0.0)
    guards = SimpleNamespace(smallest=lambda tau, y: values[tau], motion=motion)
    others: Any = SimpleNamespace(pressed=False), SimpleNamespace(guard_calls=0), LookAhead(), SimpleNamespace()
    lookout = Lookout(guards, *others)  # type: ignore[arg-type]
    for tau in values:
        lookout.at(tau, np.array([tau]), np.array([tau]))
    solution = SimpleNamespace(
        t=np.array([0.0, 0.1, np.nextafter(0.1, 1.0)]), y=np.array([[0.0], [0.1], [0.1]]), status=2
    )
    taus, points = lookout.points_of(solution)
    assert taus.tolist() == [0.0, 0.1, 0.2]
    assert points.tolist() == [[0.0], [0.1], [0.2]]
