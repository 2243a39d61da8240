"""Scenes in equilibrium: forces that cancel but for roundoff move nothing, however long a run is."""

from __future__ import annotations

import math
from typing import Any

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
    Gap,
    Gear,
    Mode,
    Scene,
    Spring,
    simulate,
    step,
)

LONG = 1e4  # span in s: thousands of periods of all springs here


def hung(stiffness: float, rest: float, position: float, damping: float = 0.0) -> Scene:
    """A body whose load is the force of its spring, as computed here."""
    return Scene(
        Body("m", inertia=1.3, position=position),
        Spring("m", GROUND, stiffness=stiffness, rest=rest, damping=damping),
        Force("m", stiffness * (position - rest)),
    )


@pytest.mark.parametrize("seed", range(30))
def test_what_hangs_at_rest_stays_there(seed: int) -> None:
    """The load of a spring is rounded, and so is its force: they differ by 1e-16 of each at most."""
    rng = np.random.default_rng(seed)
    stiffness = round(rng.uniform(1.0, 300.0), int(rng.integers(0, 3)))
    rest, position = (round(x, 1) for x in rng.uniform(-1.0, 1.0, 2))
    result = simulate(hung(stiffness, rest, position, damping=1.5 * (seed % 2)), (0.0, LONG))
    assert result.stats["engine"] == "Taylor series"
    assert np.all(result.velocity("m") == 0.0)
    assert np.all(result.position("m") == position)
    assert result.stats["steps"] == 1


@pytest.mark.parametrize("amplitude", [1e-6, 1e-9, 1e-12])
def test_small_motions_about_an_equilibrium_are_motions(amplitude: float) -> None:
    """x = x0 + a cos(omega t) with omega^2 = 20 / 1.3: roundoff is that of the position 0.3."""
    scene = hung(20.0, 0.4, -0.3)
    moved = Scene(Body("m", inertia=1.3, position=-0.3 + amplitude), *scene.elements[1:])
    t = np.linspace(0.0, 100.0, 501)
    found = simulate(moved, (0.0, 100.0)).sample(t).position("m") + 0.3
    exact = (-0.3 + amplitude + 0.3) * np.cos(np.sqrt(20.0 / 1.3) * t)
    assert np.abs(found - exact).max() < 1e-14


@pytest.mark.parametrize("span", [20.0, 100.0, LONG])
@pytest.mark.parametrize("mu, normal, stiffness", [(0.3, 10.0, 20.0), (0.6, 7.0, 14.0), (0.2, 10.0, 2e5)])
def test_a_block_slides_steadily_on_a_belt(mu: float, normal: float, stiffness: float, span: float) -> None:
    """At x = mu N / k the spring balances the friction of the belt."""
    place = mu * normal / stiffness
    scene = Scene(
        Body("block", inertia=1.0, position=place),
        Drive("belt", velocity=2.0),
        Contact("rub", "block", "belt", DryFriction(mu, mu), normal=normal),
        Spring("block", GROUND, stiffness=stiffness),
    )
    result = simulate(scene, (0.0, span))
    assert np.all(result.velocity("block") == 0.0)
    assert np.all(result.position("block") == place)
    assert not result.events
    assert set(result.mode("rub")) == {Mode.BACKWARD}
    assert result.stats["steps"] == 1


@pytest.mark.parametrize("count", [3, 15, 16, 60])
def test_a_hanging_chain_hangs_still(count: int) -> None:
    """Springs of 1e4 N/m carry all masses below them, ``x_i = sum_j (n - j) g / k``; large scenes have parts.

    The roundoff of places, 1e-16 m to 1e-15 m, moves the masses at 100 rad/s.
    """
    g, k = 9.81, 1e4
    places = [sum((count - j) * g / k for j in range(i + 1)) for i in range(count)]
    scene = Scene(
        *(Body(f"m{i}", inertia=1.0, position=x) for i, x in enumerate(places)),
        *(Spring(f"m{i}", f"m{i - 1}" if i else GROUND, stiffness=k) for i in range(count)),
        *(Force(f"m{i}", g) for i in range(count)),
    )
    result = simulate(scene, (0.0, 1.0))
    assert all(np.abs(result.velocity(f"m{i}")).max() < 1e-12 for i in range(count))


@pytest.mark.parametrize("place, rough", [(0.0, 1e-6), (1e3, 1e-4), (1e6, 0.1)])
@pytest.mark.parametrize("count", [2, 20])
def test_a_small_load_far_from_the_origin_is_not_lost(count: int, place: float, rough: float) -> None:
    """Coupled sleds of 1 kg at rest: a pull of 1e-4 N gives ``v = F t / n`` to all, wherever they are.

    At 1e6 m the forces of a coupling have terms of 1e11 N and roundoff of 1e-5 N, almost the same on both of its ends.
    """
    scene = Scene(
        *(Body(f"m{i}", inertia=1.0, position=place + i) for i in range(count)),
        *(Spring(f"m{i}", f"m{i - 1}", stiffness=1e5, rest=1.0, damping=1e2) for i in range(1, count)),
        Force("m0", 1e-4),
    )
    result = simulate(scene, (0.0, 5.0))
    total = sum(result.velocity(f"m{i}")[-1] for i in range(count))
    assert total == pytest.approx(5e-4, rel=rough)


def train(*more: Any) -> Scene:
    """Two cars and a geared wheel that roll on at 0.1 m/s with slack couplings."""
    return Scene(
        Body("a", inertia=1.0, position=-0.3, velocity=0.1),
        Body("b", inertia=2.3, position=0.37, velocity=0.1),
        Body("wheel", inertia=0.7, velocity=0.05),
        Gear("mesh", "wheel", "b", ratio=0.5),
        Spring("a", "b", stiffness=3e4, rest=-0.67, damping=20.0),
        Damper("a", "b", damping=7.0),
        *more,
    )


@pytest.mark.parametrize("steady", [True, False])
def test_what_rolls_on_rolls_on(steady: bool) -> None:
    """Free cars keep 0.1 m/s; with a drag of 2 N s/m on each, a pull of 0.4 N keeps that velocity.

    The stiff coupling feels the roundoff of positions of 10 m, 1e-15 m: at 200 rad/s this is 2e-13 m/s in each step.
    """
    balance = [Damper("a", GROUND, damping=2.0), Damper("b", GROUND, damping=2.0), Force("a", 0.2), Force("b", 0.2)]
    result = simulate(train(*balance) if steady else train(), (0.0, 100.0))
    for name, speed in (("a", 0.1), ("b", 0.1), ("wheel", 0.05)):
        assert np.abs(result.velocity(name) - speed).max() < 1e-11
    assert result.position("a")[-1] == pytest.approx(9.7, abs=1e-9)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("count", [1, 4, 20])
def test_what_lies_on_an_elastic_floor_lies_still(count: int, seed: int) -> None:
    """At ``x = floor - m g / k`` the gap carries the weight; large scenes have parts."""
    rng = np.random.default_rng(seed)
    g, k, elements = 9.81, 1e4, []
    for i in range(count):
        m, floor = round(rng.uniform(0.3, 3.0), 1), round(rng.uniform(-1.0, 1.0), 1)
        elements += [Body(f"m{i}", inertia=m, position=floor - m * g / k), Force(f"m{i}", -m * g)]
        elements += [Gap(f"floor{i}", f"m{i}", GROUND, lower=floor, stiffness=k)]
    result = simulate(Scene(*elements), (0.0, LONG))
    assert all(np.all(result.velocity(f"m{i}") == 0.0) for i in range(count))
    assert result.stats["steps"] == 1


@pytest.mark.parametrize("place", [0.0, -0.7, 1e3])
@pytest.mark.parametrize("ratio", [0.01, 0.3, 1.0, 5.0])
def test_what_has_come_to_rest_waits_at_no_cost(ratio: float, place: float) -> None:
    """A damped body (30 rad/s) comes to rest at ``x0 - g / omega^2``; after any wait it answers to a load as then.

    Under a step of 1 N it has ``x = (1 - exp(-delta t) (cos wd t + delta / wd sin wd t)) / omega^2``, with a ratio
    below 1.
    """
    omega, g = 30.0, 9.81
    steps = []
    for wait in (1e4, 1e6):
        scene = Scene(
            Body("m", inertia=1.0, position=place),
            Spring("m", GROUND, stiffness=omega**2, damping=2 * ratio * omega, rest=place),
            Force("m", -g),
            Force("m", step(wait)),
        )
        result = simulate(scene, (0.0, wait + 1.0), method="series")
        steps.append(result.stats["steps"])
        before = result.sample([0.4 * wait, wait])
        assert np.all(before.velocity("m") == 0.0)
        np.testing.assert_allclose(before.position("m"), place - g / omega**2, rtol=1e-15, atol=1e-16 * abs(place))
        if ratio < 1:
            t = np.linspace(0.0, 1.0, 50)
            delta, wd = ratio * omega, omega * np.sqrt(1 - ratio**2)
            exact = (1 - np.exp(-delta * t) * (np.cos(wd * t) + delta / wd * np.sin(wd * t))) / omega**2
            found = result.sample(wait + t).position("m") - before.position("m")[-1]
            # times of 1e6 s have roundoff of 1e-10 s
            assert np.abs(found - exact).max() < 1e-10 * wait**0.5 + 1e-15 * abs(place)
    assert abs(steps[0] - steps[1]) < 60
    assert max(steps) < 10_000


@pytest.mark.parametrize("count", [20, 100])
def test_many_bodies_that_have_come_to_rest_wait_at_no_cost(count: int) -> None:
    """Large scenes have parts; all hang at ``x = -g / k`` until a step of 1 N moves one by 1 / k."""
    g, k, wait = 9.81, 900.0, 1e5
    scene = Scene(
        *(Body(f"m{i}", inertia=1.0, position=0.1 * (i % 7)) for i in range(count)),
        *(Spring(f"m{i}", GROUND, stiffness=k, damping=30.0) for i in range(count)),
        *(Force(f"m{i}", -g) for i in range(count)),
        Force("m3", step(wait)),
    )
    result = simulate(scene, (0.0, wait + 10.0))
    assert result.stats["engine"] == "Taylor series"
    assert result.stats["steps"] < 1000
    for i in range(count):
        at = result.sample([0.5 * wait, wait + 10.0]).position(f"m{i}")
        np.testing.assert_allclose(at, [-g / k, (-g + (i == 3)) / k], rtol=1e-13)


@pytest.mark.parametrize("links", [0.0, 2.0])
@pytest.mark.parametrize("count", [15, 40, 100])
def test_many_bodies_that_slip_on_a_belt_wait_at_no_cost(count: int, links: float) -> None:
    """Each comes to ``x = mu N / k`` on its spring; springs between neighbours are slack there."""
    scene = Scene(
        Drive("belt", velocity=10.0),
        *(Body(f"m{i}", inertia=1.0, velocity=math.sin(7.3 * i)) for i in range(count)),
        *(Spring(f"m{i}", GROUND, stiffness=1.0, damping=0.1) for i in range(count)),
        *(Spring(f"m{i}", f"m{i + 1}", stiffness=links, damping=0.1) for i in range(count - 1) if links),
        *(Contact(f"c{i}", f"m{i}", "belt", DryFriction(0.35, 0.2), normal=5.0) for i in range(count)),
    )
    result = simulate(scene, (0.0, 100 * LONG), t_eval=[0.0, 100 * LONG])
    assert result.stats["steps"] < 4000
    for i in range(count):
        assert result.position(f"m{i}")[-1] == pytest.approx(1.0, abs=1e-13)
        assert result.velocity(f"m{i}")[-1] == 0.0


def test_what_comes_to_rest_beside_a_moving_belt_stays_there() -> None:
    """The belt drags with 0.2 * 3 N: in the end both bodies hang still, and the contact slips on."""
    scene = Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=2.0, position=0.4),
        Drive("belt", velocity=5.0),
        Contact("rub", "a", "belt", DryFriction(0.3, 0.2), normal=3.0),
        Spring("a", GROUND, stiffness=100.0, damping=8.0),
        Spring("b", "a", stiffness=50.0, damping=5.0, rest=0.3),
    )
    result = simulate(scene, (0.0, 1e6))
    assert result.position("a")[-1] == pytest.approx(0.6 / 100.0, rel=1e-15)
    assert result.position("b")[-1] == pytest.approx(0.6 / 100.0 + 0.3, rel=1e-15)
    assert result.velocity("a")[-1] == result.velocity("b")[-1] == 0.0
    assert result.mode("rub")[-1] == Mode.BACKWARD
    assert result.stats["steps"] < 2000


def test_what_drifts_slowly_drifts_on() -> None:
    """Only one of two bodies hangs on a spring; 1e-13 m/s takes the free one 1e-8 m in 1e5 s."""
    scene = Scene(
        Body("hung", inertia=1.0, position=1.0),
        Spring("hung", GROUND, stiffness=400.0, damping=20.0),
        Force("hung", 400.0),
        Body("free", inertia=1.0, position=0.0, velocity=1e-13),
        Body("pulled", inertia=1.0, position=0.0, velocity=1e-13),
        Spring("pulled", "free", stiffness=1.0),
    )
    result = simulate(scene, (0.0, 1e5))
    assert result.position("free")[-1] == pytest.approx(1e-8, rel=1e-9)
