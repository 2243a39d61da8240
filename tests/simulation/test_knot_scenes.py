"""Knots of large scenes: an event in one settles this knot, not the scene."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise

import numpy as np
import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Gear,
    Mode,
    Scene,
    Spring,
    Stop,
    piecewise_linear,
    position,
    simulate,
    velocity,
)
from stickslip.equations.system import System
from stickslip.simulation import run
from stickslip.simulation.knot_scenes import KnotScenes
from validation.part_by_part import difference

MANY = 24


@contextmanager
def counted() -> Iterator[list[float]]:
    """Give the times at which the whole scene is settled."""
    times, settle = [], run.settle
    with pytest.MonkeyPatch.context() as patch:

        def noted(system: object, segment: object, now: run.Situation, uncertainty: object) -> run.Settled:
            times.append(now.t)
            return settle(system, segment, now, uncertainty)  # type: ignore[arg-type]

        patch.setattr(run, "settle", noted)
        yield times


def test_wheels_in_bearings_are_braked_one_after_the_other() -> None:
    """A bearing takes 0.2 m/s², a brake from time b on 1 m/s² more: a wheel stops at ``b + (v - 0.2 b) / 1.2``."""
    speed, begin = 3.0 + 0.1 * np.arange(MANY), 0.5 + 0.03 * np.arange(MANY)
    bearing, brake = DryFriction(0.03, 0.02), DryFriction(0.3, 0.2)
    names = [f"w{i}" for i in range(MANY)]
    pressed = [piecewise_linear([b, b], [0.0, 5.0]) for b in begin.tolist()]
    scene = Scene(
        *(Body(name, inertia=1.0, velocity=v) for name, v in zip(names, speed.tolist(), strict=True)),
        *(Contact(f"bearing {name}", name, GROUND, bearing, normal=10.0) for name in names),
        *(Contact(f"brake {name}", name, GROUND, brake, normal=n) for name, n in zip(names, pressed, strict=True)),
    )
    with counted() as times:
        result = simulate(scene, (0.0, 6.0))
    stops = begin + (speed - 0.2 * begin) / 1.2
    for kind in ("bearing", "brake"):
        at_rest = [e for name in names for e in result.events if e.contact == f"{kind} {name}" and e.after == 0]
        np.testing.assert_allclose([e.t for e in at_rest], stops, rtol=1e-14)
    np.testing.assert_allclose(result.sample([1.5]).y[:MANY, 0], speed - 0.2 * 1.5 - (1.5 - begin), rtol=1e-13)
    assert times == [0.0]


def test_of_two_pads_one_carries_its_level_until_the_other_lets_go() -> None:
    """A spring of stiffness k pulls with ``F = k 0.1 t``: both pads bear half of it up to 0.5 N, the second no more.

    The first holds 1.5 N: both let go at F = 2 N.
    """
    stiffness = 8.0 + 0.3 * np.arange(MANY)
    strong, weak = DryFriction(0.3, 0.2), DryFriction(0.25, 0.2)
    names = [f"b{i}" for i in range(MANY)]
    scene = Scene(
        Drive("puller", velocity=0.1),
        *(Body(name, inertia=1.0) for name in names),
        *(Contact(f"strong {name}", name, GROUND, strong, normal=5.0) for name in names),
        *(Contact(f"weak {name}", name, GROUND, weak, normal=2.0) for name in names),
        *(Spring(name, "puller", stiffness=k) for name, k in zip(names, stiffness.tolist(), strict=True)),
    )
    with counted() as times:
        result = simulate(scene, (0.0, 2.6))
    lets_go = 2.0 / (0.1 * stiffness)
    first = {name: next(e for e in result.events if e.contact == f"strong {name}") for name in names}
    np.testing.assert_allclose([first[name].t for name in names], lets_go, rtol=1e-13)
    at = 0.9 * float(lets_go.min())
    pull, sample = 0.1 * stiffness * at, result.sample([at])
    weaker = np.minimum(0.5 * pull, 0.5)
    np.testing.assert_allclose([float(sample.force(f"weak {name}")[0]) for name in names], weaker, rtol=1e-12)
    np.testing.assert_allclose([float(sample.force(f"strong {name}")[0]) for name in names], pull - weaker, rtol=1e-12)
    second = {name: next(e for e in result.events if e.contact == f"weak {name}") for name in names}
    assert all(second[name].t == first[name].t for name in names)
    assert {e.after for e in (*first.values(), *second.values())} == {Mode.FORWARD}
    assert times == [0.0]


def test_geared_wheels_stop_together() -> None:
    """``c = 2 a``: inertias 1 and 4 times 1/4 add up, and friction of 2 N m and 2 times 0.5 N m: both slow a by 1.5."""
    names = [f"{i}" for i in range(MANY)]
    law, speed = DryFriction(0.2, 0.1), 1.0 + 0.02 * np.arange(MANY)
    scene = Scene(
        *(Body(f"a {k}", inertia=1.0, velocity=v) for k, v in zip(names, speed.tolist(), strict=True)),
        *(Body(f"c {k}", inertia=0.25, velocity=2 * v) for k, v in zip(names, speed.tolist(), strict=True)),
        *(Gear(f"gear {k}", f"a {k}", f"c {k}", ratio=0.5) for k in names),
        *(Contact(f"rub {k}", f"a {k}", GROUND, law, normal=20.0) for k in names),
        *(Contact(f"drag {k}", f"c {k}", GROUND, law, normal=5.0) for k in names),
    )
    with counted() as times:
        result = simulate(scene, (0.0, 3.0))
    for k, v in zip(names, speed.tolist(), strict=True):
        stops = {e.contact: (e.t, e.after) for e in result.events if e.contact.split()[1] == k}
        assert stops.keys() == {f"rub {k}", f"drag {k}"}
        assert all(t == pytest.approx(v / 1.5, rel=1e-13) and after == 0 for t, after in stops.values())
    assert times == [0.0]


def test_forces_that_follow_others_act_on_a_knot_in_the_whole_scene() -> None:
    """Each wheel rubs in two places, and is pushed by a force that follows the next one: as a whole, as before."""
    law, names = DryFriction(0.3, 0.2), [f"b{i}" for i in range(MANY)]
    scene = Scene(
        *(Body(name, inertia=1.0, velocity=1.0 + 0.05 * i) for i, name in enumerate(names)),
        *(Contact(f"c {name}", name, GROUND, law, normal=1.0) for name in names),
        *(Contact(f"d {name}", name, GROUND, law, normal=2.0) for name in names),
        *(Force(a, 0.3 * velocity(b) + 0.1 * position(b)) for a, b in pairwise(names[::2])),
    )
    assert difference(scene, 3.0) <= 1


def test_what_acts_on_a_knot_is_in_its_scene() -> None:
    """A neighbour on a spring and a damper is a drive that goes on with its velocity and acceleration."""
    law = DryFriction(0.2, 0.1)
    scene = Scene(
        Drive("belt", velocity=0.3),
        *(Body(name, inertia=1.0) for name in ("a", "b", "c", "d")),
        Contact("f", "a", "belt", law, normal=1.0),
        Contact("g", "a", GROUND, law, normal=1.0),
        Gear("pair", "a", "b", ratio=2.0),
        Stop("end", "b", GROUND, upper=1.0),
        Spring("b", "c", stiffness=2.0),
        Damper("c", "d", damping=1.0),
        Contact("h", "c", GROUND, law, normal=1.0),
    )
    system = System(scene)
    knot = KnotScenes(system, [np.array([0, 1])])[0]
    assert knot is not None
    own = knot.system.scene
    assert [body.name for body in own.bodies] == ["a", "b"]
    assert {drive.name for drive in own.drives} == {"belt", "c"}
    assert [row.name for row in own.rows] == ["f", "g", "pair", "end"]
    assert [system.rows[j].name for j in knot.rows.tolist()] == ["f", "g", "pair", "end"]
    assert len(own.springs) == 1 and not own.dampers
