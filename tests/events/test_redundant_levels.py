"""Contacts that lock the same motion: forces of least norm within all limits, as long as there are any."""

from __future__ import annotations

import itertools
import math
import random
from typing import Any

import numpy as np
import pytest
from reading import told
from scipy.linalg import expm
from scipy.optimize import brentq, lsq_linear

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Gear,
    OneWay,
    Result,
    Scene,
    Signal,
    Spring,
    Stop,
    Tie,
    piecewise_linear,
    simulate,
    sine,
)
from stickslip.equations import forest
from stickslip.events import search
from stickslip.results.patchwork import Patchwork

FORMULATIONS = ("contact-force", "merged", "multiplier")
LAW = DryFriction(0.3, 0.2)


def pair(load: Signal | float, strong: Any = 10.0, weak: Any = 2.0, **law: Any) -> Scene:
    """A body of 1 kg held by contacts of 3 N and 0.6 N."""
    return Scene(
        Body("b", inertia=1.0),
        Contact("strong", "b", GROUND, DryFriction(0.3, 0.2, **law), normal=strong),
        Contact("weak", "b", GROUND, DryFriction(0.3, 0.2, **law), normal=weak),
        Force("b", load),
    )


def both(result: Result) -> np.ndarray:
    return np.array([result.force("strong"), result.force("weak")])


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_two_contacts_let_go_at_the_sum_of_their_levels(formulation: str) -> None:
    """Half each up to 1.2 N, then 0.6 N and the rest, up to 3.6 N; then 2.4 N of kinetic friction."""
    load = piecewise_linear([0, 4], [0, 4])
    times = [0.6, 1.0, 1.2, 1.4, 3.0, 3.59, 3.8]
    result = simulate(pair(load), (0.0, 4.0), t_eval=times, formulation=formulation)
    assert told(result) == [("strong", 0, 1), ("weak", 0, 1)]
    assert [e.t for e in result.events] == pytest.approx([3.6, 3.6], abs=1e-6)
    weak = [min(0.5 * t, 0.6) for t in times[:-1]]
    wanted = [[t - w for t, w in zip(times, weak, strict=False)] + [2.0], [*weak, 0.4]]
    np.testing.assert_allclose(both(result), wanted, atol=1e-7)
    assert result.mode("weak").tolist() == [0, 0, 0, 0, 0, 0, 1]


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_shares_come_and_go_without_jumps(formulation: str) -> None:
    """A sine of 3 N turns the shares about without an event; each is half the load, or 0.6 N of the weak one."""
    result = simulate(pair(sine(3.0, 1.0)), (0.0, 2.0), t_eval=np.linspace(0, 2, 401), formulation=formulation)
    assert not result.events
    load = 3.0 * np.sin(2 * np.pi * result.t)
    weak = np.clip(0.5 * load, -0.6, 0.6)
    np.testing.assert_allclose(both(result), [load - weak, weak], atol=2e-6)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_level_that_rises_is_carried_as_it_is(formulation: str) -> None:
    """Both come to rest after v / 4.4 s and dwell: the weak one carries 0.6 - 0.2 exp(-(t - t_s) / 0.5) N."""
    scene = Scene(
        Body("b", inertia=1.0, velocity=0.44),
        Contact("strong", "b", GROUND, DryFriction(0.3, 0.2, dwell=0.5), normal=10.0),
        Contact("weak", "b", GROUND, DryFriction(0.3, 0.2, dwell=0.5), normal=2.0),
        Force("b", piecewise_linear([0.1, 0.3, 2.0], [-2.0, 1.6, 1.6])),
    )
    # v' = -2.4 - 2 up to 0.1 s
    result = simulate(scene, (0.0, 2.0), t_eval=[0.29, 0.5, 1.0, 1.9], formulation=formulation)
    assert next(e.t for e in result.events if e.contact == "weak") == pytest.approx(0.1, abs=1e-7)
    final = result.t >= 0.3
    level = 0.6 - 0.2 * np.exp(-(result.t - 0.1) / 0.5)
    load = 1.6
    weak = np.minimum(0.5 * load, level)
    np.testing.assert_allclose(result.force("weak")[final], weak[final], atol=1e-6)
    np.testing.assert_allclose(result.force("strong")[final], (load - weak)[final], atol=1e-6)
    assert np.all(result.mode("weak")[final] == 0)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_each_side_has_its_level(formulation: str) -> None:
    """The weak one holds 0.6 N forward and 0.2 N backward: -3.2 N let go backward."""
    law = {"mu_static_backward": 0.1, "mu_coulomb_backward": 0.05}
    scene = Scene(
        Body("b", inertia=1.0),
        Contact("strong", "b", GROUND, LAW, normal=10.0),
        Contact("weak", "b", GROUND, DryFriction(0.3, 0.2, **law), normal=2.0),
        Force("b", piecewise_linear([0, 1, 5], [0, 2, -6])),
    )
    result = simulate(scene, (0.0, 5.0), t_eval=[1.0, 2.5, 3.5], formulation=formulation)
    np.testing.assert_allclose(both(result), [[1.4, -0.8, -2.8], [0.6, -0.2, -0.2]], atol=1e-7)
    assert told(result) == [("strong", 0, -1), ("weak", 0, -1)]
    assert [e.t for e in result.events] == pytest.approx([3.6, 3.6], abs=1e-6)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_brake_that_opens_hands_its_share_over(formulation: str) -> None:
    """Of 2.5 N the weak one carries half where it can, else its level, down to 0; the strong one holds up to 3 N."""
    brake = piecewise_linear([0, 1, 2], [10, 0, 0])
    result = simulate(pair(2.5, weak=brake), (0.0, 2.0), t_eval=[0.2, 0.5, 0.7, 0.9, 1.5], formulation=formulation)
    assert not [e for e in result.events if e.contact == "strong"]
    weak = [1.25, 1.25, 0.9, 0.3, 0.0]
    np.testing.assert_allclose(both(result), [[2.5 - w for w in weak], weak], atol=1e-7)


def network(number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str], list[tuple[int, int]]]:
    """Return inertias, levels, forces on bodies, their names and the ends of contacts, -1 for the ground."""
    draw = random.Random(number)
    count = draw.randint(2, 4)
    ends = [(i, draw.choice([-1, *range(i)])) for i in range(count)]
    for _ in range(draw.randint(1, 3)):
        a, b = draw.sample(range(-1, count), 2)
        ends.append((max(a, b), min(a, b)))
    levels = np.array([round(draw.uniform(0.5, 6.0), 2) for _ in ends])
    push = np.array([round(draw.uniform(-6.0, 6.0), 2) for _ in range(count)])
    inertia = np.array([round(draw.uniform(0.5, 3.0), 2) for _ in range(count)])
    return inertia, levels, push, [f"b{i}" for i in range(count)], ends


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("number", range(20))
def test_networks_under_a_ramp(number: int, formulation: str) -> None:
    """Against bounded least squares: the forces, and the time from which no forces within all limits exist."""
    inertia, levels, push, names, ends = network(number)
    rows = np.zeros((len(ends), len(names)))
    for k, (a, b) in enumerate(ends):
        rows[k, a] += 1.0
        if b >= 0:
            rows[k, b] -= 1.0

    # all bodies are joined to the ground, some through others: G' lambda = s push while all are held
    def forces(s: float) -> np.ndarray | None:
        # a small weight on the norm leaves the balance exact to 1e-9
        weight = 1e-5
        found = lsq_linear(
            np.vstack([rows.T, weight * np.eye(len(ends))]),
            np.concatenate([s * push, np.zeros(len(ends))]),
            bounds=(-levels, levels),
            method="bvls",
            tol=1e-14,
        )
        short = np.abs(rows.T @ found.x - s * push).max()
        return found.x if short < 1e-6 else None

    scene = Scene(
        *(Body(name, inertia=m) for name, m in zip(names, inertia, strict=True)),
        *(
            Contact(f"c{k}", names[a], GROUND if b < 0 else names[b], DryFriction(1.0, 0.5), normal=level)
            for k, ((a, b), level) in enumerate(zip(ends, levels.tolist(), strict=True))
        ),
        *(Force(name, piecewise_linear([0, 3], [0, 3 * p])) for name, p in zip(names, push, strict=True)),
    )
    low, high = 0.0, 3.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if forces(middle) is not None else (low, middle)
    result = simulate(scene, (0.0, 3.0), formulation=formulation)
    first = result.events[0].t if result.events else 3.0
    assert first == pytest.approx(low, abs=1e-5)
    times = np.linspace(0.0, 0.999 * low, 40)
    held = simulate(scene, (0.0, 0.9995 * low), t_eval=times, formulation=formulation)
    assert not held.events
    wanted = np.array([forces(s) for s in times]).T
    found = np.array([held.force(f"c{k}") for k in range(len(ends))])
    np.testing.assert_allclose(found, wanted, atol=1e-5)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_through_a_spring(formulation: str) -> None:
    """A sine of 1 N moves a hand of 1 kg; through a spring of 20 N/m it loads both with 20 x, below 3.6 N."""
    scene = Scene(
        Body("b", inertia=1.0),
        Body("hand", inertia=1.0),
        Spring("hand", "b", stiffness=20.0),
        Contact("strong", "b", GROUND, LAW, normal=10.0),
        Contact("weak", "b", GROUND, LAW, normal=2.0),
        Contact("rail", "hand", GROUND, DryFriction(0.0, 0.0), normal=1.0),
        Force("hand", sine(1.0, 0.3)),
    )
    # v_hand'' + 20 v_hand = F' from rest: the load on b is 20 x, a sum of two sines
    omega, own = 2 * math.pi * 0.3, math.sqrt(20.0)
    times = np.linspace(0.05, 2.0, 40)
    result = simulate(scene, (0.0, 2.0), t_eval=times, formulation=formulation, rtol=1e-10, atol=1e-12)
    x = (np.sin(omega * times) - omega / own * np.sin(own * times)) / (20.0 - omega**2)
    weak = np.clip(10.0 * x, -0.6, 0.6)
    assert np.abs(20 * x).max() > 1.3
    np.testing.assert_allclose(both(result), [20 * x - weak, weak], atol=1e-6)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("tiny", [0.0, 1e-25])
def test_they_close_together_and_let_go_together(formulation: str, tiny: float) -> None:
    """Levels rise by 2.3 and 1.428 N/s, the load by 5.7 N/s: both slip from the start on, v = -a' (t - 1)^2 / 2."""
    scene = Scene(
        Body("b", inertia=2.0),
        Contact("strong", "b", GROUND, DryFriction(0.5, 0.4), normal=piecewise_linear([1, 2], [0, 4.6])),
        Contact("weak", "b", GROUND, DryFriction(0.28, 0.2), normal=piecewise_linear([1, 2], [0, 5.1])),
        Force("b", piecewise_linear([1, 2], [0, -5.7])),
        *([Force("b", sine(tiny, 0.5))] if tiny else []),
    )
    result = simulate(scene, (0.0, 2.0), t_eval=[1.0, 1.5, 2.0], formulation=formulation)
    assert {e for e in told(result) if e[2]} == {("strong", 0, -1), ("weak", 0, -1)}
    jerk = (5.7 - 0.4 * 4.6 - 0.2 * 5.1) / 2.0
    assert result.velocity("b").tolist() == pytest.approx([0.0, -jerk / 8, -jerk / 2], abs=1e-7)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_two_freewheels_hold_one_way_each(formulation: str) -> None:
    """One holds 8 N forward, the other 12 N backward: under a sine of 7 N each carries the load in its direction."""
    forward = DryFriction(0.4, 0.3, mu_static_backward=0.0, mu_coulomb_backward=0.0)
    scene = Scene(
        Body("b", inertia=1.0),
        Contact("forward", "b", GROUND, forward, normal=20.0),
        Contact("backward", GROUND, "b", forward, normal=30.0),
        Force("b", sine(7.0, 1.05, 2.0)),
    )
    result = simulate(scene, (0.0, 3.0), t_eval=np.linspace(0.0, 3.0, 301), formulation=formulation)
    assert not result.events
    load = 7.0 * np.sin(2 * np.pi * 1.05 * result.t + 2.0)
    np.testing.assert_allclose(result.force("forward"), np.maximum(load, 0.0), atol=1e-5)
    np.testing.assert_allclose(result.force("backward"), np.maximum(-load, 0.0), atol=1e-5)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_rows_in_a_ring_that_come_to_their_levels_together(formulation: str) -> None:
    """The row whose level falls carries this level, and the other is below its own again; nothing moves.

    Of 8 N on a body, least norm gives 16/3 N to its floor and 8/3 N to its neighbour, whose floor carries the same.
    The joint carries 2 N at most. The level of the neighbour's floor falls from 6 N to 0 N in 6 s, below 2 N at 4 s.
    """
    law = DryFriction(1.0, 0.8)
    fading = piecewise_linear([0, 6], [6, 0])
    scene = Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=2.0),
        Contact("floor", "a", GROUND, law, normal=20.0),
        Contact("joint", "a", "b", law, normal=2.0),
        Contact("other", "b", GROUND, law, normal=fading),
        Force("a", 8.0),
    )
    t = np.array([0.5, 2.0, 3.9, 4.1, 5.0, 5.9])
    result = simulate(scene, (0.0, 6.0), t_eval=t, formulation=formulation)
    assert result.events == []
    joint = np.minimum(2.0, 6.0 - t)
    np.testing.assert_allclose(result.force("joint"), joint, rtol=0, atol=1e-7)
    np.testing.assert_allclose(result.force("other"), joint, rtol=0, atol=1e-7)
    np.testing.assert_allclose(result.force("floor"), 8.0 - joint, rtol=0, atol=1e-7)
    assert np.abs(result.y).max() == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("part_by_part", [False, True])
def test_many_blocks_on_two_contacts_each_move_as_on_one(part_by_part: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two contacts of one law share what a block needs up to ``mu (N_1 + N_2)``: as one contact with that normal force.

    All of them rest at the start, so all places where rows lock the same motion are searched at once.
    """
    draw = random.Random(3)
    plain: list[Any] = [Drive("plate", velocity=0.1)]
    law, double, single = DryFriction(0.5, 0.35), list[Contact](), list[Contact]()
    for i in range(60):
        name, own, more = f"b{i}", 1.0 + 0.2 * draw.random(), 0.3 + 0.3 * draw.random()
        plain += [
            Body(name, inertia=1.0, position=0.1 * draw.random()),
            Spring(name, "plate", stiffness=2.0),
        ]
        if i:
            plain.append(Spring(f"b{i - 1}", name, stiffness=8.0))
        is_double = i % 4 == 0
        single.append(Contact(f"c{i}", name, GROUND, law, normal=own + is_double * more))
        double.append(Contact(f"c{i}", name, GROUND, law, normal=own))
        if is_double:
            double.append(Contact(f"d{i}", name, GROUND, law, normal=more))
    monkeypatch.setattr(forest, "_MOST_IN_ONE_KNOT", 1.0 if part_by_part else 0.0)
    found = simulate(Scene(*plain, *double), (0.0, 8.0))
    right = simulate(Scene(*plain, *single), (0.0, 8.0))

    def of_first(result: Result) -> list[tuple[str, int, int]]:
        return sorted((e.contact, int(e.before), int(e.after)) for e in result.events if e.contact[0] == "c")

    assert of_first(found) == of_first(right)
    assert len(right.events) > 60
    y = right.sample(found.t).y
    np.testing.assert_allclose(found.y, y, rtol=0, atol=1e-10 * np.abs(y).max())
    assert any(isinstance(part, Patchwork) for part in found.trajectory.parts) == part_by_part


@pytest.mark.parametrize("method", ["series", "BDF", "Adams", "RK4"])
@pytest.mark.parametrize("velocity", [0.3, 1.0, 2.0])
def test_what_others_bring_to_rest_is_at_rest(method: str, velocity: float) -> None:
    """Dampers bring two bodies to rest, and the contacts between them and to the ground hold them together.

    Nothing rubs: ``M v' = -D v``, so they go ``D^-1 M v`` from any v on. At 0.3 m/s b lets a catch up with it, and the
    contact between them holds from there on: together 3 kg are braked by 3 N s/m.
    """
    law = DryFriction(0.3, 0.0)
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Body("b", inertia=2.0, velocity=velocity),
        Damper("a", GROUND, damping=2.0),
        Damper("b", "a", damping=1.0),
        Damper("b", GROUND, damping=1.0),
        Contact("ca", "a", GROUND, law, normal=1.0),
        Contact("cb", "b", GROUND, law, normal=1.0),
        Contact("ab", "b", "a", law, normal=1.0),
    )
    step = {"step": 0.01} if method == "RK4" else {}
    result = simulate(scene, (0.0, 50.0), method=method, **step)
    assert not result.final_scene().bodies[0].velocity
    masses, damping = np.diag([1.0, 2.0]), np.array([[3.0, -1.0], [-1.0, 2.0]])
    begun = np.array([1.0, velocity])
    goes = np.linalg.solve(damping, masses @ begun)
    if velocity == 0.3:

        def later(t: float) -> Any:
            return expm(-np.linalg.solve(masses, damping) * t) @ begun

        joined = later(brentq(lambda t: later(t) @ [1.0, -1.0], 0.0, 1.0))
        goes += joined - np.linalg.solve(damping, masses @ joined)
    # relaxation takes about 1e-6 m/s from what is held by two contacts: from there on it would go 1e-6 m
    tolerance = 3e-5 if method == "RK4" else 2e-6 if velocity == 0.3 else 5e-8
    np.testing.assert_allclose([result.position(body)[-1] for body in "ab"], goes, rtol=0, atol=tolerance)
    assert [int(result.mode(name)[-1]) for name in ("ca", "cb", "ab")] == [0, 0, 0]


@pytest.mark.parametrize(
    ("method", "formulation"), [("auto", "contact-force"), *(("BDF", one) for one in FORMULATIONS)]
)
@pytest.mark.parametrize("force", [-3.0, 3.0])
def test_a_share_at_its_level_holds_nothing_when_a_drive_moves_off(force: float, method: Any, formulation: Any) -> None:
    """A belt of level 8 N and the ground of 0.5 N hold a block; at 1 s the belt moves off with 1 m/s^2.

    The belt is the stronger one: the ground, which carried its level of 0.5 N before, slides with 0.5 N.
    """
    scene = Scene(
        Body("b", inertia=1.0),
        Drive("belt", velocity=piecewise_linear([1.0, 2.0], [0.0, 1.0])),
        Contact("on belt", "b", "belt", DryFriction(2.0, 1.0), normal=4.0),
        Contact("on ground", "b", GROUND, DryFriction(0.5, 0.5), normal=1.0),
        Force("b", force),
    )
    result = simulate(scene, (0.0, 3.0), method=method, formulation=formulation)
    assert told(result) == [("on ground", 0, 1)] and result.events[0].t == pytest.approx(1.0, abs=1e-7)
    sample = result.sample([0.5, 1.5, 2.5])
    np.testing.assert_allclose(sample.velocity("b"), [0.0, 0.5, 1.0], rtol=0, atol=1e-7)
    np.testing.assert_allclose(sample.force("on ground"), [math.copysign(0.5, force), 0.5, 0.5], atol=1e-7)


def test_a_freewheel_that_carries_nothing_stops_a_block_all_the_same() -> None:
    """The belt pulls a block forward, which a freewheel to the ground forbids: the belt slides."""
    scene = Scene(
        Body("b", inertia=3.0),
        Drive("belt", velocity=piecewise_linear([1.0, 2.0], [0.0, 1.0])),
        Contact("on belt", "b", "belt", DryFriction(2.0, 1.0), normal=4.0),
        OneWay("free", "b", GROUND),
        Force("b", -1.0),
    )
    result = simulate(scene, (0.0, 4.0))
    assert told(result) == [("on belt", 0, -1)] and result.events[0].t == 1.0
    assert not result.velocity("b").any()
    # the freewheel carries the 4 N of the belt less 1 N
    assert result.force("free")[-1] == pytest.approx(3.0, abs=1e-14)


FORCE_OF_BODY = sine(4.0, 2.0, 2.0)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("turn", [1.0, -1.0, 7.0], ids=["alike", "mirrored", "faster"])
def test_drives_in_proportion_tear_nothing(turn: float, formulation: str) -> None:
    """Of ``F = f - m u'`` each carries half up to 4 N; beyond, the weak one 4 N and the strong one the rest."""
    scene = Scene(
        Body("b", inertia=1.0),
        Drive("one", velocity=sine(1.0, 1.0)),
        Drive("other", velocity=sine(turn, 1.0)),
        Contact("weak", "b", "one", DryFriction(0.4, 0.1), normal=10.0),
        Contact("strong", "b", "other", DryFriction(0.4, 0.1), normal=20.0, radius_b=1 / turn),
        Force("b", FORCE_OF_BODY),
    )
    times = np.linspace(0.0, 1.0, 41)
    result = simulate(scene, (0.0, 1.0), t_eval=times, formulation=formulation)
    assert not result.events
    # contacts push the body with -r
    total = [FORCE_OF_BODY(t) - 2 * math.pi * math.cos(2 * math.pi * t) for t in times]
    weak = [max(-4.0, min(0.5 * F, 4.0)) for F in total]
    assert result.force("weak") == pytest.approx(weak, abs=1e-12)
    assert result.force("strong") == pytest.approx(np.subtract(total, weak), abs=1e-12)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_what_else_moves_does_not_matter_between_drives_that_move_alike(formulation: str) -> None:
    """A clutch and a contact hold a body at drives of one velocity; they let go together, at a force of -4 N."""
    beside = (Body("far", inertia=2.0), Force("far", sine(5.0, 3.0)))
    for others in ((), beside, (Body("b0", inertia=1.0), *beside)):
        scene = Scene(
            Body("b", inertia=1.0),
            *others,
            *(Drive(name, velocity=sine(1.0, 1.0)) for name in ("d", "e")),
            Contact("c", "b", "d", DryFriction(0.4, 0.1), normal=10.0),
            OneWay("o", "b", "e"),
            Force("b", sine(2.0, 2.0, 2.0)),
        )
        result = simulate(scene, (0.0, 1.0), formulation=formulation)
        assert told(result)[-4:] == [("c", -1, 0), ("o", -1, 0), ("c", 0, -1), ("o", 0, -1)]
        released = brentq(
            lambda t: 2 * math.sin(4 * math.pi * t + 2) - 2 * math.pi * math.cos(2 * math.pi * t) + 4, 0.9, 1
        )
        assert [e.t for e in result.events[-2:]] == pytest.approx([released] * 2, abs=1e-9)
        half = math.sin(4 * math.pi * 0.55 + 2) - math.pi * math.cos(2 * math.pi * 0.55)
        assert [result.sample([0.55]).force(row)[0] for row in ("c", "o")] == pytest.approx([half, half], abs=1e-9)


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}, {"formulation": "multiplier"}])
@pytest.mark.parametrize(
    "other", [-1 * sine(0.3, 1.0, math.pi), sine(0.3, 1.0, 2 * math.pi), sine(0.1, 1.0) + sine(0.2, 1.0)]
)
def test_drives_of_one_velocity_however_it_is_written(other: Signal, options: dict[str, Any]) -> None:
    """A block at rest on both sticks from the start, at which one of them has a velocity of 4e-17 m/s, not 0."""
    scene = Scene(
        Body("b", inertia=1.0),
        Drive("one", velocity=sine(0.3, 1.0)),
        Drive("other", velocity=other),
        Contact("c", "b", "one", LAW, normal=10.0),
        Contact("e", "b", "other", LAW, normal=20.0),
        Force("b", piecewise_linear([0.0, 1.0], [0.0, 0.8])),
    )
    times = np.linspace(0.0, 1.0, 21)
    result = simulate(scene, (0.0, 1.0), t_eval=times, **options)
    assert not result.events
    half = 0.5 * (0.8 * times - 0.6 * math.pi * np.cos(2 * math.pi * times))
    for contact in ("c", "e"):
        assert result.force(contact) == pytest.approx(half, abs=1e-9)


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}])
@pytest.mark.parametrize("heavy", [None, 3e3, 1e6])
def test_heavy_bodies_elsewhere_keep_nothing_stuck(heavy: float | None, options: dict[str, Any]) -> None:
    """Two belts part until 2 s and are one from then on; 1 kg lets go of both at the sum of their levels, 6 N."""
    beside = [] if heavy is None else [Body("far", inertia=heavy, velocity=1.0)]
    scene = Scene(
        Body("b", inertia=1.0),
        *beside,
        Drive("one", velocity=piecewise_linear([0.0, 2.0, 4.0], [0.0, 0.25, 0.0])),
        Drive("other", velocity=piecewise_linear([0.0, 1.0, 2.0, 4.0], [0.0, -0.25, 0.25, 0.0])),
        Contact("c", "b", "one", LAW, normal=10.0),
        Contact("e", "b", "other", LAW, normal=10.0),
        Force("b", piecewise_linear([2.0, 4.0], [0.0, 12.0])),
    )
    result = simulate(scene, (0.0, 4.0), **options)
    # F - m u' comes to 6 N where u' = -0.125
    assert [(e.contact, e.after) for e in result.events if e.t > 2.5] == [("c", 1), ("e", 1)]
    assert [e.t for e in result.events if e.t > 2.5] == pytest.approx([2.0 + 5.875 / 6] * 2, abs=1e-7)


@pytest.mark.parametrize(
    "options", [{}, {"method": "BDF"}, {"method": "Adams", "formulation": "merged"}, {"formulation": "multiplier"}]
)
@pytest.mark.parametrize("far", [1.0, 1e3])
def test_a_drive_that_moves_as_the_sum_of_two_tears_nothing(far: float, options: dict[str, Any]) -> None:
    """Three bodies with ``v2 = v0 + v1`` on three drives of such velocities: four rows share what three bodies need."""
    one, other = sine(0.3, 1.0, 0.4), piecewise_linear([0.0, 0.7, 2.0], [0.0, 0.5, -0.4])
    velocities: tuple[Signal, ...] = (one, other, one + other)
    pushes = (sine(1.0, 0.7), 0.5, piecewise_linear([0.0, 2.0], [-1.0, 1.0]))
    scene = Scene(
        *(Body(f"b{i}", inertia=1.0 + i, velocity=u(0.0)) for i, u in enumerate(velocities)),
        Body("far", inertia=far),
        *(Drive(f"d{i}", velocity=u) for i, u in enumerate(velocities)),
        *(Contact(f"c{i}", f"b{i}", f"d{i}", LAW, normal=100.0) for i in range(3)),
        Tie("tie", {"b0": 1.0, "b1": 1.0, "b2": -1.0}),
        *(Force(f"b{i}", push) for i, push in enumerate(pushes)),
    )
    times = np.array([0.1, 0.5, 1.1, 1.7])
    result = simulate(scene, (0.0, 2.0), t_eval=times, **options)
    assert not result.events
    rows = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, -1.0]])
    for k, t in enumerate(times):
        need = [
            (push if isinstance(push, float) else push(t)) - (1 + i) * u.slope(t)
            for i, (push, u) in enumerate(zip(pushes, velocities, strict=True))
        ]
        shares = np.linalg.pinv(rows.T) @ need
        found = [result.force(row)[k] for row in ("c0", "c1", "c2", "tie")]
        assert found == pytest.approx(shares, abs=1e-7)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_of_two_backstops_only_one_spares_the_other(formulation: str) -> None:
    """A shaft and its gear mate have a backstop each; a body behind a freewheel is pulled forward for 1 s, then back.

    The body runs ahead, ``v = 2 t`` and ``x = 1`` at 1 s, and comes back to rest at 2 s where ``x = 2``.
    """
    load = piecewise_linear([0, 1, 1, 5], [2.0, 2.0, -2.0, -2.0])
    for r_a, r_b, ratio in itertools.product((1.0, 0.3, 0.08), (1.0, 0.3, 0.12), (2.0, -2.5, 3.3)):
        against = (GROUND, "c") if ratio > 0 else ("c", GROUND)
        scene = Scene(
            Body("a", inertia=1.0),
            Body("b", inertia=1.0),
            Body("c", inertia=0.5),
            Gear("mesh", "b", "c", ratio=ratio),
            OneWay("of b", GROUND, "b"),
            OneWay("of c", *against),
            OneWay("drive", "b", "a", radius_a=r_a, radius_b=r_b),
            Force("a", load),
        )
        result = simulate(scene, (0.0, 4.0), formulation=formulation)
        assert result.position("a")[-1] == pytest.approx(2.0, abs=1e-6), (r_a, r_b, ratio)
        assert result.velocity("a")[-1] == pytest.approx(0.0, abs=1e-6), (r_a, r_b, ratio)
        assert ("drive", -1, 0) in told(result)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_gear_pair_held_by_freewheels_stays(formulation: str) -> None:
    """Two freewheels and a tie hold all bodies at rest, whenever a clutch begins to be pressed."""
    for normal in (5.0, piecewise_linear([0.66, 3.2], [0.0, 5.5]), piecewise_linear([0.0, 3.2], [2.0, 5.5])):
        scene = Scene(
            Body("a", inertia=1.8),
            Body("b", inertia=1.1),
            Body("c", inertia=0.2),
            Tie("mesh", {"a": 1.0, "c": 1.3}),
            OneWay("first", "a", "c", radius_a=0.6, radius_b=-1.9),
            OneWay("second", "a", "b"),
            Contact("clutch", "b", "c", DryFriction(0.48, 0.48), normal=normal, radius_a=-1.0, radius_b=-1.0),
            Force("a", -7.95),
        )
        result = simulate(scene, (0.0, 2.0), formulation=formulation)
        assert np.abs(result.y[:3]).max() < 1e-9 and not result.events


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("frame", [0.0, 4.0])
def test_what_ties_in_a_symmetric_loop_lets_go_together(formulation: str, frame: float) -> None:
    """Two outer blocks on a belt that accelerates, an inner one between them: the outer contacts slip, both.

    Held, each outer contact has 10 N of 6 N, each inner one 5 N of 3.75 N. The outer ones let go, with 2 N:
    (7 + 7 + 6 + 2 + 2) N / 10 kg = 2.4 m/s^2 for all, and the inner ones hold (6 - 4 * 2.4) N / 2 = -1.8 N.
    """
    outer, inner = DryFriction(6.0, 2.0), DryFriction(3.75, 1.25)
    scene = Scene(
        Body("left", inertia=3.0),
        Body("right", inertia=3.0),
        Body("middle", inertia=4.0),
        Drive("belt", velocity=piecewise_linear([0.0, 10.0], [0.0, 10.0 * (4.0 - frame)])),
        *(Contact(f"{side} below", side, "belt", outer, normal=1.0) for side in ("left", "right")),
        *(Contact(f"{side} beside", "middle", side, inner, normal=1.0) for side in ("left", "right")),
        *(Force(side, 7.0 - 3 * frame) for side in ("left", "right")),
        Force("middle", 6.0 - 4 * frame),
    )
    result = simulate(scene, (0.0, 1.0), formulation=formulation)
    for body in ("left", "right", "middle"):
        assert result.velocity(body)[-1] == pytest.approx(2.4 - frame, abs=1e-6)
    for side in ("left", "right"):
        assert result.mode(f"{side} below")[-1] == -1
        assert result.force(f"{side} beside")[-1] == pytest.approx(-1.8, abs=1e-5)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("has_gears", [False, True])
def test_two_blocks_pulled_apart_leave_a_third_at_rest(formulation: str, sign: float, has_gears: bool) -> None:
    """Two blocks, each held by 2 N below and by 2 N of the block between them, are pulled apart by 1.5 + 2 (t - 6) N.

    From t = 7.25 s on they slip with 2 N. The middle one carries the same load from both sides, and stays. With gears,
    what holds a block below and a part of its load act on a wheel of 0.25 kg m^2 that turns half as fast.
    """
    ramp = piecewise_linear([6.0, 8.0], [-1.0 * sign, 7.0 * sign])
    below, beside = DryFriction(4.0, 2.0), DryFriction(2.0, 1.0)
    halves: list[Any] = []
    for side, way in (("left", 1.0), ("right", -1.0)):
        halves.append(Contact(f"{side} beside", side, "middle", beside, normal=1.0))
        halves.append(Force(side, 2.0 * way * sign))
        if has_gears:
            wheel = f"{side} wheel"
            halves += [Body(side, inertia=2.0), Body(wheel, inertia=0.25), Gear(f"{side} gear", side, wheel, ratio=2.0)]
            halves += [Contact(f"{side} below", wheel, GROUND, below, normal=1.0), Force(wheel, way * ramp)]
        else:
            halves.append(Body(side, inertia=2.0625))
            halves += [Contact(f"{side} below", side, GROUND, below, normal=0.5), Force(side, 0.5 * way * ramp)]
    result = simulate(Scene(Body("middle", inertia=1.0), *halves), (0.0, 7.7), formulation=formulation)
    assert [event.t for event in result.events] == pytest.approx([7.25] * 4, abs=1e-6)
    assert abs(result.velocity("middle")[-1]) < 1e-6
    exact = sign * ((1.7**2 - 1.25**2) - 0.5 * 0.45) / 2.0625
    assert result.velocity("left")[-1] == pytest.approx(exact, abs=1e-5)
    assert result.velocity("right")[-1] == pytest.approx(-exact, abs=1e-5)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_held_row_at_its_level_says_nothing_of_rows_that_carry_theirs(formulation: str) -> None:
    """One contact is just at its level of 3 N as another lets go: that one slides from the start, and is not STUCK.

    6 N / 11 kg accelerate all bodies but two: the ties and contacts of the ring hold until 29 / 27 s.
    """

    def contact(name: str, a: str, b: str, level: float) -> Contact:
        return Contact(name, a, b, DryFriction(level, level), normal=1.0)

    scene = Scene(
        *(Body(name, inertia=1.0) for name in ("h0", "h1", "h2", "m0", "m1")),
        contact("r0", "h1", "m0", 2.0),
        contact("r1", "h2", "h0", 4.0),
        contact("r2", "h1", "h2", 3.0),
        contact("below", "m0", GROUND, 3.0),
        contact("beside", "m1", "m0", 3.0),
        Tie("tie", {"h0": 1.0, "h1": -2.0}),
        *(Force(name, 3.0) for name in ("h2", "m1", "m0")),
        Force("m1", piecewise_linear([0.0, 1.0, 3.0], [0.0, 0.0, 3.0])),
    )
    result = simulate(scene, (0.0, 2.0), formulation=formulation)
    assert (result.mode("below") == 1).all()
    assert result.sample([0.5, 1.0]).velocity("m0") == pytest.approx([3 / 11, 6 / 11], abs=1e-6)
    assert told(result)[0] == ("r0", 0, -1)
    assert result.events[0].t == pytest.approx(29 / 27, abs=1e-5)
    assert np.diff(result.velocity("m0")).min() > -1e-9


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("to", ["belt", GROUND])
def test_a_knot_beside_a_drive_at_rest_holds_as_beside_the_ground(to: Any, formulation: str) -> None:
    """It holds while the loads do less work than the levels on its weakest motion: 4.5 t < 9, so until 2 s.

    That motion: m1 by -1, all others by -1/2. The loads do (-3 + 3 t + 3 + 6 t - 3 t + 3 t) / 2, the contacts
    at their levels 1.5 + 4 + 1.5 + 2.
    """

    def contact(name: str, a: str, b: Any, static: float, coulomb: float, radius: float = 1.0) -> Contact:
        return Contact(name, a, b, DryFriction(static, coulomb), normal=1.0, radius_a=radius)

    scene = Scene(
        *([Drive("belt", velocity=0.0)] if to == "belt" else []),
        *(Body(f"m{k}", inertia=1.0) for k in range(5)),
        contact("a", "m2", "m4", 2.0, 2.0),
        contact("b", "m1", "m2", 3.0, 3.0),
        contact("c", "m1", to, 4.0, 4.0),
        contact("d", "m1", "m2", 3.0, 3.0),
        OneWay("freewheel", "m3", "m4"),
        contact("e", "m3", "m1", 4.0, 4.0, radius=2.0),
        contact("f", "m0", to, 4.0, 2.0),
        Stop("stop", "m0", "m2", upper=0.0),
        Force("m0", piecewise_linear([0.0, 3.0], [3.0, -6.0])),
        Force("m1", piecewise_linear([0.0, 3.0], [-1.5, -10.5])),
        Force("m2", piecewise_linear([0.0, 3.0], [0.0, 9.0])),
        Force("m4", piecewise_linear([0.0, 3.0], [0.0, -9.0])),
    )
    result = simulate(scene, (0.0, 2.4), formulation=formulation)
    assert told(result)[0][0] in "bcdf" and result.events[0].t == pytest.approx(2.0, abs=1e-5)
    assert np.abs(result.sample(np.linspace(0.0, 1.999, 50)).velocity("m1")).max() < 1e-9


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_knot_whose_limits_meet_but_for_roundoff(formulation: str) -> None:
    """Two stops, nine contacts and five bodies: what holds and what moves differ by roundoff as they let go.

    If all bodies move by -1, the loads do 3 + 12 t, and c4, c7 and c8 at their levels 3 + 6 + 2: until 2/3 s.
    """

    def contact(name: str, a: str, b: Any, static: float, coulomb: float, **radii: float) -> Contact:
        return Contact(name, a, b, DryFriction(static, coulomb), normal=1.0, **radii)

    scene = Scene(
        Body("b0", inertia=1.75),
        Body("b1", inertia=4.0),
        Body("b2", inertia=1.75),
        Body("b3", inertia=2.5),
        Body("b4", inertia=1.75),
        contact("c0", "b3", "b4", 6.0, 0.6),
        contact("c1", "b4", "b2", 3.0, 2.4),
        Stop("c2", "b0", GROUND, upper=0.0),
        contact("c3", "b3", "b1", 4.0, 0.4),
        contact("c4", "b1", GROUND, 3.0, 0.9),
        Stop("c5", "b2", GROUND, upper=0.0),
        contact("c6", "b1", "b0", 4.0, 1.2),
        contact("c7", "b1", "b2", 6.0, 6.0, radius_b=2.0),
        contact("c8", "b4", "b3", 4.0, 1.2, radius_a=0.5),
        contact("c9", "b4", "b0", 2.0, 1.6),
        contact("c10", "b3", "b2", 4.0, 4.0),
        *(Force(f"b{k}", piecewise_linear([0.0, 10.0], [p, p - 30.0])) for k, p in ((0, 3.0), (1, 3.0), (2, -3.0))),
        Force("b3", -3.0),
        Force("b4", piecewise_linear([0.0, 10.0], [-3.0, -33.0])),
    )
    result = simulate(scene, (0.0, 1.5), formulation=formulation)
    assert result.events[0].t == pytest.approx(2 / 3, abs=1e-5)


@pytest.mark.parametrize("way", [{}, {"method": "BDF"}, {"formulation": "merged"}, {"formulation": "multiplier"}])
def test_a_level_that_grows_from_0_beside_a_gear_is_carried_at_rest(way: dict[str, Any]) -> None:
    """Gear and contact hold the load 2 t on b1; half is above the level t/2 of the contact.

    The load on b2 is there from the start: its roundoff in the share of the contact must not count.
    """
    law, growing = DryFriction(1.0, 0.5), piecewise_linear([0.0, 1.0], [0.0, 0.5])
    scene = Scene(
        *(Body(f"b{k}", inertia=mass) for k, mass in enumerate((1.0, 3.0, 3.0))),
        Contact("c0", "b2", GROUND, law, normal=2.0),
        Contact("c1", "b0", "b2", law, normal=2.0),
        Contact("c2", "b1", "b2", law, normal=growing),
        Gear("g", "b2", "b1", ratio=1.0),
        Force("b0", piecewise_linear([0.0, 1.0], [0.0, 3.0])),
        Force("b1", piecewise_linear([0.0, 1.0], [0.0, 2.0])),
        Force("b2", piecewise_linear([0.0, 1.0], [-1.0, 3.0])),
    )
    result = simulate(scene, (0.0, 0.25), **way)
    assert not result.events and (result.mode("c2") == 0).all()
    assert result.force("c2") == pytest.approx(0.5 * result.t, rel=1e-12, abs=1e-15)
    assert result.force("g") == pytest.approx(-1.5 * result.t, rel=1e-12, abs=1e-15)


def test_a_long_row_of_loops_settles_though_one_row_after_another_would_take_too_many_trials(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """40 blocks at the speed of a belt on which they stand, each pressed on the next one, and drawn by springs.

    Where all obey their laws: ``m a = F - G^T r``, no held row beyond its level, and what moves does so against its
    kinetic force. One after another the rows need 280 trials here, and from 80 blocks on more than are made.
    """
    monkeypatch.setattr(search, "_PATIENCE", 60)
    monkeypatch.setattr(search, "_MOST_TRIALS", 120)
    count, law, numbers = 40, DryFriction(0.35, 0.2), range(40)
    x = np.array([0.5 + 0.5 * math.sin(7.3 * i) for i in numbers])
    scene = Scene(
        Drive("belt", velocity=0.3),
        *(Body(f"b{i}", inertia=1.0, velocity=0.3, position=float(x[i])) for i in numbers),
        *(Contact(f"f{i}", f"b{i}", "belt", law, normal=5.0) for i in numbers),
        *(Contact(f"l{i}", f"b{i}", f"b{i + 1}", law, normal=0.5) for i in numbers[:-1]),
        *(Spring(f"b{i}", GROUND, stiffness=1.0) for i in numbers),
        *(Spring(f"b{i}", f"b{i + 1}", stiffness=3.0) for i in numbers[:-1]),
    )
    result = simulate(scene, (0.0, 1e-6), t_eval=[0.0])
    on_belt, between = (np.array([result.force(f"{kind}{i}")[0] for i in own]) for kind, own in rows_of(count))
    stuck, joined = (np.array([result.mode(f"{kind}{i}")[0] for i in own]) for kind, own in rows_of(count))
    pull = -x + np.append(3.0 * np.diff(x), 0.0) - np.append(0.0, 3.0 * np.diff(x))
    a = pull - on_belt - np.append(between, 0.0) + np.append(0.0, between)
    for force, mode, normal, along in ((on_belt, stuck, 5.0, a), (between, joined, 0.5, -np.diff(a))):
        held = mode == 0
        assert np.abs(force[held]).max() <= 0.35 * normal * (1 + 1e-12)
        assert np.abs(along[held]).max() < 1e-12
        assert np.abs(force[~held] - 0.2 * normal * mode[~held]).max() < 1e-14
        assert (along * mode)[~held].min() > 0
        assert 0 < held.sum() < held.size


def rows_of(count: int) -> list[tuple[str, range]]:
    """Return the contacts of blocks on a belt and between each other: the beginning of their names, and numbers."""
    return [("f", range(count)), ("l", range(count - 1))]
