"""A scene as constants."""

from __future__ import annotations

import pytest

from stickslip import GROUND, Body, Contact, DryFriction, Scene
from stickslip.simulation.simulate import compiled


def test_free_mobility_of_rows() -> None:
    """A force of 1 N between two bodies moves them apart by 1 / m_a + 1 / m_b; levers count twice."""
    scene = Scene(
        Body("a", inertia=2.0),
        Body("b", inertia=4.0),
        Contact("c", "a", "b", DryFriction(0.1, 0.1), normal=1.0),
        Contact("d", "a", GROUND, DryFriction(0.1, 0.1), normal=1.0, radius_a=3.0),
    )
    assert compiled(scene).free_mobility == pytest.approx([0.75, 4.5])
