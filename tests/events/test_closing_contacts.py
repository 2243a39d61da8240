"""A sine presses a contact again where it crosses 0: roundoff there may not keep the contact open."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from stickslip import (
    GROUND,
    TIME,
    Body,
    Contact,
    Damper,
    DryFriction,
    Force,
    Scene,
    Signal,
    Spring,
    Tie,
    feedback,
    piecewise_linear,
    position,
    relative_velocity,
    signal,
    simulate,
    sine,
    step,
    table,
    velocity,
)
from stickslip.model.arrays import Array


@pytest.mark.parametrize("method", ["auto", "BDF", "RK4"])
@pytest.mark.parametrize("periods", [0, 1, 2, 5])
def test_a_contact_pressed_by_a_sine_closes_in_every_period(method: str, periods: int) -> None:
    """v falls by 2/pi in the first half of each period, and comes to 0 after `periods` whole periods.

    There v = 0.5 - (1 - cos(2 pi t)) / pi with t from the start of that period.
    """
    speed = 0.5 + 2 / math.pi * periods
    scene = Scene(
        Body("a", inertia=1.0, velocity=speed),
        Contact("c", "a", GROUND, DryFriction(0.3, 0.2), normal=sine(10.0, 1.0)),
    )
    options = {"step": 1e-3} if method == "RK4" else {}
    result = simulate(scene, (0.0, periods + 1.0), method=method, **options)
    (event,) = (e for e in result.events if e.cause != "open")
    exact = periods + math.acos(1 - 0.5 * math.pi) / (2 * math.pi)
    assert event.t == pytest.approx(exact, abs={"auto": 1e-13, "BDF": 1e-6, "RK4": 2e-3}[method])
    assert result.velocity("a")[-1] == 0.0


@pytest.mark.parametrize("method", ["auto", "BDF", "RK4"])
@pytest.mark.parametrize("start", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("jump", [1.0, 3.0])
def test_a_normal_force_that_touches_0_as_something_else_happens(method: str, start: float, jump: float) -> None:
    """N = 2 - 2 cos(2 pi (t - 1) / 2) touches 0 at 1, 3 and 5 s: where the run or a force of 0.5 N begins.

    Friction takes t - sin(pi (t - 1)) / pi from the velocity in between.
    """
    scene = Scene(
        Body("a", inertia=1.0, velocity=9.0),
        Contact("c", "a", GROUND, DryFriction(0.5, 0.5), normal=sine(2.0, 0.5, 0.5 * math.pi, 2.0)),
        Force("a", step(jump, 0.0, 0.5)),
    )
    options = {"step": 1e-3} if method == "RK4" else {}
    result = simulate(scene, (start, 4.5), method=method, **options)
    taken = 4.5 - start - (math.sin(3.5 * math.pi) - math.sin((start - 1) * math.pi)) / math.pi
    exact = 9.0 - taken + 0.5 * (4.5 - max(start, jump))
    assert not result.events
    assert result.velocity("a")[-1] == pytest.approx(exact, abs={"auto": 1e-13, "BDF": 1e-6, "RK4": 1e-3}[method])


@pytest.mark.parametrize("stop", [2.0, 2.5])
def test_a_function_that_touches_0_presses_all_along(stop: float) -> None:
    """N = 4 (t - 1)^2 takes 2/3 ((stop - 1)^3 + 1) from the velocity, wherever in the span it touches 0."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=9.0),
        Contact("c", "a", GROUND, DryFriction(0.5, 0.5), normal=signal(lambda t: 4 * (t - 1) ** 2)),
    )
    result = simulate(scene, (0.0, stop))
    assert result.velocity("a")[-1] == pytest.approx(9.0 - 2 / 3 * ((stop - 1) ** 3 + 1), abs=1e-6)


def ramp(first: float, second: float) -> Signal:
    return piecewise_linear([1.0, 2.0, 2.5, 3.0], [0.0, first, 0.0, second])


@pytest.mark.parametrize("amplitude", [0.0, 1e-25])
def test_a_block_slips_on_when_another_one_comes_to_rest(amplitude: float) -> None:
    """All begin at rest, without forces: the scale of a small velocity is what the velocities become later.

    The force on the lone block rises backward by 2.1 - 0.16 3.6 = 1.524 N/s until 2 s, and falls to 0 until 2.5 s. Then
    it rises forward by 2 (1.05 + 0.576) N/s until 3 s, and stays at 1.626 N. So the block turns at
    3 s + (0.762 + 0.381 - 0.4065) / 1.626 s, whatever the others do.
    """
    scene = Scene(
        Body("first", inertia=1.6),
        Body("top", inertia=3.0),
        Body("second", inertia=0.69),
        Body("lone", inertia=2.41),
        Contact("c1", "first", GROUND, DryFriction(0.65, 0.26), normal=ramp(6.0, 6.0)),
        Contact("c2", "second", GROUND, DryFriction(0.767, 0.59), normal=ramp(4.4, 4.4)),
        Contact("c3", "top", "second", DryFriction(0.091, 0.07), normal=ramp(8.1, 8.1)),
        Contact("c4", "lone", GROUND, DryFriction(0.208, 0.16), normal=ramp(3.6, 3.6)),
        Spring("first", "second", stiffness=10.3, damping=0.5),
        Force("first", ramp(-5.6, 2.8)),
        Force("second", ramp(3.1, -1.55)),
        Force("second", sine(amplitude, 0.35)),
        Force("top", ramp(7.1, -3.55)),
        Force("lone", ramp(-2.1, 1.05)),
    )
    result = simulate(scene, (0.0, 4.0))
    # in the same stretch another block has come to rest
    assert any(e.contact == "c2" and 1.5 < e.t < 1.6 for e in result.events)
    start, turn = [e for e in result.events if e.contact == "c4"]
    assert (start.t, int(start.after), int(turn.after)) == (1.0, -1, 1)
    assert turn.t == pytest.approx(3 + 0.7365 / 1.626, abs=1e-12)


@pytest.mark.parametrize("start", [2.0**20, 2.0**30])
def test_a_contact_that_reverses_while_nothing_presses_it_stays_open_however_late(start: float) -> None:
    """N = 0.8 - 2.1 v is negative where the sliding turns, at 1.352 s; a late start adds only roundoff of the time."""
    scene = Scene(
        Body("a", inertia=1.8, velocity=-1.1, position=-0.2),
        Body("b", inertia=1.6),
        Contact("c", "a", "b", DryFriction(0.8, 0.75), normal=0.8 - 2.1 * velocity("a")),
        Spring("a", GROUND, stiffness=32.0, damping=0.8, rest=-0.07),
        Spring("b", "a", stiffness=38.0),
        Force("a", -2.6),
    )
    times = np.linspace(0.1, 3.9, 39)
    at_once, late = simulate(scene, (0.0, 4.0)), simulate(scene, (start, start + 4.0))
    assert [e.after for e in late.events] == [e.after for e in at_once.events]
    wanted, found = at_once.sample(times).velocity("a"), late.sample(start + times).velocity("a")
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-15 * start + 1e-9)


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}, {"formulation": "multiplier"}])
@pytest.mark.parametrize("speed", [0.3, 0.59, 1.0])
def test_what_a_planet_carrier_presses_closes_when_its_brake_slips(speed: float, options: dict[str, Any]) -> None:
    """The brake holds 0.92 N, which the ramp of 4 N/s reaches at 0.23 s; from then on N = 3 v grows as (t - 0.23)^2.

    In m v' = F - A h the gear's force h is the one that keeps A v = 0.
    """
    gear, inertias = np.array([1.8, 1.0, -2.8]), np.array([0.8, 1.3, 1.05])

    def rates(t: float, v: Array) -> Array:
        forces = np.array([4.0 * t - 0.92, -3.0 * v[0] * (0.27 + 0.054 * math.exp(-((v[1] / 0.23) ** 2))), 0.0])
        held = (gear @ (forces / inertias)) / (gear @ (gear / inertias))
        return np.asarray((forces - gear * held) / inertias)

    curve = DryFriction(0.324, 0.27, stribeck_velocity=0.23)
    scene = Scene(
        Body("carrier", inertia=0.8),
        Body("sun", inertia=1.3, velocity=speed),
        Body("ring", inertia=1.05, velocity=speed / 2.8),
        Tie("gear", {"carrier": 1.8, "sun": 1.0, "ring": -2.8}),
        Contact("brake", "carrier", GROUND, DryFriction(0.23, 0.23), normal=4.0),
        Contact("rub", "sun", GROUND, curve, normal=3.0 * velocity("carrier")),
        Force("carrier", piecewise_linear([0.0, 1.0], [0.0, 4.0])),
    )
    result = simulate(scene, (0.0, 0.9), rtol=1e-9, **options)
    assert [(e.contact, int(e.after)) for e in result.events if e.contact == "brake"] == [("brake", 1)]
    start = [0.0, speed, speed / 2.8]
    wanted = solve_ivp(rates, (0.23, 0.9), start, rtol=1e-12, atol=1e-14).y[:, -1]
    found = [result.velocity(name)[-1] for name in ("carrier", "sun", "ring")]
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-7)


def _turn(damping: float, friction: float) -> tuple[float, float]:
    """Return how long a turn from ``x = 0`` to ``x = 0`` takes, and its speed ratio, where ``N = x`` for ``x > 0``.

    By ``v' = -x - damping v - sign(v) friction max(x, 0)`` a turn has three linear parts: out to the right, back to
    ``x = 0``, and half a period of the spring alone on the left.
    """
    d = damping / 2

    def rate(stiffness: float) -> float:
        return math.sqrt(stiffness - d * d)

    out, back, left = 1 + friction, 1 - friction, 1.0
    t_out = math.atan2(rate(out), d) / rate(out)
    farthest = math.exp(-d * t_out) * math.sin(rate(out) * t_out) / rate(out)
    t_back = (math.pi - math.atan2(rate(back), d)) / rate(back)
    speed = farthest * math.exp(-d * t_back) * back / rate(back) * math.sin(rate(back) * t_back)
    t_left = math.pi / rate(left)
    return t_out + t_back + t_left, speed * math.exp(-d * t_left)


@pytest.mark.parametrize("damping", [0.02, 0.1, 0.4])
def test_friction_that_follows_a_deflection_dies_away_with_it(damping: float) -> None:
    """At last velocity and normal force are roundoff of what they were, and come to 0 together."""
    scene = Scene(
        Body("block", inertia=1.0, velocity=1.0),
        Spring("block", GROUND, stiffness=1.0, damping=damping),
        Contact("shoe", "block", GROUND, DryFriction(0.3, 0.3), normal=1.0 * position("block")),
    )
    result = simulate(scene, (0.0, 600.0))
    duration, ratio = _turn(damping, 0.3)
    turns = math.floor(math.log(1e-9) / math.log(ratio))
    there = result.sample([turns * duration])
    assert there.velocity("block")[0] == pytest.approx(ratio**turns, rel=1e-6)
    assert abs(result.velocity("block")[-1]) < 1e-12


def test_a_wedge_that_both_sides_press_dies_away() -> None:
    """The suspension of a freight car: ``N = |x|``, by a contact for each side."""
    law = DryFriction(0.5, 0.3)
    scene = Scene(
        Body("wedge", inertia=1.0, velocity=1.0),
        Spring("wedge", GROUND, stiffness=1.0, damping=0.05),
        Contact("right", "wedge", GROUND, law, normal=position("wedge")),
        Contact("left", "wedge", GROUND, law, normal=-1 * position("wedge")),
    )
    result = simulate(scene, (0.0, 300.0))
    assert abs(result.velocity("wedge")[-1]) < 1e-12


def test_a_row_beside_tells_by_its_velocity_which_one_opens() -> None:
    """Two contacts whose normal forces are those of one place: both come to 0 as the bodies come to rest."""
    scene = Scene(
        Body("a", inertia=0.7642543699392532, velocity=-0.5, position=-0.1),
        Body("b", inertia=0.5340143976011625),
        Spring("a", GROUND, stiffness=10.0, damping=5.0),
        Spring("b", GROUND, stiffness=50.0, damping=5.0),
        Spring("b", "a", stiffness=10.0),
        Contact("below", "a", GROUND, DryFriction(0.065, 0.05, dwell=0.1), normal=-5.0 * position("a")),
        Contact("between", "a", "b", DryFriction(0.3, 0.3), normal=10.0 * position("a")),
    )
    result = simulate(scene, (0.0, 20.0))
    assert np.abs(result.y[:, -1]).max() < 1e-11


@pytest.mark.filterwarnings("error")
def test_a_table_whose_corner_is_where_all_comes_to_rest() -> None:
    scene = Scene(
        Body("block", inertia=1.0, velocity=1.0),
        Spring("block", GROUND, stiffness=1.0, damping=0.3),
        Contact(
            "shoe",
            "block",
            GROUND,
            DryFriction(0.1, 0.1),
            normal=table(position("block"), [-1.0, 0.0, 0.5], [1.0, 0.0, 2.0]),
        ),
    )
    result = simulate(scene, (0.0, 1000.0))
    assert abs(result.velocity("block")[-1]) < 1e-12


@pytest.mark.parametrize("options", [{}, {"method": "Adams"}, {"formulation": "multiplier"}])
@pytest.mark.parametrize(
    ("pulses", "brakes", "stop"),
    [
        (piecewise_linear([0, 0.1, 0.2, 0.2, 0.3, 0.4], [0, 500, 500, 0, 0, 500]), (0.6, 0.6), 0.6),
        (piecewise_linear([0, 0.087, 0.175, 0.175], [0, 759, 759, 0]), (0.61, 0.48), 0.28),
    ],
)
def test_wheels_whose_slip_presses_their_tyres_roll_between_pulses(
    pulses: Signal, brakes: tuple[float, float], stop: float, options: dict[str, Any]
) -> None:
    """Friction of 4000 N s/m |w| with a coefficient of 1 is a damper: the slip dies away between two pulses.

    A slip below a solver's errors, 1e-6 of 12 m/s here, has no sign: at 0.3 m that is 4e-5 rad/s.
    """

    def car(is_damper: bool) -> Scene:
        elements: list[Any] = [Body("car", inertia=1000.0, velocity=12.0)]
        for i, mu in enumerate(brakes):
            wheel, tyre = f"wheel {i}", f"tyre {i}"
            elements.append(Body(wheel, inertia=1.0 + 0.4 * i, velocity=40.0))
            elements.append(Contact(f"brake {i}", wheel, GROUND, DryFriction(mu, mu), normal=pulses))
            if is_damper:
                elements.append(Damper("car", wheel, damping=4000.0, radius_b=0.3))
            else:
                normal = feedback(lambda w: 4000.0 * abs(w), relative_velocity(tyre))
                elements.append(Contact(tyre, "car", wheel, DryFriction(1.0, 1.0), normal=normal, radius_b=0.3))
        return Scene(*elements)

    result, exact = (simulate(car(is_damper), (0.0, stop), **options) for is_damper in (False, True))
    times = np.linspace(0.0, stop, 50)
    for body in ("car", "wheel 0", "wheel 1"):
        assert result.sample(times).velocity(body) == pytest.approx(exact.sample(times).velocity(body), abs=5e-5)
    assert result.stats["steps"] < 1000


@pytest.mark.parametrize("options", [{}, {"method": "Adams"}, {"formulation": "multiplier"}])
def test_a_cubic_normal_force_that_falls_through_0(options: dict[str, Any]) -> None:
    """A block rests before N = 2 x^3 falls to 0: x = sin(w t) / w - cos(w t) with w^2 = 3 is 0 where tan(w t) = w."""
    scene = Scene(
        Body("swings", inertia=3.0, velocity=1.0, position=-1.0),
        Body("block", inertia=1.0, velocity=-0.5),
        Spring("swings", GROUND, stiffness=9.0),
        Contact("c", "block", GROUND, DryFriction(0.5, 0.3), normal=feedback(lambda x: 2.0 * x**3, position("swings"))),
    )
    result = simulate(scene, (0.0, 3.0), **options)
    w = math.sqrt(3.0)
    exact = math.cos(3.0 * w) + w * math.sin(3.0 * w)
    assert result.velocity("swings")[-1] == pytest.approx(exact, abs=1e-5)
    assert abs(result.velocity("block")[-1]) < 1e-9
    assert result.stats["restarts"] < 200


SLOW_FUNCTIONS: dict[str, Callable[[float], float]] = {
    "x^2": lambda x: x**2,
    "x^3": lambda x: x**3,
    "x^6": lambda x: x**6,
    "Hertz": lambda x: max(x, 0.0) ** 1.5,
    "1 - cos x": lambda x: 1.0 - math.cos(x),
}


@pytest.mark.parametrize("options", [{}, {"method": "Adams"}, {"formulation": "merged"}, {"formulation": "multiplier"}])
@pytest.mark.parametrize("name", SLOW_FUNCTIONS)
def test_a_normal_force_that_leaves_0_slowly(name: str, options: dict[str, Any]) -> None:
    """With x = 2 t^3 / 3 a block that slips at 1 m/s loses the integral of mu N(x) over the time."""
    normal = SLOW_FUNCTIONS[name]
    scene = Scene(
        Body("m", inertia=1.0),
        Force("m", piecewise_linear([0.0, 10.0], [0.0, 40.0])),
        Body("o", inertia=1.0, velocity=1.0),
        Contact("c", "o", GROUND, DryFriction(0.5, 0.5), normal=feedback(normal, position("m"))),
    )
    result = simulate(scene, (0.0, 0.8), **options)
    lost = quad(lambda t: 0.5 * normal(2.0 * t**3 / 3.0), 0.0, 0.8)[0]
    assert result.velocity("o")[-1] == pytest.approx(1.0 - lost, abs=1e-7)
    assert (result.mode("c") == 1).all() and not result.events
    assert result.stats["restarts"] < 5


@pytest.mark.parametrize("options", [{}, {"method": "Adams"}])
def test_one_that_leaves_0_as_its_own_body_breaks_away(options: dict[str, Any]) -> None:
    """0.5 x'' = 4 t - 1 - 2.5 x^2 from 0.25 s on."""
    one = Contact("own", "m", GROUND, DryFriction(1.0, 1.0), normal=1.0)
    square = feedback(lambda x: 5.0 * x * x, position("m"))
    scene = Scene(
        Body("m", inertia=0.5),
        Force("m", piecewise_linear([0.0, 1.0], [0.0, 4.0])),
        one,
        Contact("square", "m", GROUND, DryFriction(0.5, 0.5), normal=square),
    )
    result = simulate(scene, (0.0, 0.5), **options)

    def rate(t: float, y: Array) -> list[float]:
        return [y[1], 8.0 * t - 2.0 - 5.0 * y[0] ** 2]

    answer = solve_ivp(rate, (0.25, 0.5), [0.0, 0.0], rtol=1e-10, atol=1e-12)
    assert result.velocity("m")[-1] == pytest.approx(answer.y[1, -1], abs=1e-6)
    assert result.events[0].t == pytest.approx(0.25, abs=1e-9)


@pytest.mark.parametrize("options", [{}, {"method": "Adams"}, {"formulation": "multiplier"}])
def test_a_cubic_normal_force_that_rises_and_falls(options: dict[str, Any]) -> None:
    """With x = 0.35 sin 2 t the block loses 0.4 times the integral of x^3 while x > 0: over 2 and a half half-waves."""
    scene = Scene(
        Body("swings", inertia=1.0, velocity=0.7),
        Spring("swings", GROUND, stiffness=4.0),
        Body("block", inertia=1.0, velocity=3.0),
        Contact("c", "block", GROUND, DryFriction(0.5, 0.4), normal=feedback(lambda x: x**3, position("swings"))),
    )
    result = simulate(scene, (0.0, 1.25 * math.pi), **options)
    half_wave = 0.4 * 0.35**3 * 2.0 / 3.0
    assert result.velocity("block")[-1] == pytest.approx(3.0 - 1.5 * half_wave, abs=1e-7)
    assert result.stats["restarts"] < 10


def test_normal_forces_that_only_touch_0() -> None:
    """The normal forces -2 v^2 and min(0, v) / 2 never press: v rises to 0 in 1 s, and the blocks go on."""
    pull = piecewise_linear([0.0, 0.5, 1.0, 3.0], [0.0, 1.0, 0.0, 2.0])
    scene = Scene(
        Body("led", inertia=1.0, velocity=-0.5),
        Force("led", pull),
        Body("a", inertia=1.0, velocity=-0.5),
        Body("b", inertia=3.0),
        Contact("c", "a", "b", DryFriction(0.5, 0.2), normal=feedback(lambda v: -2.0 * v * v, velocity("led"))),
        Contact("d", "b", "a", DryFriction(0.3, 0.2), normal=feedback(lambda v: 0.5 * min(0.0, v), velocity("led"))),
    )
    result = simulate(scene, (0.0, 3.0))
    assert result.velocity("a")[-1] == pytest.approx(-0.5, abs=1e-12)
    assert result.velocity("b")[-1] == 0.0
    assert not result.events


def test_kinks_of_functions_within_the_errors_of_the_solver() -> None:
    """A contact opens where v comes to 0, up to the solver's errors; min(0, v) is exactly 0 until v has passed 0."""
    v = velocity("led")
    scene = Scene(
        Body("led", inertia=1.0, position=-1.0),
        Body("block", inertia=2.0, velocity=1.0),
        Spring("led", GROUND, stiffness=9.0),
        Force("led", piecewise_linear([0.0, 0.5, 1.0, 3.0], [0.0, -2.0, 0.0, 2.0])),
        Force("block", 1.0),
        Contact("c", "led", "block", DryFriction(0.5, 0.3), normal=feedback(lambda v: 10.0 * min(0.0, v), v)),
        Contact(
            "d",
            "block",
            "led",
            DryFriction(0.5, 0.2),
            normal=feedback(lambda w: -10.0 * w * w, relative_velocity("d")),
        ),
        Contact("e", "led", GROUND, DryFriction(0.3, 0.3), normal=feedback(lambda v: 10.0 * v * v * (v - 0.2), v)),
    )
    result = simulate(scene, (0.0, 3.0), formulation="multiplier")
    stepped = simulate(scene, (0.0, 3.0), method="RK4", step=2e-4)
    for body in ("led", "block"):
        assert result.velocity(body)[-1] == pytest.approx(stepped.velocity(body)[-1], abs=1e-3)
    assert result.stats["restarts"] < 15


def pulled(load: Signal, normal: Any, contacts: int) -> Scene:
    """Return a body of 1 kg under a load on contacts that together carry 0.5 N at rest and 0.4 N in motion."""
    law = DryFriction(0.5 / contacts, 0.4 / contacts)
    brakes = [Contact(f"c{i}", "b", GROUND, law, normal=normal) for i in range(contacts)]
    return Scene(Body("b", inertia=1.0), Force("b", load), *brakes)


RISING = feedback(lambda x: 1.0 + 0.1 * x, position("b"))


@pytest.mark.parametrize(
    ("scene", "stop", "options", "breaks", "speed"),
    [
        # at the level from the start, while N falls by 1e-6 N/s: v = 0.1 t
        (pulled(signal(lambda t: 0.5), feedback(lambda t: 1.0 - 1e-6 * t, TIME), 2), 1.0, {}, None, 0.1 + 2e-7),
        # the load comes to the level at 1 s, by 1e-3 and by 0.05 N/s
        (pulled(piecewise_linear([0.0, 1.5], [0.499, 0.5005]), RISING, 2), 1.4, {"rtol": 1e-5}, 1.0, None),
        (pulled(piecewise_linear([0.0, 1.001, 3.0], [0.45, 0.50005, 2.0]), RISING, 10), 1.1, {}, 1.0, None),
        # the load bends at the level
        (pulled(piecewise_linear([0, 1000, 1001], [0.499, 0.5, 0.500001]), RISING, 1), 1001.0, {}, 1000.0, None),
        (
            pulled(piecewise_linear([0, 1000, 1001], [0.499, 0.5, 0.500001]), RISING, 1),
            1001.0,
            {"rtol": 1e-5},
            1000.0,
            None,
        ),
    ],
)
def test_functions_of_the_state_do_not_delay_a_breakaway(
    scene: Scene, stop: float, options: dict[str, Any], breaks: float | None, speed: float | None
) -> None:
    """However slowly a load exceeds the level: in motion contacts carry less."""
    result = simulate(scene, (0.0, stop), **options)
    if breaks is not None:
        assert result.events[0].t == pytest.approx(breaks, rel=1e-7)
    if speed is not None:
        assert result.velocity("b")[-1] == pytest.approx(speed, abs=1e-8)
    assert result.stats["restarts"] < 5


@pytest.mark.parametrize("rtol", [1e-4, 1e-5, 1e-6, 1e-7])
@pytest.mark.parametrize("options", [{}, {"method": "Adams"}, {"formulation": "multiplier"}])
def test_functions_give_what_sums_give_where_a_velocity_presses_its_own_contact(
    rtol: float, options: dict[str, Any]
) -> None:
    """The normal force v - x / 2 of a body that starts at rest passes 0 with its velocity. The series is exact."""

    def scene(of: Callable[..., Any]) -> Scene:
        x, v, w = position("b0"), velocity("b0"), velocity("b1")
        return Scene(
            Body("b0", inertia=0.1),
            Body("b1", inertia=1.0, velocity=-1.0, position=0.1),
            Force("b0", piecewise_linear([0.0, 0.3, 0.5, 1.01], [0.0, 1.0, -1.0, 2.0])),
            Force("b1", piecewise_linear([0.0, 0.3, 0.5, 1.01], [0.0, 0.01, 0.0, -0.01])),
            Spring("b0", GROUND, stiffness=1.0),
            Contact("c0", "b0", GROUND, DryFriction(0.3, 0.3), normal=of(lambda v, x: v - 0.5 * x, v, x)),
            Contact("c1", "b1", GROUND, DryFriction(1.0, 0.6), normal=of(lambda w, v: 0.01 * v - w, w, v)),
            Contact("c2", "b0", "b1", DryFriction(0.3, 0.3, dwell=0.1), normal=of(lambda w: 0.001 + 1e-4 * w, w)),
        )

    exact = simulate(scene(lambda function, *of: function(*of)), (0.0, 1.0))
    result = simulate(scene(feedback), (0.0, 1.0), rtol=rtol, **options)
    assert exact.stats["engine"] == "Taylor series"
    assert result.velocity("b0")[-1] == pytest.approx(exact.velocity("b0")[-1], abs=max(rtol, 1e-6))
    assert result.stats["restarts"] < 15


def test_a_contact_that_holds_next_to_nothing_may_be_viscous() -> None:
    """N = 0.003 t from 1 s on, and the friction is 5 N s/m w: w = exp(-5 * 0.003 * 3^2 / 2) after 3 s more."""
    law = DryFriction(1e-10, 1e-10, kinetic=lambda w: 1e-10 + 5.0 * w)
    scene = Scene(
        Body("led", inertia=1.0, velocity=0.3, position=-0.3),
        Body("slides", inertia=1.0, velocity=1.0),
        Contact("c", "slides", GROUND, law, normal=feedback(lambda x: 0.01 * x, position("led"))),
    )
    result = simulate(scene, (0.0, 4.0))
    assert result.velocity("slides")[-1] == pytest.approx(math.exp(-5.0 * 0.003 * 9.0 / 2.0), abs=1e-7)
