"""Random trees and loops of gears, planetaries, one-way clutches and contacts: what holds for every machine."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    DryFriction,
    Force,
    Gear,
    OneWay,
    Planetary,
    Result,
    Scene,
    Spring,
    Tie,
    simulate,
    sine,
)

SEEDS = range(12)
RATIOS = (1.0, -1.0, 2.0, 0.5, -3.0, 1.25)


def machine(seed: int, loads: bool = True) -> Scene:
    """A tree of ties over half of the bodies, a loop that agrees with it, and contacts and clutches all over."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(4, 8))
    # turns of each body per turn of the first in its group; two groups
    group = np.array([0, 1, *rng.integers(0, 2, n - 2)])
    turn = np.ones(n)
    velocity = rng.uniform(-2, 2, 2).round(3)
    elements: list[Any] = []
    first = [0, 1]
    members: list[list[int]] = [[0], [1]]
    for i in range(2, n):
        own = members[group[i]]
        a, ratio = int(rng.choice(own)), float(rng.choice(RATIOS))
        turn[i] = ratio * turn[a]
        elements.append(Gear(f"gear {i}", f"b{i}", f"b{a}", ratio=ratio))
        own.append(i)
    for g in (0, 1):
        if len(members[g]) > 2:
            # a loop: the same relation once more, through other teeth
            a, b = members[g][-1], first[g]
            elements.append(Tie(f"loop {g}", {f"b{a}": 2.0, f"b{b}": -2.0 * float(turn[a])}))
    speed = np.array([velocity[group[i]] * turn[i] for i in range(n)])
    elements += [
        Body(f"b{i}", inertia=round(float(rng.uniform(0.2, 3)), 3), velocity=float(speed[i])) for i in range(n)
    ]
    # a planetary with a ring of no inertia between the groups: nothing but its contacts loads it
    ratio = 1.5
    ring = (2.5 * speed[1] - speed[0]) / ratio
    elements += [
        Body("ring", inertia=0, velocity=float(ring)),
        Planetary("planets", sun="b0", carrier="b1", ring="ring", ratio=ratio),
    ]
    names = [f"b{i}" for i in range(n)] + ["ring"]
    for k in range(4):
        a, b = rng.choice(len(names), 2, replace=False)
        mu_s, mu_c = sorted(rng.uniform(0.05, 1, 2).round(3))[::-1]
        radii = {"radius_a": float(rng.choice(RATIOS)), "radius_b": float(rng.choice(RATIOS))}
        other = names[b] if k or not loads else GROUND
        elements.append(Contact(f"c{k}", names[a], other, DryFriction(float(mu_s), float(mu_c)), normal=1.5, **radii))
    a, b = (0, 1) if speed[0] <= speed[1] else (1, 0)
    elements.append(OneWay("free", f"b{a}", f"b{b}"))
    if loads:
        elements.append(Force("b0", sine(float(rng.uniform(1, 6)), frequency=0.7)))
        elements.append(Damper("b1", GROUND, damping=0.1, radius_a=0.5))
        elements.append(Spring("b0", "b1", stiffness=2.0, radius_b=-0.5, damping=0.05))
    return Scene(*elements)


def run(scene: Scene, **options: Any) -> Result:
    return simulate(scene, (0, 3), t_eval=np.linspace(0, 3, 61), **options)


@cache
def plain_run(seed: int) -> Result:
    """The run with which others are compared, simulated once."""
    return run(machine(seed))


def residuals(result: Result) -> np.ndarray:
    worst = []
    for tie in (*result.scene.ties, *result.scene.gears, *result.scene.planetaries):
        parts = np.array([c * result.velocity(name) for name, c in tie.coefficients.items()])
        worst.append(np.abs(parts.sum(axis=0)).max() / max(np.abs(parts).max(), 1e-3))
    return np.array(worst)


@pytest.mark.parametrize("seed", SEEDS)
def test_ties_hold_and_energy_is_never_created(seed: int) -> None:
    result = plain_run(seed)
    assert result.success
    assert residuals(result).max() < 4e-15
    ledger = result.energy()
    assert ledger.relative_error < 1e-11
    for heat in ledger.contacts.values():
        assert np.diff(heat).min() > -1e-12
    assert result.relative_velocity("free").max() < 1e-12
    assert result.force("free").min() > -1e-9
    assert np.abs(result.power("free")).max() < 1e-9
    for contact in result.scene.contacts:
        up, down = result.breakaway(contact.name, 1), result.breakaway(contact.name, -1)
        force = result.force(contact.name)
        assert (force <= up + 1e-9).all() and (force >= -down - 1e-9).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_the_equations_of_motion_hold(seed: int) -> None:
    """Momentum of every body: M dv is the impulse of all rows and loads on it, ``-c_i r`` each."""
    scene = machine(seed, loads=False)
    result = simulate(scene, (0, 3), t_eval=np.linspace(0, 3, 6001))
    t = result.t
    # no force from outside: the impulses of all rows explain every change of momentum
    for body in scene.bodies:
        push = np.zeros(t.size)
        for row in scene.rows:
            push -= row.coefficients.get(body.name, 0.0) * result.force(row.name)
        impulse = np.concatenate([[0.0], np.cumsum(0.5 * (push[1:] + push[:-1]) * np.diff(t))])
        momentum = body.inertia * (result.velocity(body.name) - result.velocity(body.name)[0])
        # trapezoids are off by one interval at each jump of a force
        assert np.abs(momentum - impulse).max() < 5e-4 * (1 + len(result.events)) * (1 + np.abs(push).max())


@pytest.mark.parametrize("seed", SEEDS)
def test_order_and_names_do_not_matter(seed: int) -> None:
    plain = plain_run(seed)
    scene = plain.scene
    mixed = list(scene.elements)
    np.random.default_rng(seed).shuffle(mixed)  # type: ignore[arg-type]
    other = run(Scene(*mixed))
    for body in scene.bodies:
        np.testing.assert_allclose(other.velocity(body.name), plain.velocity(body.name), rtol=0, atol=1e-9)
    for row in scene.rows:
        np.testing.assert_array_equal(other.mode(row.name)[1:-1], plain.mode(row.name)[1:-1])
    renamed = Scene.from_dict(_renamed(scene.to_dict()))
    same = run(renamed)
    for body in scene.bodies:
        assert np.array_equal(same.velocity(f"{body.name}!"), plain.velocity(body.name))


def _renamed(data: Any) -> Any:
    """Every body's name gets a mark."""
    bodies = {body["name"] for body in data["bodies"]}

    def mark(value: Any) -> Any:
        if isinstance(value, dict):
            if value.keys() <= bodies:
                return {mark(k): v for k, v in value.items()}
            return {k: mark(v) for k, v in value.items()}
        if isinstance(value, list):
            return [mark(v) for v in value]
        return f"{value}!" if isinstance(value, str) and value in bodies else value

    return mark(data)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("scale", [2.0**-20, 2.0**20])
def test_units_do_not_matter(seed: int, scale: float) -> None:
    """All inertias and forces times a power of 2: the same velocities."""
    plain = plain_run(seed)
    scene = plain.scene
    data = scene.to_dict()
    for body in data["bodies"]:
        body["inertia"] *= scale
    for contact in data["contacts"]:
        contact["normal"] = 1.5 * scale
    for spring in data["springs"]:
        spring["stiffness"] *= scale
        spring["damping"] *= scale
    data["dampers"][0]["damping"] *= scale
    scaled = Scene.from_dict(data)
    scaled = Scene(
        *(e for e in scaled.elements if not isinstance(e, Force)),
        *(Force(f.body, scale * f.signal) for f in scene.forces),
    )
    other = run(scaled)

    def told(result: Result) -> list[tuple[float, str, int]]:
        return sorted((round(e.t, 8), e.contact, int(e.after)) for e in result.events)

    assert told(plain) == told(other)
    for body in scene.bodies:
        np.testing.assert_allclose(other.velocity(body.name), plain.velocity(body.name), rtol=0, atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    "options", [{"method": "BDF"}, {"formulation": "merged", "method": "BDF"}, {"formulation": "multiplier"}]
)
def test_engines_agree(seed: int, options: dict[str, Any]) -> None:
    exact, other = plain_run(seed), run(machine(seed), **options)
    for body in exact.scene.bodies:
        np.testing.assert_allclose(other.velocity(body.name), exact.velocity(body.name), rtol=0, atol=2e-5)
    assert residuals(other).max() < 4e-15
