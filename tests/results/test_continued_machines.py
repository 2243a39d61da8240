"""A run of gaps, stops, clutches and dwelling contacts that is cut in the middle of a contact is the run not cut."""

from __future__ import annotations

import math

import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Gap,
    Gear,
    Mode,
    OneWay,
    Result,
    Scene,
    Stop,
    piecewise_linear,
    simulate,
    sine,
)
from validation.against_oracles import scene_of
from validation.machine_scenes import FAMILIES


def told(result: Result, after: float) -> list[tuple[str, int, int, float]]:
    """The events after a time, by row: those of different rows may come in any order."""
    events = [(e.contact, int(e.before), int(e.after), e.t) for e in result.events if e.t > after]
    return sorted(events, key=lambda event: (event[0], event[3]))


def check(scene: Scene, cut: float, stop: float, least: int = 1) -> tuple[Result, Result]:
    """Compare the events after a cut with those of the whole run, to 1e-12 of it."""
    whole = simulate(scene, (0.0, stop))
    first = simulate(scene, (0.0, cut))
    rest = simulate(first.final_scene(), (cut, stop))
    wanted, found = told(whole, cut), told(rest, -1.0)
    assert [event[:3] for event in found] == [event[:3] for event in wanted]
    assert len(wanted) >= least
    for have, want in zip(found, wanted, strict=True):
        assert have[3] == pytest.approx(want[3], abs=1e-12 * stop)
    for row in scene.rows:
        assert rest.mode(row.name)[0] == first.mode(row.name)[-1]
        assert rest.force(row.name)[0] == pytest.approx(first.force(row.name)[-1], abs=1e-9)
    return first, rest


BALL = Scene(
    Body("ball", inertia=1.0, position=2.0),
    Gap("walls", "ball", GROUND, lower=-0.5, upper=0.5, stiffness=10.0, damping=1.5),
)


@pytest.mark.parametrize("cut", [0.2, 0.5, 1.0, 1.3, 1.8, 2.2, 3.0, 4.0])
def test_within_a_damped_gap(cut: float) -> None:
    """Cuts in every region of the law: pushing in, in between, clipped to nothing, and in flight."""
    check(BALL, cut, 5.0)


@pytest.mark.parametrize("cut", [0.3, 1.5, 2.6])
def test_at_rest_at_a_stop_with_friction(cut: float) -> None:
    """A slider comes to its stop without rebound, is pressed on, and lifted off once the load beats its friction.

    It reaches x = 1 at 1.1554 s. The load 2 - 2 (t - 1), which falls from 1 s on, passes -0.5 at 2.25 s.
    """
    scene = Scene(
        Body("slider", inertia=1.0),
        Contact("dry", "slider", GROUND, DryFriction(0.5, 0.5), normal=1.0),
        Stop("end", "slider", GROUND, upper=1.0),
        Force("slider", piecewise_linear([1.0, 4.0], [2.0, -4.0])),
    )
    whole = simulate(scene, (0.0, 4.0))
    lift = next(event for event in whole.events if event.contact == "end" and event.before == Mode.FORWARD)
    assert lift.t == pytest.approx(2.25, abs=1e-12)
    first, _ = check(scene, cut, 4.0, least=0 if cut > 2.5 else 1)
    if cut == 1.5:
        assert first.mode("end")[-1] == Mode.FORWARD


@pytest.mark.parametrize("cut", [0.4, 1.0])
def test_a_dwelling_contact_behind_a_gear_remembers_how_long_it_has_rested(cut: float) -> None:
    """Held since 0, its level is 5 - 3 exp(-t / 0.7) at the brake; the gear makes 4 t of the load 2 t on the motor."""
    scene = Scene(
        Body("motor", inertia=0.1),
        Body("drum", inertia=1.0),
        Gear("teeth", "motor", "drum", ratio=2.0),
        Contact("brake", "drum", GROUND, DryFriction(0.5, 0.2, dwell=0.7), normal=10.0),
        Force("motor", piecewise_linear([0.0, 3.0], [0.0, 6.0])),
    )
    _, rest = check(scene, cut, 2.0)
    t = rest.events[0].t
    # a contact that is stuck at the start has dwelt for 0 s there
    assert 4.0 * t == pytest.approx(5.0 - 3.0 * math.exp(-t / 0.7), abs=1e-11)


@pytest.mark.parametrize("cut", [0.1, 0.35, 0.7, 1.2])
def test_a_locked_clutch_and_a_contact_beside_it(cut: float) -> None:
    scene = Scene(
        Body("in", inertia=1.0, velocity=-0.5),
        Body("out", inertia=1.0),
        OneWay("free", "in", "out"),
        Contact("pad", "in", "out", DryFriction(0.5, 0.3, dwell=0.1), normal=3.0),
        Stop("end", "out", GROUND, lower=-0.4, upper=0.4, restitution=0.5),
        Force("in", sine(10.0, frequency=3.0)),
    )
    check(scene, cut, 2.0, least=3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("family", "number", "cut"),
    [("machines", 1, 0.512), ("machines", 9, 1.7), ("stops", 10, 3.3), ("stops", 2, 0.13512985572453703)],
)
def test_scenes_that_differed(family: str, number: int, cut: float) -> None:
    """Once rows slipped after the cut although rigid rows lock them, and a stop at rest was hit once more."""
    data = FAMILIES[family][0](number)
    check(scene_of(data, number), cut, data["t_end"], least=0)


def test_a_cut_at_the_very_event_that_locks_a_clutch() -> None:
    """Roundoff of the velocity at the event does not turn the clutch forward, also where all else is at rest."""
    data = FAMILIES["clutches"][0](4)
    scene = scene_of(data, 4)
    event = simulate(scene, (0.0, 0.1)).events[0]
    rest = simulate(simulate(scene, (0.0, event.t)).final_scene(), (event.t, data["t_end"]))
    assert rest.success
    assert not [e for e in rest.events if e.t > event.t]


@pytest.mark.parametrize("amplitude", [0.01, 0.1])
def test_a_ball_at_rest_on_a_table_near_its_origin(amplitude: float) -> None:
    """Where the table passes 0, the roundoff of their distance is large beside it."""
    scene = Scene(
        Body("ball", inertia=0.1, position=0.1),
        Drive("table", velocity=sine(amplitude, 2.0)),
        Stop("s", "ball", "table", lower=0.0, restitution=0.0),
        Force("ball", -0.981),
    )
    for cut in (3.0, 3.05, 3.5, 3.75, 4.0):
        rest = simulate(simulate(scene, (0.0, cut)).final_scene(), (cut, cut + 1.0))
        assert rest.events == [] and (rest.mode("s") == Mode.BACKWARD).all()


def test_a_stuck_body_keeps_its_rest_where_a_drive_that_rubs_on_it_just_passes_0() -> None:
    """The ground holds 3 N and the drive pulls with 0.8 N; its velocity ``0.5 sin(2.2 pi t)`` is 0 at 3 / 2.2 s."""
    scene = Scene(
        Body("b", inertia=1.0, velocity=0.1),
        Drive("d", velocity=sine(0.5, 1.1)),
        Contact("rub", "b", "d", DryFriction(0.2, 0.2), normal=4.0),
        Contact("hold", "b", GROUND, DryFriction(0.3, 0.3), normal=10.0),
    )
    middle = 3 / 2.2
    first = simulate(scene, (0.0, middle))
    second = simulate(first.final_scene(), (middle, 2.0))
    assert second.velocity("b")[0] == 0.0 and second.mode("hold")[0] == 0
    assert second.force("hold")[0] == pytest.approx(-0.8, abs=1e-12)
    assert [event.contact for event in second.events] == ["rub"]
