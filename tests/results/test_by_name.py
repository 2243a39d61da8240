"""Large results are read name by name: the values are those of a table of all names."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from stickslip import GROUND, Body, Contact, Drive, DryFriction, Scene, Spring, piecewise_linear, simulate, triangle
from stickslip.benchmark import flywheel_chain
from stickslip.results import samples

NAMES = [f"b{i}" for i in range(20)]


def blocks() -> Scene:
    """Blocks on a belt with a dwell, joined by springs, under a normal force that changes."""
    law = DryFriction(0.35, 0.2, dwell=0.2, mu_static_backward=0.3, mu_coulomb_backward=0.15)
    places = 0.5 + 0.5 * np.sin(7.3 * np.arange(len(NAMES)))
    return Scene(
        Drive("belt", velocity=0.3),
        *(Body(s, inertia=1.0, velocity=0.3, position=x) for s, x in zip(NAMES, places.tolist(), strict=True)),
        *(Contact(f"c{s}", s, "belt", law, normal=5.0 + triangle(1.0, 2.0, 3.0, slope=1.0)) for s in NAMES),
        *(Spring(s, GROUND, stiffness=1.0, damping=0.05) for s in NAMES),
        *(Spring(a, b, stiffness=3.0) for a, b in pairwise(NAMES)),
    )


@pytest.mark.parametrize("times", [None, np.linspace(0.0, 5.0, 77)], ids=["fit for a plot", "given"])
def test_reading_one_by_one_is_reading_a_table(monkeypatch: pytest.MonkeyPatch, times: np.ndarray | None) -> None:
    scene = blocks()
    table = simulate(scene, (0.0, 5.0), t_eval=times)
    monkeypatch.setattr(samples, "_WIDE", 0)
    one = simulate(scene, (0.0, 5.0), t_eval=times)
    np.testing.assert_array_equal(one.t, table.t)
    for name in NAMES:
        np.testing.assert_allclose(one.velocity(name), table.velocity(name), rtol=0, atol=1e-15)
        np.testing.assert_allclose(one.position(name), table.position(name), rtol=0, atol=1e-15)
        row = f"c{name}"
        np.testing.assert_array_equal(one.mode(row), table.mode(row))
        for quantity in ("force", "normal", "breakaway", "relative_velocity", "power"):
            found, known = (getattr(result, quantity)(row) for result in (one, table))
            np.testing.assert_allclose(found, known, rtol=1e-12, atol=1e-12, err_msg=quantity)
    assert one.samples.kept is None and "y" not in one.samples.__dict__
    # stuck blocks move with the belt to the bit
    stuck = one.mode("cb3") == 0
    assert stuck.any() and np.all(one.velocity("b3")[stuck] == 0.3)
    np.testing.assert_allclose(one.y, table.y, rtol=0, atol=1e-15)


def test_a_position_that_is_no_state_is_read_for_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the belt kinks the whole scene is settled: there is a second patchwork from there on."""
    scene = Scene(
        *flywheel_chain(30).elements,
        Drive("belt", velocity=piecewise_linear([1.0, 2.0], [0.0, 1.0])),
        Body("led", inertia=1.0),
        Contact("pad", "led", "belt", DryFriction(0.5, 0.3), normal=10.0),
    )
    table = simulate(scene, (0.0, 4.0))
    monkeypatch.setattr(samples, "_WIDE", 0)
    one = simulate(scene, (0.0, 4.0))
    assert one.trajectory.is_patchwork and len(one.trajectory.parts) > 1
    for body in scene.bodies:
        np.testing.assert_allclose(
            one.position(body.name), table.position(body.name), rtol=1e-14, atol=1e-13, err_msg=body.name
        )


def test_times_outside_are_refused_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(samples, "_WIDE", 0)
    result = simulate(blocks(), (0.0, 1.0))
    with pytest.raises(ValueError, match="times must lie in"):
        result.sample([0.5, 1.5])
