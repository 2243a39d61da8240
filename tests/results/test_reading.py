"""Reading results costs little beside the simulation, for every quantity and every name.

Work is counted, not timed: calls of functions, which is the same on every machine.
"""

import pickle
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest

import stickslip
from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Result,
    Scene,
    Spring,
    join,
    plots,
    simulate,
    sine,
)
from stickslip.benchmark import flywheel_chain
from stickslip.results.pieces import Piece

PACKAGE = str(Path(stickslip.__file__).parent)


def blocks(count: int) -> Scene:
    """Blocks on rough ground, pulled by a plate through springs, and tied to their neighbours."""
    names = [f"b{i}" for i in range(count)]
    levels = 1.0 + 0.2 * np.sin(7.3 * np.arange(count))
    return Scene(
        Drive("plate", velocity=0.05, position=0.75),
        *(Body(name, inertia=1.0) for name in names),
        *(
            Contact(f"c{name}", name, GROUND, DryFriction(1.0, 0.8), normal=level)
            for name, level in zip(names, levels.tolist(), strict=True)
        ),
        *(Spring(name, "plate", stiffness=1.0, damping=0.3) for name in names),
        *(Spring(a, b, stiffness=3.0) for a, b in pairwise(names)),
    )


def read_everything(result: Result) -> int:
    """Read every quantity of every name; return how many arrays that is."""
    scene, count = result.scene, 0
    for element in (*scene.bodies, *scene.drives):
        for read in (result.velocity, result.position):
            assert read(element.name).shape == result.t.shape
            count += 1
    for contact in scene.contacts:
        readings: tuple[Callable[[str], Any], ...] = (
            result.mode,
            result.force,
            result.breakaway,
            result.power,
            result.normal,
            result.relative_velocity,
        )
        for quantity in readings:
            assert quantity(contact.name).shape == result.t.shape
            count += 1
    return count


def calls(run: Callable[[], Any], own: bool = False) -> tuple[Any, int]:
    """Return what a function returns and how many calls it makes; only those within the package if `own`."""
    counted = 0

    def count(frame: FrameType, event: str, argument: object) -> None:
        nonlocal counted
        if event == "call" and (not own or frame.f_code.co_filename.startswith(PACKAGE)):
            counted += 1

    before = sys.getprofile()
    sys.setprofile(count)
    try:
        found = run()
    finally:
        sys.setprofile(before)
    return found, counted


@pytest.mark.parametrize("count", [4, 12, 120])
def test_reading_everything_is_a_fraction_of_the_work_of_simulating(count: int) -> None:
    # 120 blocks are assembled as sparse matrices, the others as dense ones
    scene = blocks(count)
    result, simulated = calls(lambda: simulate(scene, (0.0, 15.0)))
    assert len(result.events) >= 4
    _, read = calls(lambda: read_everything(result))
    # calls of functions: those of reading stay few for each piece, however many names there are
    assert read < 0.25 * simulated, (read, simulated)
    assert read < 60 * len(result.trajectory.pieces) * (1 + count / 10) + 2000


def test_another_name_costs_the_same_however_many_events_there_are() -> None:
    costs = []
    # the first run computes everything that a process computes once
    for stop in (5.0, 10.0, 40.0):
        result = simulate(blocks(6), (0.0, stop))
        result.force("cb0")
        costs.append(calls(lambda result=result: read_everything(result))[1])
    assert costs[1] == costs[2]


def test_positions_that_no_spring_made_states_are_integrated_once_for_all_names() -> None:
    # 30 wheels without springs: one wheel costs nearly as much as all of them
    result = simulate(flywheel_chain(30), (0.0, 1.0))
    _, one = calls(lambda: result.position("w1"))
    _, others = calls(lambda: [result.position(f"w{i}") for i in range(2, 31)])
    assert others < 50 * 29, (one, others)
    # where a wheel moves evenly its path is exact: x' = v
    for name in ("w1", "w30"):
        x, v, t = result.position(name), result.velocity(name), result.t
        steps = np.diff(t) * 0.5 * (v[1:] + v[:-1])
        even = np.abs(np.diff(v)) < 1e-12
        np.testing.assert_allclose(np.diff(x)[even], steps[even], rtol=0, atol=1e-13)


def test_positions_in_a_scene_with_and_without_springs() -> None:
    # a is thrown up a slope of deceleration 0.5 m/s2: x = t - t^2/4; b swings on its spring: x = 0.1 cos(2 t)
    scene = Scene(
        Body("a", inertia=2.0, velocity=1.0),
        Force("a", -1.0),
        Body("b", inertia=1.0, position=0.1),
        Spring("b", GROUND, stiffness=4.0),
        Drive("d", velocity=sine(0.5, 1.0), position=3.0),
        Contact("ad", "a", "d", DryFriction(0.2, 0.1), normal=0.0),
        Contact("bd", "b", "d", DryFriction(0.2, 0.1), normal=0.0),
    )
    result = simulate(scene, (0.0, 2.0), rtol=1e-11, atol=1e-13, t_eval=np.linspace(0.0, 2.0, 41))
    t = result.t
    np.testing.assert_allclose(result.position("a"), t - t**2 / 4, rtol=0, atol=1e-9)
    np.testing.assert_allclose(result.position("b"), 0.1 * np.cos(2 * t), rtol=0, atol=1e-8)
    # the integral of 0.5 sin(2 pi t)
    path = 3.0 + 0.25 / np.pi * (1 - np.cos(2 * np.pi * t))
    np.testing.assert_allclose(result.position("d"), path, rtol=0, atol=1e-8)


@pytest.mark.slow
def test_drawing_many_blocks_asks_for_each_segment_only_a_few_times() -> None:
    few, many = (simulate(blocks(count), (0.0, 15.0)) for count in (14, 28))
    work = [calls(result.plot, own=True)[1] / len(result.scene.bodies) for result in (few, many)]
    # twice as many blocks have about twice as many events: the work for each block grows no faster than the events
    growth = len(many.events) / len(few.events)
    assert work[1] < 1.5 * growth * work[0], (work, growth)


def test_energies_of_large_scenes_are_summed_without_putting_segments_together(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    result = simulate(blocks(20), (0.0, 30.0))
    assert len(result.events) > 20
    put_together: list[int] = []
    whole = Piece.of.__func__  # type: ignore[attr-defined]
    monkeypatch.setattr(Piece, "of", classmethod(lambda cls, *a: put_together.append(1) or whole(cls, *a)))
    assert result.energy().relative_error < 1e-12
    assert not put_together
    # integrated once, for plots and reports, too; so no one may write to it
    assert result.energy() is result.energy()
    with pytest.raises(ValueError, match="read-only"):
        result.energy().kinetic[0] = 1.0


def test_strips_of_modes_are_drawn_mode_by_mode_not_bar_by_bar() -> None:
    # an eccentric load that turns over again and again
    load = Force("a", sine(5.0, 1.0))
    scene = Scene(Body("a", inertia=1.0), Contact("c", "a", GROUND, DryFriction(0.2, 0.1), normal=10.0), load)
    result = simulate(scene, (0.0, 10.0))
    assert len(result.events) > 10
    drawn = plots.modes(result).collections
    assert len(drawn) == 3
    assert sum(len(alike.get_paths()) for alike in drawn) == len(result.events) + 1


def test_explaining_reads_each_contact_once() -> None:
    # an eccentric load that turns over again and again; the long run has four times as many events
    scene = Scene(
        Body("a", inertia=1.0),
        Contact("c", "a", GROUND, DryFriction(0.2, 0.1), normal=10.0),
        Force("a", sine(5.0, 1.0)),
    )
    short, long = (simulate(scene, (0.0, stop)) for stop in (5.0, 20.0))
    assert len(long.events) > 3 * len(short.events) > 10
    work = [calls(result.explain)[1] / len(result.events) for result in (short, long)]
    assert work[1] < 1.2 * work[0], work


def test_what_was_read_is_not_pickled_again() -> None:
    result = simulate(blocks(4), (0.0, 15.0))
    before = len(pickle.dumps(result))
    read_everything(result)
    again = pickle.loads(pickle.dumps(result))
    assert len(pickle.dumps(result)) == before
    np.testing.assert_array_equal(again.force("cb1"), result.force("cb1"))


def test_nor_what_was_read_of_runs_in_a_row() -> None:
    first = simulate(blocks(2), (0.0, 5.0))
    both = join([first, simulate(first.final_scene(), (5.0, 8.0))])
    before = len(pickle.dumps(both))
    assert both.energy() is both.energy()
    assert len(pickle.dumps(both)) == before
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(both)).energy().kinetic, both.energy().kinetic)


TWO_PARTS = (
    Body("b", inertia=1.0, velocity=1.0),
    Drive("d", velocity=sine(0.5, 1.0)),
    Contact("cb", "b", "d", DryFriction(0.3, 0.2, mu_static_backward=0.25, dwell=0.1), normal=10.0),
)


@pytest.mark.parametrize("others", [(), TWO_PARTS], ids=["one part", "two parts"])
@pytest.mark.parametrize("dense", [True, False])
def test_no_outputs_are_an_empty_result_that_works_everywhere(
    others: tuple[Any, ...], dense: bool, tmp_path: Path
) -> None:
    # events alone may be wanted: the body stops at v / (mu g) = 1 / 2 s
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0),
        Contact("c", "m", GROUND, DryFriction(0.3, 0.2), normal=10.0),
        *others,
    )
    result = simulate(scene, (0.0, 1.0), t_eval=[], dense_output=dense)
    assert result.success and result.t.shape == (0,) and result.y.shape[1] == 0
    assert next(event.t for event in result.events if event.contact == "c") == pytest.approx(0.5, rel=1e-9)
    for body in (*scene.bodies, *scene.drives):
        assert result.velocity(body.name).shape == (0,)
        assert result.position(body.name).shape == (0,)
    for contact in scene.contacts:
        for read in (result.mode, result.force, result.breakaway, result.power, result.normal):
            assert read(contact.name).shape == (0,)
        assert result.breakaway(contact.name, -1).shape == (0,)
        assert result.relative_velocity(contact.name).shape == (0,)
    assert "c BACKWARD" not in result.explain() and "c FORWARD -> STUCK" in result.explain()
    if dense:
        assert result.energy().t.shape == (0,)
        assert result(0.25)[0] == pytest.approx(0.5, rel=1e-9)
    result.plot()
    result.to_csv(tmp_path / "table.csv")
    assert (tmp_path / "table.csv").read_text().count("\n") == 1
    result.save(tmp_path / "kept.npz")
    again = stickslip.load(tmp_path / "kept.npz")
    assert again.events == result.events and again.force("c").shape == (0,)
    assert str(result)
