"""Results read at any time: positions, forces, levels, the times of plots, and which engine computed them."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

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
    Gap,
    LuGre,
    OneWay,
    PreSlip,
    Result,
    Scene,
    SimulationError,
    Spring,
    Tie,
    explain,
    load,
    piecewise_linear,
    position,
    signal,
    simulate,
    sine,
    triangle,
)
from stickslip.benchmark import flywheel_benchmark
from stickslip.results.pieces import Pieces
from stickslip.results.samples import Samples


def belt() -> Scene:
    """Three blocks on a belt that swings, bound by springs, one pressed by triangles."""
    law = DryFriction(0.4, 0.25, dwell=0.05)
    return Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=2.0, velocity=0.3),
        Body("c", inertia=0.5),
        Drive("belt", velocity=0.5 * sine(1.0, 0.4) + 0.1),
        Spring("a", "b", stiffness=30.0, damping=0.2),
        Spring("b", GROUND, stiffness=10.0, rest=0.1),
        Contact("ca", "a", "belt", law, normal=5.0),
        Contact("cb", "b", "belt", DryFriction(0.3, 0.2, mu_static_backward=0.5), normal=8.0),
        Contact("cc", "c", "belt", law, normal=triangle(0.5, 1.0, 1.5, slope=20.0) + 3.0),
        Force("c", piecewise_linear([0.0, 2.0, 4.0], [0.0, 3.0, -2.0])),
    )


def stribeck() -> Scene:
    """A scene whose friction depends on velocity, beside one that sticks for good and a pre-slip contact."""
    return Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=1.0, velocity=0.2),
        Drive("belt", velocity=0.3),
        Spring("a", GROUND, stiffness=20.0),
        Contact("curve", "a", "belt", DryFriction(0.5, 0.2, stribeck_velocity=0.1), normal=5.0),
        Contact("tie", "b", GROUND, DryFriction(0.5, 0.4, dwell=0.1), normal=1.0),
        Contact("banded", "a", "b", PreSlip(DryFriction(0.3, 0.2), velocity=1e-3), normal=1.0),
    )


SCENES = {"belt": belt, "stribeck": stribeck, "benchmark": flywheel_benchmark}


@pytest.fixture(scope="module", params=SCENES)
def result(request: pytest.FixtureRequest) -> Result:
    return simulate(SCENES[request.param](), (0.0, 4.0), rtol=1e-9)


# Positions are integrals


@pytest.mark.parametrize("method", ["series", "BDF", "RK4"])
def test_positions_without_springs_are_integrals_of_the_velocities(method: str) -> None:
    """x = t - t^2 / 2 until the block rests at 1 s; the drive has moved by (1 - cos(6 pi t)) / (6 pi)."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0, position=2.0),
        Body("held", inertia=1.0, position=1.0),
        Drive("shaker", velocity=sine(1.0, 3.0), position=-1.0),
        Contact("floor", "a", GROUND, DryFriction(0.1, 0.1), normal=10.0),
        Contact("grip", "held", "shaker", DryFriction(9.0, 9.0), normal=100.0),
    )
    options: dict[str, Any] = {"step": 1e-3} if method == "RK4" else {}
    t = np.array([0.0, 0.1, 0.37, 0.8, 1.0, 1.7, 2.0])
    result = simulate(scene, (0.0, 2.0), method=method, t_eval=t, **options)
    rests = np.minimum(t, 1.0)
    tolerance = {"series": 1e-14, "BDF": 1e-7, "RK4": 2e-3}[method]
    np.testing.assert_allclose(result.position("a"), 2.0 + rests - rests**2 / 2, rtol=0, atol=tolerance)
    swing = (1 - np.cos(6 * math.pi * t)) / (6 * math.pi)
    np.testing.assert_allclose(result.position("shaker"), -1.0 + swing, rtol=0, atol=1e-13)
    np.testing.assert_allclose(result.position("held"), 1.0 + swing, rtol=0, atol=max(tolerance, 1e-13))


def test_positions_that_were_not_kept_are_refused() -> None:
    t = np.linspace(0, 1, 5)
    result = simulate(flywheel_benchmark(), (0.0, 1.0), t_eval=t, dense_output=False)
    with pytest.raises(ValueError, match=r"position of 'wheel1' was not kept.*dense_output=True"):
        result.position("wheel1")
    with pytest.raises(ValueError, match=r"position of 'wheel1' was not kept.*dense_output=True"):
        result.stretch("interface")
    kept = simulate(flywheel_benchmark(), (0.0, 1.0), t_eval=t)
    for name in ("interface", "brake"):
        np.testing.assert_array_equal(result.force(name), kept.force(name))
        np.testing.assert_array_equal(result.breakaway(name), kept.breakaway(name))


# Quantities of rows


def test_held_bodies_move_as_their_drive_to_the_bit() -> None:
    scene = Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=3.0),
        Drive("d", velocity=sine(0.7, 1.3, phase=0.2) + 0.3),
        Contact("one", "a", "d", DryFriction(9.0, 9.0), normal=100.0),
        Contact("two", "b", "a", DryFriction(9.0, 9.0), normal=100.0),
    )
    result = simulate(scene, (0.0, 3.0))
    for at in (result, result.sample(777), simulate(scene, (0.0, 3.0), t_eval=np.linspace(0, 3, 91))):
        after = at.t > 0.5
        assert np.all(at.mode("one")[after] == 0) and np.all(at.mode("two")[after] == 0)
        np.testing.assert_array_equal(at.velocity("a")[after], at.velocity("d")[after])
        np.testing.assert_array_equal(at.velocity("b")[after], at.velocity("d")[after])
        assert np.all(at.relative_velocity("two")[after] == 0)


def test_forces_that_depend_on_velocity_are_read_beside_others() -> None:
    curved = DryFriction(0.5, 0.2, stribeck_velocity=2.0, stribeck_exponent=1.0)
    scene = Scene(
        *(Body(name, inertia=1.0, velocity=3.0) for name in ("one", "other")),
        Contact("curved", "one", GROUND, curved, normal=2.0),
        Contact("plain", "other", GROUND, DryFriction(0.5, 0.2), normal=2.0),
    )
    result = simulate(scene, (0.0, 3.0), t_eval=np.linspace(0.0, 3.0, 31))
    w = result.velocity("one")
    assert np.all(w > 0)
    np.testing.assert_allclose(result.force("curved"), 0.4 + 0.6 * np.exp(-w / 2.0), rtol=1e-12)
    np.testing.assert_array_equal(result.force("plain"), 0.4)


def test_what_is_never_let_go_has_no_level() -> None:
    scene = Scene(
        *(Body(name, inertia=1.0, velocity=-0.5) for name in "ab"),
        Tie("tie", {"a": 1.0, "b": -1.0}),
        Gap("gap", "a", GROUND, lower=-1.0, upper=1.0, stiffness=10.0),
        OneWay("clutch", "b", GROUND),
        Contact("c", "b", GROUND, DryFriction(0.2, 0.1), normal=2.0),
    )
    at = simulate(scene, (0.0, 1.0)).sample(3)
    assert {name: at.breakaway(name)[0] for name in ("tie", "gap", "clutch", "c")} == {
        "tie": math.inf,
        "gap": math.inf,
        "clutch": 0.0,
        "c": 0.4,
    }


def test_forces_obey_newtons_law_and_stay_within_their_levels(result: Result) -> None:
    """A difference of the velocities over 1 us shows the sum of the forces."""
    scene, d = result.scene, 1e-6
    events = np.array([e.t for e in result.events])
    t = np.linspace(0.01, 3.99, 400)
    breaks = np.concatenate([events, [0.05, 0.1, 0.15, 0.4, 0.5, 0.6, 1.0, 1.5, 2.0]])
    t = t[np.abs(t[:, None] - breaks).min(axis=1) > 1e-4]
    at, before, after = result.sample(t), result.sample(t - d), result.sample(t + d)
    for body in scene.bodies:
        total = np.zeros_like(t)
        for c in scene.contacts:
            total -= at.force(c.name) * ((c.a == body.name) - float(c.b == body.name))
        for s in scene.springs:
            stretch = at.position(s.a) - at.position(s.b) - s.rest
            rate = at.velocity(s.a) - at.velocity(s.b)
            pull = s.stiffness * stretch + s.damping * rate
            total -= pull * ((s.a == body.name) - float(s.b == body.name))
        for f in scene.forces:
            if f.body == body.name:
                total += np.array([f.signal(x) for x in t])
        rate = (after.velocity(body.name) - before.velocity(body.name)) / (2 * d)
        np.testing.assert_allclose(body.inertia * rate, total, rtol=0, atol=2e-4)
    for c in scene.contacts:
        stuck = at.mode(c.name) == 0
        assert np.all(np.abs(at.force(c.name)[stuck]) <= at.breakaway(c.name)[stuck] * (1 + 1e-9))


def test_a_quantity_is_computed_once_for_all_names(result: Result) -> None:
    """A name is a line of the table of all names, which is read-only; quantities are computed only when asked for."""
    at = result.sample(503)
    names = [c.name for c in result.scene.contacts]
    at.mode(names[0])
    assert "forces" not in at.samples.__dict__ and "levels" not in at.samples.__dict__
    for read in (Result.force, Result.normal, Result.mode, Result.breakaway, Result.power):
        assert len({id(read(at, name).base) for name in names}) == 1
        with pytest.raises(ValueError, match="read-only"):
            read(at, names[0])[0] = 0
    for body in result.scene.bodies:
        assert not at.velocity(body.name).flags.writeable and not at.position(body.name).flags.writeable


# Times


def test_straight_lines_between_the_times_look_like_the_motion(result: Result) -> None:
    """Lines are off by 1e-3 of each range at most; at an event its two limits are given."""
    t = result.t
    assert t[0] == 0.0 and t[-1] == 4.0 and np.all(np.diff(t) >= 0)
    for event in result.events:
        assert np.count_nonzero(t == event.t) >= 2
    fine = result.sample(20_001)
    moving = [*(b.name for b in result.scene.bodies), *(d.name for d in result.scene.drives)]
    for read in (Result.velocity, Result.position):
        for name in moving:
            exact, coarse = read(fine, name), read(result, name)
            apart = np.abs(np.interp(fine.t, t, coarse) - exact)
            assert apart.max() <= 1.1e-3 * np.ptp(exact) + 1e-12, (read.__name__, name)


def test_times_fit_for_a_plot_are_few() -> None:
    """A sine of 10 turns: straight lines to 1e-3 of its range need 2 pi / sqrt(16e-3) = 50 points a turn."""
    scene = Scene(Body("a", inertia=1.0, velocity=1.0), Spring("a", GROUND, stiffness=4 * math.pi**2))
    result = simulate(scene, (0.0, 10.0))
    assert 400 < result.t.size < 1500
    fine = np.linspace(0, 10, 9999)
    apart = np.interp(fine, result.t, result.velocity("a")) - np.cos(2 * math.pi * fine)
    assert np.abs(apart).max() < 2e-3
    resting = simulate(Scene(Body("a", inertia=1.0, velocity=3.0)), (0.0, 10.0))
    assert resting.t.tolist() == [0.0, 10.0]


def test_sampling_is_what_t_eval_gives(result: Result) -> None:
    """Samples are right limits at events, and the left limit at the end."""
    t = np.unique(np.concatenate([np.linspace(0, 4, 57), [e.t for e in result.events]]))
    asked = simulate(result.scene, (0.0, 4.0), rtol=1e-9, t_eval=t)
    at = result.sample(t)
    np.testing.assert_array_equal(at.t, asked.t)
    np.testing.assert_array_equal(at.y, asked.y)
    for event in result.events:
        i = int(np.searchsorted(t, event.t))
        changes = [e for e in result.events if e.t == event.t and e.contact == event.contact]
        assert at.mode(event.contact)[i] == changes[-1].after
    assert at.events == result.events and at.stats == result.stats
    np.testing.assert_array_equal(result.sample(5).t, np.linspace(0, 4, 5))
    np.testing.assert_array_equal(result.sample(5).y, result(np.linspace(0, 4, 5)))


@pytest.mark.parametrize(
    ("times", "kind", "words"),
    [
        (1, ValueError, "a whole number from 2 on"),
        ([0.0, 5.0], ValueError, "times must lie in"),
        ([0.0, math.nan], ValueError, "times must lie in"),
        ("soon", TypeError, "times or their number"),
        ([[0.0, 1.0]], ValueError, "in one line"),
    ],
)
def test_bad_times_are_refused(times: Any, kind: type[Exception], words: str) -> None:
    result = simulate(flywheel_benchmark(), (0.0, 1.0))
    with pytest.raises(kind, match=words):
        result.sample(times)


def test_fixed_steps_show_their_steps() -> None:
    result = simulate(flywheel_benchmark(), (0.0, 0.5), method="RK4", step=0.1)
    np.testing.assert_allclose(np.unique(result.t), [0.0, 0.1, 0.2, 0.3, 0.4, 0.5])


# Whole results


def test_results_survive_pickling_and_files(result: Result, tmp_path: Path) -> None:
    result.save(tmp_path / "r.npz")
    t = np.linspace(0, 4, 97)
    for other in (pickle.loads(pickle.dumps(result)), load(tmp_path / "r.npz")):
        np.testing.assert_array_equal(other.t, result.t)
        np.testing.assert_array_equal(other.y, result.y)
        np.testing.assert_array_equal(other(t), result(t))
        for c in result.scene.contacts:
            np.testing.assert_array_equal(other.force(c.name), result.force(c.name))
            np.testing.assert_array_equal(other.mode(c.name), result.mode(c.name))
        assert other.events == result.events and str(other) == str(result)


def test_the_energy_balances_to_roundoff_where_the_engine_is_exact() -> None:
    for scene in (belt(), flywheel_benchmark()):
        result = simulate(scene, (0.0, 4.0))
        assert result.stats["engine"] == "Taylor series"
        assert result.energy().relative_error < 1e-13
    assert simulate(stribeck(), (0.0, 4.0), rtol=1e-10).energy().relative_error < 1e-7


# Which engine


def test_the_engine_follows_from_the_scene_and_is_told() -> None:
    series = simulate(belt(), (0.0, 1.0))
    assert series.stats["engine"] == "Taylor series" and "Taylor series" in series.explain()
    assert "Engine: Taylor series, because" in explain(belt())
    curved = simulate(stribeck(), (0.0, 1.0))
    assert curved.stats["engine"] == "CVODE BDF"
    assert "Engine: CVODE BDF, because the force of 'banded' depends on velocity" in explain(stribeck())
    assert simulate(belt(), (0.0, 0.1), formulation="multiplier").stats["engine"] == "IDA BDF"
    assert simulate(belt(), (0.0, 0.1), method="Adams").stats["engine"] == "CVODE Adams"
    merged = simulate(belt(), (0.0, 0.1), formulation="merged")
    assert merged.stats["engine"] == "Taylor series"


def test_stiff_scenes_are_left_to_an_implicit_method() -> None:
    scene = Scene(Body("a", inertia=1e-4, velocity=1.0), Damper("a", GROUND, damping=1.0))
    assert "decay in 0.0001 s: the scene is stiff" in explain(scene, (0.0, 10.0))
    assert simulate(scene, (0.0, 10.0)).stats["engine"] == "CVODE BDF"
    assert simulate(scene, (0.0, 0.1)).stats["engine"] == "Taylor series"


def test_a_light_body_that_its_damper_keeps_from_oscillating_is_stiff() -> None:
    # s^2 + 1e8 s + 1e12 = 0: it decays with 1e8 /s and 1e4 /s, although spring and mass alone would turn with 1e6 /s
    light = Body("light", inertia=1e-6), Spring("light", "hand", stiffness=1e6, damping=1e2)
    rub = Contact("rub", "light", GROUND, DryFriction(0.5, 0.4), normal=10.0)
    scene = Scene(*light, Drive("hand", velocity=0.01), rub)
    result = simulate(scene, (0.0, 20.0))
    assert result.stats["engine"] == "CVODE BDF"
    (slip,) = result.events
    assert abs(slip.t - (0.5 * 10.0 - 0.01 * 1e2) / (0.01 * 1e6)) < 1e-9
    assert abs(result.velocity("light")[-1] - 0.01) < 1e-9
    # two bodies joined by a damper oscillate together, however strong it is: series are the better way
    pair = [Body(name, inertia=1.0, position=0.1) for name in "ab"]
    springs = [Spring(name, GROUND, stiffness=1e4) for name in "ab"]
    joined = Scene(*pair, *springs, Damper("a", "b", damping=1e3), Force("a", 1.0))
    assert "Taylor series" in explain(joined, (0.0, 100.0))


_LIGHT = Body("light", inertia=1e-6), Spring("light", GROUND, stiffness=1.0), Body("heavy", inertia=0.01)


@pytest.mark.parametrize(
    "others",
    [
        (Damper("heavy", "light", damping=0.05), Gap("gap", "heavy", GROUND, upper=1.0, stiffness=1.0)),
        (Damper("heavy", "light", damping=0.05), Gap("gap", "heavy", "light", upper=1.0, stiffness=1.0, damping=0.1)),
        (
            Damper("heavy", "light", damping=0.05),
            Contact("rub", "heavy", GROUND, DryFriction(0.3, 0.2), normal=1.0 + 0.1 * position("heavy")),
        ),
    ],
)
def test_a_stiff_scene_is_stiff_beside_gaps_and_normal_forces_that_follow_a_motion(others: tuple[Any, ...]) -> None:
    assert "the scene is stiff" in explain(Scene(*_LIGHT, *others), (0.0, 20.0))


def test_a_gap_makes_a_scene_stiff_only_if_it_is_stiff_while_the_gap_is_open() -> None:
    gap = Gap("gap", "heavy", GROUND, upper=0.001, stiffness=1e4, damping=1e2)
    scene = Scene(Body("heavy", inertia=0.01), Spring("heavy", GROUND, stiffness=1.0), gap)
    assert "Taylor series" in explain(scene, (0.0, 20.0))


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        (Force("a", signal(math.cos)), "a load is a function"),
        (Contact("s", "a", GROUND, DryFriction(0.3, 0.1, stribeck_velocity=0.1), normal=1.0), "'s'.*curve"),
        (Contact("l", "a", GROUND, LuGre(DryFriction(0.3, 0.1), 1e3), normal=1.0), "'l'.*bristles"),
    ],
)
def test_a_series_is_refused_where_there_is_none(extra: Any, words: str) -> None:
    scene = Scene(Body("a", inertia=1.0), extra)
    with pytest.raises(ValueError, match=f"'series' does not apply.*{words}.*use 'auto'"):
        simulate(scene, (0.0, 1.0), method="series")
    assert simulate(scene, (0.0, 0.1)).stats["engine"] == "CVODE BDF"


def test_a_series_does_not_solve_the_multiplier_formulation() -> None:
    with pytest.raises(ValueError, match=r"'series' .* not 'multiplier', which is for IDA"):
        simulate(belt(), (0.0, 1.0), formulation="multiplier", method="series")


def test_what_was_computed_before_an_error_can_be_read() -> None:
    """The load fails between 1.52 s and 1.6 s only: reading its size before the run does not hit these times."""

    def fails(t: float) -> float:
        if 1.52 < t < 1.6:
            raise RuntimeError("sensor lost")
        return math.sin(t)

    scene = Scene(Body("a", inertia=1.0), Force("a", signal(fails, period=6.0)))
    with pytest.raises(SimulationError, match="sensor lost") as caught:
        simulate(scene, (0.0, 3.0), max_step=0.1)
    error = caught.value
    assert 1.0 < error.t <= 1.52 and error.result.t[-1] == error.t and not error.result.success
    np.testing.assert_allclose(error.result.velocity("a"), 1 - np.cos(error.result.t), rtol=0, atol=1e-6)


def test_a_time_just_beyond_the_end_is_shown_with_all_its_digits():
    result = simulate(Scene(Body("m", inertia=1.0, velocity=1.0)), (0.0, 0.3))
    with pytest.raises(ValueError, match=r"must lie in \[0, 0.3\] s, got 0 to 0.30000000000000004"):
        result.sample([0.0, 3 * 0.1])


def test_a_piece_ends_where_the_next_one_begins_whatever_its_steps_add_up_to() -> None:
    result = simulate(Scene(Body("m", inertia=1.0, velocity=1.0)), (0.0, 1.0))
    piece = replace(result.trajectory.pieces[0], stop=float(np.nextafter(1.0, 2.0)))
    samples = Samples.at_local(
        replace(result.trajectory, pieces=Pieces((piece,))), np.array([0, 0]), np.array([0.5, piece.end])
    )
    assert samples.t.tolist() == [0.5, piece.stop]
