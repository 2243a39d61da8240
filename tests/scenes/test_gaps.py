"""Gaps against closed forms, in every formulation and engine."""

from __future__ import annotations

import math
import pickle
from pathlib import Path
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
    Gap,
    Gear,
    Mode,
    Result,
    Scene,
    Spring,
    explain,
    load,
    normal,
    piecewise_linear,
    simulate,
    sine,
)

ENGINES: dict[str, tuple[dict[str, Any], float]] = {
    "series": ({"method": "series"}, 1e-11),
    "BDF": ({"method": "BDF"}, 2e-6),
    "Adams": ({"method": "Adams"}, 2e-6),
    "merged": ({"formulation": "merged", "method": "BDF"}, 2e-6),
    "multiplier": ({"formulation": "multiplier"}, 2e-6),
    "RK4": ({"method": "RK4", "step": 1e-3}, 5e-3),
}
every_engine = pytest.mark.parametrize(("options", "off"), ENGINES.values(), ids=ENGINES)


def times(result: Result, name: str) -> list[float]:
    return [event.t for event in result.events if event.contact == name]


@every_engine
def test_modelica_translational_elasto_gap(options: dict[str, Any], off: float) -> None:
    """In flight v is constant; in a limit ``x'' = -k d - c d'``, but -2 k d or 0 where the clip at +-k d acts."""
    scene = Scene(
        Body("m", inertia=1, position=2),
        Gap("gap", "m", GROUND, lower=-0.5, upper=0.5, stiffness=10, damping=1.5),
    )
    result = simulate(scene, (0, 5), **options)
    turns = [0.583372882547, 0.875160816924, 1.896201370487, 2.404066200137, 3.425106753700, 4.309059291854]
    np.testing.assert_allclose(times(result, "gap"), turns, rtol=0, atol=off)
    sides = [Mode.FORWARD, Mode.OPEN, Mode.BACKWARD, Mode.OPEN, Mode.FORWARD, Mode.OPEN, Mode.BACKWARD]
    assert [event.before for event in result.events] == sides[:-1]
    assert [event.after for event in result.events] == sides[1:]
    clip = [0.433372882546738, 1.00728398046181, 1.7462013704872]
    clip += [2.53618936367503, 3.27510675370043, 4.44118245539203]
    # located, but no event: the mode stays
    starts = np.array([piece.t for piece in result.trajectory.pieces[1:]])
    np.testing.assert_allclose(starts, sorted(turns + clip), rtol=0, atol=off)
    assert result.position("m")[-1] == pytest.approx(-0.7078852940798114, abs=off)
    assert result.velocity("m")[-1] == pytest.approx(0.5375291877216903, abs=off)
    force, stretch = result.force("gap"), result.stretch("gap")
    assert force[0] == pytest.approx(15, abs=1e-12)
    assert (force * stretch >= -10 * off).all()
    # where the clip takes all force away k d = -c d', and d' stays: d falls to 0 within c / k
    np.testing.assert_allclose(np.array(turns[:5:2]) - np.array(clip)[[0, 2, 4]], 1.5 / 10, atol=1e-11)
    ledger = result.energy()
    assert ledger.relative_error < max(off, 1e-12)
    assert ledger.stored[0] == pytest.approx(0.5 * 10 * 1.5**2)
    heat = ledger.dampers["gap 'gap'"]
    assert np.diff(heat).min() >= -off
    assert heat[-1] > 9


@every_engine
def test_a_ball_between_elastic_limits(options: dict[str, Any], off: float) -> None:
    """Without damping: flights of 1/v, and half a period pi sqrt(m/k) in each limit; the energy stays."""
    scene = Scene(
        Body("ball", inertia=2, velocity=0.5),
        Gap("walls", "ball", GROUND, lower=-0.25, upper=0.25, stiffness=50),
    )
    result = simulate(scene, (0, 4), **options)
    rest = math.pi * math.sqrt(2 / 50)
    expected = [0.5, 0.5 + rest, 1.5 + rest, 1.5 + 2 * rest, 2.5 + 2 * rest]
    np.testing.assert_allclose(times(result, "walls"), expected, rtol=0, atol=4 * off)
    ledger = result.energy()
    assert ledger.stored[-1] == pytest.approx(0.25, abs=off)
    assert not ledger.dampers
    assert result.force("walls").max() == pytest.approx(0.5 * math.sqrt(2 * 50), rel=1e-2)


@every_engine
def test_backlash_between_gears_with_friction(options: dict[str, Any], off: float) -> None:
    """A drive takes up the play at both ends: the teeth part, meet, and push a wheel that dry friction holds.

    The wheel moves when the torque 0.5 k d on it reaches 2 N m.
    """
    scene = Scene(
        Drive("motor", velocity=piecewise_linear([0, 1, 1, 3], [1, 1, -1, -1])),
        Body("wheel", inertia=0.5),
        Body("rack", inertia=0.25),
        Gear("teeth", "wheel", "rack", ratio=2),
        Gap("play", "motor", "wheel", lower=-0.1, upper=0.1, stiffness=100, radius_a=0.5, radius_b=0.5),
        Contact("bearing", "wheel", GROUND, DryFriction(2, 2), normal=1),
    )
    result = simulate(scene, (0, 0.26), **options)
    # stretch 0.5 t: touches at 0.2, its torque 0.5 * 100 (0.5 t - 0.1) reaches 2 at 0.28
    np.testing.assert_allclose(times(result, "play"), [0.2], rtol=0, atol=off)
    later = simulate(scene, (0, 0.3), **options)
    np.testing.assert_allclose(times(later, "bearing"), [0.28], rtol=0, atol=off)
    whole = simulate(scene, (0, 3), **options)
    assert whole.success
    assert whole.energy().relative_error < max(10 * off, 1e-12)
    assert [e.after for e in whole.events if e.contact == "play"][:2] == [Mode.FORWARD, Mode.OPEN]
    assert Mode.BACKWARD in whole.mode("play")


@every_engine
def test_resting_on_a_limit(options: dict[str, Any], off: float) -> None:
    """A weight on an elastic floor with damping comes to rest where k d carries it, without leaving again."""
    scene = Scene(
        Body("weight", inertia=1, position=0.1),
        Force("weight", -9.81),
        Gap("floor", "weight", GROUND, lower=0, stiffness=1e3, damping=40),
    )
    result = simulate(scene, (0, 3), **options)
    assert result.position("weight")[-1] == pytest.approx(-9.81e-3, abs=max(off, 1e-9))
    assert result.force("floor")[-1] == pytest.approx(-9.81, abs=1e3 * off)
    assert result.mode("floor")[-1] == Mode.BACKWARD
    assert result.force("floor").max() <= 1e-12


@pytest.mark.parametrize("method", ["series", "BDF"])
def test_what_only_touches_a_limit_stays_free(method: str) -> None:
    """x = 1 - cos t reaches 2 with velocity 0: the gap there carries no force, and is no event with the series."""
    scene = Scene(
        Body("m", inertia=1),
        Spring("m", GROUND, stiffness=1),
        Force("m", 1.0),
        Gap("gap", "m", GROUND, upper=2.0, stiffness=1e4, damping=1.0),
    )
    result = simulate(scene, (0, 6), method=method)
    if method == "series":
        assert not result.events
    assert result.position("m")[-1] == pytest.approx(1 - math.cos(6), abs=1e-6)
    assert np.abs(result.force("gap")).max() < 1e-4


def test_a_start_beyond_a_limit_and_at_it() -> None:
    """At the limit and pushed in by F: the clip doubles the stiffness at first, so 2 k d = F (1 - cos(sqrt(2 k) t)).

    With both limits at 0 a gap without damping is a spring.
    """
    at = Scene(
        Body("m", inertia=1, position=1.0),
        Force("m", 2.0),
        Gap("gap", "m", GROUND, upper=1.0, stiffness=8.0, damping=3.0),
    )
    result = simulate(at, (0, 0.1))
    assert result.mode("gap")[0] == Mode.FORWARD
    # c d' > k d at first: m d'' = 2 - 16 d
    assert result.position("m")[-1] - 1 == pytest.approx(2 / 16 * (1 - math.cos(0.4)), abs=1e-13)
    zero = Scene(Body("m", inertia=1, velocity=1.0), Gap("g", "m", GROUND, lower=0, upper=0, stiffness=4.0))
    swing = simulate(zero, (0, 5))
    assert swing.position("m")[-1] == pytest.approx(0.5 * math.sin(10.0), abs=1e-13)
    assert times(swing, "g") == pytest.approx([math.pi / 2 * k for k in (1, 2, 3)], abs=1e-12)


def wagons(n: int) -> Scene:
    return Scene(
        *(Body(f"{k}", inertia=1.0, position=1.5 * k, velocity=1.0 if k == 0 else 0.0) for k in range(n)),
        *(Gap(f"buffer {k}", f"{k}", f"{k + 1}", upper=-1.0, stiffness=400.0, damping=0.0) for k in range(n - 1)),
    )


def test_a_row_of_wagons_hands_its_momentum_on() -> None:
    """Equal masses exchange velocities, each within half a period pi sqrt(m / 2 k); dense and sparse matrices.

    While two touch, each moves on at half the speed on average: a touch follows every 0.5 + half / 2 s.
    """
    small, large = (simulate(wagons(n), (0, 3)) for n in (5, 120))
    half = math.pi * math.sqrt(1 / 800)
    touches = [0.5 + k * (0.5 + half / 2) for k in range(5)]
    expected = [t for touch in touches for t in (touch, touch + half)]
    assert [e.t for e in small.events] == pytest.approx(expected[: len(small.events)], abs=1e-10)
    assert len(small.events) == 8
    assert [e.t for e in large.events] == pytest.approx(expected[: len(large.events)], abs=1e-10)
    assert large.trajectory.system.sparse
    assert small.velocity("4")[-1] == pytest.approx(1.0, abs=1e-12)
    for method in ("BDF", "Adams"):
        other = simulate(wagons(100), (0, 1.5), method=method)
        assert [e.t for e in other.events] == pytest.approx(expected[: len(other.events)], abs=1e-5)


def test_gaps_in_files_words_and_pictures(tmp_path: Path) -> None:
    scene = Scene(
        Body("m", inertia=1, position=2),
        Gap("gap", "m", GROUND, lower=-0.5, stiffness=10, damping=1.5, radius_a=0.5),
        Contact("dry", "m", GROUND, DryFriction(0.2, 0.1), normal=sine(1.0, frequency=1.0)),
    )
    assert Scene.from_dict(scene.to_dict()) == scene
    assert scene.to_dict()["gaps"] == [
        {
            "name": "gap",
            "a": "m",
            "b": GROUND,
            "lower": -0.5,
            "stiffness": 10,
            "damping": 1.5,
            "radius_a": 0.5,
        }
    ]
    moved = scene.replace("m", velocity=-3.0)
    result = simulate(moved, (0, 3))
    assert times(result, "gap")
    result.save(tmp_path / "it.npz")
    again = load(tmp_path / "it.npz")
    assert np.array_equal(again.force("gap"), result.force("gap"))
    assert again.events == result.events
    copied = pickle.loads(pickle.dumps(result))
    assert np.array_equal(copied.sample(50).force("gap"), result.sample(50).force("gap"))
    words = explain(moved)
    assert "elastic beyond -0.5, stiffness 10, damping 1.5" in words
    assert "touched its lower limit at relative velocity -1.484" in result.explain()
    result.to_csv(tmp_path / "it.csv")
    result.plot()
    fixed = simulate(moved, (0, 3), dense_output=False, t_eval=[0, 1, 2, 3])
    np.testing.assert_allclose(fixed.force("gap"), result.sample([0, 1, 2, 3]).force("gap"), atol=1e-12)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"stiffness": 1}, "neither lower nor upper"),
        ({"stiffness": 1, "lower": 2, "upper": 1}, "lower must not be above upper, got 2 and 1"),
        ({"stiffness": 0, "upper": 1}, "stiffness must be positive, got 0; use a Stop"),
        ({"stiffness": -1, "upper": 1}, "stiffness must be positive, got -1"),
        ({"stiffness": math.inf, "upper": 1}, "stiffness"),
        ({"stiffness": 1, "upper": math.nan}, "upper"),
        ({"stiffness": 1, "upper": -math.inf}, "upper"),
        ({"stiffness": 1, "lower": "low"}, "lower"),
        ({"stiffness": 1, "upper": 1, "damping": -2}, "damping must not be negative, got -2"),
        ({"stiffness": 1, "upper": 1, "radius_b": 0}, "radius_b must not be 0"),
    ],
)
def test_bad_gaps_are_refused(values: dict[str, Any], said: str) -> None:
    with pytest.raises((ValueError, TypeError), match="gap 'g'") as caught:
        Gap("g", "a", "b", **values)
    assert said in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.0, 30.0, 3000.0])
def test_a_part_that_hops_is_slowed_by_the_impulse_of_the_floor(damping: float) -> None:
    # as long as it slips, m (v_x(t) - v_x(0)) = -mu (impulse of the floor) = -mu m (v_y(t) - v_y(0) + g t), however
    # the floor pushes; at rest on the floor the normal force is m g
    mass, mu, g = 0.5, 0.3, 9.81
    scene = Scene(
        Body("along", inertia=mass, velocity=9.0),
        Body("height", inertia=mass, position=0.02, velocity=0.3),
        Gap("floor", "height", GROUND, lower=0.0, stiffness=4000.0, damping=damping),
        Contact("rub", "along", GROUND, DryFriction(mu, mu), normal=normal("floor")),
        Force("height", -mass * g),
    )
    result = simulate(scene, (0.0, 4.0))
    assert result.stats["engine"] == "Taylor series"
    (rest,) = [event.t for event in result.events if event.contact == "rub" and event.after == 0]
    slips = result.t < rest
    lost = mu * (result.velocity("height") - 0.3 + g * result.t)
    assert np.abs(result.velocity("along") - 9.0 + lost)[slips].max() < 1e-10
    assert np.allclose(result.normal("rub"), np.abs(result.force("floor")), rtol=0, atol=1e-9)
    if damping:
        assert result.normal("rub")[-1] == pytest.approx(mass * g, rel=1e-3)
