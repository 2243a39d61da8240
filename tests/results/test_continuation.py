"""A run that is cut and goes on from `final_scene` is the run that was not cut."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from stickslip import (
    GROUND,
    TIME,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    LuGre,
    PreSlip,
    Result,
    Sampled,
    Scene,
    Spring,
    When,
    join,
    output,
    piecewise_linear,
    simulate,
)
from validation.continuation import CASES, ONLY_CVODE, SERIES, continued, dwell, on_a_belt

LAW = DryFriction(0.4, 0.25, dwell=0.3)


def belt() -> Scene:
    """Three blocks on a belt that swings, one of them pushed besides."""
    return Scene(*dwell().elements, Force("c", piecewise_linear([0.0, 2.0, 4.0], [0.0, 3.0, -2.0])))


def same_events(one: Result, parts: list[Result], tolerance: float) -> None:
    events = [event for part in parts for event in part.events]
    assert [(e.contact, e.before, e.after) for e in events] == [
        (e.contact, e.before, e.after) for e in one.events
    ]
    np.testing.assert_allclose([e.t for e in events], [e.t for e in one.events], rtol=0, atol=tolerance)


def cut(scene: Scene, times: list[float], **options: Any) -> list[Result]:
    """Simulate from each time to the next, each from where the one before has ended."""
    parts = []
    for start, stop in itertools.pairwise(times):
        parts.append(simulate(scene, (start, stop), **options))
        scene = parts[-1].final_scene()
    return parts


@pytest.fixture(scope="module")
def whole() -> Result:
    return simulate(belt(), (0.0, 6.0))


@pytest.mark.parametrize("number", range(8))
def test_a_cut_run_has_the_same_events(number: int, whole: Result) -> None:
    assert len(whole.events) > 10
    times = [0.0, *np.sort(np.random.default_rng(number).uniform(0.0, 6.0, 4)).tolist(), 6.0]
    parts = cut(belt(), times)
    same_events(whole, parts, 1e-11)
    for body in "abc":
        assert abs(parts[-1].velocity(body)[-1] - whole.velocity(body)[-1]) < 1e-10
        assert abs(parts[-1].position(body)[-1] - whole.position(body)[-1]) < 1e-10


@pytest.mark.parametrize("name", [name for name in CASES if name not in ONLY_CVODE])
def test_a_run_cut_at_many_times_is_the_run(name: str) -> None:
    """Dwell times, blocks, sample clocks, gaps, stops, tables and normal forces go on to roundoff."""
    assert continued(name, SERIES, cuts=6)[0] < 1e-12


@pytest.mark.parametrize(
    "law", [LuGre(LAW, stiffness=1e4, damping=50.0), PreSlip(DryFriction(0.4, 0.25), 1e-3)]
)
def test_bristles_and_slip_states_go_on(law: Any) -> None:
    whole = simulate(on_a_belt(law), (0.0, 3.0), rtol=1e-9)
    parts = cut(on_a_belt(law), [0.0, 0.4, 0.9, 1.7, 3.0], rtol=1e-9)
    same_events(whole, parts, 1e-5)
    assert abs(parts[-1].velocity("a")[-1] - whole.velocity("a")[-1]) < 1e-5


def test_a_slipping_contact_within_its_pre_slip_velocity_keeps_its_memory() -> None:
    """From 1 m/s friction 2.5 N slows a block; at 0.0005 m/s, within the band, it is still on the kinetic level."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Contact("rub", "a", GROUND, PreSlip(DryFriction(0.4, 0.25), 1e-3), normal=10.0),
    )
    first = simulate(scene, (0.0, (1.0 - 5e-4) / 2.5))
    then = first.final_scene()
    assert then.contacts[0].slipping
    assert abs(simulate(then, (0.3998, 0.39981)).force("rub")[0] - 2.5) < 1e-9
    assert abs(simulate(then.replace("rub", slipping=False), (0.3998, 0.39981)).force("rub")[0]) < 2.1


def test_a_final_scene_is_data_like_any_other() -> None:
    scene = simulate(belt(), (0.0, 1.234)).final_scene()
    assert Scene.from_dict(scene.to_dict()) == scene


def test_what_was_not_kept_cannot_go_on() -> None:
    result = simulate(belt(), (0.0, 1.0), t_eval=[0.5], dense_output=False)
    with pytest.raises(ValueError, match="dense_output=True"):
        result.final_scene()


def test_deflection_and_slip_state_are_checked() -> None:
    with pytest.raises(TypeError, match="slipping must be True or False"):
        Contact("rub", "a", GROUND, LAW, normal=1.0, slipping="yes")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="deflection must be finite"):
        Contact("rub", "a", GROUND, LAW, normal=1.0, deflection=float("inf"))


def test_a_scene_that_is_followed_part_by_part_goes_on() -> None:
    law = DryFriction(0.5, 0.3, dwell=0.1)
    scene = Scene(
        *(Body(f"b{k}", inertia=1.0, position=0.01 * k * k) for k in range(20)),
        *(Spring(f"b{k}", f"b{k + 1}", stiffness=5.0) for k in range(19)),
        Drive("belt", velocity=0.1),
        *(Contact(f"c{k}", f"b{k}", "belt", law, normal=1.0) for k in range(20)),
        Spring("b0", GROUND, stiffness=2.0),
    )
    whole = simulate(scene, (0.0, 6.0))
    assert len(whole.events) > 20
    same_events(whole, cut(scene, [0.0, 1.3, 2.7, 6.0]), 1e-10)


@pytest.mark.parametrize("stop", [0.0, 1.0, 1.5, 1.75])
def test_an_event_that_stops_at_a_sample_does_not_take_it_twice(stop: float) -> None:
    """A counter gives 0, 1, 2, ... N for half a second each: v(3) = (0 + 1 + ... + 5) / 2."""

    def scene() -> Scene:
        counter = Sampled(
            "n", period=0.5, states=[0.0], update=lambda t, x, u: x + 1, output=lambda t, x, u: x
        )
        return Scene(Body("a", inertia=1.0), counter, Force("a", output("n")))

    first = simulate(scene(), (0.0, 3.0), events=[When("now", TIME - stop, stop=True)])
    if stop == 0.0:
        # 0 at the start is no crossing
        assert first.t[-1] == 3.0
    else:
        assert first.t[-1] == stop
        first = simulate(first.final_scene(), (stop, 3.0))
    assert first.velocity("a")[-1] == pytest.approx(7.5, abs=1e-13)


@pytest.mark.parametrize(
    "options",
    [{"method": "BDF"}, {"method": "Adams"}, {"formulation": "merged"}, {"formulation": "multiplier"}],
)
def test_a_block_cut_off_as_it_comes_to_rest_does_not_slide_back(options: dict[str, Any]) -> None:
    """Friction alone acts on it: it comes to rest once. The first run ends where a solver has it at some -1e-9 m/s."""
    law = DryFriction(0.5, 0.3, stribeck_velocity=0.5)
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0),
        Contact("rub", "m", GROUND, law, normal=2.0),
        motion="translation",
    )
    (rest,) = simulate(scene, (0.0, 5.0), **options).events
    for later in (0.0, 1e-13, 1e-12, 1e-11, 1e-10, 1e-9, 1e-8):
        parts = cut(scene, [0.0, rest.t + later, 5.0], **options)
        (event,) = join(parts).events
        assert (event.before, event.after) == (1, 0)
        assert event.t == pytest.approx(rest.t, abs=2e-8)
        assert parts[1].velocity("m").min() == parts[1].velocity("m")[-1] == 0.0
