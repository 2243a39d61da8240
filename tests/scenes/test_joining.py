"""Parts of a scene that nothing connects: each moves as it does alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    PreSlip,
    Result,
    Scene,
    SimulationError,
    Spring,
    load,
    piecewise_linear,
    signal,
    simulate,
    step,
)
from stickslip.benchmark import flywheel_benchmark

WHEELS = flywheel_benchmark()
BLOCK = Scene(
    Body("block", inertia=1.0, position=0.1),
    Drive("belt", velocity=0.2),
    Contact("c", "block", "belt", DryFriction(1.0, 0.5), normal=1.0),
    Spring("block", GROUND, stiffness=1.0),
)
BOTH = Scene(*WHEELS.elements, *BLOCK.elements)
SPAN = (0.0, 4.0)
FORMULATIONS: list[dict[str, Any]] = [
    {},
    {"method": "BDF"},
    {"formulation": "merged", "method": "Adams"},
    {"formulation": "multiplier"},
    {"method": "RK4", "step": 1e-3},
]


def exact(options: dict[str, Any]) -> bool:
    """Whether a part beside others moves to the last digits as alone: with Taylor series, and with fixed steps."""
    return not options or "step" in options


def runs(**options: Any) -> tuple[Result, Result, Result]:
    wheels, block, both = (simulate(scene, SPAN, **options) for scene in (WHEELS, BLOCK, BOTH))
    return wheels, block, both


@pytest.mark.parametrize("options", FORMULATIONS)
def test_events_are_those_of_the_parts(options: dict[str, Any]) -> None:
    """To the last digits where the engine is exact or both take the same steps, to the tolerance where it is not."""
    wheels, block, both = runs(**options)
    alone = sorted([*wheels.events, *block.events], key=lambda event: event.t)
    assert [(e.contact, e.before, e.after, e.cause) for e in both.events] == [
        (e.contact, e.before, e.after, e.cause) for e in alone
    ]
    off = max(abs(e.t - a.t) for e, a in zip(both.events, alone, strict=True))
    assert off <= (1e-12 if exact(options) else 1e-6)
    end = [*wheels(4.0)[:2], *block(4.0)]
    assert both(SPAN[1]).tolist() == pytest.approx(end, abs=1e-12 if exact(options) else 1e-6)


@pytest.mark.parametrize("dense", [True, False])
@pytest.mark.parametrize("options", FORMULATIONS[:-1])
def test_outputs_and_what_is_read_by_name(options: dict[str, Any], dense: bool) -> None:
    outputs = np.linspace(*SPAN, 41)
    wheels, block, both = runs(t_eval=outputs, dense_output=dense, **options)
    np.testing.assert_array_equal(both.t, outputs)
    near = 1e-11 if exact(options) else 1e-6
    for part, bodies, contacts in (
        (wheels, ["wheel1", "wheel2"], ["interface", "brake"]),
        (block, ["block", "belt"], ["c"]),
    ):
        for body in bodies:
            np.testing.assert_allclose(both.velocity(body), part.velocity(body), atol=near)
            if dense:
                np.testing.assert_allclose(both.position(body), part.position(body), atol=10 * near)
        for contact in contacts:
            np.testing.assert_array_equal(both.mode(contact), part.mode(contact))
            np.testing.assert_allclose(both.force(contact), part.force(contact), atol=100 * near)
            np.testing.assert_allclose(both.breakaway(contact), part.breakaway(contact), atol=100 * near)


def test_both_limits_of_events_are_kept(tmp_path: Any) -> None:
    _, _, both = runs()
    for event in both.events:
        assert np.count_nonzero(both.t == event.t) == 2
    assert np.all(both.relative_velocity("interface")[both.mode("interface") == 0] == 0)
    assert np.abs(both.energy().error).max() < 1e-7
    both.save(tmp_path / "both.npz")
    np.testing.assert_array_equal(load(tmp_path / "both.npz").force("brake"), both.force("brake"))


def test_a_stiff_part_does_not_spoil_the_others() -> None:
    """Pre-slip at 1e-4 m/s beside the block, whose events are known to 1e-12 alone: right to the tolerance still."""
    stiff = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Contact("floor", "a", GROUND, PreSlip(DryFriction(0.3, 0.2), 1e-4), normal=10.0),
        Spring("a", GROUND, stiffness=10.0),
    )
    block, both = simulate(BLOCK, SPAN), simulate(Scene(*stiff.elements, *BLOCK.elements), SPAN)
    found = [event.t for event in both.events if event.contact == "c"]
    assert found == pytest.approx([event.t for event in block.events], abs=1e-6)


def test_a_part_that_fails_leaves_all_up_to_there() -> None:
    def force(t: float) -> float:
        if t > 2.5:
            raise RuntimeError("no data")
        return 0.1 * t

    broken = Scene(
        Body("broken", inertia=1.0, velocity=1.0),
        Spring("broken", GROUND, stiffness=2.0),
        Force("broken", signal(force)),
    )
    with pytest.raises(SimulationError, match="no data") as caught:
        simulate(Scene(*BOTH.elements, *broken.elements), SPAN)
    result = caught.value.result
    assert 2.0 < caught.value.t <= 2.5
    assert result.t[-1] == caught.value.t
    assert not result.success
    at = result.t[-1]
    # a function has no Taylor series: all of it is CVODE's
    assert result.velocity("wheel1")[-1] == pytest.approx(simulate(WHEELS, SPAN)(at)[0], abs=1e-7)
    assert result.velocity("block")[-1] == pytest.approx(simulate(BLOCK, SPAN)(at)[0], abs=1e-7)
    assert [event.contact for event in result.events].count("interface") == 3


@pytest.mark.parametrize("outputs", [[0.4, 0.5, 0.6], [0.5, 0.6], [0.25, 0.5]])
@pytest.mark.parametrize("formulation", ["contact-force", "merged", "multiplier"])
def test_an_open_contact_at_the_event_of_another_part(formulation: str, outputs: list[float]) -> None:
    """w = -1 + 4 t turns over at 0.25 s; the other part sticks at 0.5 s, where w = 1."""
    law = DryFriction(0.3, 0.2)
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Contact("ca", "a", GROUND, law, normal=10.0),
        Body("b", inertia=1.0, velocity=-1.0),
        Force("b", 4.0),
        Contact("cb", "b", GROUND, law, normal=step(2.0, 0.0, 5.0)),
    )
    for dense in (True, False):
        result = simulate(scene, (0.0, 1.0), t_eval=outputs, dense_output=dense, formulation=formulation)
        assert result.mode("cb").tolist() == [1] * len(outputs), dense
        assert result.mode("ca").tolist() == [0 if t >= 0.5 else 1 for t in outputs]
        assert [(e.contact, int(e.after)) for e in result.events] == [("cb", 1), ("ca", 0)]
        assert [e.t for e in result.events] == pytest.approx([0.25, 0.5], abs=1e-9)
        assert result.velocity("b") == pytest.approx([4.0 * t - 1.0 for t in outputs], abs=1e-9)
        assert result.velocity("a") == pytest.approx([max(1.0 - 2.0 * t, 0.0) for t in outputs], abs=1e-9)


@pytest.mark.parametrize("method", ["series", "BDF"])
def test_bodies_that_stick_together_carry_their_spring_along(method: str) -> None:
    """Two of 1 kg under ``F = 6 t``: the spring between them feels nothing, ``v = 3 t^2 / 2`` and ``x = t^3 / 2``."""
    scene = Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=1.0),
        Contact("c", "a", "b", DryFriction(1.0, 1.0), normal=1e3),
        Spring("a", "b", stiffness=1.0),
        Force("a", piecewise_linear([0.0, 2.0], [0.0, 12.0])),
    )
    result = simulate(scene, (0.0, 1.0), method=method)
    assert result.velocity("a")[-1] == pytest.approx(1.5, abs=1e-7)
    for body in ("a", "b"):
        assert result.position(body)[-1] == pytest.approx(0.5, abs=1e-7)
