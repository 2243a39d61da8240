"""Scenes followed part by part move as they do followed as a whole."""

import math
from collections.abc import Sequence
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Gap,
    Mode,
    Planetary,
    Result,
    Scene,
    Spring,
    Stop,
    When,
    feedback,
    load,
    piecewise_linear,
    position,
    power,
    relative_velocity,
    simulate,
    sine,
    velocity,
)
from stickslip import (
    normal as normal_of,
)
from stickslip.engines.part_by_part import parts
from stickslip.engines.part_by_part.sine_shares import SineShares
from stickslip.equations.forest import Forest
from stickslip.equations.loads.sines import Sines
from stickslip.equations.system import System
from stickslip.results import samples
from stickslip.results.patchwork import Patchwork
from stickslip.results.pieces import Piece
from stickslip.simulation import local as following
from validation import part_by_part as validation
from validation.against_oracles import difference
from validation.machine_scenes import FAMILIES


def both(scene: Scene, stop: float, events: Sequence[When] = ()) -> tuple[Result, Result]:
    """Return a scene followed part by part and as a whole; fail where they differ by more than roundoff."""
    local, whole = validation.both(scene, stop, events=events)
    assert validation.difference_of(local, whole) <= 1
    return local, whole


@pytest.mark.slow
@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("family", validation.FAMILIES)
def test_random_scenes_move_alike(family: str, which: int) -> None:
    """Compare four scenes of each family; the validation compares a hundred."""
    drawn = ((number, validation.draw(family, number)) for number in range(10, 30))
    scenes = ((number, scene) for number, scene in drawn if scene is not None)
    for number, scene in islice(scenes, which, 1 + 3 * which):
        assert validation.FAMILIES[family].difference(scene, number) <= 1


def test_a_sine_that_opens_a_contact_is_followed_as_a_whole() -> None:
    """``N = 5 + a sin(2 pi t)`` opens the contact where a is more than 5."""
    law, found = DryFriction(0.5, 0.3), []
    for amplitude in (4.9, 5.1):
        scene = Scene(
            Body("b", inertia=1.0),
            Contact("c", "b", GROUND, law, normal=sine(amplitude, 1.0, offset=5.0)),
            Force("b", 1.0),
        )
        local, _ = both(scene, 1.5)
        found.append(local.trajectory.is_patchwork)
        assert (local.normal("c").min() == 0) == (amplitude > 5)
    assert found == [True, False]


def test_what_a_shaken_drive_leads_moves_with_it_to_the_bit(tmp_path: Path) -> None:
    """The table moves with v = 0.1 + 0.2 sin(4 t + 1); b slides when 0.8 m/s² are more than its friction holds.

    While it slides its acceleration is mu g; while it sticks, its velocity is the table's.
    """
    turn, phase, mu = 4.0, 1.0, 0.06
    scene = Scene(
        Drive("table", velocity=sine(0.2, turn / (2 * math.pi), phase=phase, offset=0.1)),
        Body("b", inertia=2.0, velocity=0.1 + 0.2 * math.sin(phase)),
        Body("tied", inertia=1.0),
        Contact("c", "b", "table", DryFriction(mu, mu), normal=2.0 * 10.0),
        Contact("rough", "tied", GROUND, DryFriction(0.1, 0.1), normal=10.0),
        Spring("tied", "table", stiffness=3.0),
    )
    local, _ = both(scene, 8.0)
    assert sum(isinstance(part, Patchwork) for part in local.trajectory.parts) > 0
    # it breaks away when 0.2 turn cos(turn t + phase) comes to -mu g
    first = next(event for event in local.events if event.contact == "c")
    assert first.t == pytest.approx((math.acos(-mu * 10.0 / (0.2 * turn)) - phase) / turn, abs=1e-12)
    fine = local.sample(2001)
    table, stuck = fine.velocity("table"), fine.mode("c") == 0
    assert 200 < stuck.sum() < 1800
    assert np.array_equal(fine.velocity("b")[stuck], table[stuck])
    assert np.abs(table - (0.1 + 0.2 * np.sin(turn * fine.t + phase))).max() < 1e-14
    moved = 0.1 * fine.t - 0.05 * (np.cos(turn * fine.t + phase) - math.cos(phase))
    assert np.abs(fine.position("table") - moved).max() < 1e-14
    local.save(tmp_path / "shaken.npz")
    assert np.array_equal(load(tmp_path / "shaken.npz", scene).sample(2001).y, fine.y)


@pytest.mark.parametrize("frequency", [1e-3, 1e-6, 1e-9, 1e-12])
def test_a_drive_that_swings_slowly_pulls_as_exactly_as_any(frequency: float) -> None:
    """The integral of a slow sine is large; the drive's distance is a small difference of two such integrals."""
    scene = Scene(
        Drive("hand", velocity=sine(1.0, frequency, phase=0.7)),
        Body("b", inertia=1.0),
        Contact("c", "b", GROUND, DryFriction(0.3, 0.2), normal=1.0),
        Spring("b", "hand", stiffness=2.0),
    )
    local, _ = both(scene, 10.0)
    assert local.trajectory.is_patchwork and local.energy().relative_error < 1e-14
    # 2 N/m come to 0.3 N where the hand has moved by 0.15 m
    first, turn = local.events[0], 2 * math.pi * frequency
    middle = 0.5 * turn * first.t
    assert first.t * np.sinc(middle / math.pi) * math.sin(0.7 + middle) == pytest.approx(0.15, rel=1e-14)


def test_sines_that_are_there_in_one_time_span_only() -> None:
    """Up to 10 s the normal force is cut off at 0; then ``N = 5 + 3 sin(pi t)``, and friction of 0.3 N stops 1 m/s."""
    normal = piecewise_linear([0.0, 10.0, 10.0, 20.0], [-9.0, -9.0, 5.0, 5.0]) + sine(3.0, 0.5)
    scene = Scene(Body("b", inertia=1.0, velocity=1.0), Contact("c", "b", GROUND, DryFriction(0.5, 0.3), normal=normal))
    with validation.part_by_part():
        assert not simulate(scene, (0.0, 5.0)).events
        result = simulate(scene, (12.0, 14.0))
    assert result.trajectory.is_patchwork and [event.after for event in result.events] == [0]
    rest = result.events[0].t - 12.0
    assert 0.3 * (5.0 * rest + 3.0 / math.pi * (1.0 - math.cos(math.pi * rest))) == pytest.approx(1.0, rel=1e-13)


def part_by_part(scene: Scene, stop: float, **options: Any) -> Result:
    with validation.part_by_part():
        result = simulate(scene, (0.0, stop), **options)
    # only the start was settled as a whole
    assert result.trajectory.is_patchwork and len(result.trajectory.parts) == 1
    return result


@pytest.mark.parametrize("side", [1, -1])
def test_levels_that_fall_let_go(side: int) -> None:
    """``N = 10 - 2 t``: a load of 3 N forward exceeds ``0.5 N`` at 2 s, -4 N exceed ``0.8 N`` backward at 2.5 s."""
    law = DryFriction(0.5, 0.2, mu_static_backward=0.8, mu_coulomb_backward=0.3)
    normal = piecewise_linear([0.0, 4.0], [10.0, 2.0])
    scene = Scene(
        *(Body(name, inertia=1.0) for name in ("one", "other", "idle")),
        *(
            Contact(f"c {name}", *((name, GROUND) if side > 0 else (GROUND, name)), law, normal=normal)
            for name in ("one", "other", "idle")
        ),
        Force("one", 3.0 * side),
        Force("other", -4.0 * side),
    )
    result = part_by_part(scene, 4.0)
    assert [(e.contact, e.after) for e in result.events] == [("c one", 1), ("c other", -1)]
    assert [e.t for e in result.events] == pytest.approx([2.0, 2.5], abs=1e-13)
    assert side * result.velocity("one")[-1] == pytest.approx(6.0 - 0.2 * 8.0, abs=1e-13)
    assert side * result.velocity("other")[-1] == pytest.approx(-(6.0 - 0.3 * 5.25), abs=1e-13)
    assert not result.velocity("idle").any()


@pytest.mark.parametrize("dwell", [0.01, 0.4, 300.0])
@pytest.mark.parametrize("side", [1, -1])
def test_levels_rise_with_the_dwell_while_the_normal_force_falls(side: int, dwell: float) -> None:
    """A block comes to rest, and a pull of 1.3 t N takes it along."""
    law = DryFriction(0.5, 0.2, dwell=dwell)
    if side < 0:
        law = DryFriction(0.9, 0.7, mu_static_backward=0.5, mu_coulomb_backward=0.2, dwell=dwell)
    scene = Scene(
        Body("block", inertia=1.0, velocity=side),
        Contact("c", "block", GROUND, law, normal=piecewise_linear([0.0, 4.0], [10.0, 2.0])),
        Force("block", piecewise_linear([0.0, 4.0], [0.0, side * 5.2])),
    )
    result = part_by_part(scene, 4.0)
    # v = 1 + 0.65 t^2 - 2 t + 0.2 t^2
    rest = (2.0 - math.sqrt(4.0 - 4 * 0.85)) / (2 * 0.85)

    def left(t: float) -> float:
        return (0.5 - 0.3 * math.exp(-(t - rest) / dwell)) * (10.0 - 2.0 * t) - 1.3 * t

    loose = scipy.optimize.brentq(left, rest + 0.1, 4.0, xtol=1e-14)
    assert [e.after for e in result.events] == [0, side]
    assert [e.t for e in result.events] == pytest.approx([rest, loose], abs=1e-12)


@pytest.mark.parametrize("speed", [0.7, 0.8, 0.9, 1.0, 1.1, 1.3])
def test_a_loose_contact_turns_over_once_beside_one_that_rests(speed: float) -> None:
    """``v = sin(2 t) / 2 - speed cos(2 t)`` is 0 at ``(atan(2 speed) + k pi) / 2``; nothing presses any contact."""
    law, pulse = DryFriction(0.5, 0.5), piecewise_linear([5.0, 6.0], [0.0, 1.0])
    scene = Scene(
        Body("rests", inertia=1.0),
        Contact("idle", "rests", GROUND, law, normal=pulse),
        Body("turns", inertia=1.0, velocity=-speed),
        Spring("turns", GROUND, stiffness=4.0),
        Force("turns", 1.0),
        Contact("loose", "turns", GROUND, law, normal=pulse),
    )
    with validation.part_by_part():
        events = simulate(scene, (0.0, 5.0)).events
    turns = [0.5 * (math.atan(2 * speed) + k * math.pi) for k in range(3)]
    assert [(e.contact, e.after) for e in events] == [("loose", 1), ("loose", -1), ("loose", 1)]
    assert [e.t for e in events] == pytest.approx(turns, abs=1e-13)


def chain(in_pairs: bool) -> Scene:
    """Return bodies coupled by springs and dampers: all rub on the ground, or every second on the one before."""
    names = [f"b{i}" for i in range(36)]
    laws = (
        DryFriction(0.5, 0.3, mu_static_backward=0.6, mu_coulomb_backward=0.2),
        DryFriction(0.4, 0.3, dwell=0.2),
    )
    push = piecewise_linear([0.0, 1.0, 2.0], [0.0, 6.0, -6.0])
    return Scene(
        *(Body(name, inertia=1.0 + 0.05 * i, velocity=0.4 * math.sin(i)) for i, name in enumerate(names)),
        Drive("belt", velocity=piecewise_linear([0.0, 2.0], [0.3, -0.2])),
        *(
            Contact(
                f"c{i}",
                name,
                names[i - 1] if in_pairs and i % 2 else "belt" if i % 6 == 4 else GROUND,
                laws[i % 4 == 0],
                normal=piecewise_linear([0.0, 2.0], [2.0, 3.0 - 0.05 * i]),
            )
            for i, name in enumerate(names)
        ),
        *(Spring(a, b, stiffness=3.0, damping=0.5) for a, b in pairwise(names)),
        Spring("b7", "belt", stiffness=2.0, damping=0.3),
        Damper("b20", GROUND, damping=0.4),
        Force("b3", push),
        Force("b30", push),
    )


@pytest.mark.slow
@pytest.mark.parametrize("in_pairs", [False, True])
@pytest.mark.parametrize("many", [4, 10**9])
def test_in_a_long_chain_what_is_far_goes_on(monkeypatch: pytest.MonkeyPatch, in_pairs: bool, many: int) -> None:
    """Patches are smaller than the chain; their matrices are sparse from 4 bodies on, or dense."""
    scene = chain(in_pairs)
    monkeypatch.setattr(parts, "_DENSE_LIMIT", many)
    assert Forest(System(scene), math.inf).hops < 16
    local, _ = both(scene, 2.0)
    assert len(local.events) > 20


def sliders(count: int) -> Scene:
    """Return blocks that friction brings to rest: block i has 1 + i - t m/s, and comes to rest at 1 + i s."""
    law = DryFriction(0.1, 0.1)
    return Scene(
        *(Body(f"b{i}", inertia=1.0, velocity=1.0 + i) for i in range(count)),
        *(Contact(f"c{i}", f"b{i}", GROUND, law, normal=10.0) for i in range(count)),
        Drive("belt", velocity=sine(1.0, 0.05)),
    )


def test_events_of_the_user_are_found_part_by_part() -> None:
    """Block i has ``(1 + i) t - t^2 / 2`` m and ``1 + i - t`` m/s, the belt ``sin(0.1 pi t)`` m/s."""
    events = [
        When("far", position("b3") - 6.0),
        When("slow", velocity("b5") - 2.5, direction=-1),
        When("rises", velocity("b6") - 1.0, direction=1),
        When("rests", relative_velocity("c2")),
        When("product", feedback(lambda v, x: v * x, velocity("b4"), position("b9") - 9.5)),
        When("as the belt", velocity("b0") - velocity("belt")),
    ]
    local, _ = both(sliders(20), 6.0, events=events)
    assert {type(part) for part in local.trajectory.parts} == {Patchwork}
    names = {event.name for event in events}
    found = [(e.contact, e.t, e.after) for e in local.events if e.contact in names]
    belt = scipy.optimize.brentq(lambda t: 1.0 - t - math.sin(0.1 * math.pi * t), 0.0, 1.0, xtol=1e-15)
    told = [("as the belt", belt, -1), ("product", 1.0, 1), ("far", 2.0, 1), ("rests", 3.0, 0)]
    told += [("slow", 3.5, -1), ("product", 5.0, 0)]
    assert found == [(name, pytest.approx(t, abs=1e-13), after) for name, t, after in told]


def test_in_a_long_span_events_near_each_other_stay_events_of_their_own() -> None:
    """Block i, slowed by 1 m/s², comes to rest at (1 + i 1e-7) ms, or breaks away at 1 s + i 1e-10 s, in 1e4 s."""
    law, delays = DryFriction(0.1, 0.1), 1e-10 * np.arange(20)
    bodies = [Body(f"b{i}", inertia=1.0, velocity=1e-3 + float(delay)) for i, delay in enumerate(delays)]
    contacts = [Contact(f"c{i}", f"b{i}", GROUND, law, normal=10.0) for i in range(20)]
    result = part_by_part(Scene(*bodies, *contacts), 1e4)
    assert [(e.contact, e.after) for e in result.events] == [(f"c{i}", 0) for i in range(20)]
    assert [e.t for e in result.events] == pytest.approx(1e-3 + delays, rel=1e-14)

    sides = [(-1) ** i for i in range(20)]
    weak = [Contact(f"c{i}", f"b{i}", GROUND, DryFriction(0.1, 0.05), normal=10.0) for i in range(20)]
    pulls = [
        Force(f"b{i}", piecewise_linear([0.0, 1e4], [-side * delay, side * (1e4 - delay)]))
        for i, (side, delay) in enumerate(zip(sides, delays.tolist(), strict=True))
    ]
    resting = [Body(f"b{i}", inertia=1.0) for i in range(20)]
    result = part_by_part(Scene(*resting, *weak, *pulls), 1e4)
    assert [(e.contact, e.after) for e in result.events] == [(f"c{i}", side) for i, side in enumerate(sides)]
    assert [e.t for e in result.events] == pytest.approx(1.0 + delays, abs=1e-11)


def test_breaks_of_loads_change_only_what_feels_them() -> None:
    """Block i has 4 m/s, is braked by 1 m/s² from 1 + i / 100 s on for 2 s, then pushed by ``s - 1`` m/s² for 1 s.

    Its brake closes and opens with a jump, and its push begins with one and kinks twice.
    """
    law, begins = DryFriction(0.1, 0.1), 1.0 + 0.01 * np.arange(20)
    scene = Scene(
        *(Body(f"b{i}", inertia=1.0, velocity=4.0) for i in range(20)),
        *(
            Contact(f"c{i}", f"b{i}", GROUND, law, normal=piecewise_linear([a, a, a + 2, a + 2], [0, 10, 10, 0]))
            for i, a in enumerate(begins.tolist())
        ),
        *(
            Force(f"b{i}", piecewise_linear([a + 2, a + 2, a + 3, a + 3], [0, -1, 0, 0]))
            for i, a in enumerate(begins.tolist())
        ),
    )
    result = part_by_part(scene, 6.0)
    assert not result.events
    assert set(result.trajectory.starts) == {0.0, *begins, *(begins + 2), *(begins + 3)}
    fine = result.sample(601)
    for i, a in enumerate(begins.tolist()):
        braked, pushed = np.clip(fine.t - a, 0.0, 2.0), np.clip(fine.t - a - 2.0, 0.0, 1.0)
        np.testing.assert_allclose(fine.velocity(f"b{i}"), 4.0 - braked - pushed + 0.5 * pushed**2, rtol=0, atol=1e-13)
        within = (fine.t > a) & (fine.t < a + 2)
        assert np.array_equal(fine.force(f"c{i}"), np.where(within | (fine.t == a), 1.0, 0.0))


@pytest.mark.parametrize("together", [False, True])
def test_what_a_break_of_loads_sets_in_motion_is_settled_by_itself(together: bool) -> None:
    """Of blocks at rest one is pushed beyond its level from 1 s on: ``v = (3 - 1) (t - 1)``; a drive kinks at 2 s.

    Where another one is pushed as far in the same instant, the whole scene is settled.
    """
    law = DryFriction(0.2, 0.1)
    scene = Scene(
        Drive("belt", velocity=piecewise_linear([2.0, 3.0], [0.5, 1.5])),
        *(Body(f"b{i}", inertia=1.0) for i in range(20)),
        *(Contact(f"c{i}", f"b{i}", GROUND, law, normal=10.0) for i in range(20)),
        Body("led", inertia=1.0, velocity=0.5),
        Contact("pad", "led", "belt", law, normal=10.0),
        Force("b7", piecewise_linear([1.0, 1.0], [0.0, 3.0])),
        Force("b8", piecewise_linear([1.5, 1.5], [0.0, 1.9])),
        Force("b3", piecewise_linear([1.0, 1.0], [0.0, 3.0 if together else 1.0])),
    )
    with validation.part_by_part():
        result = simulate(scene, (0.0, 3.0))
    moved = ("c3", "c7") if together else ("c7",)
    assert [(e.contact, e.t, e.after) for e in result.events] == [(name, 1.0, 1) for name in moved]
    assert {e.cause for e in result.events} == {"breakaway with another event"}
    # b8 stays at rest beyond its break; where the belt kinks, a new part of the results begins
    assert len(result.trajectory.parts) == (3 if together else 2)
    assert result.velocity("b7")[-1] == pytest.approx(4.0, abs=1e-13)
    assert result.velocity("led")[-1] == 1.5


def test_belts_that_kink_one_after_the_other_leave_all_others_alone() -> None:
    """Belt i is at rest up to b, gains 2 m/s² for 0.5 s, and keeps its 1 m/s.

    Friction moves what lies on it with 1 m/s² from b on, until both have 1 m/s at ``b + 1``. A spring to the belt
    pulls another body, whose velocity after the kinks is ``w = a / omega (1 - cos omega t)`` summed over them.
    """
    many, law = 20, DryFriction(0.15, 0.1)
    begin = 0.3 + 0.07 * np.arange(many)
    scene = Scene(
        *(
            Drive(f"belt {i}", velocity=piecewise_linear([b, b + 0.5], [0.0, 1.0]))
            for i, b in enumerate(begin.tolist())
        ),
        *(Body(f"b{i}", inertia=1.0) for i in range(many)),
        *(Contact(f"c{i}", f"b{i}", f"belt {i}", law, normal=10.0) for i in range(many)),
        *(Body(f"pulled {i}", inertia=1.0) for i in range(many)),
        *(Spring(f"pulled {i}", f"belt {i}", stiffness=9.0) for i in range(many)),
    )
    local, _ = both(scene, 2.9)
    slips = {e.contact: (e.t, e.after) for e in local.events if e.after}
    sticks = {e.contact: e.t for e in local.events if not e.after}
    for i, b in enumerate(begin.tolist()):
        assert slips[f"c{i}"] == (b, -1)
        assert sticks[f"c{i}"] == pytest.approx(b + 1.0, abs=1e-13)
        v = sum(
            sign * 2.0 * np.where(local.t > at, (local.t - at) - np.sin(3.0 * (local.t - at)) / 3.0, 0.0)
            for at, sign in ((b, 1), (b + 0.5, -1))
        )
        np.testing.assert_allclose(local.velocity(f"pulled {i}"), v, atol=1e-12)
    assert all(isinstance(part, Patchwork) for part in local.trajectory.parts)


def beside(*elements: Any) -> Scene:
    """Return a scene with 16 sliding blocks beside some elements."""
    law, names = DryFriction(0.3, 0.2), [f"beside {i}" for i in range(16)]
    return Scene(
        *(Body(name, inertia=1.0, velocity=1.0) for name in names),
        *(Contact(f"floor of {name}", name, GROUND, law, normal=1.0) for name in names),
        *elements,
    )


def test_a_planetary_between_two_drives_follows_the_kinks_of_each() -> None:
    """With ratio 2 the carrier has ``(sun + 2 ring) / 3``."""
    for kinks in ("sun", "ring"):
        moves = {name: piecewise_linear([1.0, 2.0], [1.0, 3.0]) if name == kinks else 1.0 for name in ("sun", "ring")}
        scene = beside(
            *(Drive(name, velocity=v) for name, v in moves.items()),
            Body("carrier", inertia=1.0, velocity=1.0),
            Planetary("gear", sun="sun", carrier="carrier", ring="ring", ratio=2.0),
        )
        local, _ = both(scene, 4.0)
        last = {"sun": 1.0, "ring": 1.0} | {kinks: 3.0}
        assert local.velocity("carrier")[-1] == pytest.approx((last["sun"] + 2 * last["ring"]) / 3, rel=1e-15)


def test_a_belt_that_begins_to_move_is_torn_from_what_a_guide_holds() -> None:
    """The guide holds 3 N, the belt 0.3 N: from 1 s on the belt slides below the body with 0.2 N."""
    scene = beside(
        Drive("belt", velocity=piecewise_linear([1.0, 2.0], [0.0, 1.0])),
        Body("held", inertia=1.0),
        Contact("guide", "held", GROUND, DryFriction(0.3, 0.2), normal=10.0),
        Contact("on belt", "held", "belt", DryFriction(0.3, 0.2), normal=1.0),
    )
    local, _ = both(scene, 4.0)
    assert [(e.t, e.after) for e in local.events if e.contact == "on belt"] == [(1.0, -1)]
    assert local.force("on belt")[-1] == pytest.approx(-0.2, rel=1e-14)


def test_a_light_body_at_rest_does_not_make_the_steps_of_all_short() -> None:
    """A body of 1e-7 kg is held: ``x'' = -1000 x`` for its neighbour on a spring of 1000 N/m.

    If it moved, it would have 1e5 rad/s, and 3 s would take a hundred thousand steps.
    """
    scene = beside(
        Body("heavy", inertia=1.0, position=1.0),
        Body("light", inertia=1e-7),
        Contact("clamp", "light", GROUND, DryFriction(0.3, 0.2), normal=1e4),
        Spring("heavy", "light", stiffness=1000.0),
    )
    result = simulate(scene, (0.0, 3.0))
    np.testing.assert_allclose(result.position("heavy"), np.cos(math.sqrt(1000.0) * result.t), atol=1e-11)
    assert result.stats["steps"] < 3000


@pytest.mark.parametrize("late", [0.0, 1e-15, -1e-15, -1e-14])
def test_what_comes_to_rest_at_a_break_of_its_load_stays_at_rest(late: float) -> None:
    """Block i has ``(i + 1) / 10`` m/s and comes to rest after as many s, at which 1.5 N begin to push: 2 N hold it.

    Those that a break finds at rest but for roundoff are at rest; 1.5 N would move on what slides, against 1 N.
    """
    law, speeds = DryFriction(0.2, 0.1), 0.1 * np.arange(1, 21)
    scene = Scene(
        *(Body(f"b{i}", inertia=1.0, velocity=v) for i, v in enumerate(speeds.tolist())),
        *(Contact(f"c{i}", f"b{i}", GROUND, law, normal=10.0) for i in range(20)),
        *(Force(f"b{i}", piecewise_linear([v + late, v + late], [0.0, 1.5])) for i, v in enumerate(speeds.tolist())),
    )
    result = simulate(scene, (0.0, 5.0))
    assert [(e.contact, e.after) for e in result.events] == [(f"c{i}", 0) for i in range(20)]
    assert [e.t for e in result.events] == pytest.approx(speeds, rel=1e-13)
    assert not result.y[:20, -1].any()


@pytest.mark.parametrize("part", np.linspace(0.4, 1.9, 4).tolist())
@pytest.mark.parametrize("pace, start", [(1.0, 1e5), (1.0, 1e6), (1.0, 1e7), (1e-3, 1e3)])
def test_what_comes_to_rest_in_one_instant_late_in_a_run_does_so_once(pace: float, start: float, part: float) -> None:
    """Block b slides on a, and a on the ground, eight times mirrored: all come to rest after ``T = part pace`` s.

    ``m_b v_b / T`` brakes b, and that on top of ``m_a v_a / T`` brakes a. The time is rounded to 1e-16 of itself, so
    velocities at that time are by far more than roundoff.
    """
    law, time, begin = DryFriction(0.15, 0.1), part * pace, start * (0.5 + part / 4)
    slow, fast = 0.9 * pace, 1.7 * pace
    on_top = 1.3 * fast / time
    elements = list[Any]()
    for i in range(16):
        side = (-1) ** i
        elements += [
            Body(f"a{i}", inertia=0.8, velocity=side * slow),
            Body(f"b{i}", inertia=1.3, velocity=side * fast),
            Contact(f"ground{i}", f"a{i}", GROUND, law, normal=10 * (0.8 * slow / time + on_top)),
            Contact(f"top{i}", f"b{i}", f"a{i}", law, normal=10 * on_top),
        ]
    result = simulate(Scene(*elements), (begin, begin + 3 * pace))
    assert len(result.events) == 32
    assert all(e.after == 0 and abs(e.t - begin - time) <= 2e-15 * begin for e in result.events)


@pytest.mark.parametrize("gap", [4e-7, 1e-6, 3e-6])
def test_gaps_that_close_soon_after_each_other_in_a_long_run_close_one_by_one(gap: float) -> None:
    """Ball i reaches its wall at ``1 + i gap`` s, and leaves it after ``pi / 2`` s; a load has jumped before."""
    times = 1.0 + gap * np.arange(20)
    scene = Scene(
        *(Body(f"b{i}", inertia=1.0, velocity=1.0) for i in range(20)),
        *(Gap(f"g{i}", f"b{i}", GROUND, upper=t, stiffness=4.0) for i, t in enumerate(times.tolist())),
        Body("block", inertia=1.0, velocity=1e-3),
        Contact("floor", "block", GROUND, DryFriction(0.1, 0.1), normal=1.0),
        Force("block", piecewise_linear([0.1, 0.1], [0.0, 0.05])),
    )
    result = part_by_part(scene, 1e6)
    touches = [e for e in result.events if e.cause == "touches"]
    assert [e.contact for e in touches] == [f"g{i}" for i in range(20)]
    assert [e.t for e in touches] == pytest.approx(times, rel=1e-14)
    leaves = [e.t for e in result.events if e.cause == "leaves"]
    assert leaves == pytest.approx(times + math.pi / 2, rel=1e-13)


def test_free_bodies_without_any_row_have_an_energy() -> None:
    """Body i is pushed from ``1 + i / 10`` s on: ``v = t - 1 - i / 10``."""
    scene = Scene(
        *(Body(f"b{i}", inertia=2.0) for i in range(20)),
        *(Force(f"b{i}", piecewise_linear([1 + 0.1 * i, 1 + 0.1 * i], [0.0, 2.0])) for i in range(20)),
    )
    result = part_by_part(scene, 5.0)
    ledger = result.energy()
    assert ledger.kinetic[-1] == pytest.approx(sum((4 - 0.1 * i) ** 2 for i in range(20)), rel=1e-14)
    assert ledger.relative_error < 1e-14


def test_what_comes_to_rest_in_one_instant_is_settled_together() -> None:
    """All blocks have 1 m/s and are slowed by 1 m/s²: at 1 s the whole scene is settled, not block after block."""
    law = DryFriction(0.1, 0.1)
    bodies = [Body(f"b{i}", inertia=1.0 + i, velocity=1.0) for i in range(20)]
    contacts = [Contact(f"c{i}", f"b{i}", GROUND, law, normal=10.0 * (1.0 + i)) for i in range(20)]
    with validation.part_by_part():
        result = simulate(Scene(*bodies, *contacts), (0.0, 1e4))
    assert len(result.trajectory.parts) == 2
    assert len({e.t for e in result.events}) == 1
    assert [e.contact for e in result.events] == [f"c{i}" for i in range(20)]


def test_an_event_of_the_user_stops_a_run_part_by_part() -> None:
    """Block 7 has 8 - t m/s: at 4.53 s it has 3.47; the blocks that come to rest later have not done so."""
    events = [When("stop", velocity("b7") - 3.47, stop=True), When("later", velocity("b7") - 3.0)]
    local, whole = both(sliders(20), 6.0, events=events)
    assert {type(part) for part in local.trajectory.parts} == {Patchwork}
    assert [(e.contact, e.t) for e in local.events] == [
        *((f"c{i}", pytest.approx(1.0 + i)) for i in range(4)),
        ("stop", pytest.approx(4.53, abs=1e-14)),
    ]
    assert local.status == whole.status == 1 and "'stop' stopped" in local.message
    later = simulate(local.final_scene(), (0.0, 1.0))
    assert [(e.contact, e.t) for e in later.events] == [("c4", pytest.approx(0.47, abs=1e-13))]


def test_power_is_watched_as_a_whole() -> None:
    """A power needs the modes of the whole scene. Block 2 slides at 3 - t m/s against 1 N: its power is 1 W at 2 s."""
    events = [When("power", power("c2") - 1.0)]
    local, _ = both(sliders(20), 2.5, events=events)
    assert {type(part) for part in local.trajectory.parts} == {Piece}
    (found,) = [e for e in local.events if e.contact == "power"]
    assert found.t == pytest.approx(2.0, abs=1e-13)


@pytest.mark.parametrize("smooth", [False, True])
def test_what_begins_at_its_level_is_followed_part_by_part_if_it_leaves_with_a_slope(smooth: bool) -> None:
    """A load of 5 N at a level of 5 N falls and then rises.

    A body that leaves rest as t^2 is followed as a whole up to the first break: both kinds are read as one motion.
    """
    law = DryFriction(0.5, 0.2, dwell=0.1)
    scene = Scene(
        Body("held", inertia=1.0),
        Body("block", inertia=2.0, velocity=3.0),
        Drive("belt", velocity=piecewise_linear([0.0, 3.0], [0.0, 1.5])),
        Contact("at its level", "held", GROUND, DryFriction(0.5, 0.2), normal=10.0),
        Contact("c", "block", "belt", law, normal=10.0),
        Force("held", piecewise_linear([0.0, 1.0, 2.5], [5.0, 4.0, 7.0])),
        Body("third", inertia=1.0),
        *([Contact("smooth", "third", GROUND, DryFriction(0.5, 0.5), normal=10.0)] if smooth else []),
        *([Force("third", piecewise_linear([0.0, 1.0], [5.0, 7.0]))] if smooth else []),
    )
    local, whole = both(scene, 3.0)
    assert {type(part) for part in local.trajectory.parts} == ({Piece, Patchwork} if smooth else {Patchwork})
    np.testing.assert_allclose(
        local.velocity("third"), smooth * np.where(local.t < 1, local.t**2, 2 * local.t - 1), atol=1e-13
    )
    # 4 + 2 (t - 1) are 5 N again at 1.5 s; the block has 3 - t, and the belt t / 2
    assert [(e.contact, e.after) for e in local.events] == [("at its level", 1), ("c", 0)]
    assert [e.t for e in local.events] == pytest.approx([1.5, 2.0], abs=1e-13)
    for read in ("relative_velocity", "normal", "power"):
        for name in ("c", "at its level"):
            np.testing.assert_allclose(getattr(local, read)(name), getattr(whole, read)(name), atol=1e-12)
    np.testing.assert_allclose(local.position("block"), whole.position("block"), atol=1e-12)
    assert local.energy().relative_error < 1e-14


def buffers(damping: float) -> Scene:
    """Return 40 wagons, every second of them rolling on; couplings have 0.05 m of play, buffers 0.04 m."""
    names, law = [f"w{i}" for i in range(40)], DryFriction(0.02, 0.01)
    return Scene(
        *(Body(name, inertia=1.0, position=1.0 * i, velocity=0.3 * (i % 2)) for i, name in enumerate(names)),
        *(Contact(f"rail {name}", name, GROUND, law, normal=10.0 + 0.1 * i) for i, name in enumerate(names)),
        *(
            Gap(f"g{i}", b, a, lower=0.96, upper=1.05, stiffness=200.0, damping=damping)
            for i, (a, b) in enumerate(pairwise(names))
        ),
    )


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.2, 3.0])
def test_wagons_with_buffers(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, damping: float) -> None:
    """Each quantity by name is that of the scene followed as a whole, also where names are read one by one."""
    local, whole = both(buffers(damping), 1.0)
    assert local.trajectory.is_patchwork and len(local.events) > 60
    assert local.energy().relative_error < 1e-12
    local.save(tmp_path / "wagons.npz")
    again = load(tmp_path / "wagons.npz", local.scene).sample(501)
    monkeypatch.setattr(samples, "_WIDE", 0)
    by_name, table = local.sample(501), whole.sample(501)
    for name in ("g0", "g7", "g38", "rail w7"):
        for read in ("force", "stretch", "relative_velocity", "power"):
            own, all_of_them = getattr(by_name, read)(name), getattr(table, read)(name)
            np.testing.assert_allclose(own, all_of_them, rtol=0, atol=1e-10 * np.abs(all_of_them).max())
        np.testing.assert_array_equal(by_name.mode(name), table.mode(name))
        np.testing.assert_array_equal(again.mode(name), table.mode(name))
    assert {event.after for event in local.events} == set(Mode)


def test_a_body_between_two_elastic_walls() -> None:
    """A wall pushes the ball for half a period ``pi / omega``, and it flies 0.4 m; the other body touches nothing."""
    scene = Scene(
        Body("ball", inertia=2.0, velocity=0.5),
        Body("idle", inertia=1.0),
        Gap("walls", "ball", GROUND, lower=-0.2, upper=0.2, stiffness=50.0),
        Gap("far", "idle", "ball", lower=-9.0, stiffness=50.0),
    )
    result = part_by_part(scene, 5.0)
    push, flight = math.pi / 5.0, 0.4 / 0.5
    times = [0.4 + k // 2 * (push + flight) + k % 2 * push for k in range(7)]
    assert [event.t for event in result.events] == pytest.approx(times, abs=1e-13)
    assert [event.cause for event in result.events] == ["touches", "leaves"] * 3 + ["touches"]
    # v / omega = 0.1 m deep at most
    fine = result.sample(2001)
    assert fine.position("ball").max() == pytest.approx(0.3, abs=1e-6)
    assert (
        np.abs(fine.force("walls") - 50.0 * (fine.position("ball") - np.clip(fine.position("ball"), -0.2, 0.2))).max()
        < 1e-12
    )
    assert not fine.force("far").any() and result.energy().relative_error < 1e-14


def test_a_ball_that_bounces_at_0() -> None:
    """Position and limit are both 0 and give no scale for roundoff; the ball comes down as fast as it left."""
    scene = Scene(
        Body("ball", inertia=1.0, velocity=1.0),
        Gap("floor", "ball", GROUND, lower=0.0, stiffness=1e4),
        Force("ball", -10.0),
    )
    result = part_by_part(scene, 3.0)
    # x'' = -10 - 1e4 x from v = -1: back at 0 after the angle pi + 2 arctan(10 / 100)
    flight, push = 0.2, (math.pi + 2 * math.atan(0.1)) / 100.0
    times = [(k + 1) // 2 * flight + k // 2 * push for k in range(1, 10)]
    assert [event.t for event in result.events][:9] == pytest.approx(times, abs=1e-12)


def test_a_wall_that_moves_throws_a_body() -> None:
    """A wall at u = 0.2 m/s meets a body at rest after 0.05 m, pushes it for half a period; the body leaves at 2 u."""
    speed, stiffness = 0.2, 50.0
    scene = Scene(
        Drive("wall", velocity=speed),
        Body("ball", inertia=2.0),
        Gap("face", "ball", "wall", lower=-0.05, stiffness=stiffness),
    )
    result = part_by_part(scene, 3.0)
    assert result.trajectory.is_patchwork
    omega, meets = math.sqrt(stiffness / 2.0), 0.05 / speed
    assert [event.t for event in result.events] == pytest.approx([meets, meets + math.pi / omega], abs=1e-13)
    pushed = np.clip(result.t - meets, 0.0, math.pi / omega)
    assert result.velocity("ball") == pytest.approx(speed * (1.0 - np.cos(omega * pushed)), abs=1e-13)
    assert result.force("face") == pytest.approx(-stiffness * speed / omega * np.sin(omega * pushed), abs=1e-12)


@pytest.mark.parametrize(
    "wall",
    [
        piecewise_linear([0.0, 1.0, 3.0, 4.0], [0.0, 0.4, -0.2, -0.2]),
        sine(0.3, 0.6),
        sine(0.3, 0.6) + piecewise_linear([0.0, 1.0, 3.0, 4.0], [0.0, 0.4, -0.2, -0.2]),
    ],
    ids=["lines", "a sine", "both"],
)
def test_bodies_between_walls_that_are_shaken(wall: Any) -> None:
    """The walls push and drag through gaps, on the first body from both sides, on the second by a lever."""
    law = DryFriction(0.2, 0.1)
    scene = Scene(
        Drive("wall", velocity=wall, position=0.1),
        Body("first", inertia=1.0),
        Body("second", inertia=2.0, velocity=0.1),
        Contact("c1", "first", GROUND, law, normal=2.0),
        Contact("c2", "second", GROUND, law, normal=1.0),
        Gap("faces", "wall", "first", lower=-0.05, upper=0.15, stiffness=40.0, damping=0.5),
        Gap("between", "first", "second", lower=-0.1, upper=0.1, stiffness=30.0),
        Gap("lever", "second", "wall", lower=-0.1, upper=0.05, stiffness=20.0, damping=0.2, radius_b=0.5),
        Spring("second", GROUND, stiffness=3.0),
    )
    local, whole = both(scene, 4.0)
    assert local.trajectory.is_patchwork and len(local.events) > 10
    assert local.energy().relative_error < 1e-13
    for gap in ("faces", "lever"):
        np.testing.assert_allclose(local.force(gap), whole.force(gap), rtol=0, atol=1e-10)
        assert {event.after for event in local.events if event.contact == gap} > {Mode.OPEN}


@pytest.mark.parametrize("static", [0.5, 0.3])
def test_an_open_contact_of_a_block_that_breaks_away(static: float) -> None:
    """Its mode shows the block's direction: at once with a static coefficient of 0.5, a step later with 0.3.

    The block of 1 kg is pulled by t N, presses with 10 N, and breaks away at 10 times the coefficient.
    """
    law = DryFriction(static, 0.3)
    scene = Scene(
        Body("b", inertia=1.0),
        Contact("holds", "b", GROUND, law, normal=10.0),
        Contact("open", "b", GROUND, law, normal=-1.0),
        Force("b", piecewise_linear([0.0, 9.0], [0.0, 9.0])),
    )
    local, whole = both(scene, 6.0)
    away = 10.0 * static
    assert next((event.contact, event.t) for event in local.events) == (
        "holds",
        pytest.approx(away, abs=1e-13),
    )
    assert local.mode("open")[local.t > away + 1e-3].tolist() == whole.mode("open")[whole.t > away + 1e-3].tolist()
    assert local.velocity("b")[-1] == pytest.approx(0.5 * (6.0**2 - away**2) - 3.0 * (6.0 - away), abs=1e-12)


@pytest.mark.slow
def test_patches_that_are_not_kept_are_left_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without dense output the values at the asked times are those of a run that keeps all."""
    times = np.linspace(0.0, 1.0, 37)
    with validation.part_by_part():
        kept = simulate(buffers(0.2), (0.0, 1.0), t_eval=times)
        monkeypatch.setattr(following, "_FLUSH", 2)
        left = simulate(buffers(0.2), (0.0, 1.0), t_eval=times, dense_output=False)
    assert [str(event) for event in left.events] == [str(event) for event in kept.events]
    np.testing.assert_allclose(left.y, kept.y, rtol=0, atol=1e-14)
    np.testing.assert_allclose(left.force("rail w7"), kept.force("rail w7"), rtol=0, atol=1e-12)


@pytest.mark.slow
def test_wagons_that_touch_at_rest_start_one_by_one() -> None:
    """All buffers begin at their limit, but none leaves it then; beyond the end of the ramp all go on as they were."""
    names, law = [f"w{i}" for i in range(20)], DryFriction(0.02, 0.01)
    scene = Scene(
        *(Body(name, inertia=1.0, position=-1.0 * i) for i, name in enumerate(names)),
        *(Contact(f"rail {name}", name, GROUND, law, normal=10.0) for name in names),
        *(
            Gap(f"g{i}", a, b, lower=1.0, upper=1.02, stiffness=200.0, damping=1.0)
            for i, (a, b) in enumerate(pairwise(names))
        ),
        Force("w0", piecewise_linear([0.0, 1.0, 4.0], [0.0, 4.0, 4.0])),
    )
    local, _ = both(scene, 4.0)
    assert [type(part) for part in local.trajectory.parts] == [Patchwork]
    # a break begins a piece, as an event does
    assert 1.0 in local.trajectory.starts
    assert local.mode("g0")[-1] == Mode.FORWARD


@pytest.mark.parametrize("stiffness", [1e7, 1e9])
def test_stiff_gaps_cost_nothing_while_they_are_open(stiffness: float) -> None:
    """Each of 20 balls passes its velocity on to the next one, 10 mm away: a touch lasts ``T = pi sqrt(m / (2 k))``.

    Meanwhile the next ball moves ``v T / 2``.
    """
    scene = Scene(
        *(Body(f"b{i}", inertia=1.0, velocity=float(i == 0)) for i in range(20)),
        *(Gap(f"g{i}", f"b{i}", f"b{i + 1}", upper=0.01, stiffness=stiffness) for i in range(19)),
    )
    result = part_by_part(scene, 4.0)
    assert len(result.events) == 38 and result.stats["steps"] < 150
    assert result.velocity("b19")[-1] == pytest.approx(1.0, abs=1e-11)
    touch = math.pi * math.sqrt(0.5 / stiffness)
    assert result.events[-1].t == pytest.approx(19 * 0.01 + 10 * touch, abs=1e-12)


def test_what_keeps_a_scene_with_gaps_from_being_followed_part_by_part() -> None:
    law = DryFriction(0.2, 0.1)
    body, drive = Body("b", inertia=1.0), Drive("d", velocity=1.0)
    rail = Contact("c", "b", GROUND, law, normal=1.0)

    def why_not(*more: Any) -> str | None:
        system = System(Scene(body, drive, rail, *more))
        return Forest.why_not(system, system.loads(0.0, 1.0))

    assert why_not(Gap("g", "b", "d", upper=1.0, stiffness=2.0)) is None
    # one body is all of this scene; it may be one of many
    stop = Stop("s", "b", GROUND, upper=1.0)
    assert "too many of its bodies" in str(why_not(stop))
    assert why_not(stop, *(Body(f"more {i}", inertia=1.0) for i in range(9))) is None


def test_a_force_follows_a_body_that_is_let_go() -> None:
    """A block let go after s = t - 1 = 0 gains ``v = (s + s^2) / 2``, another that it leads the integral of that."""
    scene = Scene(
        Body("a", inertia=1.0),
        Contact("c", "a", GROUND, DryFriction(1.0, 0.5), normal=1.0),
        Force("a", piecewise_linear([0.0, 2.0], [0.0, 2.0])),
        Body("b", inertia=1.0),
        Force("b", 1.0 * velocity("a")),
    )
    found = part_by_part(scene, 2.0, t_eval=[1.5, 2.0])
    s = np.array([0.5, 1.0])
    np.testing.assert_allclose(found.velocity("a"), (s + s**2) / 2, rtol=1e-12)
    np.testing.assert_allclose(found.velocity("b"), s**2 / 4 + s**3 / 6, rtol=1e-12)


LEAVES_SMOOTHLY = 125
"""Number of a machine with a stop that opens with neither velocity nor acceleration."""


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_machines_followed_part_by_part_do_as_their_oracle(family: str) -> None:
    with validation.part_by_part(knots=True):
        for number in (1, 2, 3, 4, LEAVES_SMOOTHLY):
            assert difference(family, "auto", number) < 1e-9


@pytest.mark.slow
def test_a_normal_force_that_touches_0_has_not_come_through_it() -> None:
    """It falls to 0 N at a break and rises again: a value below 0 by roundoff is small beside the force before."""
    for k in range(0, 60, 5):
        turn, most = 0.8 + 0.013 * k, 7.3 + 0.11 * k
        normal = piecewise_linear([0.3, turn, 1.7], [most, 0.0, most])
        scene = Scene(
            *(Body(f"b{i}", inertia=1.0, velocity=-3.0 + 0.1 * i) for i in range(20)),
            *(Contact(f"c{i}", f"b{i}", GROUND, DryFriction(0.1, 0.05), normal=normal) for i in range(20)),
            Force("b0", piecewise_linear([0.37 + 0.003 * k] * 2, [0.0, 0.1])),
            Force("b0", sine(0.3, 1.0 + 0.1 * k)),
        )
        with validation.part_by_part():
            result = simulate(scene, (0.0, 2.0), events=[When("lost", normal_of("c0"), stop=True)])
        assert result.status == 0


def test_a_velocity_that_touches_0_at_a_break_has_not_come_through_it() -> None:
    """``v = (t - t0)^2 / 2``, and another load breaks at t0: series begin there with a velocity of nearly 0."""
    for k in range(0, 60, 5):
        turn = 1.1 + 0.0137 * k
        scene = Scene(
            Drive("d", velocity=-5.0),
            Body("b0", inertia=1.0, velocity=0.5 * turn**2),
            Contact("c0", "b0", "d", DryFriction(0.1, 0.1), normal=13.7),
            # beside the friction of 1.37 N
            Force("b0", piecewise_linear([0.0, 4.0], [1.37 - turn, 5.37 - turn])),
            *(one for one in sliders(20).elements if one.name not in ("b0", "c0", "belt")),
            Force("b3", piecewise_linear([turn / 3, turn / 3, turn, turn], [0.0, 0.1, 0.1, 0.2])),
        )
        with validation.part_by_part():
            result = simulate(scene, (0.0, 3.5), events=[When("turned", velocity("b0"), stop=True)])
        assert result.status == 0


def test_rates_of_sines_have_the_size_of_amplitude_times_angular_frequency() -> None:
    """Two sines of thing 0 and none of thing 1: 2 pi (2 m/s 3 Hz + 1 m/s 5 Hz)."""
    sines = Sines.of([(0, 2.0, 3.0, 0.1), (0, -1.0, 5.0, 0.0)])
    shares = SineShares.among(sines, np.array([0, 0]), 2)
    assert shares.sizes == pytest.approx([3.0, 0.0])
    assert shares.rate_sizes == pytest.approx([22 * math.pi, 0.0])
