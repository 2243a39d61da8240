"""Scenes followed part by part move as they do followed as a whole."""

from dataclasses import replace
from itertools import pairwise
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
    Result,
    Scene,
    Spring,
    piecewise_linear,
    simulate,
)
from stickslip.equations.forest import Forest
from stickslip.equations.system import System
from stickslip.simulation import simulate as module


def both(monkeypatch: pytest.MonkeyPatch, scene: Scene, stop: float, **options: Any) -> tuple[Result, Result]:
    """Return a scene followed part by part and as a whole; fail where they differ by more than roundoff."""
    times = np.linspace(0.0, stop, 101)
    found = []
    for many in (1, 10**9):
        monkeypatch.setattr(module, "_MANY", many)
        found.append(simulate(scene, (0.0, stop), t_eval=times, **options))
    local, whole = found
    scale = np.abs(whole.y).max(axis=1, keepdims=True).max()
    assert [(e.contact, e.before, e.after, e.cause) for e in local.events] == [
        (e.contact, e.before, e.after, e.cause) for e in whole.events
    ]
    np.testing.assert_allclose(
        [e.t for e in local.events], [e.t for e in whole.events], rtol=0, atol=1e-11 * stop
    )
    np.testing.assert_allclose(local.y, whole.y, rtol=0, atol=1e-10 * scale)
    for contact in scene.contacts:
        name = contact.name
        np.testing.assert_array_equal(local.mode(name), whole.mode(name))
        size = np.abs(whole.force(name)).max() + 1e-300
        np.testing.assert_allclose(local.force(name), whole.force(name), rtol=0, atol=1e-9 * size)
        np.testing.assert_allclose(local.breakaway(name), whole.breakaway(name), rtol=1e-12)
    assert local.stats["fewest_states"] == whole.stats["fewest_states"]
    assert local.stats["guards"] == whole.stats["guards"]
    return local, whole


def random_forest(seed: int) -> tuple[Scene, float]:
    """Return bodies joined by contacts in trees, some of them to the ground or a drive, and by springs anyhow."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 12))
    law = [
        DryFriction(float(s), float(c), dwell=float(rng.choice([0.0, 0.0, 0.05, 0.4])))
        for s, c in zip(rng.uniform(0.3, 0.5, 3), rng.uniform(0.1, 0.3, 3), strict=True)
    ]
    # one rubs more in one direction than in the other
    law[1] = replace(
        law[1], mu_static_backward=1.3 * law[1].mu_static, mu_coulomb_backward=0.6 * law[1].mu_coulomb
    )
    elements: list[Any] = [Drive("belt", velocity=float(rng.uniform(-0.5, 0.5)))]
    names = [f"b{i}" for i in range(n)]
    for name in names:
        x, v = rng.normal(size=2)
        elements.append(
            Body(name, inertia=float(rng.uniform(0.5, 3.0)), velocity=float(v), position=float(x))
        )
    roots = 0
    for i, name in enumerate(names):
        other = names[int(rng.integers(0, i))] if i and rng.random() < 0.5 else None
        if other is None:
            if rng.random() < 0.2:
                continue
            other, roots = (GROUND if rng.random() < 0.6 else "belt"), roots + 1
        ends = (name, other) if rng.random() < 0.5 else (other, name)
        elements.append(Contact(f"c{i}", *ends, law[i % 3], normal=float(rng.uniform(1.0, 6.0))))
    if rng.random() < 0.8:
        for k, (a, b) in enumerate(pairwise(names)):
            if rng.random() < 0.8:
                elements.append(
                    Spring(a, b, stiffness=float(rng.uniform(1, 8)), damping=float(rng.choice([0, 0.2])))
                )
            elif rng.random() < 0.5:
                elements.append(Damper(a, b, damping=float(rng.uniform(0.1, 1.0))))
            if k % 3 == 0:
                elements.append(Spring(a, GROUND, stiffness=float(rng.uniform(1, 4))))
    push = piecewise_linear([0.0, 1.0, 2.5, 4.0], [0.0, *rng.normal(scale=4.0, size=3)])
    elements.append(Force(names[0], push))
    return Scene(*elements), 4.0


def apart(scene: Scene) -> bool:
    """Tell whether no body touches ground and drives twice, so that its contacts form no loop."""
    system = System(scene)
    return Forest.why_not(system, system.loads(0.0, 4.0)) is None


SOME = (10, 14)
"""Seeds that are tried always, for they are quick and have trees of several rows."""


@pytest.mark.parametrize(
    "seed", [seed if seed in SOME else pytest.param(seed, marks=pytest.mark.slow) for seed in range(40)]
)
def test_random_forests_move_alike(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, stop = random_forest(seed)
    if apart(scene):
        both(monkeypatch, scene, stop)
