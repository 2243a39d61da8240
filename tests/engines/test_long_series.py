"""Motions of many steps without an event, by Taylor series: as exact as short ones, and never whole in memory."""

from __future__ import annotations

import math

import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    DryFriction,
    Force,
    Scene,
    SimulationError,
    Spring,
    When,
    simulate,
    sine,
    velocity,
)


def oscillator(stiffness: float = 1.0) -> Scene:
    return Scene(Body("a", inertia=1.0, velocity=1.0), Spring("a", GROUND, stiffness=stiffness))


@pytest.mark.slow
def test_times_of_many_steps_add_up_without_roundoff() -> None:
    result = simulate(oscillator(), (0.0, 20000.0), t_eval=[20000.0], method="series")
    assert result.velocity("a")[-1] == pytest.approx(math.cos(20000.0), abs=1e-12)
    assert result.position("a")[-1] == pytest.approx(math.sin(20000.0), abs=1e-12)


@pytest.mark.parametrize("load", [0.0, sine(0.1, 0.3)])
@pytest.mark.parametrize("dense", [True, False])
def test_a_long_motion_is_handed_over_in_parts(monkeypatch: pytest.MonkeyPatch, load: float, dense: bool) -> None:
    scene = Scene(*oscillator().elements, Force("a", load))
    outputs = [k * math.pi for k in range(60)]
    turns = [When("turn", velocity("a"))]
    whole = simulate(scene, (0.0, 200.0), t_eval=outputs, dense_output=dense, events=turns)
    monkeypatch.setattr("stickslip.engines.series._AT_ONCE", 20)
    parts = simulate(scene, (0.0, 200.0), t_eval=outputs, dense_output=dense, events=turns)
    assert parts.stats["restarts"] > 10 > whole.stats["restarts"]
    assert parts.velocity("a") == pytest.approx(whole.velocity("a"), abs=1e-13)
    assert [e.t for e in parts.events] == pytest.approx([e.t for e in whole.events], abs=1e-12)


def test_an_end_that_is_out_of_reach_is_told_and_what_was_followed_is_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("stickslip.engines.series._AT_ONCE", 100)
    with pytest.raises(
        SimulationError, match=r"last 100 steps took .* the end is out of reach; simulate a shorter time"
    ) as caught:
        simulate(oscillator(1e12), (0.0, 100.0), method="series")
    kept = caught.value.result
    assert 1e-6 < caught.value.t == kept.t[-1]
    assert kept.velocity("a")[-1] == pytest.approx(math.cos(1e6 * kept.t[-1]), abs=1e-9)


@pytest.mark.filterwarnings("error")
def test_a_span_far_longer_than_the_motion_changes_nothing() -> None:
    """A block on a spring comes to rest within seconds; powers of 1e30 s would overflow in its series."""
    elements = *oscillator().elements, Contact("c", "a", GROUND, DryFriction(0.2, 0.1), normal=1.0)
    short, long = (simulate(Scene(*elements), (0.0, end), method="series") for end in (100.0, 1e30))
    assert [e.t for e in long.events] == pytest.approx([e.t for e in short.events], abs=1e-12)
    assert len(short.events) == 5
    assert long.position("a")[-1] == pytest.approx(short.position("a")[-1], abs=1e-12)
