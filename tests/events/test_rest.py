"""A velocity that has just left 0 with slope 0 has not relaxed to it, though a solver's first points are roundoff."""

from __future__ import annotations

import itertools

import pytest

from stickslip import GROUND, Body, Contact, Drive, DryFriction, Scene, Spring, limit_cycle, simulate

ROUND = list(itertools.product((1e2, 1e3, 1e4), (1e-3, 1e-4), (1.0, 10.0), (1e-3, 1e-4)))


def belt(stiffness: float, v: float, normal: float, stribeck: float, inertia: float = 1.0) -> Scene:
    """A block on a belt with Stribeck's curve: friction does not jump at breakaway; it falls with the speed squared."""
    law = DryFriction(0.5, 0.3, stribeck_velocity=stribeck)
    return Scene(
        Body("m", inertia=inertia),
        Spring("m", GROUND, stiffness=stiffness),
        Drive("belt", velocity=v),
        Contact("c", "m", "belt", law, normal=normal),
    )


@pytest.mark.parametrize(("stiffness", "v", "normal", "stribeck"), ROUND)
def test_a_stribeck_curve_lets_go_once_at_tight_tolerances(
    stiffness: float, v: float, normal: float, stribeck: float
) -> None:
    """The belt drags it along from rest; it lets go as the spring pulls with ``mu_s N``: at ``mu_s N / (k v)``."""
    scene, breakaway = belt(stiffness, v, normal, stribeck), 0.5 * normal / (stiffness * v)
    found = simulate(scene, (0.0, 1.1 * breakaway), rtol=1e-11, atol=1e-13)
    first = next(e for e in found.events if e.cause == "breakaway")
    # until it moves with the belt, the block, and so the stretch of the spring, falls a little behind
    caught = [e.t for e in found.events if e.t < first.t]
    assert len(caught) == 1
    behind = v * caught[0] - found.sample([caught[0]]).position("m")[0]
    assert first.t == pytest.approx(breakaway + behind / v, rel=1e-9)
    modes = [e.after for e in found.events]
    assert all(now != following for now, following in itertools.pairwise(modes))


def test_its_limit_cycle_is_found() -> None:
    cycle = limit_cycle(belt(1e4, 1e-4, 1.0, 1e-4, inertia=1e-3))
    long = simulate(cycle.scene, (0.0, 3.5 * cycle.period), rtol=1e-10, atol=1e-12)
    catches = [e.t for e in long.events if e.cause == "breakaway"]
    assert [b - a for a, b in itertools.pairwise(catches)] == pytest.approx(
        [cycle.period] * (len(catches) - 1), rel=1e-7
    )
    assert len(cycle.sequence) == 2
