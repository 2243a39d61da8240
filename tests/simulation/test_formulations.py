"""Contact-force, merged and multiplier: the same events, motion and forces, by three routes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reading import told

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    LuGre,
    PreSlip,
    Scene,
    Spring,
    piecewise_linear,
    simulate,
    sine,
)
from stickslip.benchmark import BENCHMARK_SPAN, EXACT_EVENTS, flywheel_benchmark
from stickslip.simulation.result import Result
from validation.exact import REFERENCES, Story, reference

FORMULATIONS = ("contact-force", "merged", "multiplier")
WITHIN = {"contact-force": 1e-7, "merged": 1e-7, "multiplier": 1e-6}
TIGHT: dict[str, Any] = {"rtol": 1e-9, "atol": 1e-12}
_DONE: dict[tuple[str, str], Result] = {}


def solved(story: Story, formulation: str) -> Result:
    key = story.title, formulation
    if key not in _DONE:
        span = (0.0, story.stop)
        _DONE[key] = simulate(story.scene, span, formulation=formulation, t_eval=story.t, **TIGHT)
    return _DONE[key]


def away_from(events: list[float], t: np.ndarray, distance: float) -> np.ndarray:
    return np.abs(t[:, None] - np.array([-1.0, *events])).min(axis=1) > distance


# Reference scenes


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("name", REFERENCES)
def test_events_and_velocities(name: str, formulation: str) -> None:
    story = reference(name)
    result = solved(story, formulation)
    assert told(result) == [event[1:] for event in story.events]
    exact = [event[0] for event in story.events]
    within = WITHIN[formulation] * story.stop
    np.testing.assert_allclose([e.t for e in result.events], exact, rtol=0, atol=within)
    scale = max(1.0, float(np.abs(story.velocities).max()))
    np.testing.assert_allclose(story.seen(result), story.velocities, rtol=0, atol=1e-6 * scale)


@pytest.mark.slow
@pytest.mark.parametrize("name", REFERENCES)
def test_forces_and_modes_agree(name: str) -> None:
    story = reference(name)
    base = solved(story, "contact-force")
    times = [event[0] for event in story.events]
    away = away_from(times, story.t, 2e-6 * story.stop)
    for formulation in FORMULATIONS[1:]:
        other = solved(story, formulation)
        for contact in story.scene.contacts:
            a, b = base.force(contact.name)[away], other.force(contact.name)[away]
            scale = max(1.0, float(np.abs(base.normal(contact.name)).max()))
            np.testing.assert_allclose(b, a, rtol=0, atol=1e-6 * scale, err_msg=f"{formulation} {contact.name}")
            np.testing.assert_array_equal(base.mode(contact.name)[away], other.mode(contact.name)[away])


@pytest.mark.parametrize("name", REFERENCES)
def test_stuck_contacts_do_not_drift_in_any(name: str) -> None:
    story = reference(name)
    for formulation in FORMULATIONS:
        result = solved(story, formulation)
        for contact in story.scene.contacts:
            stuck = (result.mode(contact.name) == 0) & (result.normal(contact.name) > 0)
            assert np.all(result.relative_velocity(contact.name)[stuck] == 0)


# What each assembles


def held() -> Scene:
    """Three sprung blocks in a row: the first two stick together for a while, then slip; the third is held."""
    law = DryFriction(0.5, 0.3, dwell=0.2)
    return Scene(
        Body("a", inertia=1.0, velocity=0.2),
        Body("b", inertia=2.0, velocity=0.2),
        Body("c", inertia=1.0),
        Contact("ab", "a", "b", law, normal=4.0),
        Contact("cg", "c", GROUND, DryFriction(2.0, 1.0), normal=10.0),
        Spring("b", "c", stiffness=8.0, damping=0.1),
        Force("a", piecewise_linear([0.0, 4.0], [0.0, 6.0])),
    )


def test_merged_states_shrink_and_grow() -> None:
    merged = simulate(held(), (0.0, 4.0), formulation="merged", **TIGHT)
    base = simulate(held(), (0.0, 4.0), **TIGHT)
    assert told(merged) == told(base) and merged.events
    # a and b are one, c stands still: one velocity and the two positions that the spring needs
    assert merged.stats["states"] == base.stats["states"] == 5
    assert merged.stats["fewest_states"] == 3
    assert np.abs(merged.y[:, -1] - base.y[:, -1]).max() < 1e-6


def test_the_benchmark_in_all_three_and_what_it_costs() -> None:
    calls = {}
    for formulation in FORMULATIONS:
        result = simulate(flywheel_benchmark(), BENCHMARK_SPAN, formulation=formulation)
        assert [(e.contact, e.before, e.after) for e in result.events] == [
            (e.contact, e.before, e.after) for e in EXACT_EVENTS
        ]
        times = [e.t for e in result.events]
        np.testing.assert_allclose(times, [e.t for e in EXACT_EVENTS], rtol=0, atol=4 * WITHIN[formulation])
        assert result.stats["restarts"] == 11
        calls[formulation] = result.stats["rate_calls"]
    # a springless scene is a polynomial in all but the multiplier formulation, where IDA has forces to follow
    assert calls["merged"] == calls["contact-force"] <= 64
    assert calls["multiplier"] < 2000


def test_multipliers_are_solved_by_ida_only() -> None:
    with pytest.raises(ValueError, match="IDA"):
        simulate(flywheel_benchmark(), (0.0, 0.1), formulation="multiplier", method="Adams")


# Redundant contacts: the forces of least norm


def ring(load: float) -> Scene:
    """Three bodies stuck in a ring, pushed at the first: the forces of a ring of equal resistances."""
    law = DryFriction(1.0, 0.8)
    return Scene(
        *(Body(name, inertia=1.0) for name in "abc"),
        Contact("ab", "a", "b", law, normal=10.0),
        Contact("bc", "b", "c", law, normal=10.0),
        Contact("ca", "c", "a", law, normal=10.0),
        Force("a", load),
    )


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_ring_shares_its_load(formulation: str) -> None:
    """Of 6 N on a each body needs 2 N: a hands on 2 N to each side, and nothing passes between b and c."""
    result = simulate(ring(6.0), (0.0, 1.0), formulation=formulation)
    assert not result.events
    for name, force in (("ab", 2.0), ("bc", 0.0), ("ca", -2.0)):
        np.testing.assert_allclose(result.force(name), force, atol=1e-6)
    np.testing.assert_allclose([result.velocity(b)[-1] for b in "abc"], 2.0, rtol=1e-7)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_doubled_contacts_share_evenly(formulation: str) -> None:
    """Two contacts between the same bodies carry half each, whatever presses them."""
    law = DryFriction(0.5, 0.4)
    scene = Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=3.0),
        Contact("one", "a", "b", law, normal=10.0),
        Contact("two", "b", "a", law, normal=20.0),
        Force("a", 8.0),
    )
    result = simulate(scene, (0.0, 1.0), formulation=formulation)
    assert not result.events
    # lambda = F m_b / (m_a + m_b) = 6
    np.testing.assert_allclose(result.force("one"), 3.0, atol=1e-6)
    np.testing.assert_allclose(result.force("two"), -3.0, atol=1e-6)


@pytest.mark.parametrize("unit", [1e-12, 1e11])
def test_contacts_that_share_their_load_take_no_more_steps_in_another_unit(unit: float) -> None:
    """Mass and forces in another unit: three contacts stop a body, and hold it against 1/60 of their levels' sum."""

    def run(k: float) -> Result:
        scene = Scene(
            Body("b", inertia=2.0 * k, velocity=1.0),
            *(Contact(f"c{i}", "b", GROUND, DryFriction(0.5, 0.3), normal=k * (3 + i)) for i in range(3)),
            Force("b", sine(0.1 * k, 0.7)),
        )
        return simulate(scene, (0.0, 4.0), formulation="multiplier")

    one, other = run(1.0), run(unit)
    assert [(e.contact, e.after) for e in other.events] == [(f"c{i}", 0) for i in range(3)]
    np.testing.assert_allclose([e.t for e in other.events], [e.t for e in one.events], rtol=0, atol=1e-6)
    np.testing.assert_allclose(other.force("c0")[-1], unit * one.force("c0")[-1], rtol=1e-6)
    assert other.stats["steps"] < 1.2 * one.stats["steps"]


@pytest.mark.parametrize("radius", [1.0, 3e4])
def test_a_wheel_that_rests_on_another_through_a_long_lever(radius: float) -> None:
    """Two brakes hold the drum. At the wheel's own radius of 1 m its 0.3 N m are below the level of 1 N m."""
    law = DryFriction(0.5, 0.4)
    scene = Scene(
        Body("wheel", inertia=1.0),
        Body("drum", inertia=10.0),
        Contact("rim", "wheel", "drum", law, normal=2.0, radius_b=radius),
        Contact("one", "drum", GROUND, law, normal=2e5),
        Contact("two", "drum", GROUND, law, normal=1e5),
        Force("wheel", 0.3),
    )
    result = simulate(scene, (0.0, 1.0), formulation="multiplier")
    assert not result.events and result.force("rim")[-1] == pytest.approx(0.3, rel=1e-6)


def test_forces_of_random_redundant_groups_have_least_norm() -> None:
    """Against the pseudo-inverse of the rows' matrix G, transposed: ``lambda = (G^T)^+ (F - M a)``."""
    rng = np.random.default_rng(7)
    for _ in range(10):
        n = int(rng.integers(3, 6))
        inertia, push = rng.uniform(0.5, 3.0, n), rng.normal(size=n)
        ends = [(i, i + 1) for i in range(n - 1)] + [tuple(rng.choice(n, 2, replace=False)) for _ in range(3)]
        grounded = rng.random() < 0.5
        contacts = [
            Contact(f"c{k}", f"b{i}", f"b{j}", DryFriction(5.0, 4.0), normal=10.0) for k, (i, j) in enumerate(ends)
        ]
        G = np.zeros((len(ends), n))
        for k, (i, j) in enumerate(ends):
            G[k, i], G[k, j] = 1.0, -1.0
        if grounded:
            for i in (0, n - 1):
                contacts.append(Contact(f"g{i}", f"b{i}", GROUND, DryFriction(5.0, 4.0), normal=10.0))
                G = np.vstack([G, np.eye(n)[i]])
        bodies = [Body(f"b{i}", inertia=m) for i, m in enumerate(inertia)]
        scene = Scene(*bodies, *contacts, *(Force(f"b{i}", f) for i, f in enumerate(push)))
        acceleration = 0.0 if grounded else push.sum() / inertia.sum()
        expected = np.linalg.pinv(G.T) @ (push - inertia * acceleration)
        for formulation in FORMULATIONS:
            result = simulate(scene, (0.0, 0.5), formulation=formulation)
            found = [result.force(c.name)[-1] for c in contacts]
            np.testing.assert_allclose(found, expected, atol=1e-6, err_msg=formulation)


# Laws that act through velocity, and large scenes


@pytest.mark.slow
def test_soft_laws_in_every_formulation() -> None:
    curve = DryFriction(0.5, 0.3, stribeck_velocity=0.2)
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Body("b", inertia=2.0),
        Drive("d", velocity=sine(0.3, 0.5)),
        Contact("hard", "a", "b", curve, normal=4.0),
        Contact("soft", "b", GROUND, PreSlip(DryFriction(0.2, 0.1), 0.01), normal=5.0),
        Contact("bristly", "a", "d", LuGre(curve, 200.0, 2.0, 0.1), normal=2.0),
        Spring("a", GROUND, stiffness=3.0),
        Damper("b", GROUND, damping=0.1),
    )
    base = simulate(scene, (0.0, 3.0), **TIGHT)
    assert len(base.events) >= 4
    for formulation in FORMULATIONS[1:]:
        other = simulate(scene, (0.0, 3.0), formulation=formulation, **TIGHT)
        assert told(other) == told(base)
        np.testing.assert_allclose([e.t for e in other.events], [e.t for e in base.events], rtol=0, atol=3e-6)
        np.testing.assert_allclose(other.y[:, -1], base.y[:, -1], rtol=0, atol=1e-6)


@pytest.mark.slow
def test_sparse_multipliers() -> None:
    """A chain of 60 sprung blocks, large enough to be assembled sparse."""
    law = DryFriction(0.4, 0.3)
    n = 60
    scene = Scene(
        *(Body(f"b{i}", inertia=1.0) for i in range(n)),
        *(Contact(f"c{i}", f"b{i}", GROUND, law, normal=1.0 + 0.01 * i) for i in range(n)),
        *(Spring(f"b{i}", f"b{i + 1}", stiffness=50.0) for i in range(n - 1)),
        Force("b0", piecewise_linear([0.0, 2.0], [0.0, 2.0])),
    )
    base = simulate(scene, (0.0, 1.2), **TIGHT)
    other = simulate(scene, (0.0, 1.2), formulation="multiplier", **TIGHT)
    assert told(other) == told(base) and base.events
    np.testing.assert_allclose([e.t for e in other.events], [e.t for e in base.events], rtol=0, atol=1e-6)
    np.testing.assert_allclose(other.y[:, -1], base.y[:, -1], rtol=0, atol=1e-6)


@pytest.mark.parametrize("bodies", [2, 4])
def test_a_contact_that_is_being_closed_carries_no_more_than_roundoff(bodies: int) -> None:
    """The lid is pressed from 0 on, while others carry all the load: IDA must not be asked for less than roundoff."""
    law = DryFriction(0.6, 0.4)
    scene = Scene(
        *(Body(f"b{i}", inertia=0.7 + 0.31 * i) for i in range(bodies)),
        Body("mass", inertia=1.0, velocity=0.3),
        Contact("floor", "b0", GROUND, law, normal=10.0),
        Contact("beside", "b0", GROUND, law, normal=7.0),
        *(Contact(f"c{i}", f"b{i}", "b0", law, normal=10.0) for i in range(2, bodies)),
        Contact("lid", "b1", "b0", law, normal=sine(1.0, 1.0, phase=3.5, offset=0.5)),
        Spring("mass", "b0", stiffness=20.0),
    )
    base = simulate(scene, (0.0, 1.0), method="BDF", **TIGHT)
    other = simulate(scene, (0.0, 1.0), formulation="multiplier", **TIGHT)
    assert told(other) == told(base)
    np.testing.assert_allclose(other.y[:, -1], base.y[:, -1], rtol=0, atol=1e-7)
    assert other.stats["steps"] < 3 * base.stats["steps"]


@st.composite
def scenes(draw: Any) -> Scene:
    """Chains with springs, loads and up to two more contacts, which may double others or close loops."""
    n = draw(st.integers(2, 4))
    number = st.integers(1, 30).map(lambda k: k / 10)
    bodies = [
        Body(f"b{i}", inertia=draw(number), velocity=draw(st.sampled_from([0.0, 0.0, 1.0, -0.7]))) for i in range(n)
    ]
    ends = [(f"b{i}", f"b{i + 1}") for i in range(n - 1)] + [("b0", GROUND)]
    ends += draw(st.lists(st.sampled_from([("b0", "b1"), ("b1", GROUND), (f"b{n - 1}", "b0")]), max_size=2))
    contacts = []
    for k, (a, b) in enumerate(ends):
        coulomb = draw(st.sampled_from([0.11, 0.23, 0.37]))
        law = DryFriction(
            coulomb * draw(st.sampled_from([1.0, 1.3, 1.9])), coulomb, dwell=draw(st.sampled_from([0, 0.2]))
        )
        levels = [draw(number) * 3.1 for _ in range(3)]
        contacts.append(Contact(f"c{k}", a, b, law, normal=piecewise_linear([0.0, 1.0, 2.0], levels)))
    others: list[Any] = [Force(f"b{i}", sine(draw(number) * 1.7, 0.3 + 0.21 * i, phase=float(i))) for i in range(n)]
    if draw(st.booleans()):
        others.append(Spring("b0", "b1", stiffness=draw(number) * 5, damping=0.13))
    return Scene(*bodies, *contacts, *others)


@pytest.mark.slow
@settings(max_examples=12, deadline=None, derandomize=True, database=None)
@given(scenes())
def test_any_scene_is_the_same_in_all_three(scene: Scene) -> None:
    base = simulate(scene, (0.0, 2.0), **TIGHT)
    for formulation in FORMULATIONS[1:]:
        other = simulate(scene, (0.0, 2.0), formulation=formulation, **TIGHT)
        assert sorted(told(other)) == sorted(told(base))
        np.testing.assert_allclose([e.t for e in other.events], [e.t for e in base.events], rtol=0, atol=2e-6)
        np.testing.assert_allclose(other.y[:, -1], base.y[:, -1], rtol=0, atol=1e-6)


def test_a_position_that_comes_back_to_0_from_far_away() -> None:
    # where the hand's position is near 0, its tolerance is below roundoff of the positions before: IDA gave up there
    scene = Scene(
        Body("m", inertia=1e-6),
        Drive("hand", velocity=sine(0.01, 0.2)),
        Spring("m", "hand", stiffness=1e6, damping=1e2),
        Contact("floor", "m", GROUND, DryFriction(0.5, 0.4), normal=10.0),
    )
    options: dict[str, Any] = {"rtol": 1e-9, "atol": 1e-11}
    one, other = (simulate(scene, (0.0, 6.0), formulation=f, **options) for f in ("multiplier", "merged"))
    assert told(one) == told(other) and len(one.events) == 5
    assert [e.t for e in one.events] == pytest.approx([e.t for e in other.events], abs=1e-6)
