"""Values between computed points, and the multiplier formulation, against closed forms and integrations to roundoff."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

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
    load,
    piecewise_linear,
    simulate,
    sine,
)
from validation import between

Array = NDArray[np.float64]
WAYS = (("contact-force", "BDF"), ("contact-force", "Adams"), ("merged", "BDF"), ("multiplier", "BDF"))


@pytest.mark.slow
@pytest.mark.parametrize(("formulation", "method"), WAYS)
@pytest.mark.parametrize("rtol", [1e-6, 1e-12])
def test_an_undamped_oscillator_is_as_right_between_its_points(formulation: str, method: str, rtol: float) -> None:
    """``v = cos(1000 t)``: the values between the points are as right as the points."""
    omega = 1000.0
    scene = Scene(Body("m", inertia=1.0, velocity=1.0), Spring("m", GROUND, stiffness=omega**2))
    t = np.linspace(0.0, 20.0 / omega, 2001)
    given = {"formulation": formulation, "method": method, "rtol": rtol, "atol": 1e-2 * rtol / omega}
    own, at = simulate(scene, (0.0, t[-1]), **given), simulate(scene, (0.0, t[-1]), t_eval=t, **given)
    error = np.abs(at.velocity("m") - np.cos(omega * t)).max()
    assert error <= 1.5 * np.abs(own.velocity("m") - np.cos(omega * own.t)).max() + rtol
    assert np.abs(omega * at.position("m") - np.sin(omega * t)).max() <= 100 * rtol
    assert np.abs(own(t)[0] - at.velocity("m")).max() <= 1e-14


@pytest.mark.slow
@pytest.mark.parametrize(("formulation", "method"), WAYS)
@pytest.mark.parametrize("damping", [1e4, 1e9])
def test_velocities_and_heat_of_a_stiff_damper(formulation: str, method: str, damping: float) -> None:
    """Masses 2 and 3 kg part at 1.5 m/s: ``w = 1.5 exp(-c t / 1.2)``, and 1.35 J of heat at last."""
    scene = Scene(
        Body("a", inertia=2.0, velocity=1.0),
        Body("b", inertia=3.0, velocity=-0.5),
        Damper("a", "b", damping=damping),
    )
    rtol = 1e-5
    t = np.concatenate([[0.0], np.geomspace(1e-12, 5.0, 3001)])
    r = simulate(scene, (0.0, 5.0), formulation=formulation, method=method, rtol=rtol, atol=1e-7, t_eval=t)
    w = 1.5 * np.exp(-damping * t / 1.2)
    assert np.abs(r.velocity("a") - (0.1 + 0.6 * w)).max() <= 10 * rtol
    assert np.abs(r.velocity("b") - (0.1 - 0.4 * w)).max() <= 10 * rtol
    heat = r.energy().dampers["damper 'a'-'b'"]
    assert np.abs(heat - 1.35 * -np.expm1(-2 * damping * t / 1.2)).max() <= 1.35 * 100 * rtol


@pytest.mark.parametrize("velocity", [2e-7, 8e-7])
def test_a_thin_layer_is_followed_between_the_points(velocity: float) -> None:
    """While the block rides on the belt its speed is 0.2 m/s to about the pre-slip velocity; it lets go at x = 1 m."""
    scene = Scene(
        Body("m", inertia=1.0),
        Drive("belt", velocity=0.2),
        Spring("m", GROUND, stiffness=1.0),
        Contact("c", "m", "belt", DryFriction(1.0, 0.4, stribeck_velocity=0.3), normal=1.0),
    )
    t = np.linspace(0.5, 4.5, 1001)
    r = simulate(scene.regularized(velocity, "tanh"), (0.0, 20.0), rtol=1e-7, atol=1e-9)
    assert np.abs(r(t)[0] - 0.2).max() <= 10 * velocity + 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(("formulation", "method"), WAYS)
@pytest.mark.parametrize("rtol", [1e-6, 1e-12])
@pytest.mark.parametrize("leine", [True, False])
def test_the_last_steps_before_sticking(formulation: str, method: str, rtol: float, leine: bool) -> None:
    """Curves with a slope at rest, ``1 / (1 + 3 w)`` and ``0.4 + 0.6 exp(-10 w)``: DOP853 from the point before."""
    if leine:
        law = DryFriction(1.0, 1.0, kinetic=lambda v: 1.0 / (1.0 + 3.0 * abs(v)))
    else:
        law = DryFriction(1.0, 0.4, stribeck_velocity=0.1, stribeck_exponent=1.0)
    scene = Scene(
        Body("m", inertia=1.0),
        Drive("belt", velocity=0.2),
        Contact("c", "m", "belt", law, normal=1.0),
        Spring("m", GROUND, stiffness=1.0),
    )

    def rate(t: float, y: Array) -> list[float]:
        w = 0.2 - y[1]
        return [y[1], -y[0] + (1.0 / (1.0 + 3.0 * w) if leine else 0.4 + 0.6 * math.exp(-10.0 * w))]

    r = simulate(scene, (0.0, 30.0), formulation=formulation, method=method, rtol=rtol, atol=1e-2 * rtol)
    stops = [e.t for e in r.events if int(e.after) == 0 and e.t > 1.0]
    assert stops
    for stop in stops:
        i = int(np.searchsorted(r.t, stop))
        for k in range(i - 8, i):
            t = np.linspace(r.t[k], r.t[k + 1], 7)[1:-1]
            if not np.all(np.diff(t) > 0):
                continue
            start = [r.position("m")[k], r.velocity("m")[k]]
            y = solve_ivp(rate, (r.t[k], r.t[k + 1]), start, method="DOP853", rtol=1e-13, atol=1e-15, t_eval=t).y
            assert np.abs(r(t)[0] - y[1]).max() <= 100 * rtol
            assert np.abs(r(t)[1] - y[0]).max() <= 100 * rtol


@pytest.mark.slow
@pytest.mark.parametrize("family", list(between.FAMILIES))
@pytest.mark.parametrize("number", range(4))
def test_random_laws_stiffnesses_tolerances_methods_and_times(family: str, number: int) -> None:
    """A sample of the validation study: closed forms, and integrations to roundoff."""
    assert between.measure(family, number) <= between.LARGEST


def test_parts_of_a_scene_are_read_off_as_each_alone() -> None:
    """Two oscillators that nothing connects, 300 and 1000 rad/s, in one result: ``v = cos(omega t)``."""
    speeds = {"slow": 300.0, "fast": 1000.0}
    bodies = [Body(name, inertia=1.0, velocity=1.0) for name in speeds]
    springs = [Spring(name, GROUND, stiffness=omega**2) for name, omega in speeds.items()]
    r = simulate(Scene(*bodies, *springs), (0.0, 0.05), rtol=1e-10, atol=1e-15)
    t = np.linspace(0.0, 0.05, 777)
    for row, omega in enumerate(speeds.values()):
        assert np.abs(r(t)[row] - np.cos(omega * t)).max() <= 1e-7


def test_a_file_keeps_what_is_between_the_points(tmp_path: Path) -> None:
    """Values between the points are the same to the bit after `load`."""
    scene = Scene(Body("m", inertia=1.0, velocity=1.0), Spring("m", GROUND, stiffness=1e6))
    r = simulate(scene, (0.0, 0.02))
    r.save(tmp_path / "kept.npz")
    t = np.linspace(0.0, 0.02, 333)
    assert np.array_equal(load(tmp_path / "kept.npz")(t), r(t))


# -- the multiplier formulation -------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-10, 1e-11])
def test_an_open_contact_follows_the_one_beside_it(rtol: float) -> None:
    """The relative velocity changes its sign four times: eight events, as in the other formulations."""
    scene = Scene(
        Body("b", inertia=1.3),
        Drive("d", velocity=sine(0.78, 0.23)),
        Contact("c", "b", "d", DryFriction(0.334, 0.19, stribeck_velocity=0.05), normal=8.0),
        Contact("o", "b", "d", DryFriction(0.3, 0.2), normal=0.0),
        Force("b", sine(8.0, 0.612)),
    )
    found, other = (
        simulate(scene, (0.0, 3.0), formulation=f, rtol=rtol, atol=1e-2 * rtol).events
        for f in ("multiplier", "contact-force")
    )
    assert [(e.contact, e.before, e.after) for e in found] == [(e.contact, e.before, e.after) for e in other]
    assert len(found) == 8
    assert max(abs(a.t - b.t) for a, b in zip(found, other, strict=True)) <= max(100 * rtol, 1e-9)


def closing_pad() -> tuple[Scene, float]:
    """A pad closes on a body that nothing pushes: the force of the pad is 0 and stays 0."""
    p, d = piecewise_linear, DryFriction
    return (
        Scene(
            Body("b0", inertia=0.232419),
            Body("b1", inertia=0.140368),
            Body("b2", inertia=1.002334),
            Body("b3", inertia=0.110714),
            Body("b4", inertia=5.110552),
            Contact(
                "c0",
                "b0",
                GROUND,
                d(0.602, 0.448),
                normal=p((2.5234, 3.5403, 4.2708, 4.5336, 4.6391), (1.397, -3.627, 5.01, 4.608, -2.058)),
            ),
            Contact(
                "c1",
                "b1",
                "b0",
                d(0.636, 0.417, stribeck_velocity=0.072),
                normal=p((1.8086, 3.3132, 4.8658), (-2.3, 6.19, -3.339)),
            ),
            Contact(
                "c2",
                "b2",
                "b0",
                d(0.761, 0.47, stribeck_velocity=0.036),
                normal=sine(5.67, 1.024, 1.0, 14.01),
            ),
            Contact(
                "c3",
                "b3",
                GROUND,
                d(0.454, 0.338, dwell=0.05),
                normal=p((2.0762, 2.9516, 3.0947, 3.3998), (4.226, 5.097, -2.921, 10.864)),
            ),
            Contact(
                "c4",
                "b4",
                "b1",
                d(0.387, 0.157, stribeck_velocity=0.204),
                normal=sine(4.857, 0.736, math.pi / 2, 11.85),
            ),
            Spring("b2", "b1", stiffness=3.407179, damping=20.0, rest=-0.09),
            Damper("b3", "b2", damping=0.513038),
        ),
        5.0,
    )


def lifting_pad() -> tuple[Scene, float]:
    """All contacts are stuck while the normal force of one falls to 0."""
    d = DryFriction
    normal = piecewise_linear(
        (2.7882, 5.5467, 6.3295, 7.222, 7.2564, 7.8565), (3.416, 4.632, 9.903, 13.406, -5.613, 0.615)
    )
    return (
        Scene(
            Body("b0", inertia=0.826211),
            Body("b1", inertia=0.614675),
            Body("b2", inertia=0.541015, velocity=1.65),
            Contact(
                "c0",
                "b0",
                GROUND,
                d(0.064, 0.051, dwell=0.5, mu_static_backward=0.664, mu_coulomb_backward=0.367),
                normal=normal,
            ),
            Contact("c1", "b1", "b0", d(0.411, 0.411, dwell=0.5), normal=4.63),
            Contact("c2", "b2", "b1", d(0.317, 0.14, dwell=1e-4), normal=9.9),
            Spring("b0", "b1", stiffness=8.004877, damping=1.0, rest=-0.06),
            Spring("b1", "b0", stiffness=25.461619, damping=1.0, rest=0.08),
        ),
        10.0,
    )


@pytest.mark.slow
@pytest.mark.parametrize("rtol", [1e-7, 1e-8, 1e-9, 1e-10])
@pytest.mark.parametrize("case", [closing_pad, lifting_pad])
def test_multipliers_do_not_crawl_where_nothing_moves(case: object, rtol: float) -> None:
    """The events are those of the contact-force formulation, and take a few hundred steps, not 30 000."""
    scene, stop = case()  # type: ignore[operator]
    found = simulate(scene, (0.0, stop), formulation="multiplier", rtol=rtol, atol=1e-2 * rtol)
    assert found.stats["steps"] < 5000 and found.stats["rate_calls"] < 20_000
    other = simulate(scene, (0.0, stop), rtol=rtol, atol=1e-2 * rtol)
    names = [(e.contact, e.before, e.after) for e in other.events]
    assert [(e.contact, e.before, e.after) for e in found.events] == names
    for a, b in zip(found.events, other.events, strict=True):
        assert a.t == pytest.approx(b.t, abs=max(100 * rtol, 1e-8))


@pytest.mark.parametrize("formulation", ["contact-force", "merged", "multiplier"])
@pytest.mark.parametrize("rtol", [1e-6, 1e-8])
def test_forces_of_stuck_contacts_keep_the_tolerance(formulation: str, rtol: float) -> None:
    """Two blocks stick to each other on a spring, under a sine.

    As one mass of 3 kg they move as ``x = q (sin(2 t) - 2 sin(w t) / w) / (w^2 - 4)``, with ``w^2 = 9 / 3`` and
    ``q = 2 / 3``; by eq. (1) the contact accelerates the upper one with the force ``1 x''``.
    """
    scene = Scene(
        Body("lower", inertia=2.0),
        Body("upper", inertia=1.0),
        Contact("c", "upper", "lower", DryFriction(0.9, 0.8), normal=10.0),
        Spring("lower", GROUND, stiffness=9.0),
        Force("lower", sine(2.0, 1.0 / math.pi)),
    )
    t = np.linspace(0.0, 10.0, 501)
    r = simulate(scene, (0.0, 10.0), formulation=formulation, rtol=rtol, atol=1e-2 * rtol, t_eval=t)
    w, q = math.sqrt(3.0), 2.0 / 3.0
    acceleration = q * (-4.0 * np.sin(2 * t) + 2.0 * w * np.sin(w * t)) / (w * w - 4.0)
    assert not r.events
    # the contact holds the upper block back by r = -a
    assert np.abs(r.force("c") + acceleration).max() <= 10 * rtol * np.abs(acceleration).max()


@pytest.mark.parametrize("formulation", ["contact-force", "merged", "multiplier"])
@pytest.mark.parametrize("rtol", [1e-5, 1e-8])
def test_the_force_of_a_block_at_rest_is_what_pushes_it(formulation: str, rtol: float) -> None:
    """Nothing moves: the contact holds ``3 sin(pi t)`` N against the ground, to roundoff."""
    law = DryFriction(0.9, 0.8)
    scene = Scene(Body("m", inertia=1.3), Contact("c", "m", GROUND, law, normal=10.0), Force("m", sine(3.0, 0.5)))
    t = np.linspace(0.0, 10.0, 501)
    r = simulate(scene, (0.0, 10.0), formulation=formulation, rtol=rtol, atol=1e-2 * rtol, t_eval=t)
    assert np.abs(r.force("c") - 3.0 * np.sin(np.pi * t)).max() <= 1e-12
