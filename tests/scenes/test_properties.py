"""What every motion must obey, on some random scenes of the validation: trees and loops of one to eight bodies."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip import GROUND, Body, Contact, DryFriction, Force, Scene, Spring, piecewise_linear, simulate
from validation.conservation import law_error, momentum_error, move
from validation.random_scenes import CHECKS, STOP, draw


@pytest.mark.slow
@pytest.mark.parametrize("name", CHECKS)
def test_scenes_move_as_laws_and_symmetries_say(name: str) -> None:
    """No row of the validation runs scenes of these numbers by default."""
    measure, *_, bound = CHECKS[name]
    for number in range(1000, 1015):
        assert measure(number) <= bound, f"scene {number}"


@pytest.mark.slow
@pytest.mark.parametrize("number", range(1000, 1016))
def test_events_follow_each_other(number: int) -> None:
    result = simulate(draw(number), (0.0, STOP))
    assert [e.t for e in result.events] == sorted(e.t for e in result.events)
    last: dict[str, int] = {}
    for event in result.events:
        assert event.before != event.after
        assert last.get(event.contact, event.before) == event.before
        last[event.contact] = event.after
    for name, mode in last.items():
        if result.normal(name)[-1] > 0:
            assert result.mode(name)[-1] == mode


@pytest.mark.slow
@pytest.mark.parametrize("number", range(1000, 1016))
def test_reruns_are_bit_identical(number: int) -> None:
    first, second = (simulate(draw(number), (0.0, STOP)) for _ in range(2))
    assert first.t.tobytes() == second.t.tobytes() and first.y.tobytes() == second.y.tobytes()
    assert first.events == second.events and first.stats == second.stats


@pytest.mark.slow
@pytest.mark.parametrize("number", range(1000, 1016))
def test_an_unconnected_scene_changes_nothing(number: int) -> None:
    scene = draw(number)
    other = (
        Body("unconnected", inertia=1.0, velocity=1.0),
        Spring("unconnected", GROUND, stiffness=100.0),
        Contact("beside", "unconnected", GROUND, DryFriction(0.3, 0.2), normal=10.0),
    )
    both = Scene(*scene.elements, *other)
    times = np.linspace(0.0, STOP, 31)
    alone, beside = (simulate(one, (0.0, STOP), t_eval=times) for one in (scene, both))
    others = [e for e in beside.events if e.contact != "beside"]
    assert [(e.contact, e.after) for e in others] == [(e.contact, e.after) for e in alone.events]
    # the series leaves roundoff; where a curve asks for CVODE, all parts share its steps
    exact = alone.stats["engine"] == "Taylor series"
    off = 1e-10 if exact else 1e-5
    np.testing.assert_allclose([e.t for e in others], [e.t for e in alone.events], rtol=0, atol=off * STOP)
    n = len(scene.bodies)
    speed = max(1.0, float(np.abs(alone.y[:n]).max()))
    np.testing.assert_allclose(beside.y[:n], alone.y[:n], rtol=0, atol=10 * off * speed)


@pytest.mark.slow
def test_three_contacts_at_their_levels_whose_forces_on_one_body_point_both_ways() -> None:
    """Limiting the shares of the contacts one after another once ran in a circle."""

    def law(static: float, coulomb: float, **more: float) -> DryFriction:
        return DryFriction(static, coulomb, **more)

    def lines(*points: tuple[float, float]) -> object:
        return piecewise_linear(*zip(*points, strict=True))

    elements = [
        *(
            Body(f"b{k}", inertia=inertia, velocity=velocity)
            for k, (inertia, velocity) in enumerate(
                [(0.634, 1.6169), (1.1505, 1.791), (3.6511, 0), (2.9208, 0), (1.8866, 0.7732), (0.8383, 0)]
            )
        ),
        Contact("c0", "b1", "b0", law(0.0105, 0.0105), normal=18.349),
        Contact(
            "c1",
            "b3",
            "b2",
            law(0.2766, 0.2766, stribeck_velocity=0.5),
            normal=lines((0, 17.9626), (0.3187, 7.5714), (0.3187, 9.4092), (0.6359, 3.0612)),
        ),
        Contact(
            "c2",
            "b4",
            "b1",
            law(
                0.3803,
                0.3803,
                stribeck_velocity=0.5,
                mu_static_backward=0.29015,
                mu_coulomb_backward=0.19015,
            ),
            normal=lines((0.3219, 0), (0.8219, 16.34485), (1.3219, 0)),
        ),
        Contact(
            "c3",
            "b5",
            "b3",
            law(0.211, 0.1941),
            normal=lines((0, 7.5013), (0.0456, 2.3389), (1.1606, 18.9807)),
        ),
        Contact(
            "c4",
            "b0",
            GROUND,
            law(0.3771, 0.0002, mu_static_backward=0.1001, mu_coulomb_backward=0.0001),
            normal=5.7458,
        ),
        Contact("c5", "b1", GROUND, law(0.2396, 0.2019), normal=11.8276),
        Contact("c6", "b3", GROUND, law(0.391, 0.291, stribeck_velocity=0.5), normal=13.015),
        Contact("c7", "b5", GROUND, law(0.1626, 0.1525, dwell=1.0), normal=13.6415),
        Contact(
            "c8",
            "b0",
            "b4",
            law(0.6805, 0.4547, dwell=0.1, mu_static_backward=0.32735, mu_coulomb_backward=0.22735),
            normal=lines((0.5176, 0), (1.0176, 8.5622), (1.5176, 0)),
        ),
        Contact("c9", "b5", "b4", law(0.5127, 0.1691, stribeck_velocity=0.5), normal=18.1478),
        Force("b4", lines((0, -2.1955), (0.3932, -7.1906), (1.959, -1.5225), (1.9831, -7.344))),
    ]
    for order in (1, -1):
        motion = move(Scene(*elements[::order]), (0.0, 2.0), parts=50)
        assert law_error(motion) < 1e-9 and momentum_error(motion) < 1e-8
