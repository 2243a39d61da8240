"""Scenes with many contacts whose normal forces depend on the state: their coefficients are kept as sparse matrices."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    DryFriction,
    Scene,
    StateSpace,
    explain,
    feedback,
    linearize,
    output,
    position,
    saturate,
    simulate,
)

SPEED, NORMAL, MU = 1.0, 5.0, 0.3


def scene(count: int, normal: str) -> Scene:
    """Blocks of 1 kg that slide on while their own places press them."""
    elements: list[object] = []
    for i in range(count):
        x = position(f"m{i}")
        more = {
            "place": x,
            "limited": saturate(x, -9.0, 9.0),
            "function": feedback(lambda x: x, x),
            "block": output(f"block{i}"),
        }[normal]
        if normal == "block":
            elements.append(StateSpace(f"block{i}", [[-1.0]], [[1.0]], [[0.0]], [[1.0]], inputs=[x]))
        elements.append(Body(f"m{i}", inertia=1.0, velocity=SPEED))
        elements.append(Contact(f"c{i}", f"m{i}", GROUND, DryFriction(MU, MU), normal=NORMAL + more))
    return Scene(*elements)


@pytest.mark.parametrize("normal", ["place", "limited", "function", "block"])
@pytest.mark.parametrize("count", [31, 40])
def test_many_blocks_come_to_rest_as_one_does(count: int, normal: str) -> None:
    """``x'' = -mu (N + x)``: with omega^2 = mu, rest is at ``tan(omega t) = v / (omega N)``."""
    omega = math.sqrt(MU)
    rest = math.atan(SPEED / (omega * NORMAL)) / omega
    place = NORMAL * (math.cos(omega * rest) - 1) + SPEED / omega * math.sin(omega * rest)
    own = scene(count, normal)
    result = simulate(own, (0.0, 1.0))
    assert len(result.events) == count
    np.testing.assert_allclose([event.t for event in result.events], rest, rtol=1e-6)
    np.testing.assert_allclose([result.position(f"m{i}")[-1] for i in range(count)], place, rtol=1e-6)
    assert f"{count} bodies" in explain(own)


def test_many_pressed_contacts_are_linearized() -> None:
    """Each block has a pole at 0 and none else that moves it: ``x'' = -mu (N + x)`` while it slides."""
    model = linearize(scene(40, "place"))
    assert model.A.shape[0] == model.A.shape[1]
    assert np.isfinite(model.A).all()
