"""A body in free motion is a clock: a table over its position and the same points over time are one scene."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    DryFriction,
    Force,
    PreSlip,
    Scene,
    Spring,
    piecewise_linear,
    position,
    simulate,
    table,
)
from stickslip.model.laws.dry_friction import Law

FOUND = [4, 7, 16, 23, 24, 39, 42, 45]
"""Scenes with which something was once wrong."""


def law(random: np.random.Generator) -> Law:
    static = float(random.uniform(0.2, 0.5))
    coulomb = float(random.uniform(0.1, static))
    kinds: list[tuple[float, Any]] = [
        (0.35, lambda: DryFriction(static, coulomb)),
        (0.55, lambda: DryFriction(static, coulomb, dwell=float(random.uniform(0.05, 0.3)))),
        (
            0.7,
            lambda: DryFriction(static, coulomb, mu_static_backward=0.5 * static, mu_coulomb_backward=0.4 * coulomb),
        ),
        (0.85, lambda: DryFriction(static, coulomb, stribeck_velocity=0.3)),
        (1.0, lambda: PreSlip(DryFriction(static, coulomb), 1e-2)),
    ]
    which = random.random()
    return next(make for part, make in kinds if which < part)()


def scene(seed: int, by_clock: bool) -> Scene:
    """Return up to three bodies whose loads and normal forces are lines between points, many of them 0."""
    random = np.random.default_rng(seed)
    count = int(random.integers(1, 4))
    pace = float(random.choice([1.0, 0.5, 2.0]))

    def load(low: float, high: float) -> Any:
        points = int(random.integers(2, 6))
        times, values = np.cumsum(random.uniform(0.2, 0.8, points)), random.uniform(low, high, points)
        values[[random.random() < 0.4 for _ in range(points)]] = 0.0
        times, values = np.append(0.0, times), np.append(values[0], values)
        if by_clock:
            return table(position("clock"), (pace * times).tolist(), values.tolist())
        return piecewise_linear(times.tolist(), values.tolist())

    elements: list[Any] = [Body("clock", inertia=1.0, velocity=pace)]
    for i in range(count):
        inertia = float(random.uniform(0.5, 2.0))
        elements.append(Body(f"b{i}", inertia=inertia, velocity=float(random.choice([0.0, 1.0, -0.5]))))
    for i in range(count):
        under = GROUND if i == 0 or random.random() < 0.4 else f"b{i - 1}"
        elements.append(Contact(f"c{i}", f"b{i}", under, law(random), normal=load(0.0, 10.0)))
        if random.random() < 0.7:
            elements.append(Force(f"b{i}", load(-4.0, 4.0)))
        if random.random() < 0.4:
            stiffness, damping = float(random.uniform(1.0, 20.0)), float(random.choice([0.0, 0.3]))
            elements.append(Spring(f"b{i}", GROUND, stiffness=stiffness, damping=damping))
    return Scene(*elements)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "Adams"])
@pytest.mark.parametrize("seed", [0, 1, 2, *FOUND])
def test_a_table_over_a_clock_is_one_over_time(seed: int, method: Any) -> None:
    one, other = (
        simulate(scene(seed, by_clock), (0.0, 3.0), method=method, t_eval=np.linspace(0.0, 3.0, 301))
        for by_clock in (True, False)
    )
    is_exact = one.stats["engine"] == other.stats["engine"] == "Taylor series"
    for body in other.scene.bodies:
        np.testing.assert_allclose(
            one.velocity(body.name), other.velocity(body.name), rtol=0, atol=1e-9 if is_exact else 2e-6
        )

    def story(result: Any) -> list[tuple[str, int, int]]:
        return sorted((e.contact, int(e.before), int(e.after)) for e in result.events)

    assert story(one) == story(other)
    times = [sorted(event.t for event in result.events) for result in (one, other)]
    np.testing.assert_allclose(times[0], times[1], rtol=0, atol=1e-5)
